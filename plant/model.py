"""A model: a vehicle, its controller and sensors, its topics, and a list of effects with values.

A model is never changed in place: `with_effects` returns a new one. `plant.model_file` reads and writes it.
"""

import itertools
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Self

import numpy as np

from wrenchgap.flight.errors import ModelError
from wrenchgap.flight.flight import Array
from wrenchgap.plant.command_curve import CommandCurve
from wrenchgap.plant.controller import ControllerGains
from wrenchgap.plant.effects import find
from wrenchgap.plant.history import Snapshot, Value, Version
from wrenchgap.plant.sensors import SensorNoise
from wrenchgap.plant.vehicle import Tolerances, Vehicle
from wrenchgap.plant.wrench_model import ModelEffect, WrenchModel


@dataclass(frozen=True)
class Model:
    """A vehicle with its effects, controller, sensors and logs.

    Attributes
    ----------
    topics
        Topics by role, for logs of this vehicle.
    text
        Of the model file, so that comments survive a rewrite; empty for a model without a file.
    history
        Versions of the model, oldest first.
    notes
        Remarks on the file, for the user.
    shifts
        What is added to the stamps of a role [s], in logs of this vehicle.
    unmeasured
        Axes that the IMU does not measure (`flight.unmeasured`).
    cutoff_hz
        Cut-off of the low-pass [Hz] behind which logs of this vehicle are analysed, where the usual one is too high.
    between_flights : (6,)
        Standard deviation of the constant wrench between flights [N, Nm] (`learn.identify.bias_and_trim`), where it was
        measured.
    command
        From the rotor commands of logs to speeds, where the commands are not speeds.
    beside
        Files that the model file names and that were read: its bench table.
    """

    vehicle: Vehicle
    effects: tuple[ModelEffect, ...] = ()
    controller: ControllerGains = field(default_factory=ControllerGains)
    sensors: SensorNoise = field(default_factory=SensorNoise)
    topics: Mapping[str, str] = field(default_factory=dict)
    shifts: Mapping[str, float] = field(default_factory=dict)
    path: Path | None = None
    text: str = ""
    history: tuple[Version, ...] = ()
    notes: tuple[str, ...] = ()
    unmeasured: tuple[str, ...] = ()
    cutoff_hz: float | None = None
    between_flights: tuple[float, ...] | None = None
    command: CommandCurve | None = None
    beside: tuple[Path, ...] = ()

    @property
    def name(self) -> str:
        """Name for tables: the file's stem, or the vehicle's name."""
        return self.path.stem if self.path is not None else self.vehicle.name

    @property
    def wrench_model(self) -> WrenchModel:
        """The model ready for evaluation."""
        return WrenchModel(self.vehicle, self.effects)

    @property
    def nominal(self) -> Self:
        """The same vehicle without any effect."""
        return replace(self, effects=())

    @property
    def without_tolerances(self) -> Self:
        """The model without tolerances, for changes of a vehicle since its numbers were measured."""
        return replace(self, vehicle=replace(self.vehicle, tolerances=Tolerances()))

    @property
    def with_known_thrust(self) -> Self:
        """The model without a tolerance of its thrust, which then is an effect's and not granted."""
        return replace(self, vehicle=replace(self.vehicle, tolerances=replace(self.vehicle.tolerances, thrust=None)))

    def effect(self, name: str) -> ModelEffect | None:
        """The effect of this name, None if the model does not have it."""
        return next((e for e in self.effects if e.name == name), None)

    def theta(self, name: str) -> Array:
        """Parameters (P,) of an effect, in the order of `Effect.parameters`; zero where the model lacks it."""
        own = self.effect(name)
        return np.zeros(len(find(name).parameters(self.vehicle))) if own is None else own.theta

    @property
    def snapshot(self) -> tuple[Snapshot, ...]:
        """The effects as plain values."""
        found = []
        for e in self.effects:
            stds = [None] * len(e.theta) if e.std is None else e.std.tolist()
            rows = zip(e.effect.parameters(self.vehicle), e.theta.tolist(), stds, strict=True)
            found.append(Snapshot(e.name, tuple(Value(p.name, value, std, p.unit) for p, value, std in rows)))
        return tuple(found)

    def with_effects(self, effects: Iterable[ModelEffect]) -> Self:
        """A copy with exactly these effects, sorted by name; raises ModelError if one comes twice."""
        listed = sorted(effects, key=lambda e: e.name)
        for first, second in itertools.pairwise(listed):
            if first.name == second.name:
                raise ModelError(f"effect {first.name}: it is in the model twice; remove one")
        return replace(self, effects=tuple(listed))

    def with_replaced(self, effects: Iterable[ModelEffect]) -> Self:
        """A copy with these effects, in place of its own of the same names."""
        new = tuple(effects)
        names = {e.name for e in new}
        return self.with_effects((*(e for e in self.effects if e.name not in names), *new))

    def without(self, names: Iterable[str]) -> Self:
        """A copy without these effects; raises ModelError if the model lacks one."""
        names = tuple(names)
        for name in names:
            if self.effect(name) is None:
                have = ", ".join(e.name for e in self.effects) or "none"
                raise ModelError(f"{self.name}: has no effect {name!r} to remove; its effects: {have}")
        return replace(self, effects=tuple(e for e in self.effects if e.name not in names))


def make_effect(vehicle: Vehicle, name: str, values: Mapping[str, float] | Iterable[float]) -> ModelEffect:
    """An effect of the catalogue with values.

    Parameters
    ----------
    name
        Of the effect.
    values
        By the name of the parameter, where the others keep their start values, or all in order.

    Raises
    ------
    ModelError
        For an unknown effect or parameter, a wrong number of values, or a vehicle without the geometry it needs.

    Examples
    --------
    >>> from wrenchgap.plant.model_file import load
    >>> make_effect(load("crazyflie").vehicle, "mass", {"added": 0.002}).theta.tolist()
    [0.002]
    """
    effect = find(name)
    if effect.needs_rotors and not vehicle.has_rotors:
        raise ModelError(f"effect {name}: this needs arms and rotors, and the model file has none")
    parameters = effect.parameters(vehicle)
    names = [p.name for p in parameters]
    if isinstance(values, Mapping):
        unknown = [n for n in values if n not in names]
        if unknown:
            said = f"no parameter {unknown[0]!r}; its parameters: {', '.join(names)}"
            raise ModelError(f"effect {name}: {effect.outdated(values) or said}")
        theta = np.array([float(values.get(p.name, p.start)) for p in parameters])
    else:
        theta = np.array([float(v) for v in values])
        if theta.shape != (len(names),):
            raise ModelError(
                f"effect {name}: got {theta.size} values, expected {len(names)} in the order {', '.join(names)}"
            )
    if not np.all(np.isfinite(theta)):
        raise ModelError(f"effect {name}: a parameter is not a finite number: {theta.tolist()}")
    return ModelEffect(effect, theta)
