"""What the numbers of a topic mean: units, axes and the order of a quaternion, said behind the topic's name.

`parse_source` takes an override to pieces, `/topic.field[columns]*factor:words`; `meaning` reads the words.

    imu=/imu:frd,g                    axes forward-right-down; the accelerometer in units of g
    imu=/imu:yaw=45                   the sensor is mounted turned by 45 deg about z: v_B = R_z(45 deg) v_sensor
    imu=/imu:axes=-yxz                new x is minus the logged y, new y the logged x, new z the logged z
    imu=/imu:gyro.axes=x-yz           the same for one of the vectors of a topic
    rotor_speed=/esc.rpm*0.10472      a factor on everything
    rotor_speed=/table.m:pwm=0..65535 commands from no to full throttle, read as shares of it
    rotor_speed=/table.u:throttle     shares of full throttle; `pwm`: pulse widths [us]; `rpm`: speeds
    commanded=/wrench:Nmm             torques in Nmm
    commanded=/wrench:torque*0.4      a factor on one of the vectors
    imu=/imu:gyro.x*1.05              a factor on one axis of the sensor, before it is turned
    odometry=/odom:ned,frd,mm         world north-east-down, body forward-right-down, lengths in millimetres
    odometry=/odom:wxyz               the quaternion's scalar comes first in the fields x y z w
    imu=/imu:ms                       stamps in milliseconds

A word acts on the vectors that it suits, of all parts of the role: `odometry=/odom:deg` turns the rates of its twist
into rad/s. A vector turns as v_B = R v. Of a pose the body's axes change, R_EB = R_ES R^T, and with `ned` the world's.
"""

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Literal

import numpy as np

from wrenchgap.flight import so3
from wrenchgap.flight.budget import LIMITS
from wrenchgap.flight.errors import UsageError
from wrenchgap.flight.flight import DEGREE, GRAVITY, RPM, Array, SpeedUnit

VECTORS_OF: dict[str, dict[str, slice]] = {
    "wrench": {"force": slice(0, 3), "torque": slice(3, 6)},
    "imu": {"gyro": slice(0, 3), "accel": slice(3, 6)},
    "gyroscope": {"gyro": slice(0, 3)},
    "accelerometer": {"accel": slice(0, 3)},
    "pose": {"position": slice(0, 3), "attitude": slice(3, 7)},
    "twist": {"velocity": slice(0, 3), "rate": slice(3, 6)},
    "acceleration": {"acceleration": slice(0, 3), "angular": slice(3, 6)},
    "rotor_speed": {"speed": slice(None)},
    "tilt": {"tilt": slice(None)},
    "voltage": {"voltage": slice(None)},
}
"""The vectors of a quantity, and their columns."""

UNITS: dict[str, tuple[float, tuple[str, ...]]] = {
    "g": (GRAVITY, ("accel",)),
    "mg": (1e-3 * GRAVITY, ("accel",)),
    "deg": (DEGREE, ("gyro", "rate", "tilt")),
    "rpm": (RPM, ("speed",)),
    "mm": (1e-3, ("position", "velocity", "acceleration")),
    "cm": (1e-2, ("position", "velocity", "acceleration")),
    "Nmm": (1e-3, ("torque",)),
    "mNm": (1e-3, ("torque",)),
    "mN": (1e-3, ("force",)),
    "kgf": (GRAVITY, ("force",)),
    "mV": (1e-3, ("voltage",)),
}
"""Factor to SI, and the vectors that come in this unit."""
COMMANDS: dict[str, SpeedUnit] = {"rpm": "rad/s", "throttle": "normalised", "pwm": "pwm"}
"""Words that say what rotor commands are, whatever their topic is called."""
STAMPS = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}
"""Factor to seconds of stamps that count something else."""
NED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
"""From north-east-down to east-north-up."""
FRD = np.diag([1.0, -1.0, -1.0])
"""From forward-right-down to forward-left-up."""
TURNING = ("force", "torque", "gyro", "accel", "attitude", "velocity", "rate")
"""Vectors that have the body's axes."""
ALL_UNITS = ", ".join([*UNITS, *STAMPS, "throttle", "pwm", "pwm=LOW..HIGH"])
EXPECTED = (
    "expected words out of frd, ned, wxyz, inverse, axes=-yxz, roll=DEG, pitch=DEG, yaw=DEG, VECTOR*FACTOR, "
    f"VECTOR.x*FACTOR, {ALL_UNITS}"
)
LEAST, MOST = 1e-12, 1e12
"""Sizes of a factor: from nanoseconds to hours, and from millinewtons to kilonewtons, with room."""
TURN = 360.0
"""Largest angle of an axis [deg]."""
NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"


@dataclass(frozen=True)
class Word:
    """What a word does to its `vectors`: a factor, factors by axis, or a turn (3, 3); `stamp` is a factor of stamps.

    `zero` is subtracted before. `unit` is what rotor commands are then; empty where the word does not say it.
    """

    vectors: tuple[str, ...]
    scale: float = 1.0
    axis_scales: tuple[float, ...] = (1.0, 1.0, 1.0)
    turn: Array | None = None
    stamp: float = 1.0
    zero: float = 0.0
    unit: SpeedUnit | Literal[""] = ""


@lru_cache(maxsize=256)
def known_word(word: str) -> Word | None:
    """What a word means; None for what is no word."""
    if word in UNITS or word in COMMANDS:
        scale, vectors = UNITS.get(word, (1.0, ("speed",)))
        return Word(vectors, scale=scale, unit=COMMANDS.get(word, ""))
    if ends := re.fullmatch(rf"pwm=({NUMBER})\.\.({NUMBER})", word):
        low, high = float(ends[1]), float(ends[2])
        if not 0.0 < high - low < MOST:
            return None
        return Word(("speed",), scale=1.0 / (high - low), zero=low, unit="normalised")
    if word in STAMPS:
        return Word((), stamp=STAMPS[word])
    if word in ("flu", "enu", "xyzw", "ned"):
        return Word(("position", "attitude", "velocity", "acceleration", *TURNING))
    if word in ("wxyz", "inverse"):
        return Word(("attitude",))
    if match := re.fullmatch(rf"([a-z]+)(?:\.([xyz]))?\*({NUMBER})", word):
        vector, axis, factor = match[1], match[2], float(match[3])
        if vector == "stamp" and not axis:
            return Word((), stamp=factor)
        every = {vector for vectors in VECTORS_OF.values() for vector in vectors}
        if vector not in (TURNING if axis else every) or vector == "attitude":
            return None
        if axis:
            return Word((vector,), axis_scales=tuple(factor if other == axis else 1.0 for other in "xyz"))
        return Word((vector,), scale=factor)
    match = re.fullmatch(r"(?:([a-z]+)\.)?(.*)", word)
    turn = None if match is None else _turn(match[2])
    if match is None or turn is None or (match[1] and match[1] not in TURNING):
        return None
    return Word((match[1],) if match[1] else TURNING, turn=turn)


def _turn(word: str) -> Array | None:
    """The matrix (3, 3) of a word about axes; None for any other."""
    if word == "frd":
        return FRD
    if match := re.fullmatch(rf"(roll|pitch|yaw)=({NUMBER})", word):
        axis = np.eye(3)[("roll", "pitch", "yaw").index(match[1])]
        with np.errstate(over="ignore", invalid="ignore"):  # of an angle that is none, which is refused
            return np.asarray(so3.matrix(so3.exp(np.radians(float(match[2])) * axis)))
    if re.fullmatch(r"axes=(?:[+-]?[xyz]){3}", word):
        rows = re.findall(r"([+-]?)([xyz])", word.removeprefix("axes="))
        if len({axis for _, axis in rows}) == 3:
            return np.array([[(-1.0 if sign == "-" else 1.0) * (axis == c) for c in "xyz"] for sign, axis in rows])
    return None


@dataclass(frozen=True)
class Meaning:
    """The words behind a topic, and the `factor` of everything."""

    words: tuple[str, ...] = ()
    factor: float = 1.0

    def __str__(self) -> str:
        """As it is written behind a topic."""
        factor = "" if self.factor == 1.0 else f"*{self.factor:.10g}"
        return factor + (f":{','.join(self.words)}" if self.words else "")

    @cached_property
    def known(self) -> tuple[Word, ...]:
        """What its words mean."""
        return tuple(found for word in self.words if (found := known_word(word)) is not None)

    @cached_property
    def stamp(self) -> float:
        """Factor of the stamps."""
        return math.prod(word.stamp for word in self.known)

    @property
    def world(self) -> Array:
        """From the log's world to E (3, 3)."""
        return NED if "ned" in self.words else np.eye(3)

    def body(self, vector: str) -> Array:
        """From the log's axes to B (3, 3), of one of the vectors."""
        turn = np.eye(3)
        for word in self.known:
            if word.turn is not None and vector in word.vectors:
                turn = word.turn @ turn
        return turn

    @property
    def turns(self) -> bool:
        """Whether the log's axes are not the body's."""
        return any(word.turn is not None for word in self.known)

    @cached_property
    def command(self) -> SpeedUnit | None:
        """What rotor commands are, where a word says it."""
        return next((word.unit for word in self.known if word.unit), None)

    def axis_scales(self, vector: str) -> Array:
        """Factors (3,) of the axes of one of the vectors, besides `scale`."""
        scales = np.ones(3)
        for word in self.known:
            scales *= word.axis_scales if vector in word.vectors else 1.0
        return scales

    def scale(self, vector: str) -> float:
        """Factor of one of the vectors."""
        own = 1.0 if vector == "attitude" else self.factor
        return math.prod((word.scale for word in self.known if vector in word.vectors), start=own)

    def applied(self, quantity: str, values: Array) -> Array:
        """A quantity's numbers (N, K) in SI and our axes; a twist's are turned where its frame is known."""
        if not self.words and self.factor == 1.0:
            return values
        out = np.array(values, dtype=float)
        for vector, columns in VECTORS_OF[quantity].items():
            if vector == "attitude":
                out[:, columns] = self._attitude(out[:, columns])
                continue
            out[:, columns] -= sum(word.zero for word in self.known if vector in word.vectors)
            out[:, columns] *= self.scale(vector)
            if vector in TURNING:
                out[:, columns] *= self.axis_scales(vector)
            if vector == "position":
                out[:, columns] = out[:, columns] @ self.world.T
            elif vector in TURNING and quantity != "twist":
                out[:, columns] = out[:, columns] @ self.body(vector).T
        return out

    def _attitude(self, xyzw: Array) -> Array:
        """Attitudes (N, 4) with the scalar last, B to E."""
        wxyz = xyzw if "wxyz" in self.words else xyzw[:, [3, 0, 1, 2]]
        if "inverse" in self.words:
            wxyz = wxyz * [1.0, -1.0, -1.0, -1.0]
        count = len(wxyz)
        world, body = (np.tile(_quaternion(m), (count, 1)) for m in (self.world, self.body("attitude").T))
        return np.asarray(so3.multiply(so3.multiply(world, wxyz), body))[:, [1, 2, 3, 0]]


def meaning(text: str, factor: float, value: str, quantities: Iterable[str]) -> Meaning:
    """The words `text` behind a topic that plays `quantities`; `value` is the whole, for the message.

    Raises UsageError for a word that is none, or suits none of the quantities, and for numbers that no sensor has.
    """
    words = tuple(word.strip() for word in text.split(",")) if text.strip() else ()
    vectors = {vector for quantity in quantities for vector in VECTORS_OF[quantity]}
    for word in words:
        found = known_word(word)
        if found is None:
            raise UsageError(f"topic {value!r}: {word!r} means nothing; {EXPECTED}")
        if found.vectors and not vectors & set(found.vectors):
            about = f"is about {', '.join(found.vectors)}, and this role has {', '.join(sorted(vectors))}"
            raise UsageError(f"topic {value!r}: {word!r} {about}")
    meant = Meaning(words, factor)
    _check_numbers(meant, value, vectors)
    return meant


def _check_numbers(found: Meaning, value: str, vectors: Iterable[str]) -> None:
    """Raise UsageError for factors, also of several words together, and angles that no sensor has."""
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        scales = [found.scale(vector) * found.axis_scales(vector) for vector in vectors]
        factors = np.concatenate([[found.stamp, found.factor], *scales])
        if not np.all((np.abs(factors) >= LEAST) & (np.abs(factors) <= MOST)):
            worst = factors[np.argmax(np.abs(np.log(np.abs(factors))))]
            raise UsageError(f"topic {value!r}: its factors come to {worst:g}; expected {LEAST:g} to {MOST:g}")
    for word in found.words:
        angle = re.search(r"(?:roll|pitch|yaw)=(.*)", word)
        if angle and not abs(float(angle[1])) <= TURN:
            raise UsageError(f"topic {value!r}: {word!r} is no angle; expected -{TURN:g} to {TURN:g} degrees")


def axes_word(matrix: Array) -> str:
    """The word for a signed permutation (3, 3) with v_B = matrix v_log; `frd` where it is that."""
    if np.array_equal(matrix, FRD):
        return "frd"
    columns = np.argmax(np.abs(matrix), axis=1)
    letters = (("-" if row[k] < 0 else "") + "xyz"[k] for row, k in zip(matrix, columns, strict=True))
    return f"axes={''.join(letters)}"


def _quaternion(matrix: Array) -> Array:
    """Quaternion (4,) of a rotation; raises UsageError where axes mirror, which an attitude cannot."""
    if np.linalg.det(matrix) < 0.0:
        raise UsageError("axes of an attitude must be right-handed; e.g. axes=y-xz, frd")
    return np.asarray(so3.from_matrix(matrix))


def topic_of(value: str) -> str:
    """The topic alone."""
    return re.split(r"[.\[*:]", value, maxsplit=1)[0]


@dataclass(frozen=True)
class Said:
    """An override in its pieces: `/topic.field[columns]*factor:words`."""

    topic: str
    field: str | None
    columns: tuple[int, ...] | None
    factor: float
    words: str


def parse_source(value: str) -> Said:
    """Split `/topic.field[columns]*factor:words`; raises `UsageError` where it is not of this form."""
    form = rf"([^.\[\]*:]+)(?:\.([\w.]+))?(?:\[([\d,:\s]+)\])?(?:\*({NUMBER}))?(?::(.+))?"
    match = re.fullmatch(form, value.strip())
    if match is None:
        raise UsageError(
            f"topic {value!r}: expected /topic, /topic.field, /topic[0:6] or /topic[3,2,1,0], with *FACTOR or :WORDS "
            "behind it, as in /imu:frd,g"
        )
    topic, place, columns, factor, words = match.groups()
    return Said(topic, place, None if columns is None else _columns(columns, value), float(factor or 1.0), words or "")


def _columns(text: str, value: str) -> tuple[int, ...]:
    chosen: list[int] = []
    for piece in text.split(","):
        bounds = re.fullmatch(r"\s*(\d{1,5})\s*(?:(:)\s*(\d{1,5})\s*)?", piece)
        if bounds is None:
            raise UsageError(
                f"topic {value[:80]!r}: columns {piece.strip()[:80]!r}; expected numbers below 100,000 or "
                "first:last+1, as in [0:6]"
            )
        first = int(bounds[1])
        chosen += range(first, int(bounds[3]) if bounds[2] else first + 1)
        if len(chosen) > LIMITS.array_numbers:
            raise UsageError(f"topic {value[:80]!r}: selects more than {LIMITS.array_numbers} columns")
    if not chosen:
        raise UsageError(f"topic {value!r}: selects no column")
    return tuple(chosen)
