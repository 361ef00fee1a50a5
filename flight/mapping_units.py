"""What the numbers of a topic mean: units, axes and the order of a quaternion, said behind the topic's name.

`parse_source` takes an override to pieces, `/topic.field[columns]*factor:words`; `meaning` reads the words.

    imu=/imu:frd,g                    axes forward-right-down; the accelerometer in units of g
    imu=/imu:yaw=45                   the sensor is mounted turned by 45 deg about z: v_B = R_z(45 deg) v_sensor
    imu=/imu:axes=-yxz                new x is minus the logged y, new y the logged x, new z the logged z
    imu=/imu:gyro.axes=x-yz           the same for one of the vectors of a topic
    rotor_speed=/esc.rpm*0.10472      a factor on everything
    commanded=/wrench:Nmm             torques in Nmm
    commanded=/wrench:torque*0.4      a factor on one of the vectors
    imu=/imu:gyro.x*1.05              a factor on one axis of the sensor, before it is turned
    odometry=/odom:ned,frd,mm         world north-east-down, body forward-right-down, lengths in millimetres
    odometry=/odom:wxyz               the quaternion's scalar comes first in the fields x y z w
    imu=/imu:ms                       stamps in milliseconds

A word acts on the vectors that it suits, of all parts of the role: `odometry=/odom:deg` turns the rates of its twist
into rad/s. A vector turns as v_B = R v. Of a pose the body's axes change, R_EB = R_ES R^T, and with `ned` the world's.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from wrenchgap.flight import so3
from wrenchgap.flight.budget import LIMITS
from wrenchgap.flight.errors import UsageError
from wrenchgap.flight.flight import Array

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
    "g": (9.80665, ("accel",)),
    "mg": (9.80665e-3, ("accel",)),
    "deg": (np.pi / 180.0, ("gyro", "rate", "tilt")),
    "rpm": (np.pi / 30.0, ("speed",)),
    "mm": (1e-3, ("position", "velocity", "acceleration")),
    "cm": (1e-2, ("position", "velocity", "acceleration")),
    "Nmm": (1e-3, ("torque",)),
    "mNm": (1e-3, ("torque",)),
    "mN": (1e-3, ("force",)),
    "kgf": (9.80665, ("force",)),
    "mV": (1e-3, ("voltage",)),
}
"""Factor to SI, and the vectors that come in this unit."""
STAMPS = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}
"""Factor to seconds of stamps that count something else."""
NED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
"""From north-east-down to east-north-up."""
FRD = np.diag([1.0, -1.0, -1.0])
"""From forward-right-down to forward-left-up."""
TURNING = ("force", "torque", "gyro", "accel", "attitude", "velocity", "rate")
"""Vectors that have the body's axes."""
ALL_UNITS = ", ".join([*UNITS, *STAMPS])
EXPECTED = (
    "expected words out of frd, ned, wxyz, inverse, axes=-yxz, roll=DEG, pitch=DEG, yaw=DEG, VECTOR*FACTOR, "
    f"VECTOR.x*FACTOR, {ALL_UNITS}"
)
LEAST, MOST = 1e-12, 1e12
"""Sizes of a factor: from nanoseconds to hours, and from millinewtons to kilonewtons, with room."""
TURN = 360.0
"""Largest angle of an axis [deg]."""
NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_AXIS_FACTOR = re.compile(rf"([a-z]+)\.([xyz])\*({NUMBER})")


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
    def stamp(self) -> float:
        """Factor of the stamps."""
        scale = 1.0
        for word in self.words:
            vector, _, factor = word.partition("*")
            scale *= float(factor) if vector == "stamp" and factor else STAMPS.get(word, 1.0)
        return scale

    @property
    def world(self) -> Array:
        """From the log's world to E (3, 3)."""
        return NED if "ned" in self.words else np.eye(3)

    def body(self, vector: str) -> Array:
        """From the log's axes to B (3, 3), of one of the vectors."""
        turn = np.eye(3)
        for word in self.words:
            own, rest = _split(word)
            if not own or own == vector:
                turn = _turn(rest) @ turn
        return turn

    @property
    def turns(self) -> bool:
        """Whether the log's axes are not the body's."""
        return any(word == "frd" or "=" in word for word in self.words)

    def axis_scales(self, vector: str) -> Array:
        """Factors (3,) of the axes of one of the vectors, besides `scale`."""
        scales = np.ones(3)
        for word in self.words:
            found = _AXIS_FACTOR.fullmatch(word)
            if found and found[1] == vector:
                scales["xyz".index(found[2])] *= float(found[3])
        return scales

    def scale(self, vector: str) -> float:
        """Factor of one of the vectors."""
        scale = 1.0 if vector == "attitude" else self.factor
        for word in self.words:
            unit, named = UNITS.get(word), word.partition("*")
            scale *= unit[0] if unit is not None and vector in unit[1] else 1.0
            scale *= float(named[2]) if named[1] and named[0] == vector else 1.0
        return scale

    def applied(self, quantity: str, values: Array) -> Array:
        """A quantity's numbers (N, K) in SI and our axes; a twist's are turned where its frame is known."""
        if not self.words and self.factor == 1.0:
            return values
        out = np.array(values, dtype=float)
        for vector, columns in VECTORS_OF[quantity].items():
            if vector == "attitude":
                out[:, columns] = self._attitude(out[:, columns])
                continue
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
        suits = suited(word)
        if suits is None:
            raise UsageError(f"topic {value!r}: {word!r} means nothing; {EXPECTED}")
        if suits and not vectors & set(suits):
            raise UsageError(
                f"topic {value!r}: {word!r} is about {', '.join(suits)}, and this role has {', '.join(sorted(vectors))}"
            )
    found = Meaning(words, factor)
    _check_numbers(found, value, vectors)
    return found


def _check_numbers(found: Meaning, value: str, vectors: Iterable[str]) -> None:
    """Raise UsageError for factors, also of several words together, and angles that no sensor has."""
    with np.errstate(over="ignore", invalid="ignore"):
        scales = [found.scale(vector) * found.axis_scales(vector) for vector in vectors]
    factors = np.concatenate([[found.stamp, found.factor], *scales])
    if not np.all((np.abs(factors) >= LEAST) & (np.abs(factors) <= MOST)):
        raise UsageError(f"topic {value!r}: its factors come to {_worst(factors):g}; expected {LEAST:g} to {MOST:g}")
    for word in found.words:
        name, _, angle = _split(word)[1].partition("=")
        if name in ("roll", "pitch", "yaw") and not abs(float(angle)) <= TURN:
            raise UsageError(f"topic {value!r}: {word!r} is no angle; expected -{TURN:g} to {TURN:g} degrees")


def _worst(factors: Array) -> float:
    """The factor that is furthest from one."""
    with np.errstate(divide="ignore"):
        return float(factors[np.argmax(np.abs(np.log(np.abs(factors))))])


def suited(word: str) -> tuple[str, ...] | None:
    """The vectors that a word is about, () for stamps; None for what is no word."""
    if word in UNITS:
        return UNITS[word][1]
    if word in STAMPS or re.fullmatch(rf"stamp\*{NUMBER}", word):
        return ()
    if word in ("flu", "enu", "xyzw", "ned"):
        return ("position", "attitude", "velocity", "acceleration", *TURNING)
    if word in ("wxyz", "inverse"):
        return ("attitude",)
    scaled = re.fullmatch(rf"([a-z]+)\*{NUMBER}", word)
    every = {vector for vectors in VECTORS_OF.values() for vector in vectors}
    if scaled:
        return (scaled[1],) if scaled[1] in every - {"attitude"} else None
    axis = _AXIS_FACTOR.fullmatch(word)
    if axis:
        return (axis[1],) if axis[1] in {*TURNING} - {"attitude"} else None
    own, rest = _split(word)
    if own and own not in TURNING:
        return None
    axes = re.fullmatch(r"axes=((?:[+-]?[xyz]){3})", rest)
    if axes and len(set(re.sub(r"[+-]", "", axes[1]))) < 3:
        return None
    if rest == "frd" or axes or re.fullmatch(rf"(roll|pitch|yaw)={NUMBER}", rest):
        return (own,) if own else TURNING
    return None


def axes_word(matrix: Array) -> str:
    """The word for a signed permutation (3, 3) with v_B = matrix v_log; `frd` where it is that."""
    if np.array_equal(matrix, FRD):
        return "frd"
    letters = []
    for row in matrix:
        k = int(np.argmax(np.abs(row)))
        letters.append(("-" if row[k] < 0 else "") + "xyz"[k])
    return f"axes={''.join(letters)}"


def _turn(word: str) -> Array:
    """The matrix (3, 3) of a word about axes; of any other word the identity."""
    name, _, value = word.partition("=")
    if name == "frd":
        return FRD
    if name == "axes":
        rows = re.findall(r"([+-]?)([xyz])", value)
        return np.array([[(-1.0 if sign == "-" else 1.0) * (axis == c) for c in "xyz"] for sign, axis in rows])
    if name not in ("roll", "pitch", "yaw"):
        return np.eye(3)
    axis = np.eye(3)[("roll", "pitch", "yaw").index(name)]
    return np.asarray(so3.matrix(so3.exp(np.radians(float(value)) * axis)))


def _quaternion(matrix: Array) -> Array:
    """Quaternion (4,) of a rotation; raises UsageError where axes mirror, which an attitude cannot."""
    if np.linalg.det(matrix) < 0.0:
        raise UsageError("axes of an attitude must be right-handed; e.g. axes=y-xz, frd")
    return np.asarray(so3.from_matrix(matrix))


def _split(word: str) -> tuple[str, str]:
    """`gyro.yaw=45` as ("gyro", "yaw=45"), `yaw=45` as ("", "yaw=45")."""
    match = re.fullmatch(r"(?:([a-z]+)\.)?(.*)", word)
    return ("", word) if match is None else (match[1] or "", match[2])


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
