"""Whether a vehicle stood still while its motors ran: on a bench, with propellers off, or held down."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wrenchgap.flight.check import Check
from wrenchgap.flight.flight import Array, Samples
from wrenchgap.flight.row_kernels import lengths
from wrenchgap.learn.data.checks.commands_and_motion import CommandsAndMotion
from wrenchgap.learn.data.measurement import low_pass
from wrenchgap.learn.data.phases.phase import SIGNALS


@dataclass(frozen=True)
class BenchThresholds:
    """What is no flight; all signals behind a low-pass of `SIGNALS.slow_hz`."""

    still: float = 0.001
    """Rate [rad/s], rms of all axes, below which nothing flies. Of 38 recorded and simulated flights it is 0.0475 and
    more, of six runs on a bench 0.0006 at most: twice this, or 40 times, changes none of them."""
    varied: float = 0.01
    """Of the usual commanded force: how much its changes are at least (rms), that a flight would show."""
    follows: float = 0.3
    """Slope of the specific force over the commanded one, both in shares of their means: 1 of what flies."""
    moved: float = 0.2
    """Way [m] that an odometry does not drift by on a bench."""


BENCH = BenchThresholds()


def stood_still(turned: Array, pushed: Array, felt: Array, stretches: Sequence[Samples]) -> bool:
    """Whether, while motors ran, a gyroscope read nothing, no accelerometer went with the thrust, and nothing moved.

    Of the `stretches`, one behind the other: body rates (N, 3) [rad/s], commanded forces (N, 3) in any unit, and
    specific forces (N, 3) in any unit.
    """
    if any(s.position_E is not None and np.ptp(s.position_E, axis=0).max() > BENCH.moved for s in stretches):
        return False
    sizes = lengths(pushed)
    on = sizes > SIGNALS.pushing * float(np.percentile(sizes, 90.0))
    if not on.any():  # the motors never ran
        return False
    thrust, force = (values[on] / max(float(values[on].mean()), 1e-30) for values in (sizes, lengths(felt)))
    if not float(np.sqrt(np.mean(np.sum(turned[on] ** 2, axis=1)))) < BENCH.still or thrust.std() < BENCH.varied:
        return False
    return float(np.cov(thrust, force)[0, 1] / thrust.var()) < BENCH.follows


def bench(seen: CommandsAndMotion, stretches: Sequence[Samples]) -> list[Check]:
    """A check `motion` where the vehicle stood still."""

    def slow(values: Array) -> Array:
        return np.concatenate([low_pass(values[part], seen.dt, SIGNALS.slow_hz) for part in seen.parts])

    pushed = seen.pushed if seen.made is None else seen.made
    if not stood_still(slow(seen.omega), slow(pushed[:, :3]), slow(seen.measured[:, :3]), stretches):
        return []
    words = "The motors ran with changing thrust, and neither gyroscope nor accelerometer went with them, as on a bench"
    return [Check("motion", "bad", f"{words}: give a flight")]
