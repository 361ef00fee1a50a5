"""The view of a flight as a frozen state, saved as JSON and opened again, also on another log.

    {"schema": "wrenchgap.view/1", "flight": "test", "time": 12.5, "marks": {"A": 3.0, "B": 4.0}, "loop": true,
     "zoom": "10 s", "speed": "1", "shown": {...}, "channels": [...], "ghost": "nothing", "ghost_shift": 0.0,
     "camera": {"position": [..], "look_at": [..]}}

What a document lacks stays as it is. The camera is relative to the body where `shown.follow` is true, else in E.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, BeforeValidator, Field

from wrenchgap._escaping import json_text
from wrenchgap.flight.errors import UsageError
from wrenchgap.plant.reader import Flag, Number, Text, Vector, expected, quoted, stored, text_of
from wrenchgap.plant.reader import read as read_document
from wrenchgap.viewer.scene_drawing import NOTHING, Shown

SCHEMA = "wrenchgap.view/1"
MOST_CHANNELS = 100
"""Channels that are plotted at once, at most: each is a chart in every browser."""


def _of_a_and_b(marks: Mapping[str, float]) -> Mapping[str, float]:
    if not marks.keys() <= {"A", "B"}:
        raise ValueError
    return marks


def _two_points(said: Any) -> Any:
    """A camera of a document, whose two points differ, as they are kept."""
    if said is None:
        return None
    if not isinstance(said, dict) or said.keys() != {"position", "look_at"} or said["position"] == said["look_at"]:
        raise ValueError
    return said["position"], said["look_at"]


@stored
@dataclass(frozen=True)
class ViewState:
    """The page holds one and replaces it; `time` and `camera` are filled in when it is saved. None is "as it is"."""

    flight: Text | None = None
    time: Annotated[Number | None, expected("a number")] = None
    marks: Annotated[Mapping[str, Number], AfterValidator(_of_a_and_b), expected("numbers for A and B")] = field(
        default_factory=dict
    )
    loop: Flag = False
    zoom: Text | None = None
    speed: Text | None = None
    shown: Shown = field(default_factory=Shown)
    channels: Annotated[
        tuple[Text, ...], Field(max_length=MOST_CHANNELS), expected(f"a list of at most {MOST_CHANNELS} texts")
    ] = ()
    ghost: Text = NOTHING
    ghost_shift: Annotated[Number, expected("a number")] = 0.0
    camera: Annotated[
        tuple[Vector, Vector] | None,
        BeforeValidator(_two_points),
        expected("position and look_at, three numbers each"),
    ] = None

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
    given = {name: value for name, value in content.items() if name != "schema" and value is not None}
    try:
        return read_document(ViewState, given, error=UsageError)
    except UsageError as error:
        raise UsageError(f"{where}: {error}") from None
