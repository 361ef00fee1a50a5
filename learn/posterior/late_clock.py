"""The other reading of a delay: the clock of the IMU, or a gyroscope that is late by itself.

Measured wrenches come from the IMU. Stamps of it that are late by d make every command look late by d, which is what
`command_delay` predicts; but the odometry then leads the IMU by d, too, and that is seen without any physics
(`learn.diagnose.timing`). Where both are there and agree, sets with the delay are split into two of one class, half
each: what is logged has no preference between a late clock, and late commands beside an early odometry.

A gyroscope behind a low-pass of its own makes torques late and forces not. One delay, or one lag of the motors, for
both is a compromise between the two: whatever is no longer than the gyroscope is late, the gyroscope may have made.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from wrenchgap.learn.diagnose.timing import TIMING, FlightTiming, LateGyroscope
from wrenchgap.learn.posterior.discriminating_tests import Check
from wrenchgap.learn.posterior.posterior import NamedSet, WeighedSets
from wrenchgap.plant.effects import family
from wrenchgap.plant.vehicle import Vehicle

DELAY, LAG = "command_delay", "motor_lag"
LATE_CLOCK, LATE_GYROSCOPE = "late_clock", "late_gyroscope"
"""Names, in sets and of their checks, of what is no effect."""
EXACT, LEAST = 0.1, 1e-3
"""What a fitted delay is good for beyond that, as a share of it and in seconds: other effects are in its place."""


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

    def made(self, name: str, values: Mapping[str, float]) -> bool:
        """Whether this clock, or a filter before it, may have made an effect with these values."""
        return _no_longer(name, values, self.seconds / (1.0 - EXACT), self.std)


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

    def made(self, name: str, values: Mapping[str, float]) -> bool:
        """Whether this gyroscope may have made an effect with these values."""
        return _no_longer(name, values, self.seconds, self.std)


def _no_longer(name: str, values: Mapping[str, float], seconds: float, std: float) -> bool:
    """Whether an effect is a delay or a lag no longer than what is late by so much."""
    longest = max(values.values(), default=0.0)
    return family(name) in (DELAY, LAG) and longest < seconds + TIMING.certain * std + LEAST


def other_clock(timing: Sequence[FlightTiming]) -> LateClock | SlowGyroscope | None:
    """What is late in the IMU, where it is on every flight."""
    late = [one.late_gyroscope for one in timing if one.late_gyroscope is not None]
    if late and len(late) == len(timing):
        latest = max(late, key=lambda one: one.seconds)
        return SlowGyroscope(latest.seconds, latest.std)
    return late_clock(timing)


def late_clock(timing: Sequence[FlightTiming]) -> LateClock | None:
    """The clock of the IMU, where the odometry of every flight leads it by the same, beyond chance."""
    offsets = [one.odometry for one in timing]
    known = [o for o in offsets if o is not None and o[2] < TIMING.unlike]
    if not known or len(known) < len(offsets):
        return None
    lag, std, _ = np.array(known).T
    clock = LateClock(float(-lag.mean()), float(np.hypot(std.mean(), np.ptp(lag))))
    return clock if clock.seconds > TIMING.certain * clock.std else None


def with_clock(found: WeighedSets, clock: LateClock | SlowGyroscope | None, vehicle: Vehicle) -> WeighedSets:
    """The same with a late clock beside every delay that it may have made, half the weight each."""
    if clock is None:
        return found

    def halves(one: NamedSet) -> tuple[NamedSet, ...]:
        values = one.values(vehicle)
        made = [n for n in one.names if n in values and clock.made(n, values[n])]
        if not made:
            return (one,)
        half = replace(one, weight=0.5 * one.weight)
        names = dict.fromkeys(clock.name if n in made else n for n in one.names)
        return half, replace(half, names=tuple(names), stands_for=((clock.name, made[0]),))

    return found.each(lambda sets: tuple(half for s in sets for half in halves(s)))
