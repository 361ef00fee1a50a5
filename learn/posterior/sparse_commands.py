"""Delays and lags that a log may have made which says too seldom what was commanded (`flight.checks.command_rate`)."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

from wrenchgap.flight.checks.command_rate import widest_spacing
from wrenchgap.flight.flight import Flight
from wrenchgap.learn.posterior.discriminating_tests import Check
from wrenchgap.plant.effects import family
from wrenchgap.plant.vehicle import Vehicle

SPARSE_COMMANDS = "sparse_commands"
"""Name, in sets and of its check, of what is no effect."""
LAGS = ("command_delay", "motor_lag", "servo_lag")


@dataclass(frozen=True)
class SparseCommands:
    """Commands of which the log says something every `seconds` only: repeated, interpolated, or stamped in bursts."""

    seconds: float
    name: ClassVar[str] = SPARSE_COMMANDS

    @property
    def check(self) -> Check:
        """What settles whether they make it."""
        what = (
            f"Log each command once, as it is sent and with its stamp: this log says every {1e3 * self.seconds:.3g} ms "
            "what was commanded, and a delay or lag below that may be the log's."
        )
        return Check("flight", what, (tuple((name,) for name in LAGS), ((SPARSE_COMMANDS,),)), self.name)

    def made(self, values: Mapping[str, Mapping[str, float]], vehicle: Vehicle) -> list[str]:
        """Delays and lags that may come from when, between two of them, commands were sent."""
        return [n for n, by in values.items() if family(n) in LAGS and max(by.values(), default=0.0) < self.seconds]


def made_by_sparse_commands(
    values: Mapping[str, Mapping[str, float]], healthy: Sequence[Flight], suspect: Sequence[Flight]
) -> list[str]:
    """Delays and lags that came between two sides of flights of which one logged its commands less often."""
    sides = widest_spacing(healthy), widest_spacing(suspect)
    sizes = {name: {at: abs(v) for at, v in by.items()} for name, by in values.items()}
    most = 0.0 if math.isclose(*sides, rel_tol=0.1) else max(sides)  # alike but for jitter: what the log does, cancels
    return [name for name, by in sizes.items() if family(name) in LAGS and max(by.values(), default=0.0) < most]
