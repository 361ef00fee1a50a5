"""What a client may send: the messages of a hand at the page pass, all others do not, and raise nothing."""

import tracemalloc
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest
import viser
from hypothesis import given
from hypothesis import strategies as st

from wrenchgap.viewer.inbox import FIELDS, LIMITS, PNG, Inbox, is_possible
from wrenchgap.viewer.serving import serve


@pytest.fixture(scope="module")
def gui():
    server, _, _ = serve("127.0.0.1", 0)
    yield server.gui
    server.stop()


@pytest.fixture(scope="module")
def controls(gui):
    """One of each kind, by the id under which a message names it."""
    return {
        "slider": gui.add_slider("slider", 0.0, 1.0, 0.001, 0.5),
        "number": gui.add_number("number", 1.0, min=0.0),
        "any": gui.add_number("any", 1.0),
        "text": gui.add_text("text", ""),
        "box": gui.add_checkbox("box", False),
        "choice": gui.add_dropdown("choice", ("a", "b")),
        "group": gui.add_button_group("group", ("c", "d")),
        "button": gui.add_button("button"),
        "hidden": gui.add_button("hidden", visible=False),
        "off": gui.add_button("off", disabled=True),
        "bar": gui.add_progress_bar(0.0),
        "upload": gui.add_upload_button("upload"),
        "note": gui.add_markdown("note"),
    }


@pytest.fixture(scope="module")
def inbox(controls):
    return Inbox(controls.get)


def packed(kind, **fields):
    return msgspec.msgpack.encode({"type": kind, **fields})


def moved(uuid, value, name="value"):
    return packed("GuiUpdateMessage", uuid=uuid, updates={name: value})


OFFERED = {"slider": (0, 1.0), "number": (7,), "any": (-1e9,), "text": ("a view",), "box": (True,), "choice": ("b",),
           "group": ("c",), "button": (True,)}  # fmt: skip
NOT_OFFERED = {"slider": (1.1, np.nan, "0.5", True), "number": (-1.0,), "any": (np.inf, 1e300),
               "text": (5, "x" * 200_000), "box": (1,), "choice": ("c", ["a"]), "group": ("e",), "button": ("x",),
               "hidden": (True,), "off": (True,), "bar": (5.0,),
               "upload": (b"",), "note": ("x",), "no control": (1,)}  # fmt: skip


@pytest.mark.parametrize("name", OFFERED)
def test_what_a_hand_does_passes(inbox, name):
    assert all(inbox.admits(moved(name, value)) for value in OFFERED[name])


@pytest.mark.parametrize("name", NOT_OFFERED)
def test_what_a_control_does_not_offer_does_not(inbox, name):
    assert not any(inbox.admits(moved(name, value)) for value in NOT_OFFERED[name])


@pytest.mark.parametrize("name", ["update_cb", "sync_cb", "removed", "visible", "options", "min", "uuid"])
def test_a_client_sets_values_and_nothing_else_of_a_control(inbox, name):
    assert not inbox.admits(moved("slider", 0.5, name))
    assert not inbox.admits(packed("GuiUpdateMessage", uuid="slider", updates={"value": 0.5, name: 0.5}))


@pytest.mark.parametrize(
    "kind", ["ShareUrlRequest", "RunJavascriptMessage", "GuiFormDirtyMessage", "SceneNodeClickMessage"]
)
def test_messages_that_this_page_has_no_use_for_do_not_reach_viser(inbox, kind):
    assert not inbox.admits(packed(kind))


values = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**63), 2**64 - 1)
    | st.floats()
    | st.text(max_size=9)
    | st.binary(max_size=9),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=6,
)


@given(st.binary(max_size=200))
def test_bytes_of_any_kind_raise_nothing(inbox, raw):
    assert not inbox.admits(raw)


@given(st.data(), st.sampled_from(sorted(FIELDS)))
def test_messages_with_fields_of_any_kind_raise_nothing(inbox, controls, data, kind):
    names = st.sampled_from(sorted(controls)) | values
    fields = {name: data.draw(names if "uuid" in name else values) for name in FIELDS[kind]}
    admitted = inbox.admits(packed(kind, **fields))
    assert isinstance(admitted, bool)
    if admitted and kind == "GuiUpdateMessage":
        assert is_possible(controls[fields["uuid"]], fields["updates"]["value"])


def test_the_types_are_those_of_this_viser():
    """Each with exactly its fields: a message that viser renames would be dropped, and its control be dead."""
    for kind, fields in FIELDS.items():
        own = getattr(viser._messages, kind)
        assert set(fields) == set(viser.infra._messages.wire_field_names(own)) - {"excluded_self_client"}, kind


def test_an_upload_keeps_to_what_it_said(controls):
    inbox = Inbox(controls.get)

    def begin(transfer, size=100, parts=1, button="upload"):
        names = {"source_component_uuid": button, "transfer_uuid": transfer, "filename": "v.json", "mime_type": ""}
        return inbox.admits(packed("FileTransferStartUpload", **names, part_count=parts, size_bytes=size))

    def part(transfer, size):
        content = {"part_index": 0, "content": bytes(size)}
        return inbox.admits(
            packed("FileTransferPart", source_component_uuid="upload", transfer_uuid=transfer, **content)
        )

    assert begin("one")
    assert not part("other", 10)
    assert not part("one", 101)
    assert part("one", 60)
    assert part("one", 40)
    assert not part("one", 1)
    assert not begin("large", 2_000_000)
    assert not begin("many", parts=10**6)
    assert not begin("elsewhere", button="button")
    assert [begin(str(k)) for k in range(6)] == [True] * 4 + [False] * 2


def test_a_picture_is_a_png_that_can_be_unpacked(inbox):
    def picture(width, height, rest=b"IDAT"):
        return PNG + b"\0\0\0\rIHDR" + width.to_bytes(4, "big") + height.to_bytes(4, "big") + rest

    for payload, good in (
        (b"", True),
        (picture(3840, 2160), True),
        (picture(2**31, 2**31), False),
        (picture(LIMITS.pixels + 1, 1), False),
        (picture(100, 100, b"acTL....IDAT"), False),
        (b"GIF89a" + bytes(40), False),
        (PNG, False),
    ):
        assert inbox.admits(packed("GetRenderResponseMessage", payload=payload, render_uuid="x")) is good


def test_a_flood_waits_and_a_hand_does_not():
    now = SimpleNamespace(time=0.0)
    inbox = Inbox({}.get, clock=lambda: now.time)
    assert [inbox.wait() for _ in range(int(LIMITS.burst))] == [0.0] * int(LIMITS.burst)
    waits = [inbox.wait() for _ in range(100)]
    assert waits[-1] == pytest.approx(100 / LIMITS.rate)
    now.time += 10.0
    for _ in range(700):  # ten seconds of 70 messages
        now.time += 1.0 / 70.0
        assert inbox.wait() == 0.0


@pytest.mark.parametrize("inside", [b"", b"\x81\xa4type", b"\x82\xa4type\xb0GuiUpdateMessage\xa7updates\x81\xa5value"])
@pytest.mark.parametrize("item", [b"\x80", b"\x90", b"\xc0"])
def test_nothing_is_built_of_a_message_that_the_page_has_not(inbox, inside, item):
    """16 MB of empty maps became 1.2 GB of objects before the message was refused."""
    count = 1_000_000
    raw = inside + b"\xdd" + count.to_bytes(4, "big") + item * count
    tracemalloc.start()
    try:
        assert not inbox.admits(raw)
        assert tracemalloc.get_traced_memory()[1] < 100_000
    finally:
        tracemalloc.stop()
