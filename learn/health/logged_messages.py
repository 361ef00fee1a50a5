"""What an autopilot reported to be wrong, in its own words or by its own codes.

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
