"""The physics: vehicle, actuation, effects, rigid body, sensors, controller, closed-loop simulation."""

from __future__ import annotations

from typing import TYPE_CHECKING

from wrenchgap._lazy import names_of

__getattr__, __all__ = names_of(
    __name__,
    {
        "wrenchgap.plant.effects": (
            "AirEffect",
            "BodyEffect",
            "CommandEffect",
            "Context",
            "Parameter",
            "SensorEffect",
            "ThrustEffect",
            "WrenchEffect",
            "catalogue",
        ),
        "wrenchgap.plant.model": ("Model", "make_effect"),
        "wrenchgap.plant.vehicle": ("Vehicle",),
    },
)

if TYPE_CHECKING:
    from wrenchgap.plant.effects import AirEffect as AirEffect
    from wrenchgap.plant.effects import BodyEffect as BodyEffect
    from wrenchgap.plant.effects import CommandEffect as CommandEffect
    from wrenchgap.plant.effects import Context as Context
    from wrenchgap.plant.effects import Parameter as Parameter
    from wrenchgap.plant.effects import SensorEffect as SensorEffect
    from wrenchgap.plant.effects import ThrustEffect as ThrustEffect
    from wrenchgap.plant.effects import WrenchEffect as WrenchEffect
    from wrenchgap.plant.effects import catalogue as catalogue
    from wrenchgap.plant.model import Model as Model
    from wrenchgap.plant.model import make_effect as make_effect
    from wrenchgap.plant.vehicle import Vehicle as Vehicle
