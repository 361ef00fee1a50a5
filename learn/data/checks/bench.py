"""Whether the vehicle moved at all when its motors turned: with propellers off, or held down, it does not."""

from dataclasses import dataclass

import numpy as np

from wrenchgap.flight.check import Check
from wrenchgap.flight.checks.motion import cosine, rms
from wrenchgap.learn.data.checks.commands_and_motion import COMPARED, CommandsAndMotion, at_lags, moving

AXES = [2, 3, 4, 5]
"""Of a wrench: force along z and torques, which every multirotor commands."""


@dataclass(frozen=True)
class BenchThresholds:
    """From when on a run of the motors is no flight.

    Twice or half of each changes none of the 22 below, but for half of `chance`, which takes one bench for a flight.
    """

    chance: float = 4.0
    """Standard errors of a cosine between commands and motion within which it is chance. Of 16 recorded flights the
    largest of the four axes is 6.5 and more, of six runs on a bench 2.3 at most."""
    louder: float = 10.0
    """How many times more than it turns the commands would turn it about x and about y. Real hovers: up to 7, since
    commands answer disturbances; the runs on a bench: 172 and more."""

    still: float = 0.003
    """Rate [rad/s], rms of all axes, above which it may fly, and its commands be snapshots of faster ones that say
    nothing of its motion. Recorded flights: 0.09 and more; runs on a bench: up to 0.001."""


BENCH = BenchThresholds()


def bench(seen: CommandsAndMotion) -> list[Check]:
    """A check `motion` where nothing that the IMU reads goes with the commands, which would have moved it.

    Two independent signals of the band from `COMPARED.fast_hz` to `COMPARED.cutoff_hz` and a length T have a cosine of
    zero mean and variance 1 / (2 B T), with the width B of the band.
    """
    felt = moving(seen, seen.measured, fast=True)[:, AXES]
    made = [wrench[:, AXES] for wrench in at_lags(seen, seen.pushed if seen.made is None else seen.made, fast=True)]
    error = (2.0 * (COMPARED.cutoff_hz - COMPARED.fast_hz) * len(felt) * seen.dt) ** -0.5
    alike = max(abs(cosine(felt[:, [k]], one[:, [k]])) for one in made for k in range(len(AXES)))
    times = np.sqrt(np.mean(made[0] ** 2, axis=0) / np.maximum(np.mean(felt**2, axis=0), 1e-30))
    still = rms(moving(seen, seen.omega, fast=True)) < BENCH.still
    if not still or alike > BENCH.chance * error or not np.all(times[1:3] > BENCH.louder):
        return []
    words = f"The motors are commanded to turn the vehicle {times[1:3].min():.0f} times more than it turns, and nothing"
    return [Check("motion", "bad", f"{words} that the IMU reads goes with them, as on a bench: give a flight")]
