"""What an autopilot reported: its flight modes, and what was wrong, in its own words or by its own codes.

Numbers and names of modes: ArduCopter's parameter FLTMODE1 (ArduPilot's parameter reference), `nav_state` of PX4's
message vehicle_status (PX4's message reference).

PX4's logged messages have the levels of syslog (ULog File Format, docs.px4.io). ArduPilot's ERR has a subsystem and a
code, 0 once an error is over ("Subsystem and Error Codes", ardupilot.org); its MSG has no level.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from wrenchgap.learn.health.autopilot_messages import Recorded
from wrenchgap.learn.health.phases import AIRBORNE, FlightPhases

SEVERITIES = ("emergency", "alert", "critical", "error", "warning")
"""The levels that are kept, the worst first: the digits 0 to 4 of a ULog."""
_SUBSYSTEMS = """2:radio 3:compass 5:radio_failsafe 6:battery_failsafe 7:GPS_failsafe 8:ground_station_failsafe
    9:fence_failsafe 10:flight_mode 11:GPS 12:crash_check 13:flip 15:parachute 16:EKF_check 17:EKF_failsafe
    18:barometer 19:CPU 20:ADSB_failsafe 21:terrain 22:navigation 23:terrain_failsafe 24:EKF_primary
    25:thrust_loss_check 26:sensor_failsafe 27:leak_failsafe 28:pilot_input 29:vibration_failsafe 30:internal_error
    31:deadreckoning_failsafe"""
SUBSYSTEMS = {int(n): name.replace("_", " ") for n, name in (one.split(":") for one in _SUBSYSTEMS.split())}


@dataclass(frozen=True)
class LoggedMessage:
    """A message of a level (of `SEVERITIES`): its first `time` [s], in flight if it came there, and how often."""

    time: float
    level: str
    text: str
    in_flight: bool
    count: int = 1


def messages_of(recorded: Recorded, phases: FlightPhases) -> tuple[LoggedMessage, ...]:
    """Every message that something is wrong, once, the worst first."""
    air = phases.named(*AIRBORNE)
    start, stop = (air[0].start, air[-1].stop) if air else (np.inf, -np.inf)
    times: dict[tuple[str, str], list[float]] = {}
    for time, level, text in _read(recorded):
        times.setdefault((level, text), []).append(time)
    found = []
    for (level, text), every in times.items():
        flown = [time for time in every if start <= time <= stop]
        found.append(LoggedMessage((flown or every)[0], level, text, bool(flown), len(every)))
    return tuple(sorted(found, key=lambda one: (SEVERITIES.index(one.level), one.time)))


def _read(recorded: Recorded) -> Iterator[tuple[float, str, str]]:
    """Time [s], level and text of each."""
    if (said := recorded.tables.get("logged_messages")) is not None:
        levels = said.columns["log_level"].astype(int) - ord("0")
        rows = zip(said.log_time_ns, levels, said.columns["message"].tolist(), strict=True)
        for stamp, level, text in rows:
            if 0 <= level < len(SEVERITIES):
                yield float(stamp - recorded.start_ns) * 1e-9, SEVERITIES[level], text.decode(errors="replace").strip()
    if (errors := recorded.columns("ERR", "Subsys", "ECode")) is not None:
        for time, (subsystem, code) in zip(*errors, strict=True):
            if code:
                name = SUBSYSTEMS.get(int(subsystem), f"subsystem {subsystem:g}")
                yield float(time), "error", f"{name}, error {code:g}"


ARDUCOPTER_MODES = {0: "Stabilize", 1: "Acro", 2: "AltHold", 3: "Auto", 4: "Guided", 5: "Loiter", 6: "RTL", 7: "Circle"}
ARDUCOPTER_MODES |= {9: "Land", 11: "Drift", 13: "Sport", 14: "Flip", 15: "AutoTune", 16: "PosHold", 17: "Brake"}
ARDUCOPTER_MODES |= {18: "Throw", 20: "Guided_NoGPS", 21: "Smart_RTL", 22: "FlowHold", 23: "Follow", 24: "ZigZag"}
PX4_MODES = {0: "Manual", 1: "Altitude", 2: "Position", 3: "Mission", 4: "Hold", 5: "Return", 10: "Acro", 12: "Descend"}
PX4_MODES |= {13: "Termination", 14: "Offboard", 15: "Stabilized", 17: "Takeoff", 18: "Land", 19: "Follow", 21: "Orbit"}
MODE_FIELDS = (
    ("vehicle_status", "nav_state", PX4_MODES),
    ("MODE", "ModeNum", ARDUCOPTER_MODES),
    ("MODE", "Mode", ARDUCOPTER_MODES),
)


@dataclass(frozen=True)
class FlightMode:
    """A flight mode by its name, or its number where that has none here, and when it began [s]."""

    name: str
    start: float


def modes_of(recorded: Recorded) -> tuple[FlightMode, ...]:
    """The flight modes in order of time; empty where none is logged."""
    for topic, column, names in MODE_FIELDS:
        found = recorded.columns(topic, column)
        if found is not None:
            time, numbers = found[0], found[1][:, 0]
            begins = np.flatnonzero(np.diff(numbers, prepend=np.nan) != 0.0)
            return tuple(FlightMode(names.get(int(numbers[k]), f"{numbers[k]:g}"), float(time[k])) for k in begins)
    return ()


def changed_before(modes: tuple[FlightMode, ...], time: float, within: float = 30.0) -> FlightMode | None:
    """The mode at a time [s], where it was changed to up to `within` [s] before; None where it was not.

    30 s: a pilot in a new mode. The first mode was not changed to.
    """
    now = [mode for mode in modes[1:] if mode.start <= time][-1:]
    return now[0] if now and time - now[0].start < within else None
