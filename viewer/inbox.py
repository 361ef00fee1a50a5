"""Messages of clients: each is checked before viser acts on it, and dropped where it is not one the page expects.

viser's client is a program that runs at whoever has the link, so what arrives is whatever he likes: viser would set any
attribute of a control to any value, keep uploads of any size, and open a tunnel to a public server when asked. Here a
message has a known type with exactly its fields, and nothing else is ever built; a control is one that is seen and gets
a value that it offers.
"""

from __future__ import annotations

import math
import operator
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import reduce
from typing import Any

import msgspec
import viser


@dataclass(frozen=True)
class Limits:
    """What clients of the page may use.

    Attributes
    ----------
    rate, burst
        Messages of one client [1/s], and how many at once: dragging a slider and turning the camera make 70 a second.
    message
        Bytes of one message: a picture of the scene on a 4K screen has 2 to 8 million.
    upload, uploads
        Bytes of one upload (a saved view has some hundreds), and how many of one client may be under way.
    text
        Characters in a field: a saved view with a hundred channels has ten thousand.
    number
        Size of a time [s] or place [m]: clocks that count from 1970 are at 2e9.
    pixels
        Of a picture that a client renders: 8K has 33 million.
    pages
        Open at a time: each costs the server a copy of everything that is drawn.
    handshakes
        Connections at a time that are not yet a page; of more, the oldest are ended.
    queued
        Messages of one client that wait to be read.
    """

    rate: float = 200.0
    burst: float = 400.0
    message: int = 2**24
    upload: int = 1_000_000
    uploads: int = 4
    text: int = 100_000
    number: float = 1e12
    pixels: int = 40_000_000
    pages: int = 32
    handshakes: int = 64
    queued: int = 4


LIMITS = Limits()
PNG = b"\x89PNG\r\n\x1a\n"

Check = Callable[[Any], bool]


def _number(value: Any) -> bool:
    """Whether it is a finite number of a plausible size."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= LIMITS.number


def _count(most: int) -> Check:
    return lambda value: isinstance(value, int) and not isinstance(value, bool) and 0 <= value <= most


def _text(most: int) -> Check:
    return lambda value: isinstance(value, str) and len(value) <= most


def _vector(size: int) -> Check:
    return lambda value: isinstance(value, list) and len(value) == size and all(map(_number, value))


def _picture(value: Any) -> bool:
    """Whether it is a PNG of one frame of a plausible size, or empty, which means none."""
    if not isinstance(value, bytes) or (value and (len(value) < 24 or not value.startswith(PNG))):
        return False
    width, height = int.from_bytes(value[16:20], "big"), int.from_bytes(value[20:24], "big")
    return width * height <= LIMITS.pixels and b"acTL" not in value[: value.find(b"IDAT")]


_name, _size = _text(256), _count(16384)
FIELDS: Mapping[str, Mapping[str, Check]] = {
    "GuiUpdateMessage": {"uuid": _name, "updates": lambda value: isinstance(value, dict) and set(value) == {"value"}},
    "CommandTriggerMessage": {"uuid": _name},
    "ViewerCameraMessage": {
        "wxyz": _vector(4),
        "position": _vector(3),
        "fov": _number,
        "near": _number,
        "far": _number,
        "image_height": _size,
        "image_width": _size,
        "look_at": _vector(3),
        "up_direction": _vector(3),
    },
    "GetRenderResponseMessage": {"payload": _picture, "render_uuid": _name},
    "FileTransferStartUpload": {
        "source_component_uuid": _name,
        "transfer_uuid": _name,
        "filename": _name,
        "mime_type": _name,
        "part_count": _count(16),
        "size_bytes": _count(LIMITS.upload),
    },
    "FileTransferPart": {
        "source_component_uuid": _name,
        "transfer_uuid": _name,
        "part_index": _count(16),
        "content": lambda value: isinstance(value, bytes) and len(value) <= LIMITS.upload,
    },
}
"""The messages that mean something to this page, and what their fields hold. viser knows a dozen more."""
_updates = msgspec.defstruct("Updates", [("value", bool | float | str)], forbid_unknown_fields=True)
TYPES: Mapping[str, Any] = {
    "wxyz": tuple[float, float, float, float],
    **dict.fromkeys(("position", "look_at", "up_direction"), tuple[float, float, float]),
    **dict.fromkeys(("fov", "near", "far"), float),
    **dict.fromkeys(("image_height", "image_width", "part_count", "size_bytes", "part_index"), int),
    **dict.fromkeys(("payload", "content"), bytes),
    "updates": _updates,
}
"""Of fields that are no text."""
_shapes: Any = reduce(
    operator.or_,
    (
        msgspec.defstruct(
            kind,
            [(name, TYPES.get(name, str)) for name in fields],
            tag_field="type",
            tag=kind,
            forbid_unknown_fields=True,
        )
        for kind, fields in FIELDS.items()
    ),
)
_shaped = msgspec.msgpack.Decoder(_shapes)
"""Refuses at the first byte that fits no message: 16 MB of empty maps would be built as 1.2 GB of objects."""


INPUTS = (
    viser.GuiButtonHandle,
    viser.GuiCheckboxHandle,
    viser.GuiTextHandle,
    viser.GuiDropdownHandle,
    viser.GuiButtonGroupHandle,
    viser.GuiSliderHandle,
    viser.GuiNumberHandle,
)
"""Kinds of controls that this page has for its users; viser would take a value for its progress bars as well."""


def is_possible(control: Any, value: Any) -> bool:
    """Whether a control that a client sees could have sent this value."""
    if not isinstance(control, INPUTS) or control.disabled or not control.visible:
        return False
    match control:
        case viser.GuiButtonHandle():
            return value is True
        case viser.GuiCheckboxHandle():
            return isinstance(value, bool)
        case viser.GuiTextHandle():
            return _text(LIMITS.text)(value)
        case viser.GuiDropdownHandle() | viser.GuiButtonGroupHandle():
            return isinstance(value, str) and value in control.options
        case viser.GuiSliderHandle() | viser.GuiNumberHandle():
            low = -math.inf if control.min is None else control.min
            high = math.inf if control.max is None else control.max
            slack = 1e-9 * max(abs(bound) if math.isfinite(bound) else 0.0 for bound in (low, high))
            return _number(value) and low - slack <= value <= high + slack
    return False


class Inbox:
    """The messages of one client. `control` finds a control by its id, None where there is none."""

    def __init__(self, control: Callable[[str], Any], clock: Callable[[], float] = time.monotonic) -> None:
        self._control, self._clock = control, clock
        self._allowance, self._at = LIMITS.burst, clock()
        self._uploads: dict[str, int] = {}

    def wait(self) -> float:
        """Count a message; the time [s] for which the next ones stay unread, so that a flood stays with its sender."""
        now = self._clock()
        self._allowance = min(LIMITS.burst, self._allowance + LIMITS.rate * (now - self._at)) - 1.0
        self._at = now
        return max(0.0, -self._allowance / LIMITS.rate)

    def admits(self, raw: bytes | str) -> bool:
        """Whether a message is one that the page expects, with plausible contents."""
        if isinstance(raw, str):
            return False
        try:
            _shaped.decode(raw)
            message = msgspec.msgpack.decode(raw)
        except (msgspec.MsgspecError, RecursionError, ValueError):
            return False
        kind = message.pop("type", None) if isinstance(message, dict) else None
        fields = FIELDS.get(kind) if isinstance(kind, str) else None
        if fields is None or set(message) != set(fields):
            return False
        if not all(check(message[name]) for name, check in fields.items()):
            return False
        match kind:
            case "GuiUpdateMessage":
                return is_possible(self._control(message["uuid"]), message["updates"]["value"])
            case "FileTransferStartUpload":
                return self._admits_start(message)
            case "FileTransferPart":
                return self._admits_part(message)
        return True

    def _admits_start(self, message: dict[str, Any]) -> bool:
        """Whether an upload may start: to an upload button, and not too many at once."""
        button, transfer = self._control(message["source_component_uuid"]), message["transfer_uuid"]
        if not isinstance(button, viser.GuiUploadButtonHandle) or transfer in self._uploads:
            return False
        if len(self._uploads) >= LIMITS.uploads or button.disabled or not button.visible:
            return False
        if message["part_count"] > 0:
            self._uploads[transfer] = message["size_bytes"]
        return True

    def _admits_part(self, message: dict[str, Any]) -> bool:
        """Whether a part belongs to a started upload and is within its size."""
        transfer = message["transfer_uuid"]
        rest = self._uploads.get(transfer, 0) - len(message["content"])
        if transfer not in self._uploads or rest < 0:
            return False
        self._uploads[transfer] = rest
        if rest == 0:
            del self._uploads[transfer]
        return True
