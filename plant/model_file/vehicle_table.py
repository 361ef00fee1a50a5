"""The table [vehicle] of a model file: arms, rotors, and mass properties with their tolerances.

A mass property is a bare number or, where it is known to a tolerance, `mass = { value = 1.52, tolerance = 0.005 }`.
Tolerances are one standard deviation, in the unit of the value: of a vector one number for all entries or one for each;
of an inertia one for all moments, one for each, or three rows.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Self

import numpy as np
from annotated_types import Interval
from pydantic import AfterValidator, ValidatorFunctionWrapHandler, WrapValidator, model_validator

from wrenchgap.flight.flight import Array
from wrenchgap.plant import reader
from wrenchgap.plant.reader import BOUNDS, Name, NotNegative, Number, Positive, Table, Vector, expected, rule_error
from wrenchgap.plant.vehicle import Arms, Body, Rotors, Tolerances, Vehicle


@dataclass(frozen=True, eq=False)
class Toleranced:
    """A value as the file has it, and its tolerance, None where there is none."""

    value: Any
    tolerance: Any = None


def toleranced(tolerance: Callable[[Any], Any]) -> WrapValidator:
    """Validator of a value, or of a table of it with a tolerance, which `tolerance` reads; either as `Toleranced`."""

    def check(value: Any, handler: ValidatorFunctionWrapHandler) -> Toleranced:
        if not isinstance(value, dict):
            return Toleranced(handler(value))
        if set(value) != {"value", "tolerance"}:
            keys = f"the keys {', '.join(value)}" if value else "no keys"
            raise rule_error(f"got a table with {keys}, expected {{ value = ..., tolerance = ... }}")
        return Toleranced(handler(value["value"]), tolerance(value["tolerance"]))

    return WrapValidator(check)


def as_toleranced(value: Any) -> Toleranced:
    """The value as `Toleranced`; a default has no tolerance."""
    return value if isinstance(value, Toleranced) else Toleranced(value)


def _positive(value: Any, shapes: tuple[tuple[int, ...], ...], words: str) -> Array:
    """The tolerance as an array of one of these shapes; an error of the file where it is none, or out of `BOUNDS`."""
    wrong = rule_error(f"tolerance: got {value!r}, expected {words}, positive, from 1e-15 to 1e12")
    flat = value if isinstance(value, list) else [value]
    entries = [x for row in flat for x in (row if isinstance(row, list) else [row])]
    if any(isinstance(x, bool) or not isinstance(x, int | float) for x in entries):
        raise wrong
    try:
        values = np.array(value, dtype=float)
    except ValueError:
        raise wrong from None
    if values.shape not in shapes or not np.all((values >= BOUNDS.smallest) & (values <= BOUNDS.largest)):
        raise wrong
    return values


def number_tolerance(value: Any) -> float:
    """The tolerance of one number."""
    return float(_positive(value, ((),), "one number"))


def vector_tolerance(value: Any) -> Array:
    """The tolerance (3,) of a vector."""
    return np.broadcast_to(_positive(value, ((), (3,)), "one number or three"), 3).copy()


def inertia_tolerance(value: Any, products: float = 0.3) -> Array:
    """The tolerance (3, 3) of an inertia; of products that are not given, relative to both moments."""
    values = _positive(value, ((), (3,), (3, 3)), "one number, three, or three rows of three")
    if values.ndim == 2:
        return values
    moments = np.broadcast_to(values, 3)
    out = products * np.sqrt(np.outer(moments, moments))
    np.fill_diagonal(out, moments)
    return out


def checked_inertia(entry: Toleranced, rounding: float = 0.03) -> tuple[Array, str]:
    """The inertia (3, 3) of the file's rows, and a note where it is impossible by no more than its tolerance.

    No rigid body has a principal moment above the sum of the other two. An excess within `rounding`, relative (papers
    give two digits), or within the sum of the tolerances of the moments gives a note; a larger one is an error.
    """
    rows = entry.value
    inertia = np.diag(rows) if np.ndim(rows) == 1 else np.array(rows, dtype=float)
    low, middle, high = np.linalg.eigvalsh(inertia)
    if 0.0 < low < BOUNDS.smallest:
        raise rule_error(f"a principal moment is {low:.3g} kg m^2; expected at least {BOUNDS.smallest:g}")
    excess = float(high - low - middle)
    if excess <= 1e-3 * (low + middle):
        return inertia, ""
    granted = rounding * (low + middle)
    if entry.tolerance is not None:
        granted = max(granted, float(np.trace(entry.tolerance)))
    words = f"the principal moments {low:.4g}, {middle:.4g}, {high:.4g} kg m^2"
    if low <= 0.0 or excess > granted:
        raise rule_error(f"no body has {words}: the largest exceeds the sum of the others by {excess:.2g}")
    over = 100.0 * excess / (low + middle)
    return inertia, (
        f"vehicle.inertia: of {words} the largest exceeds the sum of the others by {over:.2g} %, which no body does; "
        "taken as it is, since its tolerance allows it."
    )


def _checked(entry: Toleranced) -> Toleranced:
    checked_inertia(entry)
    return entry


def _spin(value: float) -> float:
    if value not in (1.0, -1.0):
        raise ValueError
    return value


Inertia = Annotated[
    Vector | tuple[Vector, Vector, Vector],
    expected("three finite numbers [xx, yy, zz], or three rows of three, of a size up to 1e12 [kg m^2]"),
    toleranced(inertia_tolerance),
    AfterValidator(_checked),
]
Mass = Annotated[Positive, toleranced(number_tolerance)]
Place = Annotated[Vector, toleranced(vector_tolerance)]
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
    def _speeds(self) -> Self:
        if self.speed_min >= self.speed_max:
            raise rule_error(f"speed_min: got {self.speed_min:g}, expected less than speed_max, {self.speed_max:g}")
        return self


class ArmTable(Table):
    """One arm: by azimuth and length, or by its pose."""

    name: Name | None = None
    azimuth_deg: Number | None = None
    length: Number | None = None
    position: Vector | None = None
    tilt_axis: reader.Direction | None = None
    thrust_direction: reader.Direction = (0.0, 0.0, 1.0)
    tilts: reader.Flag = True
    tilt_min_deg: Number = -1e9
    tilt_max_deg: Number = 1e9
    tilt_rate_deg: Positive = 1e9
    rotors: tuple[RotorTable, ...]

    @model_validator(mode="after")
    def _geometry(self) -> Self:
        if self.position is None:
            for key in ("azimuth_deg", "length"):
                if getattr(self, key) is None:
                    raise rule_error(f"{key} is missing; an arm has azimuth_deg and length, or position")
        elif self.tilt_axis is None and np.hypot(*self.position[:2]) <= 1e-9:
            raise rule_error(f"tilt_axis is missing; no direction is outward at position {list(self.position)}")
        if self.tilt_min_deg >= self.tilt_max_deg:
            raise rule_error("tilt_min_deg must be below tilt_max_deg")
        if self.tilts and abs(float(self.pose[1] @ np.array(self.thrust_direction))) > 1e-6:
            raise rule_error("tilt_axis and thrust_direction must be at right angles")
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


ArmDefaults, RotorDefaults = reader.partial(ArmTable), reader.partial(RotorTable)


class VehicleTable(Table):
    """The vehicle. `arm` and `rotor` hold defaults for all arms and rotors."""

    name: Name
    mass: Mass
    inertia: Inertia
    com: Place = (0.0, 0.0, 0.0)
    imu_position: Place = (0.0, 0.0, 0.0)
    thrust_tolerance: Annotated[Number, Interval(gt=0.0, le=1.0), expected("a share, as 0.1 for 10 %")] | None = None
    thrust_axis_tolerance_deg: Annotated[Number, Interval(gt=0.0, le=45.0), expected("degrees up to 45")] | None = None
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
        listed = (arm.get("rotors") for arm in values["arms"] if isinstance(arm, dict))
        rotors = sum(len(one) for one in listed if isinstance(one, list))
        if (most := max(len(values["arms"]), rotors)) > BOUNDS.rotors:
            raise rule_error(f"arms: got {most:,} arms or rotors, expected {BOUNDS.rotors} at most")
        arms = [over(values.get("arm"), arm) for arm in values["arms"]]
        for arm in arms:
            if isinstance(arm, dict) and isinstance(arm.get("rotors"), list):
                arm["rotors"] = [over(values.get("rotor"), rotor) for rotor in arm["rotors"]]
        return {**values, "arms": arms}

    @property
    def rotors(self) -> list[tuple[str, int, RotorTable]]:
        """All rotors, each with its place in the file and the number of its arm."""
        return [(f"arms[{i}].rotors[{k}]", i, r) for i, arm in enumerate(self.arms) for k, r in enumerate(arm.rotors)]

    @model_validator(mode="after")
    def _comparable_rotors(self) -> Self:
        """Every rotor's full thrust, by which the allocation divides, is at least 1e-6 of the strongest one's."""
        full = {place: rotor.c_f * rotor.speed_max**2 for place, _, rotor in self.rotors}
        for place, thrust in full.items():
            if not 1e-6 * max(full.values()) <= thrust <= BOUNDS.largest:
                raise rule_error(
                    f"{place}: its full thrust, c_f speed_max^2, is {thrust:.3g} N, and that of the strongest rotor "
                    f"{max(full.values()):.3g} N; check c_f [N s^2] and speed_max [rad/s]"
                )
        return self

    @model_validator(mode="after")
    def _own_names(self) -> Self:
        """Every arm and rotor has a unique name: that of the file, or that of its parameters."""
        arms = [(f"arms[{i}]", arm.name) for i, arm in enumerate(self.arms)]
        rotors = [(place, rotor.name) for place, _, rotor in self.rotors]
        taken: dict[str, str] = {}
        for kind, listed in (("arm", arms), ("rotor", rotors)):
            for number, (place, given) in enumerate(listed):
                name = given or f"{kind}_{number}"
                if name in taken:
                    raise rule_error(f"{place} and {taken[name]} are both called {name!r}; give each a name of its own")
                taken[name] = place
        return self

    def vehicle(self) -> Vehicle:
        """The vehicle of these values."""
        mass, inertia, com, imu = map(as_toleranced, (self.mass, self.inertia, self.com, self.imu_position))
        degrees = self.thrust_axis_tolerance_deg
        axis = None if degrees is None else float(np.radians(degrees))
        tolerances = Tolerances(
            mass.tolerance, inertia.tolerance, com.tolerance, imu.tolerance, self.thrust_tolerance, axis
        )
        body = Body(mass.value, checked_inertia(inertia)[0], np.array(com.value))
        place = np.array(imu.value)
        if not self.arms:
            return Vehicle(self.name, body, None, None, place, tolerances=tolerances)
        rows = [(*arm.pose, arm.thrust_direction, arm.tilts) for arm in self.arms]
        limits = ("tilt_min_deg", "tilt_max_deg", "tilt_rate_deg")
        arms = Arms(
            *(np.array(column) for column in zip(*rows, strict=True)),
            *(np.radians([getattr(arm, key) for arm in self.arms]) for key in limits),
        )
        rotors = [rotor for _, _, rotor in self.rotors]
        keys = [key for key in RotorTable.model_fields if key != "name"]
        columns = {key: np.array([getattr(r, key) for r in rotors]) for key in keys}
        on = np.array([arm for _, arm, _ in self.rotors], dtype=np.intp)
        names = _names(self.arms), _names(rotors)
        return Vehicle(self.name, body, arms, Rotors(on, **columns), place, *names, tolerances=tolerances)

    @property
    def inertia_note(self) -> str:
        """A note on an inertia that is impossible within its tolerance, "" for none."""
        return checked_inertia(as_toleranced(self.inertia))[1]


def _names(items: Sequence[ArmTable | RotorTable]) -> tuple[str, ...]:
    """The names of arms or rotors, "" for one without; empty where none has one."""
    names = tuple(item.name or "" for item in items)
    return names if any(names) else ()
