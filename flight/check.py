"""What a check finds, and times that are left out: both travel with a flight into every result."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Literal

from wrenchgap.flight.errors import LogError, UsageError

Level = Literal["ok", "warn", "bad"]

NAMES: dict[str, str] = {
    "roles": "which roles are played",
    "vehicles": "whether the log, and all that `changed` compares, are of one vehicle",
    "accelerometer-unit": "the unit of the accelerometer, and whether it has gravity in it",
    "body-frame": "the axes of the IMU against the attitude",
    "inertial-frame": "the attitude: frames, order of the quaternion",
    "gyroscope": "the unit of the gyroscope, and whether it shows the attitude's motion",
    "gyroscope-scale": "the scale of the gyroscope against the attitude, axis by axis",
    "accelerometer-scale": "the accelerometer against gravity and the odometry's acceleration, axis by axis",
    "clipped": "flat tops of the IMU, of all rotors at one value, or of a rotor or an arm where others go on",
    "odometry-rate": "the unit of the odometry's own body rates",
    "velocity": "the odometry's velocity against its position",
    "odometry-scale": "the unit of the odometry against the accelerometer",
    "rotor-speed-unit": "the unit of rotor speeds",
    "tilt-unit": "the unit of tilt angles",
    "not-measured": "axes of the IMU without a reading",
    "constant-channel": "channels that never change",
    "frozen": "channels that stand still for a while in mid-flight",
    "spikes": "samples beyond what is physically possible",
    "gaps": "stretches without samples",
    "jitter": "periods that vary",
    "damaged": "whether the file could be read whole",
    "parameters": "parameters that were changed while the log was written, or are those of a simulation",
    "repeated": "whether a part of the recording stands in it twice",
    "left-out": "samples that the reader left out",
    "clock": "stamps against the times of recording",
    "clock-unit": "the unit of the stamps",
    "clock-jump": "stamps that jump in mid-flight",
    "early-response": "whether the motion comes before its commands",
    "rate": "whether IMU and commands are fast enough for the filter, and the IMU as fast as its stamps",
    "wrench-frame": "the axes of the commanded wrench against the motion",
    "force-unit": "the unit of the commanded force",
    "torque-unit": "the unit of the commanded torque",
    "weight": "the force that carries the vehicle against its weight",
    "actuation": "the wrench that the model makes of the logged actuators against the commanded one",
    "actuators": "how many rotors and tilting arms",
    "motion": "whether the vehicle moved when its motors were commanded to move it",
    "frame": "where the rotors are against the parameters of the autopilot",
    "rotors": "order and spin of the rotors, and the sign of tilt, against the motion or the commanded wrench",
    "inertia": "the inertia against mass and arms",
    "kappa": "the drag torque per thrust against the rotor's radius",
    "thrust-coefficient": "the rotors' c_f against their radius",
    "crash": "impacts and crashes, which are left out",
    "saturation": "commands beyond the limits of the model file",
    "model": "whether the log can be used with the model at all",
}
"""Every check, in the spelling of `--accept`, and what it looks at; docs/checks.md has a row for each."""

UNPOWERED = "this log holds no powered flight."
"""How a reader ends its note of a log whose motors never turned."""
HOPELESS = ("model",)
"""Checks that cannot be accepted: nothing can be computed, whatever the user knows."""


@dataclass(frozen=True)
class Check:
    """What was looked at (`name`, of `NAMES`), how it is (`level`), in words, and the option that mends it.

    `accepted` says that the user knows of what is bad (`--accept NAME`).
    """

    name: str
    level: Level
    words: str
    mend: str | None = None
    accepted: bool = False

    @property
    def stops(self) -> bool:
        """Whether nothing may be computed from this log."""
        return self.level == "bad" and not self.accepted

    @property
    def remedy(self) -> str:
        """The option that mends it, or accepts it; empty where nothing does."""
        if self.name in HOPELESS and not self.mend:
            return ""
        accept = f"--accept {self.name}"
        return f"read it with {self.mend}, or take it as it is with {accept}" if self.mend else f"or say {accept}"


@dataclass(frozen=True)
class Finding:
    """A check of the flight of this name, as a note of every result that was computed from it."""

    flight: str
    check: Check


@dataclass(frozen=True)
class TimeLeftOut:
    """Times [s] of a flight that are not used although the log has them, and why; infinite at an open end."""

    flight: str
    start: float
    stop: float
    why: str


def accepted_names(names: Iterable[str]) -> tuple[str, ...]:
    """Names of checks, however they are spelt; raises UsageError for one that there is not."""
    found = [name.strip().lower().replace(" ", "-").replace("_", "-") for name in names]
    wrong = [name for name in found if name not in NAMES]
    if wrong:
        raise UsageError(f"--accept {wrong[0]}: no check is called so; checks: {', '.join(NAMES)}")
    return tuple(dict.fromkeys(found))


def accepting(checks: Iterable[Check], accept: Iterable[str]) -> tuple[Check, ...]:
    """The checks, with those accepted whose names are in `accept`."""
    names = set(accept)
    return tuple(replace(c, accepted=True) if c.name in names and c.level != "ok" else c for c in checks)


def stop_where_bad(where: str, checks: Iterable[Check]) -> None:
    """Raise LogError, in one line, for the first check that is bad and not accepted; others are counted."""
    bad = [check for check in checks if check.stops]
    if not bad:
        return
    others = list(dict.fromkeys(check.name for check in bad[1:] if check.name != bad[0].name))
    more = f" (also bad: {', '.join(others)}; see `wrenchgap inspect`)" if others else ""
    raise LogError(f"{where}: {bad[0].name}: {bad[0].words.rstrip('. ')}; {bad[0].remedy}{more}")
