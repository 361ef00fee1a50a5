"""A folder is the old one or the new one, whoever ends the process, and is nobody's but its owner's."""

import os
import signal
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from wrenchgap.flight.errors import UsageError
from wrenchgap.replay.export import folder as place
from wrenchgap.replay.export.folder import write_folder

OLD, NEW = ({f"{k}.c": f"{word} {k}" * 1000 for k in range(8)} for word in ("old", "new"))


@pytest.fixture
def folder(tmp_path):
    return write_folder(tmp_path / "made", OLD)


@pytest.mark.parametrize("name", ["a\0b", "\ud800"])
def test_what_no_folder_can_be_called_is_refused(name, tmp_path):
    with pytest.raises(UsageError, match=r"is no name that a file can have"):
        write_folder(tmp_path / name, NEW)


def content(folder):
    return {p.name: p.read_text(encoding="utf-8") for p in folder.iterdir()}


@pytest.fixture(params=["in one step", "in two steps"])
def steps(request, monkeypatch):
    if request.param == "in two steps":
        monkeypatch.setattr(place, "_exchanged", lambda one, other: False)


@pytest.mark.usefixtures("steps")
def test_a_folder_is_replaced_whole_and_nothing_is_left_beside_it(folder):
    write_folder(folder, NEW, force=True)
    assert content(folder) == NEW
    assert list(folder.parent.iterdir()) == [folder]


@pytest.mark.usefixtures("steps")
@pytest.mark.parametrize("when", range(1, 14))
def test_interrupted_at_any_call_the_folder_is_the_old_or_the_new_one(folder, when):
    """The old one was gone, its files in a hidden folder, where a signal came between two renames."""
    calls = 0

    def interrupt(frame, event, arg):
        nonlocal calls
        if event == "c_return" and arg.__name__ in ("rename", "replace", "fsync", "renameat2", "mkdir", "chmod"):
            calls += 1
            if calls == when + 1:
                raise KeyboardInterrupt

    sys.setprofile(interrupt)
    try:
        write_folder(folder, NEW, force=True)
    except KeyboardInterrupt:
        pass
    finally:
        sys.setprofile(None)
    assert content(folder) in (OLD, NEW)
    assert list(folder.parent.iterdir()) == [folder]


@pytest.mark.skipif(sys.platform != "linux", reason="two names change places in one step on Linux")
def test_killed_at_any_moment_the_folder_is_the_old_or_the_new_one(folder):
    for moment in np.linspace(0.0, 0.02, 25):
        child = os.fork()
        if not child:
            while True:
                write_folder(folder, NEW, force=True)
                write_folder(folder, OLD, force=True)
        time.sleep(moment)
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        assert content(folder) in (OLD, NEW)


@pytest.mark.parametrize("names", [("Makefile",), ("Makefile", "README.md"), ("__pycache__",)])
def test_a_folder_of_files_that_anybody_may_have_is_not_ours(names, tmp_path):
    """`effectiveness -o PROJECT --force` replaced a folder in which there was only the user's Makefile."""
    for name in names:
        (tmp_path / name).mkdir() if name == "__pycache__" else (tmp_path / name).write_text("mine\n")
    files = {"Makefile": "", "README.md": "", "wrenchgap_allocation.py": ""}
    with pytest.raises(UsageError, match=f"holds {names[0]}.*did not write"):
        write_folder(tmp_path, files, force=True)
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted(names)


@pytest.mark.usefixtures("steps")
def test_permissions_are_those_of_the_old_folder_or_of_the_umask(folder):
    folder.chmod(0o700)
    write_folder(folder, NEW, force=True)
    assert folder.stat().st_mode & 0o777 == 0o700
    before = os.umask(0o027)
    try:
        other = write_folder(folder.with_name("other"), NEW)
    finally:
        os.umask(before)
    assert other.stat().st_mode & 0o777 == 0o750


def test_the_working_folder_is_not_replaced(folder, monkeypatch):
    monkeypatch.chdir(folder)
    for name in (Path(), folder):
        with pytest.raises(UsageError, match=r"is the working folder.* run the command from .* --output made"):
            write_folder(name, NEW, force=True)
    assert content(folder) == OLD


def test_a_long_name_is_written(tmp_path):
    assert content(write_folder(tmp_path / ("a" * 255), NEW)) == NEW
