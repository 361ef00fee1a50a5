"""What is seen of a flight, as a frozen state; saved and opened again, by a colleague or on the next log, as JSON.

    {"schema": "wrenchgap.view/1", "flight": "test", "time": 12.5, "marks": {"A": 3.0, "B": 4.0}, "loop": true,
     "zoom": "10 s", "speed": "1", "shown": {...}, "channels": [...], "ghost": "nothing", "ghost_shift": 0.0,
     "camera": {"position": [..], "look_at": [..]}}

What a document lacks stays as it is. The camera is relative to the body where `shown.follow` is true, else in E.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from wrenchgap._escaping import json_text
from wrenchgap.flight.errors import UsageError
from wrenchgap.plant.reader import shortened, text_of
from wrenchgap.viewer.inbox import LARGEST_NUMBER
from wrenchgap.viewer.scene_drawing import NOTHING, Shown

SCHEMA = "wrenchgap.view/1"
MOST_CHANNELS = 100
"""Channels that are plotted at once, at most: each is a chart in every browser."""
Point = tuple[float, float, float]


@dataclass(frozen=True)
class ViewState:
    """The page holds one and replaces it; `time` and `camera` are filled in when it is saved. None is "as it is"."""

    flight: str | None = None
    time: float | None = None
    marks: Mapping[str, float] = field(default_factory=dict)
    loop: bool = False
    zoom: str | None = None
    speed: str | None = None
    shown: Shown = field(default_factory=Shown)
    channels: tuple[str, ...] = ()
    ghost: str = NOTHING
    ghost_shift: float = 0.0
    camera: tuple[Point, Point] | None = None

    def to_text(self) -> str:
        """As JSON on one line."""
        content = asdict(self)
        content["shown"]["hidden"] = sorted(self.shown.hidden)
        content["camera"] = self.camera and dict(zip(("position", "look_at"), self.camera, strict=True))
        return json_text({"schema": SCHEMA, **content})


def read(path: Path) -> ViewState:
    """A view from its file. Raises UsageError where there is none."""
    text = text_of(path, "as --view", UsageError, "; expected what `Save view` wrote")
    return parse(text, f"--view {path}")


def parse(text: str, where: str = "saved view") -> ViewState:
    """A view from its JSON. Raises UsageError, naming the entry, for anything that is none."""
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise UsageError(f"{where}: not JSON ({error}); expected what `Save view` wrote") from None
    if not isinstance(content, dict) or content.get("schema") != SCHEMA:
        found = content.get("schema") if isinstance(content, dict) else type(content).__name__
        raise UsageError(
            f"{where}: schema is {shortened(repr(found))}, expected {SCHEMA!r}; expected what `Save view` wrote"
        )
    known = {f.name for f in fields(ViewState)}
    unknown = sorted(set(content) - known - {"schema"})
    if unknown:
        raise UsageError(f"{where}: unknown entry {shortened(repr(unknown[0]))}; known are {', '.join(sorted(known))}")
    entry = _Entries(content, where)
    return ViewState(
        flight=entry.text("flight"),
        time=entry.number("time"),
        marks=entry.marks(),
        loop=entry.truth("loop", False),
        zoom=entry.text("zoom"),
        speed=entry.text("speed"),
        shown=entry.shown(),
        channels=entry.texts("channels"),
        ghost=entry.text("ghost") or NOTHING,
        ghost_shift=entry.number("ghost_shift") or 0.0,
        camera=entry.camera(),
    )


class _Entries:
    """Reads the entries of a document, each as what it must be."""

    def __init__(self, content: Mapping[str, Any], where: str) -> None:
        self._content, self._where = content, where

    def text(self, name: str) -> str | None:
        value = self._content.get(name)
        return None if value is None else str(self._checked(name, value, isinstance(value, str), "text"))

    def texts(self, name: str) -> tuple[str, ...]:
        value = self._content.get(name) or []
        good = isinstance(value, list) and len(value) <= MOST_CHANNELS and all(isinstance(item, str) for item in value)
        return tuple(self._checked(name, value, good, f"a list of at most {MOST_CHANNELS} texts"))

    def truth(self, name: str, default: bool) -> bool:
        value = self._content.get(name, default)
        return bool(self._checked(name, value, isinstance(value, bool), "true or false"))

    def number(self, name: str) -> float | None:
        value = self._content.get(name)
        return None if value is None else float(self._checked(name, value, _is_number(value), "a number"))

    def marks(self) -> dict[str, float]:
        value = self._content.get("marks") or {}
        good = isinstance(value, dict) and set(value) <= {"A", "B"} and all(map(_is_number, value.values()))
        return {k: float(v) for k, v in self._checked("marks", value, good, "numbers for A and B").items()}

    def camera(self) -> tuple[Point, Point] | None:
        value = self._content.get("camera")
        if value is None:
            return None
        parts: list[Any] = [value.get(key) for key in ("position", "look_at")] if isinstance(value, dict) else [None]
        good = all(isinstance(p, list) and len(p) == 3 and all(map(_is_number, p)) for p in parts)
        self._checked("camera", value, good and parts[0] != parts[-1], "position and look_at, three numbers each")
        one, two = ((float(p[0]), float(p[1]), float(p[2])) for p in parts)
        return one, two

    def shown(self) -> Shown:
        """The switches; those that the document lacks are as by default."""
        value = self._content.get("shown") or {}
        self._checked("shown", value, isinstance(value, dict), "switches by name")
        found: dict[str, Any] = {}
        for name, default in vars(Shown()).items():
            if name not in value:
                continue
            given, entry = value[name], f"shown.{name}"
            if isinstance(default, bool):
                found[name] = self._checked(entry, given, isinstance(given, bool), "true or false")
            elif name == "hidden":
                good = isinstance(given, list) and all(isinstance(item, str) for item in given)
                found[name] = frozenset(self._checked(entry, given, good, "a list of names"))
            elif name == "factors":
                good = isinstance(given, list) and len(given) == 3 and all(_is_number(v) and v > 0 for v in given)
                found[name] = tuple(float(v) for v in self._checked(entry, given, good, "three positive numbers"))
            elif isinstance(default, float):
                found[name] = float(self._checked(entry, given, _is_number(given) and given > 0, "a positive number"))
            else:
                found[name] = self._checked(entry, given, isinstance(given, str), "text")
        return replace(Shown(), **found)

    def _checked(self, name: str, value: Any, good: bool, expected: str) -> Any:
        if not good:
            raise UsageError(f"{self._where}: {name} is {shortened(repr(value))}, expected {expected}")
        return value


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= LARGEST_NUMBER
