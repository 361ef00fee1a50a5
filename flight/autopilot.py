"""What an autopilot's log says of the autopilot itself: firmware, board, parameters, messages that its logger lost.

Parameters of logs are compared as they were at the end of each, in the precision of the autopilots, which is single.
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class ParameterChange:
    """A parameter that was set to another value while the log was written; `time_ns` on the log's clock."""

    name: str
    time_ns: int
    before: float
    after: float


def changes_of(rows: Iterable[tuple[int, str, object]], known: Mapping[str, object]) -> tuple[ParameterChange, ...]:
    """Which of these settings (time [ns], name, value) change a parameter; `known` are values before them."""
    values, found = dict(known), []
    for time_ns, name, value in rows:
        before = values.setdefault(name, value)
        both = [v for v in (before, value) if isinstance(v, int | float) and np.isfinite(v)]  # else damaged
        if len(both) == 2 and both[0] != both[1]:
            found.append(ParameterChange(name, time_ns, *both))
            values[name] = value
    return tuple(found)


@dataclass(frozen=True)
class Autopilot:
    """The autopilot that wrote a log; texts are empty where it does not say.

    `name` is "PX4" or "ArduPilot", `frame` what it calls its vehicle, `serial` the number of its processor. `dropouts`
    are gaps (PX4), or blocks (ArduPilot), that the logger lost, `lost` their length in all [s], None where it is not
    logged. `parameters` have the last values, `changes` are those made on the way, in order of time.
    """

    name: str
    firmware: str = ""
    hardware: str = ""
    frame: str = ""
    parameters: Mapping[str, float | int] = field(default_factory=dict)
    dropouts: int = 0
    lost: float | None = None
    serial: str = ""
    changes: tuple[ParameterChange, ...] = ()


OF_VEHICLE = {"name": "autopilot", "hardware": "board", "frame": "frame", "serial": "processor"}
"""What is the same in all logs of one vehicle, in words."""


def other_vehicle(one: Autopilot | None, others: Iterable[Autopilot | None]) -> str:
    """In what an autopilot is like none of the others, in words; empty where it is, or where one of them is silent."""
    listed = list(others)
    for name, words in OF_VEHICLE.items():
        own, theirs = getattr(one, name, ""), [getattr(other, name, "") for other in listed]
        if own and all(theirs) and own not in theirs:
            return f"{words} {own}, not {' or '.join(dict.fromkeys(theirs))}"
    return ""


COUNTERS = {
    r"STAT_.*|SYS_NUM_RESETS|LND_FLIGHT_T_.*|COM_FLIGHT_UUID": "counts flights, starts or hours",
    r"BARO\d*_GND_.*|GND_ABS_PRESS\d*|GND_TEMP": "is the air pressure of the day",
    r"INS_GYR\d*_?OFFS_.*": "is calibrated anew at every start",
    r"MIS_TOTAL": "counts waypoints",
}
"""Parameters that differ between any two flights and say nothing of the vehicle, and why."""


CALIBRATIONS = r"CAL_.*|COMPASS_(OFS|DIA|ODI|MOT|SCALE).*|INS_(ACC|GYR).*|RC\d+_.*"
"""Parameters of sensors and radio, which differ wherever one was calibrated: listed last."""


@dataclass(frozen=True)
class Parameter:
    """A parameter with its `values` in the order of the logs, None in those that lack it."""

    name: str
    values: tuple[float | None, ...]


@dataclass(frozen=True)
class ParameterDifferences:
    """How the parameters of several logs differ.

    `logs` are those with parameters and `without` those that have none. `differ` are parameters that all of `logs`
    have. Besides, so many are `ignored` (`COUNTERS`), and so many are not in all logs (`not_in_all`): of another
    firmware.
    """

    logs: tuple[str, ...]
    without: tuple[str, ...]
    differ: tuple[Parameter, ...] = ()
    ignored: tuple[str, ...] = ()
    not_in_all: int = 0


def parameter_differences(logs: Iterable[tuple[str, Autopilot | None]]) -> ParameterDifferences:
    """Which parameters differ between logs, by their names and autopilots."""
    listed = list(logs)
    known = [(name, one.parameters) for name, one in listed if one is not None and one.parameters]
    names = tuple(name for name, _ in known)
    without = tuple(name for name, one in listed if one is None or not one.parameters)
    if len(known) < 2:
        return ParameterDifferences(names, without)
    every = set.union(*(set(found) for _, found in known))
    shared = set.intersection(*(set(found) for _, found in known))
    differ = [key for key in shared if len({_single(found[key]) for _, found in known}) > 1]
    differ.sort(key=lambda key: (re.fullmatch(CALIBRATIONS, key) is not None, key))
    counters = tuple(key for key in differ if why_ignored(key) is not None)
    values = (Parameter(key, tuple(found[key] for _, found in known)) for key in differ if key not in counters)
    return ParameterDifferences(names, without, tuple(values), counters, len(every) - len(shared))


def why_ignored(name: str) -> str | None:
    """Why a difference in this parameter means nothing; None where it may mean something."""
    return next((why for pattern, why in COUNTERS.items() if re.fullmatch(pattern, name)), None)


def _single(value: float) -> float:
    with np.errstate(over="ignore"):
        return float(np.float32(value))
