"""The option that mends what a check found: the mapping as it is, with a word more."""

import shlex

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


def factor(value: float) -> str:
    """A factor in three digits."""
    return f"{value:.3g}"


def _with(source: str, words: str, one: float = 0.05) -> str:
    """A source with words more.

    A factor of the accelerometer stands in the place of all words that scale it, behind a unit's word because that was
    wrong. The specific force of a flight is its weight's within some per cent, so that a factor within `one` of 1 is
    none. What is said already and says the same again was wrong: the sensor is not turned after all.
    """
    topic, _, said = source.partition(":")
    known = said.split(",") if said else []
    scaling = [word for word in known if word in ACCELEROMETER_UNITS or word.startswith("accel*")]
    fresh = [word for word in words.split(",") if word not in known or "=" in word or "*" in word]
    if words.startswith("*"):
        topic += words
    elif words.startswith("accel*") and scaling:
        scale = float(words.removeprefix("accel*"))
        for word in scaling:
            scale *= ACCELEROMETER_UNITS.get(word) or float(word.removeprefix("accel*"))
        known = [word for word in known if word not in scaling]
        known += [] if abs(scale - 1.0) < one else [f"accel*{factor(scale)}"]
    elif fresh:
        known += fresh
    else:
        known = [word for word in known if word != words]
    return f"{topic}:{','.join(known)}" if known else topic
