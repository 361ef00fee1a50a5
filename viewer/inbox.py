"""Messages of clients: each is checked before viser acts on it, and dropped where it is not one the page expects.

viser's client is a program that runs at whoever has the link, so what arrives is whatever he likes: viser would set any
attribute of a control to any value, keep uploads of any size, and open a tunnel to a public server when asked. Here a
message has a known type with exactly its fields, and nothing else is ever built; a control is one that is seen and gets
a value that it offers.
"""

import math
import operator
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import reduce
from types import MappingProxyType
from typing import Annotated, Any

import msgspec
import viser
from msgspec import Meta


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
    part, parts
        Bytes of one piece of a file (viser's client cuts them at 524,288), and pieces of one upload.
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
    part: int = 1_000_000
    parts: int = 16
    text: int = 100_000
    number: float = 1e12
    pixels: int = 40_000_000
    pages: int = 32
    handshakes: int = 64
    queued: int = 4


LIMITS = Limits()
PNG = b"\x89PNG\r\n\x1a\n"

Name = Annotated[str, Meta(max_length=256)]
Number = Annotated[float, Meta(ge=-LIMITS.number, le=LIMITS.number)]
Size = Annotated[int, Meta(ge=0, le=16384)]
Count = Annotated[int, Meta(ge=0, le=2**40)]
Vector = tuple[Number, Number, Number]
_transfer = {"source_component_uuid": Name, "transfer_uuid": Name}
FIELDS: Mapping[str, Mapping[str, Any]] = {
    "GuiUpdateMessage": {
        "uuid": Name,
        "updates": msgspec.defstruct("Updates", [("value", bool | float | str)], forbid_unknown_fields=True),
    },
    "CommandTriggerMessage": {"uuid": Name},
    "ViewerCameraMessage": {
        "wxyz": tuple[Number, Number, Number, Number],
        **dict.fromkeys(("position", "look_at", "up_direction"), Vector),
        **dict.fromkeys(("fov", "near", "far"), Number),
        **dict.fromkeys(("image_height", "image_width"), Size),
    },
    "GetRenderResponseMessage": {"payload": bytes, "render_uuid": Name},
    "FileTransferStartUpload": {
        **_transfer,
        **dict.fromkeys(("filename", "mime_type"), Name),
        **dict.fromkeys(("part_count", "size_bytes"), Count),
    },
    "FileTransferPart": {
        **_transfer,
        "part_index": Count,
        "content": Annotated[bytes, Meta(max_length=LIMITS.part)],
    },
}
"""The messages that mean something to this page, and what their fields hold. viser knows a dozen more."""
_strict: Any = {"tag_field": "type", "forbid_unknown_fields": True}
_shapes = [msgspec.defstruct(kind, list(fields.items()), tag=kind, **_strict) for kind, fields in FIELDS.items()]
_shaped = msgspec.msgpack.Decoder(reduce(operator.or_, _shapes))
"""Refuses at the first byte that fits no message: 16 MB of empty maps would be built as 1.2 GB of objects."""


def _picture(value: bytes) -> bool:
    """Whether it is a PNG of one frame of a plausible size, or empty, which means none."""
    if value and (len(value) < 24 or not value.startswith(PNG)):
        return False
    width, height = int.from_bytes(value[16:20], "big"), int.from_bytes(value[20:24], "big")
    return width * height <= LIMITS.pixels and b"acTL" not in value[: value.find(b"IDAT")]


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
            return isinstance(value, str) and len(value) <= LIMITS.text
        case viser.GuiDropdownHandle() | viser.GuiButtonGroupHandle():
            return isinstance(value, str) and value in control.options
        case viser.GuiSliderHandle() | viser.GuiNumberHandle():
            low = -math.inf if control.min is None else control.min
            high = math.inf if control.max is None else control.max
            slack = 1e-9 * max(abs(bound) if math.isfinite(bound) else 0.0 for bound in (low, high))
            number = isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= LIMITS.number
            return number and low - slack <= value <= high + slack
    return False


class Inbox:
    """The messages of one client. `control` finds a control by its id, None where there is none.

    `drops` (`viewer.file_drop.FileDrop`, by the id of their button) get the files that are uploaded to them.
    """

    def __init__(
        self,
        control: Callable[[str], Any],
        drops: Mapping[str, Any] = MappingProxyType({}),
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._control, self._drops, self._clock = control, drops, clock
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
            kind = type(_shaped.decode(raw)).__name__
            message = msgspec.msgpack.decode(raw)
        except (msgspec.MsgspecError, RecursionError, ValueError):
            return False
        if message["type"] != kind:  # said twice: viser takes the last
            return False
        match kind:
            case "GuiUpdateMessage":
                return is_possible(self._control(message["uuid"]), message["updates"]["value"])
            case "GetRenderResponseMessage":
                return _picture(message["payload"])
            case "FileTransferStartUpload":
                return self._admits_start(message)
            case "FileTransferPart":
                return self._admits_part(message)
        return True

    def _admits_start(self, message: dict[str, Any]) -> bool:
        """Whether an upload may start: to an upload button, not too many at once. Viser never sees those of a drop."""
        uuid, transfer = message["source_component_uuid"], message["transfer_uuid"]
        button = self._control(uuid)
        if not isinstance(button, viser.GuiUploadButtonHandle) or transfer in self._uploads:
            return False
        if len(self._uploads) >= LIMITS.uploads or button.disabled or not button.visible:
            return False
        if uuid in self._drops:
            self._drops[uuid].start(transfer, message["filename"], message["size_bytes"])
            return False
        if message["size_bytes"] > LIMITS.upload or message["part_count"] > LIMITS.parts:
            return False
        if message["part_count"] > 0:
            self._uploads[transfer] = message["size_bytes"]
        return True

    def _admits_part(self, message: dict[str, Any]) -> bool:
        """Whether a part belongs to a started upload and is within its size."""
        transfer, drop = message["transfer_uuid"], self._drops.get(message["source_component_uuid"])
        if drop is not None:
            drop.part(transfer, message["content"])
            return False
        rest = self._uploads.get(transfer, 0) - len(message["content"])
        if transfer not in self._uploads or rest < 0 or message["part_index"] >= LIMITS.parts:
            return False
        self._uploads[transfer] = rest
        if rest == 0:
            del self._uploads[transfer]
        return True
