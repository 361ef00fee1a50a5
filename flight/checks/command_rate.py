"""How often a log says what was commanded, whatever the stamps of its commands say.

Recorders repeat the last command at their own rate, tables are resampled by straight lines, and packets of several
commands are stamped when they arrive. When between two of those the vehicle was sent something is not known.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from wrenchgap.flight.check import Check
from wrenchgap.flight.checks.channels import held_for
from wrenchgap.flight.flight import Array, Flight, Series
from wrenchgap.flight.stamps import Steps


def straight_for(values: Array, share: float = 1e-3) -> int:
    """How many samples a channel (N,) lies on each straight line for, where it was interpolated from fewer; else 1.

    A bend is a change of slope above the `share` of the usual slope: a command that is smooth at 1 kHz bends by more.
    """
    slope = np.diff(values)
    moving = np.abs(slope[slope != 0.0])
    if len(moving) < 0.5 * len(values):
        return 1
    bends = int(np.sum(np.abs(np.diff(slope)) > share * np.median(moving)))
    return max(1, round(len(values) / max(bends, 1)))


@dataclass(frozen=True)
class CommandSpacing:
    """Commands that were logged every `seconds` [s], whatever their stamps say, and `words` on how that shows."""

    seconds: float
    words: str


def command_spacing(flight: Flight, least: float = 0.005) -> dict[str, CommandSpacing]:
    """By role, of commands that repeat, lie on straight lines, or have the stamps of bursts.

    Up to `least` [s] between commands it is no matter how they were logged: motors' lags are 10 ms and more.
    """
    found: dict[str, CommandSpacing] = {}
    wrench, actuators = flight.commanded, flight.actuators
    values: dict[str, tuple[Series, Array]] = {}
    if wrench is not None:
        values["commanded"] = wrench, wrench.wrench_B
    if actuators is not None:
        values["actuators"] = actuators, np.concatenate((actuators.tilt, actuators.rotor_speed), axis=1)
    for role, (series, logged) in values.items():
        columns = [c for c in logged.T if np.ptp(c) > 0.0]
        if not columns or len(series.time) < 3:
            continue
        same, line = min(map(held_for, columns)), min(map(straight_for, columns))
        period, burst = series.period, Steps(series.time).burst
        if same > 1:
            found[role] = CommandSpacing(same * period, f"have each value {same} times")
        elif line > 2:
            found[role] = CommandSpacing(line * period, f"lie on straight lines between every {line}th")
        elif burst:
            found[role] = CommandSpacing(burst, f"have stamps in bursts, {1e3 * burst:.3g} ms apart")
    return {role: one for role, one in found.items() if one.seconds > least}


def widest_spacing(flights: Sequence[Flight]) -> float:
    """Time [s] between what logs say of commands, where that is longer than between their stamps; else zero."""
    return max((one.seconds for f in flights for one in command_spacing(f).values()), default=0.0)


def sparse_commands(flight: Flight) -> Iterator[Check]:
    """Commands that say less often what was commanded than their stamps do."""
    for role, one in command_spacing(flight).items():
        series = flight.series()[role]
        words = f"{role}: commands {one.words}: they say what was commanded at {1.0 / one.seconds:.3g} Hz, not at the "
        words += f"{len(series.time) / np.ptp(series.time):.3g} Hz of their stamps, so that no delay and no lag below "
        words += f"{1e3 * one.seconds:.2g} ms is known from them: log each command once, stamped when it was sent."
        yield Check("rate", "warn", words)
