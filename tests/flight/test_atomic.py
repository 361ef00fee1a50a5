"""A file is the old one or the new one, whoever ends the process, and whatever the disk does."""

import ast
import errno
import os
import resource
import secrets
import signal
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from wrenchgap.flight.atomic import atomic, identity, write_below
from wrenchgap.flight.errors import UsageError

ROOT = Path(__file__).resolve().parents[2]
OLD = b"old" * 400_000
NEW = b"new" * 500_000


def in_child(work):
    """The id of a process that does `work`; it ends with code 0, with 2 for UsageError, with 130 where interrupted."""
    child = os.fork()
    if child:
        return child
    try:
        work()
        os._exit(0)
    except UsageError:
        os._exit(2)
    except KeyboardInterrupt:
        os._exit(130)
    finally:
        os._exit(1)


def write(path, content=NEW, pieces=50):
    with atomic(path) as partial, partial.open("wb", buffering=0) as stream:
        for piece in np.array_split(np.frombuffer(content, dtype=np.uint8), pieces):
            stream.write(piece.tobytes())


@pytest.fixture
def path(tmp_path):
    (tmp_path / "file.bin").write_bytes(OLD)
    return tmp_path / "file.bin"


def test_killed_at_any_moment_the_file_is_the_old_or_the_new_one(path):
    found = set()
    for moment in np.linspace(0.0, 0.02, 25):
        path.write_bytes(OLD)
        child = in_child(lambda: write(path))
        time.sleep(moment)
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        content = path.read_bytes()
        assert content in (OLD, NEW)
        found.add(content == NEW)
    write(path)
    assert path.read_bytes() == NEW
    assert found  # which of both depends on the machine


def test_interrupted_while_writing_the_old_file_stays_and_nothing_else(path):
    reading, writing = os.pipe()

    def slow():
        signal.signal(
            signal.SIGINT, signal.default_int_handler
        )  # what runs in the background inherits that it is ignored
        with atomic(path) as partial:
            partial.write_bytes(b"half")
            os.write(writing, b"x")
            time.sleep(30)

    child = in_child(slow)
    os.read(reading, 1)
    os.kill(child, signal.SIGINT)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 130
    assert path.read_bytes() == OLD
    assert list(path.parent.iterdir()) == [path]


def test_a_full_disk_is_one_line_and_the_old_file_stays(path):
    def limited():
        resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        write(path)

    assert os.waitstatus_to_exitcode(os.waitpid(in_child(limited), 0)[1]) == 2
    assert path.read_bytes() == OLD
    assert list(path.parent.iterdir()) == [path]


@pytest.mark.parametrize("name", ["/dev/full", "/dev/null"])
def test_a_device_is_not_replaced_by_a_file(name):
    with pytest.raises(UsageError, match="no ordinary file"):
        write(Path(name))
    assert Path(name).is_char_device()


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="needs /proc, where nobody can write")
def test_a_place_where_nobody_can_write(tmp_path):
    with pytest.raises(UsageError, match=r"wrenchgap\.json: cannot be written"):
        write(Path("/proc/wrenchgap.json"))


@pytest.mark.parametrize("name", ["a\0b.toml", "\ud800.toml"])
def test_what_no_file_can_be_called_is_refused(name, tmp_path):
    with pytest.raises(UsageError, match=r"is no name that a file can have"):
        write(tmp_path / name)


def test_a_link_that_leads_back_to_itself_is_refused(tmp_path):
    (tmp_path / "a.toml").symlink_to("b.toml")
    (tmp_path / "b.toml").symlink_to("a.toml")
    with pytest.raises(UsageError, match=r"a.toml: is a link that leads back to itself"):
        write(tmp_path / "a.toml")


def test_a_link_stays_a_link(path):
    link = path.with_name("link.bin")
    link.symlink_to(path.name)
    write(link)
    assert link.is_symlink()
    assert path.read_bytes() == NEW


def test_another_name_of_the_same_file_keeps_its_content(path):
    other = path.with_name("input.bin")
    os.link(path, other)
    write(path)
    assert other.read_bytes() == OLD


@pytest.mark.parametrize("name", ["a" * 250 + ".toml", "é" * 125 + ".json", "a." + "b" * 253])
def test_a_name_is_as_long_as_the_file_system_takes_it(name, tmp_path):
    """The hidden one beside it was longer, and what was said named that one."""
    write(tmp_path / name)
    write_below(tmp_path, name, OLD)
    assert [(p.name, p.read_bytes()) for p in tmp_path.iterdir()] == [(name, OLD)]


def test_two_that_write_one_name_at_the_same_time_each_write_it_whole(tmp_path):
    """Also where their process numbers are the same, as those of two containers that share a folder may be."""
    path = tmp_path / "file"
    with atomic(path) as first:
        first.write_bytes(b"1")
        with atomic(path) as second:
            second.write_bytes(b"2")
        assert path.read_bytes() == b"2"
    assert path.read_bytes() == b"1"
    times = []

    def other(found):
        """Write too, once the hidden file is written."""
        times.append(found)
        if len(times) == 2:
            write_below(tmp_path, "file", b"other")

    write_below(tmp_path, "file", b"own", other)
    assert len(times) == 2
    assert [(p.name, p.read_bytes()) for p in tmp_path.iterdir()] == [("file", b"own")]


def test_below_a_folder_no_link_is_followed_wherever_it_is(tmp_path, monkeypatch):
    own, shared = tmp_path / "own", tmp_path / "shared"
    own.mkdir()
    shared.mkdir()
    (own / "mine").write_bytes(OLD)
    write_below(shared, "a/b/file", b"1")
    assert (shared / "a/b/file").read_bytes() == b"1"
    guessed = shared / "a/b/.file.guessed.part"
    guessed.symlink_to(own / "mine")
    with monkeypatch.context() as patch:
        patch.setattr(secrets, "token_hex", lambda size: "guessed")
        with pytest.raises(UsageError, match="nothing was replaced"):
            write_below(shared, "a/b/file", b"2")
    guessed.unlink()
    assert (shared / "a/b/file").read_bytes() == b"1"
    (shared / "a/b/link").symlink_to(own / "mine")
    (shared / "linked").symlink_to(own)
    os.mkfifo(shared / "pipe")
    for name, words in {"a/b/link": "no ordinary", "linked/mine": "expected a folder", "pipe": "no ordinary"}.items():
        with pytest.raises(UsageError, match=words):
            write_below(shared, name, b"3")
    with pytest.raises(UsageError, match="cannot be written"):
        write_below(tmp_path / "none", "file", b"4")
    assert (own / "mine").read_bytes() == OLD
    assert sorted(p.name for p in (shared / "a/b").iterdir()) == ["file", "link"]


def test_below_a_folder_a_file_that_is_replaced_keeps_its_mode(tmp_path):
    write_below(tmp_path, "file", b"1")
    (tmp_path / "file").chmod(0o600)
    found = write_below(tmp_path, "file", b"22")
    assert (tmp_path / "file").stat().st_mode & 0o777 == 0o600
    assert found == identity((tmp_path / "file").lstat())


def test_what_somebody_puts_there_meanwhile_is_neither_followed_nor_replaced(tmp_path, monkeypatch):
    """Between the look and the write, at every step of the system."""
    (tmp_path / "mine").write_bytes(OLD)
    folder = tmp_path / "shared"
    folder.mkdir()
    real = os.link

    def late(*arguments, **options):
        (folder / "file").symlink_to(tmp_path / "mine")
        real(*arguments, **options)

    monkeypatch.setattr(os, "link", late)
    with pytest.raises(UsageError, match="somebody else made it meanwhile"):
        write_below(folder, "file", b"new")
    assert (tmp_path / "mine").read_bytes() == OLD
    assert [p.name for p in folder.iterdir()] == ["file"]


def test_a_file_system_without_hard_links_is_written_to(tmp_path, monkeypatch):
    def none(*arguments, **options):
        raise OSError(errno.EPERM, "Operation not permitted")

    monkeypatch.setattr(os, "link", none)
    write_below(tmp_path, "file", b"1")
    write_below(tmp_path, "file", b"2")
    assert [p.read_bytes() for p in tmp_path.iterdir()] == [b"2"]


WRITERS = ("write_text", "write_bytes", "to_csv", "savefig", "savez", "to_parquet", "copyfile", "copyfileobj")
NO_OUTPUT = {
    "flight/formats/rosbag2.py": "a decompressed copy in a folder that goes again",
    "flight/work_files.py": "what worker processes read, in a folder that goes again",
    "viewer/file_drop.py": "a log on its way in, in a folder that goes again",
    "learn/worker.py": "the pipe to whoever asks",
    "plant/drafts/mjcf_urdf.py": "the pipe to whoever asks",
    "plant/trajectory/file.py": "a path that `replay.present.design` gets of `atomic`",
    "replay/export/folder.py": "a folder beside the target, which takes its name when it is whole",
    "replay/batch/tasks.py": "what a worker reads, in a folder that goes again",
    "replay/cli/main.py": "the traceback of a fault, in a file of its own",
    "replay/present/report/sections.py": "a picture in memory",
    "replay/export/records.py": "code that is compiled in a folder of its own",
}


def writes(source):
    """Lines that write to something that is not what `atomic` gives, called `partial`, or the stream of one."""
    given = "atomic(" in source or "partial: Path" in source
    for node in ast.walk(ast.parse(source)):
        if not isinstance(node, ast.Call) or not isinstance(node.func, ast.Attribute):
            continue
        name, words = node.func.attr, ast.unparse(node)
        modes = [a.value for a in [*node.args, *(k.value for k in node.keywords)] if isinstance(a, ast.Constant)]
        opens = name in ("open", "fdopen") and any(isinstance(m, str) and set(m) & set("wax+") for m in modes[:1])
        if (
            (name in WRITERS or opens)
            and not (given and "partial" in words)
            and not words.startswith("np.savez(stream")
        ):
            yield node.lineno, words


def test_every_file_is_written_through_atomic():
    found = {}
    for package in ("flight", "plant", "learn", "compensate", "viewer", "replay"):
        for path in sorted((ROOT / package).rglob("*.py")):
            name = str(path.relative_to(ROOT))
            text = path.read_text(encoding="utf-8")
            lines = list(writes(text)) if any(word in text for word in (*WRITERS, "open(")) else []
            if lines and name not in NO_OUTPUT and name != "flight/atomic.py":
                found[name] = lines
    assert found == {}
    assert list(writes("path.write_text('x')\nwith path.open('w') as f: pass"))
    assert list(writes("with system.open(partial, 'wb') as stream: pass"))  # a hidden file of its own


if sys.platform != "linux":
    pytest.skip("processes and their limits as on Linux", allow_module_level=True)
