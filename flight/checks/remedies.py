"""The option that mends what a check found: the mapping as it is, with a word more."""

from __future__ import annotations

import shlex
from collections.abc import Sequence

from wrenchgap.flight.flight import Flight
from wrenchgap.flight.mapping_units import UNITS, Meaning

ACCELEROMETER_UNITS = {word: scale for word, (scale, vectors) in UNITS.items() if vectors == ("accel",)}


def option(flight: Flight, words: str, *parts: str) -> str:
    """`--topic` options that add words to what these parts (or roles of one part) come from.

    Parts of an odometry that come from one topic share one option.
    """
    found = {part: _source(flight, part) for part in parts}
    if set(parts) == {"pose", "twist"} and found["pose"] == found["twist"]:
        found = {"odometry": found["pose"]}
    if parts == ("imu",) and not {"gyroscope", "accelerometer"}.isdisjoint(flight.mapping):
        found = {part: _source(flight, part) for part in _sensors(words)}
    return " ".join(f"--topic {shlex.quote(f'{part}={_with(source, words)}')}" for part, source in found.items())


def turns(flight: Flight, *parts: str) -> bool:
    """Whether a word behind the topic of one of these parts turns its axes."""
    words = ",".join(flight.mapping.get(part, "").partition(":")[2] for part in parts).split(",")
    return Meaning(tuple(words)).turns


def _sensors(words: str) -> tuple[str, ...]:
    """Which of the two sensors of an IMU the words are about: a unit is that of one, axes are those of both."""
    both, first = ("gyroscope", "accelerometer"), words.partition(",")[0]
    if first in ACCELEROMETER_UNITS or first.startswith("accel"):
        return both[1:]
    return both[:1] if first == "deg" or first.startswith("gyro") else both


def _source(flight: Flight, part: str) -> str:
    if part in flight.mapping:
        return flight.mapping[part]
    if part in ("gyroscope", "accelerometer") and "imu" in flight.mapping:
        return flight.mapping["imu"]
    role = {"pose": "odometry", "twist": "odometry", "rotor_speed": "actuators", "tilt": "actuators"}.get(part, part)
    series = flight.series().get(role)
    return "/topic" if series is None else series.topic.split(" + ")[-1 if part in ("twist", "rotor_speed") else 0]


def _with(source: str, words: str) -> str:
    known = source.partition(":")[2].split(",")
    if words.startswith("accel*") and any(_scales(word) for word in known):
        return _rescaled(source.partition(":")[0], known, float(words.removeprefix("accel*")))
    if words.startswith("*"):
        return source.replace(":", f"{words}:", 1) if ":" in source else f"{source}{words}"
    fresh = [word for word in words.split(",") if word not in known or "=" in word or "*" in word]
    # what is said already and says the same again was wrong: the sensor is not turned after all
    if not fresh and words in known:
        left = [word for word in known if word != words]
        return source.partition(":")[0] + (f":{','.join(left)}" if left else "")
    return f"{source}{',' if ':' in source else ':'}{','.join(fresh)}"


def _scales(word: str) -> bool:
    return word in ACCELEROMETER_UNITS or word.startswith("accel*")


def _rescaled(topic: str, known: Sequence[str], by: float, one: float = 0.05) -> str:
    """The source with one factor in the place of the words that scale the accelerometer; none where that is about one.

    The specific force of a flight is its weight's within some per cent, so that a factor within `one` of 1 is none.
    Behind a unit's word it means that the word was wrong.
    """
    scale = by
    for word in filter(_scales, known):
        scale *= ACCELEROMETER_UNITS.get(word) or float(word.removeprefix("accel*"))
    words = [word for word in known if not _scales(word)]
    words += [] if abs(scale - 1.0) < one else [f"accel*{factor(scale)}"]
    return topic + (f":{','.join(words)}" if words else "")


def factor(value: float) -> str:
    """A factor in three digits."""
    return f"{value:.3g}"
