"""The flight modes that an autopilot was in, from its own messages.

Numbers and names: ArduCopter's parameter FLTMODE1 (ArduPilot's parameter reference), `nav_state` of PX4's message
vehicle_status (PX4's message reference).
"""

from dataclasses import dataclass

import numpy as np

from wrenchgap.learn.health.autopilot_messages import Recorded

ARDUCOPTER = {0: "Stabilize", 1: "Acro", 2: "AltHold", 3: "Auto", 4: "Guided", 5: "Loiter", 6: "RTL", 7: "Circle"}
ARDUCOPTER |= {9: "Land", 11: "Drift", 13: "Sport", 14: "Flip", 15: "AutoTune", 16: "PosHold", 17: "Brake", 18: "Throw"}
ARDUCOPTER |= {20: "Guided_NoGPS", 21: "Smart_RTL", 22: "FlowHold", 23: "Follow", 24: "ZigZag"}
PX4 = {0: "Manual", 1: "Altitude", 2: "Position", 3: "Mission", 4: "Hold", 5: "Return", 10: "Acro", 12: "Descend"}
PX4 |= {13: "Termination", 14: "Offboard", 15: "Stabilized", 17: "Takeoff", 18: "Land", 19: "Follow", 21: "Orbit"}
MESSAGES = (("vehicle_status", "nav_state", PX4), ("MODE", "ModeNum", ARDUCOPTER), ("MODE", "Mode", ARDUCOPTER))


@dataclass(frozen=True)
class FlightMode:
    """A flight mode by its name, or its number where that has none here, and when it began [s]."""

    name: str
    start: float


def modes_of(recorded: Recorded) -> tuple[FlightMode, ...]:
    """The flight modes in order of time; empty where none is logged."""
    for topic, column, names in MESSAGES:
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
