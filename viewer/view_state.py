"""The view of a flight as a frozen state, saved as JSON and opened again, also on another log.

    {"schema": "wrenchgap.view/1", "flight": "test", "time": 12.5, "marks": {"A": 3.0, "B": 4.0}, "loop": true,
     "zoom": "10 s", "speed": "1", "shown": {...}, "channels": [...], "ghost": "nothing", "ghost_shift": 0.0,
     "camera": {"position": [..], "look_at": [..]}}

What a document lacks stays as it is. The camera is relative to the body where `shown.follow` is true, else in E.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Annotated, Any, Literal, get_type_hints

from pydantic import AfterValidator, Field, create_model

from wrenchgap._escaping import json_text
from wrenchgap.flight.errors import UsageError
from wrenchgap.plant.reader import Flag, Number, Positive, Table, Text, Vector, expected, quoted, text_of
from wrenchgap.plant.reader import read as read_table
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
    """The view in a file. Raises UsageError for a file that holds none."""
    text = text_of(path, "as --view", UsageError, "; expected what `Save view` wrote")
    return parse(text, f"--view {path}")


def parse(text: str, where: str = "saved view") -> ViewState:
    """The view in a JSON text. Raises UsageError that names the invalid entry."""
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise UsageError(f"{where}: not JSON ({error}); expected what `Save view` wrote") from None
    if not isinstance(content, dict) or content.get("schema") != SCHEMA:
        found = content.get("schema") if isinstance(content, dict) else type(content).__name__
        raise UsageError(
            f"{where}: schema is {quoted(repr(found))}, expected {SCHEMA!r}; expected what `Save view` wrote"
        )
    del content["schema"]
    try:
        found = read_table(_Document, content, error=UsageError)
    except UsageError as error:
        raise UsageError(f"{where}: {error}") from None
    given = {name: value for name, value in found if value is not None}
    return ViewState(**given | {"shown": Shown(**dict(found.shown))})


_SomeNumber = Annotated[Number | None, expected("a number")]
_KINDS: dict[type, Any] = {bool: Flag, str: Text, float: Positive}
_OWN_KINDS = {
    "hidden": Annotated[frozenset[Text], expected("a list of names")],
    "factors": Annotated[tuple[Positive, Positive, Positive], expected("three positive numbers")],
}


def _different(camera: _Camera) -> tuple[Point, Point]:
    if camera.position == camera.look_at:
        raise ValueError
    return camera.position, camera.look_at


class _Camera(Table):
    """Where a camera is, and at what it looks."""

    position: Vector
    look_at: Vector


class _Document(Table):
    """The entries; `shown` are the fields of `Shown`. What is absent or null stays as it is."""

    flight: Text | None = None
    time: _SomeNumber = None
    marks: Annotated[dict[Literal["A", "B"], Number] | None, expected("numbers for A and B")] = None
    loop: Flag = False
    zoom: Text | None = None
    speed: Text | None = None
    shown: create_model(  # type: ignore[valid-type]
        "_Shown",
        __base__=Table,
        **{f.name: (_OWN_KINDS.get(f.name) or _KINDS[get_type_hints(Shown)[f.name]], f.default) for f in fields(Shown)},
    ) = Field(default_factory=Shown)
    channels: Annotated[
        tuple[Text, ...] | None, Field(max_length=MOST_CHANNELS), expected(f"a list of at most {MOST_CHANNELS} texts")
    ] = None
    ghost: Text | None = None
    ghost_shift: _SomeNumber = None
    camera: Annotated[
        _Camera | None,
        AfterValidator(lambda found: found and _different(found)),
        expected("position and look_at, three numbers each"),
    ] = None
