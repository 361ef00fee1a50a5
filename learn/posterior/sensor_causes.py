"""The other reading of an effect: a sensor of the IMU that is late, or whose calibration is off.

Measured wrenches come from the IMU. Stamps of it that are late by d make every command look late by d, which is what
`command_delay` predicts; but the odometry then leads the IMU by d, too, and that is seen without any physics
(`learn.diagnose.timing`). Where both are there and agree, sets with the delay are split into two of one class, half
each: what is logged has no preference between a late clock, and late commands beside an early odometry.

A gyroscope behind a low-pass of its own makes torques late and forces not. One delay, or one lag of the motors, for
both is a compromise between the two: whatever is no longer than the gyroscope is late, the gyroscope may have made.

An accelerometer that reads k times what there is shows all thrust k, or the mass 1/k times what it is; a gyroscope all
torques: the inertia 1/k times what it is, or all thrust k, with a mass that makes up for it in force. How far either
scale may be off is known from the odometry (`flight.checks.accelerometer_scale`, `flight.checks.sensor_scales`), else
from datasheets. A gyroscope whose axes are off square makes products of inertia.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Protocol

import numpy as np

from wrenchgap.flight.checks.accelerometer_scale import gravity_ratio
from wrenchgap.flight.checks.command_rate import widest_spacing
from wrenchgap.flight.checks.motion import motion_means
from wrenchgap.flight.checks.sensor_scales import Bounds, sensor_scales
from wrenchgap.flight.checks.sensor_windows import SCALE
from wrenchgap.flight.flight import Flight
from wrenchgap.learn.diagnose.timing import TIMING, FlightTiming, LateGyroscope
from wrenchgap.learn.posterior.discriminating_tests import Check
from wrenchgap.learn.posterior.posterior import NamedSet, WeighedSets
from wrenchgap.learn.posterior.sparse_commands import SparseCommands
from wrenchgap.plant.effects import family
from wrenchgap.plant.vehicle import Vehicle

DELAY, LAG = "command_delay", "motor_lag"
MASS, THRUST, INERTIA = "mass", "thrust_scale", "inertia"
LATE_CLOCK, LATE_GYROSCOPE = "late_clock", "late_gyroscope"
ACCELEROMETER, GYROSCOPE = "accelerometer_calibration", "gyroscope_calibration"
"""Names, in sets and of their checks, of what is no effect."""


@dataclass(frozen=True)
class SensorTolerances:
    """What sensors may be off by."""

    exact: float = 0.1
    """Share of a fitted delay by which it may be longer than what is late: other effects are in its place."""
    least: float = 1e-3
    """And by how much [s]."""
    datasheet: float = 0.05
    """How far the scale of a sensor may be off that nothing bounds: 3 % at first for IMUs of the MPU-6000 class, and
    2 % over temperature."""
    unbounded: float = 0.02
    """How late an IMU may be that nothing bounds [s]: behind a low-pass of 8 Hz, or stamped a period of 50 Hz late."""
    offset: float = 0.005
    """How far an accelerometer's scale may be from what the odometry shows: a bias of 0.05 m/s^2 looks like it."""
    askew: float = 0.03
    """Products of inertia that a gyroscope's axes may make, relative to the moments: 2 % off square, as datasheets
    allow (cross-axis sensitivity), looks like products of 2 %."""


SENSOR = SensorTolerances()


class SensorCause(Protocol):
    """What a sensor may do to a log that looks like effects; `name` stands for those in sets, `check` settles it."""

    name: ClassVar[str]

    @property
    def check(self) -> Check:
        """What settles whether it is so."""
        ...

    def made(self, values: Mapping[str, Mapping[str, float]], vehicle: Vehicle) -> list[str]:
        """Those effects of a set, with these values, that it may have made."""
        ...


@dataclass(frozen=True)
class LateClock:
    """The odometry leads the IMU by `seconds` +- `std`, with one offset for all of it and on all flights."""

    seconds: float
    std: float
    name: ClassVar[str] = LATE_CLOCK

    @property
    def shift(self) -> str:
        """The option that takes it out."""
        return f"--shift imu={-self.seconds:.4f}"

    @property
    def check(self) -> Check:
        """What settles whether it is late."""
        late = f"{1e3 * self.seconds:.1f} ms"
        what = (
            f"Compare the stamp of an IMU message with the instant of its sample (data-ready line, or the driver's "
            f"clock), and look up the IMU's low-pass (PX4 IMU_GYRO_CUTOFF, ArduPilot INS_GYRO_FILTER): stamps or "
            f"filters {late} late are the IMU's, no missing effect, and logs are read with {self.shift}; else {DELAY} "
            "is left."
        )
        return Check("bench", what, (((DELAY,),), ((LATE_CLOCK,),)), LATE_CLOCK)

    def made(self, values: Mapping[str, Mapping[str, float]], vehicle: Vehicle) -> list[str]:
        """Delays and lags that this clock, or a filter before it, may have made."""
        return _no_longer(values, self.seconds / (1.0 - SENSOR.exact), self.std)


@dataclass(frozen=True)
class UnboundedClock(LateClock):
    """The clock, or a low-pass, of an IMU that may be late by up to `seconds`: no odometry says that it is not. Or of
    the odometry, where there is no `imu`.
    """  # noqa: D205

    imu: bool = True

    @property
    def check(self) -> Check:
        """What settles whether it is late."""
        what = f"Find out how the velocity is made: one that is differenced, or filtered, makes a {DELAY}."
        of_imu = (
            "Look up the IMU's low-pass (PX4 IMU_GYRO_CUTOFF, ArduPilot INS_GYRO_FILTER, Betaflight "
            f"gyro_lpf1_static_hz) and how its messages are stamped: an IMU that is late makes a {DELAY} of as much, "
            "and no effect is missing; or log the attitude too, which tells."
        )
        return Check("bench", of_imu if self.imu else what, (((DELAY,),), ((LATE_CLOCK,),)), LATE_CLOCK)


class SlowGyroscope(LateGyroscope):
    """A gyroscope that is late by itself, as the cause of lags."""

    name: ClassVar[str] = LATE_GYROSCOPE

    @property
    def check(self) -> Check:
        """What settles whether it is late."""
        late = f"{1e3 * self.seconds:.1f} ms"
        what = (
            f"Look up the low-pass of the gyroscope (PX4 IMU_GYRO_CUTOFF, ArduPilot INS_GYRO_FILTER, its own): "
            f"one that is {late} later than the accelerometer's makes the lag, no missing effect; log both alike."
        )
        return Check("bench", what, (((DELAY,), (LAG,)), ((LATE_GYROSCOPE,),)), LATE_GYROSCOPE)

    def made(self, values: Mapping[str, Mapping[str, float]], vehicle: Vehicle) -> list[str]:
        """Delays and lags that this gyroscope may have made."""
        return _no_longer(values, self.seconds, self.std)


def _no_longer(values: Mapping[str, Mapping[str, float]], seconds: float, std: float) -> list[str]:
    """Delays and lags no longer than what is late by so much."""
    most = seconds + TIMING.certain * std + SENSOR.least
    return [n for n, by in values.items() if family(n) in (DELAY, LAG) and max(by.values(), default=0.0) < most]


@dataclass(frozen=True)
class ScaledAccelerometer:
    """An accelerometer that reads `low` to `high` times what there is."""

    low: float
    high: float
    name: ClassVar[str] = ACCELEROMETER

    @property
    def check(self) -> Check:
        """What settles whether its scale is off."""
        what = (
            "At rest, with each side up in turn, the accelerometer must read 9.81 m/s^2 to 0.5 %: else its scale is "
            "off, and no effect is missing; the ground station calibrates it. Weigh the vehicle if it does."
        )
        return Check("bench", what, (((MASS,), (THRUST,)), ((ACCELEROMETER,),)), self.name)

    def made(self, values: Mapping[str, Mapping[str, float]], vehicle: Vehicle) -> list[str]:
        """A mass, or all thrust, that is off by no more than such an accelerometer makes it; not both of them."""
        off = _relative(values, vehicle)
        read = [1.0 / (1.0 + size) if name == MASS else 1.0 + size for name, size in off.items()]
        return [*off] if len(off) == 1 and self.low <= read[0] <= self.high else []


@dataclass(frozen=True)
class ScaledGyroscope:
    """A gyroscope that reads `low` to `high` times what there is, and whose axes are as square as datasheets say."""

    low: float
    high: float
    name: ClassVar[str] = GYROSCOPE

    @property
    def check(self) -> Check:
        """What settles whether its scale is off."""
        what = (
            "Turned by hand through a full turn about each axis, the gyroscope must add up to 360 deg to 0.5 % on that "
            "axis and to nothing on the others: else its calibration is off, and no effect is missing."
        )
        return Check("bench", what, (((MASS, THRUST), (INERTIA,)), ((GYROSCOPE,),)), self.name)

    def made(self, values: Mapping[str, Mapping[str, float]], vehicle: Vehicle) -> list[str]:
        """An inertia; or all thrust, for the torques, and a mass that makes up for it in force, off by as little."""
        off, made = _relative(values, vehicle), list[str]()
        if len(off) == 2 and all(self.low <= 1.0 + size <= self.high for size in off.values()):
            made += off
        if INERTIA in values:
            J = vehicle.body.inertia
            sizes = {
                at: v / np.sqrt(np.prod([J[i, i] for i in map("xyz".index, at)])) for at, v in values[INERTIA].items()
            }
            square = [abs(size) <= SENSOR.askew for at, size in sizes.items() if at[0] != at[1]]
            scaled = [self.low <= 1.0 / (1.0 + size) <= self.high for at, size in sizes.items() if at[0] == at[1]]
            made += [INERTIA] if all(square) and all(scaled) else []
        return made


def _relative(values: Mapping[str, Mapping[str, float]], vehicle: Vehicle) -> dict[str, float]:
    """By how much mass and all thrust are off in a set, relative to the model's."""
    units = {MASS: vehicle.body.mass, THRUST: 1.0}
    return {name: next(iter(values[name].values())) / unit for name, unit in units.items() if name in values}


def sensor_causes(flights: Sequence[Flight], timing: Sequence[FlightTiming]) -> tuple[SensorCause, ...]:
    """What the sensors of these flights may do that looks like effects."""
    clock = other_clock(timing)
    spacing = widest_spacing(flights)
    sparse = (SparseCommands(spacing),) if spacing else ()
    if all(f.imu is None for f in flights):
        return (replace(clock, imu=False) if isinstance(clock, UnboundedClock) else clock, *sparse)
    return clock, scaled_accelerometer(flights), scaled_gyroscope(flights), *sparse


def scaled_accelerometer(flights: Sequence[Flight]) -> ScaledAccelerometer:
    """As far as the odometry of all flights bounds the scale of the mean, or datasheets do; and as it shows the scale
    of what changes along the thrust, which is another where vibration is rectified.
    """  # noqa: D205
    ratios = [gravity_ratio(f, motion_means(f)) for f in flights]
    known = [(r.value, SENSOR.offset + SCALE.sigmas * r.std) for r in ratios if r is not None]
    spans = [(middle - reach, middle + reach) for middle, reach in known or [(1.0, SENSOR.datasheet)]]
    scales = [(sensor_scales(f, "accelerometer") or {}).get("z") for f in flights]
    spans += _plain([one.best for one in scales if one is not None])
    return ScaledAccelerometer(*_hull(spans))


def scaled_gyroscope(flights: Sequence[Flight]) -> ScaledGyroscope:
    """As far as the attitude of all flights bounds the scale of the axes that it shows, or datasheets do: bounds that
    are further apart than those say nothing.
    """  # noqa: D205
    spans = _plain([one.best for f in flights for one in (sensor_scales(f, "gyroscope") or {}).values()])
    return ScaledGyroscope(*_hull(spans or [(1.0 - SENSOR.datasheet, 1.0 + SENSOR.datasheet)]))


def _plain(scales: Sequence[Bounds]) -> list[tuple[float, float]]:
    """Bounds that say more of a scale than datasheets do, widened by what they, and fitted effects, may be off by."""
    known = [b for b in scales if b.width < SENSOR.datasheet and b.std < SCALE.tolerance]
    reach = [SCALE.tolerance + SENSOR.exact / (1.0 - SENSOR.exact) * abs(b.middle - 1.0) for b in known]
    return [(b.low - r, b.high + r) for b, r in zip(known, reach, strict=True)]


def _hull(spans: Sequence[tuple[float, float]]) -> tuple[float, float]:
    low, high = zip(*spans, strict=True)
    return min(low), max(high)


def other_clock(timing: Sequence[FlightTiming]) -> LateClock | SlowGyroscope:
    """What is late in the IMU, where it is on every flight, or may be where none tells."""
    late = [one.late_gyroscope for one in timing if one.late_gyroscope is not None]
    if late and len(late) == len(timing):
        latest = max(late, key=lambda one: one.seconds)
        return SlowGyroscope(latest.seconds, latest.std)
    return late_clock(timing) or UnboundedClock(max(map(_latest, timing), default=SENSOR.unbounded), 0.0)


def _latest(one: FlightTiming) -> float:
    """By how much the IMU may be later than the odometry of a flight [s], or than anything where that does not tell."""
    known = one.imu_lateness
    return SENSOR.unbounded if known is None else max(0.0, known[0] + TIMING.certain * known[1])


def made_by_another_filter(
    values: Mapping[str, Mapping[str, float]], healthy: Sequence[FlightTiming], suspect: Sequence[FlightTiming]
) -> list[str]:
    """Delays and lags that came between two sides of flights and that an IMU may have made which is later on one of
    them than on the other, by another low-pass, say.
    """  # noqa: D205
    sides = [[one.imu_lateness for one in side] for side in (healthy, suspect)]
    known = [np.array([one for one in side if one is not None]) for side in sides]
    if any(not len(own) or len(own) < len(side) for own, side in zip(known, sides, strict=True)):
        return _no_longer({n: {at: abs(v) for at, v in by.items()} for n, by in values.items()}, SENSOR.unbounded, 0.0)
    (before, before_std), (after, after_std) = (own.mean(axis=0) for own in known)
    later, std = float(after - before) / (1.0 - SENSOR.exact), float(np.hypot(before_std, after_std))
    sizes = {n: max(by.values(), key=abs, default=0.0) for n, by in values.items()}
    return [n for n, size in sizes.items() if _no_longer({n: {"": abs(size)}}, math.copysign(1.0, size) * later, std)]


def late_clock(timing: Sequence[FlightTiming]) -> LateClock | None:
    """The clock of the IMU, where the odometry of every flight leads it by the same, beyond chance."""
    offsets = [one.odometry for one in timing]
    known = [o for o in offsets if o is not None and o[2] < TIMING.unlike]
    if not known or len(known) < len(offsets):
        return None
    lag, std, _ = np.array(known).T
    clock = LateClock(float(-lag.mean()), float(np.hypot(std.mean(), np.ptp(lag))))
    return clock if clock.seconds > TIMING.certain * clock.std else None


def with_sensor_causes(found: WeighedSets, causes: Sequence[SensorCause], vehicle: Vehicle) -> WeighedSets:
    """The same with each cause beside every set of effects that it may have made, half the weight each."""

    def halves(one: NamedSet) -> tuple[NamedSet, ...]:
        some: tuple[NamedSet, ...] = (one,)
        for cause in causes:
            some = tuple(half for s in some for half in _halves(s, cause, vehicle))
        return some

    return found.each(lambda sets: tuple(half for s in sets for half in halves(s)))


def _halves(one: NamedSet, cause: SensorCause, vehicle: Vehicle) -> tuple[NamedSet, ...]:
    """A set, or where the cause may have made some of its effects, the set and one with the cause in their place."""
    values = one.values(vehicle)
    made = cause.made({name: values[name] for name in one.names if name in values}, vehicle)
    if not made:
        return (one,)
    half = replace(one, weight=0.5 * one.weight)
    names = dict.fromkeys(cause.name if n in made else n for n in one.names)
    return half, replace(half, names=tuple(names), stands_for=(*one.stands_for, (cause.name, made[0])))
