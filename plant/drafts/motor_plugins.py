"""Motor plugins of Gazebo in SDF and URDF: which joint or link is a rotor, how it turns, its constants.

Classic (`libgazebo_motor_model.so` of RotorS and PX4) and new (`gz-sim-multicopter-motor-model-system`) share the
elements read here: thrust motorConstant omega^2 [N s^2] along the link's z axis, torque momentConstant thrust [m]
against the turning direction, which is seen from above the link. Source: RotorS, gazebo_motor_model; gz-sim,
MulticopterMotorModel.
"""

from __future__ import annotations

import math
from xml.etree.ElementTree import Element

from wrenchgap.plant.drafts.draft import Said
from wrenchgap.plant.drafts.tree import Motor

TURNS = {"ccw": 1, "cw": -1}


def motors_of(document: Element) -> dict[str, Motor]:
    """Motors by the name of their link, or of their joint where no link is named; in the order of their numbers."""
    found: dict[str, Motor] = {}
    for plugin in document.iter("plugin"):
        turn = (plugin.findtext("turningDirection") or "").strip()
        place = (plugin.findtext("linkName") or plugin.findtext("jointName") or "").strip()
        if turn not in TURNS or not place:
            continue
        number = _number(plugin, "motorNumber")
        if number is None:
            number = _number(plugin, "actuator_number")
        told = f"motor plugin of {place}"
        found[place.rpartition("::")[2]] = Motor(
            spin=Said(TURNS[turn], f"turningDirection {turn} of the {told}"),
            kappa=_said(plugin, "momentConstant", told),
            c_f=_said(plugin, "motorConstant", told),
            speed_max=_said(plugin, "maxRotVelocity", told),
            number=None if number is None else int(number),
        )
    return found


def _number(plugin: Element, name: str) -> float | None:
    try:
        value = float(plugin.findtext(name) or "")
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _said(plugin: Element, name: str, told: str) -> Said | None:
    value = _number(plugin, name)
    return None if value is None or value <= 0.0 else Said(value, f"{name} of the {told}")
