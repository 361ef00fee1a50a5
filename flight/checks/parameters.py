"""What an autopilot's parameters say of the log itself: changed on the way, or those of a simulation."""

import re
from collections.abc import Iterator

from wrenchgap.flight.check import Check
from wrenchgap.flight.flight import Flight

MATTERS = re.compile(
    r"CA_.*|THR_MDL_FAC|MC_.*|PWM_.*|FRAME.*|SERVO\d+_.*|MOT_(?!THST_HOVER).*|ATC_.*|BAT.*|SENS_BOARD.*|AHRS_TRIM.*"
    r"|IMU_.*|INS_.*FILTER"
)
"""Parameters that models, gains and checks are made of. ArduPilot learns `MOT_THST_HOVER` as it flies."""


def changed_parameters(flight: Flight, most: int = 3) -> Iterator[Check]:
    """A parameter that was changed while the log was written: its last value is taken for all of it."""
    autopilot = flight.autopilot
    found = [] if autopilot is None else [one for one in autopilot.changes if MATTERS.fullmatch(one.name)]
    if not found:
        return
    listed = ", ".join(
        f"{c.name} from {c.before:g} to {c.after:g} at {(c.time_ns - flight.start_ns) * 1e-9:.1f} s"
        for c in found[:most]
    )
    more = f" and {len(found) - most} more" if len(found) > most else ""
    ask = "the last values are taken for the whole log: keep to one side of it with --between"
    yield Check("parameters", "warn", f"Changed while the log was written: {listed}{more}; {ask}.")


def simulated(flight: Flight) -> Iterator[Check]:
    """Whether the sensors were a simulator's."""
    autopilot = flight.autopilot
    if autopilot is None:
        return
    if autopilot.parameters.get("SYS_HITL", 0) > 0:
        yield Check("parameters", "warn", "SYS_HITL is set: hardware in the loop, whose motion is that of a simulator.")
    elif "SITL" in autopilot.hardware.upper():
        yield Check("parameters", "warn", f"{autopilot.hardware}: the motion is that of a simulator.")
