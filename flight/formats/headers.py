"""What the header of a table means: quantities, axes and units by the names of columns (docs/formats.md).

A header is a name, an axis or number, and perhaps a unit, which stands in brackets or at the end: `gyro_x [deg/s]`,
`gyro_x_dps`, `gyroX`. Names are compared without regard to capitals and punctuation. Words before a known name must be
known as well (`imu_gyro_x`, `ref_pos_z`), so that a payload's position is not taken for the vehicle's.
Columns whose header is known become topics that play roles (`flight.formats.named_columns`).

Sources of what firmwares call theirs: the log variables' descriptions in bitcraze/crazyflie-firmware
(`stateEstimate.pitch` is "legacy CF2 body coordinate system, where pitch is inverted"; `motor.m1` "[0 - UINT16_MAX]");
betaflight/blackbox-tools, whose `blackbox_decode` writes rates and accelerations as they are logged unless told
otherwise.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from wrenchgap.flight.budget import LIMITS
from wrenchgap.flight.flight import DEGREE, GRAVITY, RPM

UNITS: dict[str, dict[str, float]] = {
    "time": {"s": 1.0, "sec": 1.0, "seconds": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9},
    "rate": {"rad s": 1.0, "rads": 1.0, "radps": 1.0, "deg s": DEGREE, "degs": DEGREE, "dps": DEGREE},
    "acceleration": {
        **dict.fromkeys(("m s2", "m s 2", "m s s", "mps2", "mss", "ms2"), 1.0),
        "g": GRAVITY,
        "mg": 1e-3 * GRAVITY,
        "counts": 1.0,
    },
    "length": {"m": 1.0, "cm": 1e-2, "mm": 1e-3},
    "speed": {"m s": 1.0, "mps": 1.0, "cm s": 1e-2, "mm s": 1e-3, "km h": 1.0 / 3.6},
    "angle": {"rad": 1.0, "deg": DEGREE, "degrees": DEGREE, "deg nose up": -DEGREE},
    "number": {},
    "force": {"n": 1.0, "mn": 1e-3},
    "torque": {"nm": 1.0, "n m": 1.0, "nmm": 1e-3, "mnm": 1e-3},
    "rotor": {"rad s": 1.0, "rads": 1.0, "radps": 1.0, "rpm": RPM, "krpm": 1e3 * RPM, "hz": 2.0 * np.pi},
    "tilt": {"rad": 1.0, "deg": DEGREE},
    "voltage": {"v": 1.0, "volt": 1.0, "mv": 1e-3, "m v": 1e-3},
}
"""Factors to SI by quantity; "/", "^" and "*" of a unit are read as blanks."""
OTHER_ROTOR_UNITS = {
    **dict.fromkeys(("pwm", "us"), "pwm"),
    **dict.fromkeys(("normalised", "normalized", "norm"), "normalised"),
    "of 65535": "of 65535",
}
"""Units of rotor commands that are no speeds."""

XYZ, WXYZ = "xyz", "wxyz"
NAMES: tuple[tuple[str, str, str, str], ...] = (
    ("time", "time", "", "time t timestamp stamp seconds sec secs elapsed elapsed_time time_stamp timeus log_time"),
    ("rotor", "rotor", "number", "motor rotor rotor_speed motor_speed esc omega w m rpm pwm throttle motor_cmd"),
    ("rotor", "rotor", "number", "motor_m motor_motor_m"),
    ("rotor", "rotor", "number", "motor_command motor_rpm rotor_rpm esc_rpm motor_pwm esc_pwm motor_throttle"),
    ("tilt", "tilt", "number", "tilt tilt_angle servo servo_angle arm_angle alpha"),
    ("est position", "length", XYZ, "state_estimate"),
    ("est velocity", "speed", XYZ, "state_estimate_v"),
    ("est acceleration", "acceleration", XYZ, "state_estimate_a"),
    ("est orientation", "number", WXYZ, "state_estimate_q"),
    ("est roll", "angle", "", "state_estimate_roll stabilizer_roll"),
    ("est pitch", "angle", "", "state_estimate_pitch stabilizer_pitch"),
    ("est yaw", "angle", "", "state_estimate_yaw stabilizer_yaw"),
    ("ref position", "length", XYZ, "ctrltarget"),
    ("gyro", "rate", XYZ, "gyro_adc"),
    ("acc", "acceleration", XYZ, "acc_smooth"),
    ("gyro", "rate", XYZ, "gyro gyr gyroscope angular_velocity ang_vel angvel omega body_rate w g"),
    ("acc", "acceleration", XYZ, "acc accel accelerometer linear_acceleration specific_force acceleration a"),
    ("position", "length", XYZ, "position pos translation p"),
    ("position", "length", "bare", ""),
    ("velocity", "speed", XYZ, "velocity vel linear_velocity v"),
    ("orientation", "number", WXYZ, "orientation quaternion quat attitude rotation q"),
    ("roll", "angle", "", "roll phi"),
    ("pitch", "angle", "", "pitch theta"),
    ("yaw", "angle", "", "yaw psi heading"),
    ("force", "force", XYZ, "force wrench_force f thrust"),
    ("torque", "torque", XYZ, "torque moment tau wrench_torque t"),
    ("voltage", "voltage", "", "voltage battery vbat battery_voltage bat_voltage battery_volt"),
    ("voltage", "voltage", "", "pm_vbat vbat_latest"),
)
"""Field, quantity, axes and spellings, which are words joined by `_`; what is spelt out more comes first."""

REFERENCE = frozenset({"ref", "reference", "des", "desired", "setpoint", "sp", "target"})
KNOWN = REFERENCE | frozenset(
    {"imu", "odom", "odometry", "state", "vehicle", "body", "pose", "twist", "mocap", "vicon", "est", "estimate", "cmd"}
    | {"command", "commanded", "wrench", "drone", "uav", "quad", "world", "local", "linear", "angular", "ground"}
    | {"truth", "header", "sensor", "battery", "actuators", "actuator", "att", "pwr", "log", "cf", "crazyflie"}
)
"""Words that may stand before a name."""
CRAZYFLIE, BLACKBOX = "Crazyflie", "Betaflight or INAV"
FIRMWARE_UNITS: dict[str, tuple[str, str]] = {
    **dict.fromkeys(("motor_m", "motor_motor_m"), (CRAZYFLIE, "of 65535")),
    **dict.fromkeys(("state_estimate", "ctrltarget"), (CRAZYFLIE, "m")),
    "state_estimate_v": (CRAZYFLIE, "m s"),
    "state_estimate_a": (CRAZYFLIE, "g"),
    **dict.fromkeys(("state_estimate_roll", "stabilizer_roll"), (CRAZYFLIE, "deg")),
    **dict.fromkeys(("state_estimate_pitch", "stabilizer_pitch"), (CRAZYFLIE, "deg nose up")),
    **dict.fromkeys(("state_estimate_yaw", "stabilizer_yaw"), (CRAZYFLIE, "deg")),
    "pm_vbat": (CRAZYFLIE, "v"),
    "gyro_adc": (BLACKBOX, "deg s"),
    "acc_smooth": (BLACKBOX, "counts"),
    "vbat_latest": (BLACKBOX, "raw"),
}
"""Names that one firmware alone has, and the unit in which it logs them, where the header states none."""


Names = tuple[list[str], ...]
_SPLIT: tuple[tuple[str, str, str, Names], ...] = tuple(
    (field, quantity, axes, tuple(name.split("_") for name in sorted(spelled.split(), key=len, reverse=True)))
    for field, quantity, axes, spelled in NAMES
)
"""The same with names as words, the longest first."""
_BARE = tuple(entry for entry in _SPLIT if entry[2] == "bare")
_SPELLED = {
    last: tuple(entry for entry in _SPLIT if entry[2] == "bare" or any(name[-1] == last for name in entry[3]))
    for last in {name[-1] for entry in _SPLIT for name in entry[3]}
}
"""Those that a last word leaves: a table may have a hundred thousand columns."""


@dataclass(frozen=True)
class Meaning:
    """Of one column: `field` ("gyro", "ref position", ...), place along it, factor to SI, unit if one is stated.

    `firmware` is the one whose name it is, where no other has it; then the unit may be what this firmware logs.
    """

    field: str
    index: int
    factor: float
    unit: str
    firmware: str = ""


@lru_cache(maxsize=4096)
def meaning(header: str) -> Meaning | None:
    """What a column holds, or None where its header is not known."""
    if len(header) > LIMITS.header_letters:
        return None
    name, bracketed = _split(header)
    for words, index in _indexed(name):
        for size in range(len(words) + 1):
            for found in _named(words[:size], words[size:], index, bracketed):
                return found
    return None


def _split(header: str) -> tuple[list[str], str | None]:
    """Lower-case words, and the unit in brackets."""
    name, unit = header.strip(), None
    if name.endswith(("]", ")")):
        inner = name[:-1]
        first = max(inner.rfind("]"), inner.rfind(")"), 0)
        for at in range(first, len(inner) - 1):  # the first bracket that the last one closes and that holds no number
            if inner[at] in "[(" and not inner[at + 1].isdecimal():
                name, unit = inner[:at].rstrip(), inner[at + 1 :]
                break
    spaced = re.sub(r"([a-z])([A-Z])", r"\1 \2", name)
    return [word.lower() for word in re.split(r"[^A-Za-z0-9µ]+", spaced) if word], unit


def _indexed(words: list[str]) -> Iterator[tuple[list[str], str]]:
    """The words with an axis or number taken out of them, wherever one may be; without one last."""
    for place in range(len(words) - 1, -1, -1):
        word, rest = words[place], (words[:place], words[place + 1 :])
        if re.fullmatch(r"[wxyz]|\d+", word) and (place or word in "xyz"):
            yield [*rest[0], *rest[1]], word
        elif match := re.fullmatch(r"([a-zµ]+?)([wxyz]|\d+)", word):
            yield [*rest[0], match[1], *rest[1]], match[2]
    if words:
        yield words, ""


def _named(words: list[str], unit: list[str], index: str, bracketed: str | None) -> Iterator[Meaning]:
    """Meanings of a name whose last words are `unit`."""
    if unit and bracketed is not None:
        return
    stated = " ".join(unit) if bracketed is None else " ".join(re.split(r"[^\wµ]+", bracketed.lower())).strip()
    for name, quantity, axes, spelled in _SPELLED.get(words[-1] if words else "", _BARE):
        found = _before(words, spelled, bare=axes == "bare")
        place = _place(index, axes)
        if found is None or place is None or not found[0] <= KNOWN:
            continue
        prefix, spelling = found
        if axes == "" and name == "time" and prefix:
            continue
        firmware, usual = FIRMWARE_UNITS.get(spelling, ("", ""))
        factor = _factor(quantity, stated or usual, words)
        if factor is not None:
            free = name in ("rotor", "tilt", "voltage", "time") or name.startswith(("est ", "ref "))
            yield Meaning("ref " * (bool(prefix & REFERENCE) and not free) + name, place, *factor, firmware)


def _before(words: list[str], spelled: Names, bare: bool) -> tuple[frozenset[str], str] | None:
    """The words before a known name, and its spelling; None where they do not end in one. A bare axis has no name."""
    if bare:
        return (frozenset(words), "") if not set(words) - KNOWN else None
    for parts in spelled:
        if words[-len(parts) :] == parts:
            return frozenset(words[: -len(parts)]), "_".join(parts)
    return None


def _place(index: str, axes: str) -> int | None:
    """Where along a field of these axes an index is; None where it cannot be."""
    if axes == "":
        return 0 if not index else None
    if axes == "number":
        return int(index) if index.isdigit() else None
    letters = XYZ if axes == "bare" else axes
    if index.isdigit() and axes != "bare":
        return int(index) if int(index) < len(axes) else None
    return letters.index(index) if index and index in letters else None


def _factor(quantity: str, stated: str, words: list[str]) -> tuple[float, str] | None:
    """Factor and unit; "" where none is stated, None where the stated one does not belong to the quantity."""
    if quantity == "rotor" and not stated:
        spelt = (("rpm", "rpm"), ("pwm", "pwm"), ("throttle", "normalised"))
        stated = next((unit for word, unit in spelt if word in words), "")
    if quantity == "rotor" and stated in OTHER_ROTOR_UNITS:
        return 1.0, OTHER_ROTOR_UNITS[stated]
    if not stated:
        return 1.0, ""
    known = UNITS[quantity].get(stated)
    return None if known is None else (known, stated)


def listed(names: Sequence[str], longest: int = 100, most: int = 12) -> str:
    """Names for a sentence: the first `most`, each to its `longest` letter, and how many more there are."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return f"{', '.join(f'{name:.{longest}}' for name in names[:most])}{more}"
