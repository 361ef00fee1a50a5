"""The other reading of a delay: the clock of the IMU.

Measured wrenches come from the IMU. Stamps of it that are late by d make every command look late by d, which is what
`command_delay` predicts; but the odometry then leads the IMU by d, too, and that is seen without any physics
(`learn.diagnose.timing`). Where both are there and agree, sets with the delay are split into two of one class, half
each: what is logged has no preference between a late clock, and late commands beside an early odometry.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from wrenchgap.learn.diagnose.timing import UNLIKE, FlightTiming
from wrenchgap.learn.posterior.discriminating_tests import Check
from wrenchgap.learn.posterior.posterior import NamedSet, WeighedSets
from wrenchgap.plant.vehicle import Vehicle

DELAY = "command_delay"
LATE_CLOCK = "late_clock"
"""Name, in sets and of its check, of what is no effect."""
CERTAIN = 3.0
"""Standard errors within which clock and delay agree."""
EXACT, LEAST = 0.1, 1e-3
"""What a fitted delay is good for beyond that, as a share of it and in seconds: other effects are in its place."""


@dataclass(frozen=True)
class LateClock:
    """The odometry leads the IMU by `seconds` +- `std`, with one offset for all of it and on all flights."""

    seconds: float
    std: float

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
            f"clock): stamps {late} late are the IMU's clock, no missing effect, and logs are read with {self.shift}; "
            f"stamps that are right leave {DELAY}."
        )
        return Check("bench", what, (((DELAY,),), ((LATE_CLOCK,),)), LATE_CLOCK)

    def explains(self, delay: float) -> bool:
        """Whether a fitted delay [s] is what this clock makes."""
        return abs(delay - self.seconds) < CERTAIN * self.std + EXACT * abs(delay) + LEAST


def late_clock(timing: Sequence[FlightTiming]) -> LateClock | None:
    """The clock of the IMU, where the odometry of every flight leads it by the same, beyond chance."""
    offsets = [one.odometry for one in timing]
    known = [o for o in offsets if o is not None and o[2] < UNLIKE]
    if not known or len(known) < len(offsets):
        return None
    lag, std, _ = np.array(known).T
    clock = LateClock(float(-lag.mean()), float(np.hypot(std.mean(), np.ptp(lag))))
    return clock if clock.seconds > CERTAIN * clock.std else None


def with_clock(found: WeighedSets, clock: LateClock | None, vehicle: Vehicle) -> WeighedSets:
    """The same with a late clock beside every delay that it explains, half the weight each."""
    if clock is None:
        return found

    def halves(one: NamedSet) -> tuple[NamedSet, ...]:
        if DELAY not in one.names or not clock.explains(one.values(vehicle)[DELAY]["delay"]):
            return (one,)
        half = replace(one, weight=0.5 * one.weight)
        names = tuple(LATE_CLOCK if n == DELAY else n for n in one.names)
        return half, replace(half, names=names, stands_for=((LATE_CLOCK, DELAY),))

    return found.each(lambda sets: tuple(half for s in sets for half in halves(s)))
