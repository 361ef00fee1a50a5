"""The page writes into one folder, and over no file but its own."""

import os
from contextlib import suppress
from threading import Event, Thread
from time import monotonic

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wrenchgap.flight.errors import UsageError
from wrenchgap.replay.session.saving import SaveFolder, file_name
from wrenchgap.viewer.host import error_text


@pytest.mark.parametrize("name", ["fitted.toml", "2026-11-24.v2.toml", "A_b.TOML"])
def test_plain_names_pass(name):
    assert file_name(name) == name


@given(st.text(max_size=130) | st.from_regex(r"[./\\a-c:~ -]{0,12}\.toml", fullmatch=True))
def test_a_name_that_passes_is_one_file_of_the_folder_on_every_system(name):
    with suppress(UsageError):
        file_name(name)
        is_plain(name)


def is_plain(name):
    assert name.isascii()
    assert name.isprintable()
    assert not set(name) & set('/\\:*?"<>| ~')
    assert name[0] not in ".-"
    assert len(name) <= 105


@pytest.mark.parametrize(
    "name", ["nul.toml", "CON.x.toml", "com1.toml", "a.toml\n", "\uff0e.toml", ".toml", "toml", ""]
)
def test_devices_and_odd_names_do_not(name):
    with pytest.raises(UsageError, match=r"expected a file name that ends in \.toml"):
        file_name(name)


@pytest.mark.parametrize("name", ["/tmp/elsewhere/z.toml", "../y.toml", "sub/x.toml", "C:\\models\\z.toml"])
def test_a_refused_name_is_shown_as_it_was_given_folders_and_all(name):
    """The page takes the folders of a path out of what it shows (`viewer.host`), and this was the last part alone."""
    with pytest.raises(UsageError) as refused:
        file_name(name)
    assert error_text(refused.value).partition(": expected")[0].replace(" ", "") == name


def test_what_the_page_wrote_it_may_replace(tmp_path):
    folder = SaveFolder(tmp_path)
    assert folder.write("a.toml", "1").read_text() == "1"
    assert folder.write("a.toml", "2").read_text() == "2"


def test_what_somebody_changed_or_replaced_since_it_may_not(tmp_path):
    folder = SaveFolder(tmp_path)
    path = folder.write("a.toml", "1")
    path.write_text("by hand")
    with pytest.raises(UsageError, match="--force"):
        folder.write("a.toml", "2")
    path.unlink()
    folder.write("a.toml", "3")
    other = tmp_path / "other"
    other.write_text("3")
    other.replace(path)
    with pytest.raises(UsageError, match="exists already"):
        folder.write("a.toml", "4")
    assert path.read_text() == "3"


def test_force_replaces_files_and_nothing_else(tmp_path):
    (tmp_path / "mine.toml").write_text("mine")
    (tmp_path / "folder.toml").mkdir()
    outside = tmp_path.parent / f"{tmp_path.name}-outside"
    outside.write_text("mine")
    (tmp_path / "link.toml").symlink_to(outside)
    os.mkfifo(tmp_path / "pipe.toml")
    folder = SaveFolder(tmp_path, force=True)
    assert folder.write("mine.toml", "new").read_text() == "new"
    for name in ("folder.toml", "link.toml", "pipe.toml"):
        with pytest.raises(UsageError, match="no ordinary file"):
            folder.write(name, "new")
    assert outside.read_text() == "mine"


def test_a_link_that_comes_and_goes_is_never_followed(tmp_path):
    """One was put there between the look and the write: after some thousand saves a file of the user was a model."""
    mine, shared = tmp_path / "mine", tmp_path / "shared"
    shared.mkdir()
    mine.write_text("mine")
    stop = Event()

    def flip():
        while not stop.is_set():
            with suppress(OSError):
                (shared / "m.toml").symlink_to(mine)
            with suppress(OSError):
                (shared / "m.toml").unlink()

    other = Thread(target=flip)
    other.start()
    try:
        folder, end = SaveFolder(shared), monotonic() + 2.0
        while monotonic() < end:
            with suppress(UsageError):
                folder.write("m.toml", "model")
            assert mine.read_text() == "mine"
    finally:
        stop.set()
        other.join()


def test_a_folder_that_is_none_is_said_at_the_start(tmp_path):
    with pytest.raises(UsageError, match=r"--save-to .*: is no folder; make it first"):
        SaveFolder(tmp_path / "none")
