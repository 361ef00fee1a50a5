"""The other reading of a delay: the clock of the IMU.

Measured wrenches come from the IMU. Stamps of it that are late by d make every command look late by d, which is what
`command_delay` predicts; but the odometry then leads the IMU by d, too, and that is seen without any physics
(`learn.diagnose.timing`). Where both are there and agree, sets with the delay are split into two of one class, half
each: what is logged has no preference between a late clock, and late commands beside an early odometry.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from wrenchgap.learn.diagnose.timing import UNLIKE, FlightTiming
from wrenchgap.learn.posterior.discriminating_tests import Check
from wrenchgap.learn.posterior.equivalence_classes import LATE_CLOCK, EquivalenceClass, NamedSet, checks_between
from wrenchgap.learn.posterior.posterior import Posterior
from wrenchgap.plant.vehicle import Vehicle

DELAY = "command_delay"
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


def with_clock(found: Posterior, clock: LateClock | None, vehicle: Vehicle) -> Posterior:
    """The same with a late clock beside every delay that it explains, and what would settle which it is."""
    if clock is None or not any(_delayed(s, clock, vehicle) for s in found.sets):
        return found

    def both(sets: Sequence[NamedSet]) -> tuple[NamedSet, ...]:
        return tuple(half for s in sets for half in (_halves(s) if _delayed(s, clock, vehicle) else (s,)))

    check = _check(clock)
    classes = []
    for one in found.classes:
        sets = both(one.sets)
        listed = checks_between(sets, vehicle)
        classes.append(EquivalenceClass(one.weight, sets, (check, *listed) if len(sets) > len(one.sets) else listed))
    return replace(found, sets=both(found.sets), classes=tuple(classes), settle=(check, *found.settle))


def _delayed(one: NamedSet, clock: LateClock, vehicle: Vehicle) -> bool:
    return DELAY in one.names and clock.explains(one.values(vehicle)[DELAY]["delay"])


def _halves(one: NamedSet) -> tuple[NamedSet, NamedSet]:
    """The set, and the same with the clock in the place of the delay."""
    other = tuple(LATE_CLOCK if n == DELAY else n for n in one.names)
    half = replace(one, weight=0.5 * one.weight)
    return half, replace(half, names=other, stands_for=((LATE_CLOCK, DELAY),))


def _check(clock: LateClock) -> Check:
    late = f"{1e3 * clock.seconds:.1f} ms"
    what = (
        f"Compare the stamp of an IMU message with the instant of its sample (data-ready line, or the driver's clock): "
        f"stamps {late} late are the IMU's clock, no missing effect, and logs are read with {clock.shift}; stamps that "
        f"are right leave {DELAY}."
    )
    return Check("bench", what, (((DELAY,),), ((LATE_CLOCK,),)), LATE_CLOCK)
