"""What was typed after an option, as a value; each function raises UsageError for what it does not understand."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TypeVar

T = TypeVar("T")


def usage_error(text: str) -> Exception:
    """What to raise where an option cannot be used; imported late, because `--help` must be quick."""
    from wrenchgap.flight.errors import UsageError

    return UsageError(text)


def parse_cutoff(hz: float) -> float:
    """The cut-off [Hz], if it is one; raises UsageError."""
    if not (math.isfinite(hz) and hz > 0):
        raise usage_error(f"--cutoff {hz:g}: expected a positive number of Hz, e.g. 8")
    return hz


def parse_between(texts: Sequence[str] | None) -> tuple[tuple[float, float], ...] | None:
    """`["5:40"]` as ((5.0, 40.0),), either side may be left open; raises UsageError on anything else."""
    return tuple(map(_interval, texts)) if texts else None


def _interval(text: str) -> tuple[float, float]:
    first, colon, last = text.partition(":")
    try:
        start, stop = float(first or "-inf"), float(last or "inf")
    except ValueError:
        start = stop = float("nan")
    if not colon or not start < stop:
        raise usage_error(f"--between {text}: expected T0:T1 in seconds with T0 before T1, e.g. --between 5:40")
    return start, stop


def parse_shifts(texts: Sequence[str] | None) -> dict[str, float]:
    """`["odometry=-0.012"]` as `{"odometry": -0.012}`; raises UsageError on anything else."""

    def seconds(text: str) -> float | None:
        try:
            return float(text) if math.isfinite(float(text)) else None
        except ValueError:
            return None

    return _by_role("--shift", texts, seconds, "ROLE=SECONDS, e.g. --shift odometry=-0.0123")


def parse_topics(texts: Sequence[str] | None) -> dict[str, str]:
    """`["imu=/my/imu"]` as `{"imu": "/my/imu"}`; raises UsageError on anything else."""
    return _by_role("--topic", texts, lambda topic: topic or None, "ROLE=/TOPIC, e.g. --topic imu=/my/imu")


def _by_role(option: str, texts: Sequence[str] | None, read: Callable[[str], T | None], expected: str) -> dict[str, T]:
    found: dict[str, T] = {}
    for text in texts or ():
        role, _, given = text.partition("=")
        value = read(given)
        if not role or value is None:
            raise usage_error(f"{option} {text}: expected {expected}")
        if role in found:
            raise usage_error(f"{option} {role}: given twice; say it once")
        found[role] = value
    return found


def parse_unmeasured(text: str | None) -> tuple[str, ...]:
    """`"force_x,force_y"` as names of axes; raises UsageError for others."""
    from wrenchgap.flight.unmeasured import axis_names

    return axis_names(parse_names(text))


def parse_accept(texts: Sequence[str] | None) -> tuple[str, ...]:
    """Names of checks; raises UsageError for one that there is not."""
    if not texts:
        return ()
    from wrenchgap.flight.check import accepted_names

    return accepted_names(name for text in texts for name in parse_names(text))


def parse_keep(texts: Sequence[str] | None) -> tuple[str, ...]:
    """Names of phases; raises UsageError for one that there is not."""
    if not texts:
        return ()
    from wrenchgap.learn.data.phases.phase import phase_names

    return phase_names(name for text in texts for name in parse_names(text))


def parse_budget(text: str | None) -> str | None:
    """A memory, a time or both, as it is; raises UsageError for others."""
    if text is not None:
        from wrenchgap.flight.budget import Budget

        Budget.of(text)
    return text


def parse_effects(text: str | None) -> tuple[str, ...]:
    """`"a,b"` as names of effects; raises ModelError for one that is not in the catalogue."""
    from wrenchgap.plant.effects import find

    return tuple(find(name).name for name in parse_names(text))


def parse_outputs(text: str) -> tuple[str, ...]:
    """`torque`, `wrench`, or names of axes separated by commas; raises UsageError on anything else."""
    from wrenchgap.flight.flight import AXES

    if text in ("torque", "wrench"):
        return AXES[3:] if text == "torque" else AXES
    names = parse_names(text)
    wrong = [n for n in names if n not in AXES]
    if wrong or not names or len(set(names)) < len(names):
        raise usage_error(f"--outputs {text}: expected torque, wrench, or different names out of {', '.join(AXES)}")
    return names


def parse_room(text: str | None) -> tuple[float, float, float] | None:
    """`"4,4,3"` as three lengths [m]; raises UsageError on anything else."""
    if text is None:
        return None
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError:
        raise usage_error(f"--room {text}: expected three lengths in metres, e.g. --room 4,4,3") from None
    return x, y, z


def parse_names(text: str | None) -> tuple[str, ...]:
    """`"a,b"` as `("a", "b")`; raises UsageError for a text that names nothing, or one thing twice."""
    names = tuple(part.strip() for part in (text or "").split(",") if part.strip())
    if text is not None and not 0 < len(set(names)) == len(names):
        raise usage_error(
            f"{text!r}: names nothing, or one twice; expected names divided by commas, e.g. mass,com_offset"
        )
    return names
