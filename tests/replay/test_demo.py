"""`demo` into a folder that is not empty: it replaces what a demo wrote, and nothing else."""

import pytest

from wrenchgap.replay.cli.commands import demo


@pytest.fixture
def short(monkeypatch):
    """A demo of its first step alone, with a flight of 2 s."""
    line = "simulate -m tilt_hexarotor -t figure8 --duration 2 --quiet -o train.mcap"
    monkeypatch.setattr(demo, "_steps", lambda: [demo.Step("Fly", tuple(line.split()))])
    monkeypatch.setattr(demo, "_numbers", lambda folder: {})
    monkeypatch.setattr(demo, "_result", lambda run, found: None)


def test_a_second_demo_replaces_what_the_first_wrote(short, run, tmp_path):
    assert run("demo").exit_code == 0
    folder = tmp_path / "demo-output"
    (folder / "mine.txt").write_text("notes")
    first = (folder / "train.mcap").stat().st_ino
    again = run("demo")
    assert again.exit_code == 0, again.output
    assert (folder / "train.mcap").stat().st_ino != first
    assert (folder / "mine.txt").read_text() == "notes"


@pytest.mark.parametrize("content", [b"edited", None])
def test_a_changed_file_is_kept(short, run, refused, tmp_path, content):
    run("demo")
    file = tmp_path / "demo-output" / "train.mcap"
    file.unlink()
    file.write_bytes(content) if content else file.mkdir()
    assert "train.mcap: was changed since the demo wrote it; choose another folder with -o" in refused("demo")
    assert file.is_dir() or file.read_bytes() == content


@pytest.mark.parametrize("note", [None, "no JSON", "[]"])
def test_a_folder_that_no_demo_wrote_is_left_alone(short, refused, tmp_path, note):
    folder = tmp_path / "demo-output"
    folder.mkdir()
    (folder / "train.mcap").write_bytes(b"a flight of mine")
    if note:
        (folder / demo.WRITTEN).write_text(note)
    assert "is not empty; choose another folder with -o, or say --force" in refused("demo")
    assert (folder / "train.mcap").read_bytes() == b"a flight of mine"
