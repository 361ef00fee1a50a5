"""Files that are dropped on the page: what arrives is on the disk, what does not fit is refused in one line."""

from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace

import msgspec
import pytest

from wrenchgap.viewer import file_drop
from wrenchgap.viewer.file_drop import FileDrop
from wrenchgap.viewer.host import Host
from wrenchgap.viewer.inbox import Inbox
from wrenchgap.viewer.serving import serve


class Page(Host):
    """The part of a page that a drop needs; `said` are the errors, `came` the bytes that were acknowledged."""

    def __init__(self):
        button = SimpleNamespace(_impl=SimpleNamespace(uuid="drop"))
        add_html = lambda content: SimpleNamespace(content=content)  # noqa: E731
        self.gui = SimpleNamespace(add_html=add_html, add_upload_button=lambda label: button)
        self.server, self.lock = SimpleNamespace(atomic=nullcontext), nullcontext()
        self.drops, self.said, self.came = {}, [], []

    def fail(self, error, client=None):
        self.said.append(str(error))


@pytest.fixture
def page(monkeypatch):
    made = Page()
    monkeypatch.setattr(file_drop, "acknowledge", lambda server, button, transfer, done, size: made.came.append(done))
    return made


@pytest.fixture
def drop(page, tmp_path):
    page.received = []
    return FileDrop(page, "Drop a log here.", tmp_path, page.received.append)


def sent(drop, name, content, transfer="a", size=None, piece=4):
    drop.start(transfer, name, len(content) if size is None else size)
    for at in range(0, len(content), piece):
        drop.part(transfer, content[at : at + piece])


def test_a_file_is_on_the_disk_as_it_was_sent(drop, page, eventually):
    sent(drop, "Flug süd 3.ulg", b"0123456789")
    (path,) = eventually(lambda: page.received)
    assert (path.name, path.read_bytes()) == ("Flug süd 3.ulg", b"0123456789")
    assert page.came == [0, 4, 8, 10]
    drop._handing.join()
    assert not drop._words.content, "what is here is the log's to say, or the refusal's"
    sent(drop, "Flug süd 3.ulg", b"", "b")
    eventually(lambda: len(page.received) == 2, "an empty file never came")
    assert page.received[1] != path, "a second file of the same name replaced the first"


@pytest.mark.parametrize(
    "name", ["../a.ulg", "/etc/a.ulg", ".hidden", "a\x00.ulg", "a/b", "a\\b", "", "a\nb", "x" * 201, "é" * 200]
)
def test_no_name_leads_out_of_the_folder(drop, page, tmp_path, name):
    sent(drop, name, b"0123")
    assert len(page.said) == 1
    assert not any(tmp_path.iterdir())
    assert page.came == [4], "the browser would wait for ever"


def test_what_is_too_large_is_refused_before_it_comes(drop, page, tmp_path, monkeypatch):
    drop.start("a", "large.ulg", FileDrop.largest + 1)
    drop.part("a", b"0123")
    assert "wrenchgap view LOG" in page.said[0]
    monkeypatch.setattr(FileDrop, "most", 10)
    sent(drop, "one.ulg", b"01234567")
    sent(drop, "two.ulg", b"012", "b")
    assert "start the page again" in page.said[1]
    assert [p.name for p in tmp_path.rglob("*") if p.is_file()] == ["one.ulg"]


def test_more_than_was_said_is_no_file(drop, page, tmp_path):
    sent(drop, "a.ulg", b"012345678901", size=10)
    assert len(page.said) == 1
    assert page.received == []
    assert not [p for p in tmp_path.rglob("*") if p.is_file()]


def test_another_file_ends_one_that_is_on_its_way(drop, page, tmp_path, eventually):
    drop.start("a", "first.ulg", 8)
    drop.part("a", b"0123")
    sent(drop, "second.ulg", b"01234567", "b")
    drop.part("a", b"4567")
    (path,) = eventually(lambda: page.received)
    assert path.name == "second.ulg"
    assert [p.name for p in tmp_path.rglob("*") if p.is_file()] == ["second.ulg"]
    assert [said.partition(":")[0] for said in page.said] == ["first.ulg"], "nobody was told that it did not come"


def test_a_page_that_changes_ends_a_file_that_is_on_its_way(drop, page, tmp_path):
    drop.start("a", "first.ulg", 8)
    drop.part("a", b"0123")
    drop.end()
    drop.part("a", b"4567")
    assert [said.partition(":")[0] for said in page.said] == ["first.ulg"]
    assert page.received == []
    assert not any(tmp_path.iterdir())
    drop.end()
    assert len(page.said) == 1


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_a_full_disk_is_one_line_and_the_next_file_comes(drop, page, eventually):
    """What the system has not taken yet fails once more when the file is closed."""
    drop.start("a", "first.ulg", 8)
    drop._file = Path("/dev/full").open("wb")  # noqa: SIM115
    drop._file.write(b"0123")
    with pytest.raises(OSError, match="space"):
        drop._file.flush()
    drop.end()
    sent(drop, "second.ulg", b"01234567", "b")
    (path,) = eventually(lambda: page.received)
    assert path.read_bytes() == b"01234567"


def test_viser_never_has_what_a_drop_takes(drop, page, eventually):
    server, _, _ = serve("127.0.0.1", 0)
    try:
        button = server.gui.add_upload_button("upload")
        inbox = Inbox({"drop": button}.get, page.drops)
        names = {"source_component_uuid": "drop", "transfer_uuid": "t"}
        start = {"type": "FileTransferStartUpload", **names, "filename": "a.ulg", "mime_type": ""}
        assert not inbox.admits(msgspec.msgpack.encode({**start, "part_count": 3000, "size_bytes": 6}))
        for k, content in enumerate((b"012", b"345")):
            part = {"type": "FileTransferPart", **names, "part_index": k, "content": content}
            assert not inbox.admits(msgspec.msgpack.encode(part))
    finally:
        server.stop()
    (path,) = eventually(lambda: page.received)
    assert path.read_bytes() == b"012345"
