"""The keys of a model file and the model that they describe. docs/model-file.md explains them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from wrenchgap.flight.errors import ModelError
from wrenchgap.flight.flight import Array
from wrenchgap.plant.controller import ControllerGains, default_gains
from wrenchgap.plant.effects import Source, catalogue, sources
from wrenchgap.plant.model import Model, make_effect
from wrenchgap.plant.model_file.command import CommandTable
from wrenchgap.plant.model_file.past import FileTable, ParameterTable, VersionTable
from wrenchgap.plant.model_file.told import Told, inertia_of, of_inertia, of_number, of_vector, told, told_of
from wrenchgap.plant.reader import (
    MOST,
    Axes,
    Direction,
    Flag,
    Name,
    NotNegative,
    Number,
    Positive,
    Table,
    Text,
    Vector,
    broken,
    check_schema,
    expected,
    partial,
    read,
    toml,
    values_of,
)
from wrenchgap.plant.sensors import SensorNoise
from wrenchgap.plant.vehicle import Arms, Body, Rotors, Tolerances, Vehicle
from wrenchgap.plant.wrench_model import ModelEffect, Provenance

SCHEMA = 1
MASS_PROPERTIES = ("mass", "inertia", "com", "imu_position")
"""Keys of [vehicle] that may have a tolerance, in the order of `Tolerances`."""
PAGE = "docs/model-file.md"
WEAKEST = 1e-6
"""Share of the strongest rotor's full thrust that a rotor must have: the allocation divides by it."""


def _possible(given: Told) -> Told:
    inertia_of(given)
    return given


def _spin(value: float) -> float:
    if value not in (1.0, -1.0):
        raise ValueError
    return value


Inertia = Annotated[
    Vector | tuple[Vector, Vector, Vector],
    expected("[xx, yy, zz] or three rows of three [kg m^2]"),
    told(of_inertia),
    AfterValidator(_possible),
]
Mass = Annotated[Positive, told(of_number)]
Place = Annotated[Vector, told(of_vector)]
SizeVector = Annotated[tuple[NotNegative, NotNegative, NotNegative], expected("three numbers that are not negative")]
Spin = Annotated[Number, AfterValidator(_spin), expected("1 (counter-clockwise about thrust) or -1")]


class RotorTable(Table):
    """One rotor of an arm."""

    name: Name | None = None
    offset: Number = 0.0
    spin: Spin
    c_f: Positive
    kappa: Number
    radius: Positive
    speed_min: NotNegative = 0.0
    speed_max: Positive

    @model_validator(mode="after")
    def _speeds(self) -> RotorTable:
        if self.speed_min >= self.speed_max:
            raise broken(f"speed_min: got {self.speed_min:g}, expected less than speed_max, {self.speed_max:g}")
        return self


class ArmTable(Table):
    """One arm: by azimuth and length, or by its pose."""

    name: Name | None = None
    azimuth_deg: Number | None = None
    length: Number | None = None
    position: Vector | None = None
    tilt_axis: Direction | None = None
    thrust_direction: Direction = (0.0, 0.0, 1.0)
    tilts: Flag = True
    tilt_min_deg: Number = -1e9
    tilt_max_deg: Number = 1e9
    tilt_rate_deg: Positive = 1e9
    rotors: tuple[RotorTable, ...]

    @model_validator(mode="after")
    def _geometry(self) -> ArmTable:
        if self.position is None:
            for key in ("azimuth_deg", "length"):
                if getattr(self, key) is None:
                    raise broken(f"{key} is missing; an arm has azimuth_deg and length, or position")
        elif self.tilt_axis is None and np.hypot(*self.position[:2]) <= 1e-9:
            raise broken(f"tilt_axis is missing; no direction is outward at position {list(self.position)}")
        if self.tilt_min_deg >= self.tilt_max_deg:
            raise broken("tilt_min_deg must be below tilt_max_deg")
        if self.tilts and abs(float(self.pose[1] @ np.array(self.thrust_direction))) > 1e-6:
            raise broken("tilt_axis and thrust_direction must be at right angles")
        return self

    @property
    def pose(self) -> tuple[Array, Array]:
        """Hub point (3,) [m] and unit tilt axis (3,) in B."""
        if self.position is not None:
            position = np.array(self.position)
            outward = position * [1.0, 1.0, 0.0] / max(float(np.hypot(*self.position[:2])), 1e-9)
        else:
            azimuth = np.radians(self.azimuth_deg or 0.0)
            outward = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
            position = (self.length or 0.0) * outward
        return position, outward if self.tilt_axis is None else np.array(self.tilt_axis)


ArmDefaults, RotorDefaults = partial(ArmTable), partial(RotorTable)


class VehicleTable(Table):
    """The vehicle. `arm` and `rotor` hold defaults for all arms and rotors."""

    name: Name
    mass: Mass
    inertia: Inertia
    com: Place = (0.0, 0.0, 0.0)
    imu_position: Place = (0.0, 0.0, 0.0)
    arm: ArmDefaults | None = None  # type: ignore[valid-type]  # made from ArmTable
    rotor: RotorDefaults | None = None  # type: ignore[valid-type]
    arms: tuple[ArmTable, ...] = ()

    @model_validator(mode="before")
    @classmethod
    def _spread_defaults(cls, values: Any) -> Any:
        def over(defaults: Any, item: Any) -> Any:
            return {**defaults, **item} if isinstance(item, dict) and isinstance(defaults, dict) else item

        if not isinstance(values, dict) or not isinstance(values.get("arms"), list):
            return values
        arms = [over(values.get("arm"), arm) for arm in values["arms"]]
        for arm in arms:
            if isinstance(arm, dict) and isinstance(arm.get("rotors"), list):
                arm["rotors"] = [over(values.get("rotor"), rotor) for rotor in arm["rotors"]]
        return {**values, "arms": arms}

    @model_validator(mode="after")
    def _comparable_rotors(self) -> VehicleTable:
        """No rotor's full thrust is below `WEAKEST` of the strongest's: a unit or a digit is wrong, or it is none."""
        rotors = [(f"arms[{i}].rotors[{k}]", r) for i, arm in enumerate(self.arms) for k, r in enumerate(arm.rotors)]
        full = {place: rotor.c_f * rotor.speed_max**2 for place, rotor in rotors}
        for place, thrust in full.items():
            if not WEAKEST * max(full.values()) <= thrust <= MOST:
                raise broken(
                    f"{place}: its full thrust, c_f speed_max^2, is {thrust:.3g} N, and that of the strongest rotor "
                    f"{max(full.values()):.3g} N; check c_f [N s^2] and speed_max [rad/s]"
                )
        return self

    @model_validator(mode="after")
    def _own_names(self) -> VehicleTable:
        """Every arm and rotor has a name of its own: one that was given, or what parameters call it."""
        arms = [(f"arms[{i}]", arm.name) for i, arm in enumerate(self.arms)]
        rotors = [
            (f"arms[{i}].rotors[{k}]", r.name) for i, arm in enumerate(self.arms) for k, r in enumerate(arm.rotors)
        ]
        taken: dict[str, str] = {}
        for kind, listed in (("arm", arms), ("rotor", rotors)):
            for number, (place, given) in enumerate(listed):
                name = given or f"{kind}_{number}"
                if name in taken:
                    raise broken(f"{place} and {taken[name]} are both called {name!r}; give each a name of its own")
                taken[name] = place
        return self

    def made(self) -> Vehicle:
        """The vehicle of these values."""
        mass, inertia, com, imu = (told_of(getattr(self, name)) for name in MASS_PROPERTIES)
        known = Tolerances(*(one.tolerance for one in (mass, inertia, com, imu)))
        body = Body(mass.value, inertia_of(inertia)[0], np.array(com.value))
        place = np.array(imu.value)
        if not self.arms:
            return Vehicle(self.name, body, None, None, place, tolerances=known)
        axes = [arm.pose for arm in self.arms]
        low, high, rate = (
            np.radians([getattr(arm, f"tilt_{key}_deg") for arm in self.arms]) for key in ("min", "max", "rate")
        )
        arms = Arms(
            np.array([position for position, _ in axes]),
            np.array([axis for _, axis in axes]),
            np.array([arm.thrust_direction for arm in self.arms]),
            np.array([arm.tilts for arm in self.arms]),
            *(low, high, rate),
        )
        rotors = [(on, rotor) for on, arm in enumerate(self.arms) for rotor in arm.rotors]
        keys = [key for key in RotorTable.model_fields if key != "name"]
        columns = {key: np.array([getattr(r, key) for _, r in rotors]) for key in keys}
        on = np.array([arm for arm, _ in rotors], dtype=np.intp)
        names = _names(self.arms), _names([rotor for _, rotor in rotors])
        return Vehicle(self.name, body, arms, Rotors(on, **columns), place, *names, tolerances=known)

    @property
    def doubt(self) -> str:
        """What a user should know of these values, "" for nothing."""
        return inertia_of(told_of(self.inertia))[1]


def _names(items: Sequence[ArmTable | RotorTable]) -> tuple[str, ...]:
    """The names of arms or rotors, "" for one without; empty where none has one."""
    names = tuple(item.name or "" for item in items)
    return names if any(names) else ()


class ProvenanceTable(Table):
    """Where an effect's values come from."""

    fitted: Text = ""
    version: Text = ""
    method: Text = ""
    logs: tuple[FileTable, ...] = ()


Parameter = Annotated[ParameterTable, BeforeValidator(lambda v: v if isinstance(v, dict) else {"value": v})]


class EffectTable(Table):
    """One effect with its values."""

    name: Text
    parameters: dict[str, Parameter]
    source: FileTable = FileTable()
    provenance: ProvenanceTable = ProvenanceTable()

    def made(self, vehicle: Vehicle) -> tuple[ModelEffect, str]:
        """The effect on this vehicle, and a note on it."""
        own, note = self._own()
        effect = make_effect(vehicle, self.name, {key: p.value for key, p in self.parameters.items()})
        names = [p.name for p in effect.effect.parameters(vehicle)]
        missing = [n for n in names if n not in self.parameters]
        if missing:
            raise ModelError(f"effect {self.name}: parameter {missing[0]!r} is missing; expected {', '.join(names)}")
        stds = [self.parameters[n].std for n in names]
        std = None if None in stds else np.array(stds, dtype=float)
        p = self.provenance
        logs = tuple((log.file, log.sha256) for log in p.logs)
        return replace(effect, std=std, provenance=Provenance(logs, p.fitted, p.version, p.method, own)), note

    def _own(self) -> tuple[Source | None, str]:
        """The file of a user's own effect, and a note where another one is loaded; an error where none is."""
        file, name = self.source.file, self.name
        if not file:
            return None, ""
        if name not in catalogue():
            raise ModelError(f"effect {name!r} is a user's own, from {file}; pass that file with --effects {file}")
        loaded, source = sources().get(name), Source(file, self.source.sha256)
        if loaded is None or loaded.sha256 == source.sha256:
            return source, ""
        return source, (
            f"effect {name}: {loaded.file} is not as it was when the effect was fitted; fit it anew with wrenchgap add."
        )


class BetweenFlightsTable(Table):
    """By how much the wrench differs between flights, one standard deviation [N, Nm]."""

    force: SizeVector
    torque: SizeVector


class ModelTable(Table):
    """The whole file. The tables [controller] and [sensors] have the fields of their dataclasses as keys."""

    version: Number = Field(alias="schema")
    vehicle: VehicleTable
    controller: dict[str, Any] = Field({})
    sensors: dict[str, Any] = Field({})
    topics: dict[str, Text] = Field({})
    command: CommandTable | None = None
    unmeasured: Axes = ()
    between_flights: BetweenFlightsTable | None = None
    effects: tuple[EffectTable, ...] = ()
    history: tuple[VersionTable, ...] = ()


def loads(text: str) -> Model:
    """A model from the text of a model file; raises ModelError in one line."""
    document = toml(text)
    check_schema(document, SCHEMA)
    table = read(ModelTable, document, page=PAGE)
    vehicle = table.vehicle.made()
    gains = values_of(ControllerGains, table.controller, where="controller", page=PAGE)
    noise = values_of(SensorNoise, table.sensors, where="sensors", page=PAGE)
    effects = [effect.made(vehicle) for effect in table.effects]
    scatter = table.between_flights
    model = Model(
        vehicle,
        controller=default_gains(vehicle, gains),
        sensors=SensorNoise(**noise),
        topics=table.topics,
        command=None if table.command is None else table.command.made(),
        unmeasured=table.unmeasured,
        between_flights=None if scatter is None else (*scatter.force, *scatter.torque),
        text=text,
        history=tuple(version.made() for version in table.history),
        notes=tuple(note for note in (table.vehicle.doubt, *(note for _, note in effects)) if note),
    )
    return model.with_effects(effect for effect, _ in effects)
