"""A kept flight is the flight; whatever changes makes it be read anew; a damaged file is no disaster."""

import os
from dataclasses import fields

import numpy as np
import pytest

from wrenchgap import flight
from wrenchgap.flight import cache
from wrenchgap.flight.budget import Limits
from wrenchgap.flight.errors import LogError
from wrenchgap.flight.inspection import channels_of
from wrenchgap.plant import model_file
from wrenchgap.plant.simulation.flight_plan import Plan, fly


def written(path, seconds):
    plan = Plan(model_file.load("tilt_hexarotor"), "figure8", seconds, 0.0, 1, None, ())
    flight.write(fly(plan, name="short"), path, force=True)


@pytest.fixture
def log(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    path = tmp_path / "short.mcap"
    written(path, 3.0)
    return path


@pytest.fixture
def reads(monkeypatch):
    """Paths of the logs that were really read."""
    seen = []
    monkeypatch.setattr(cache, "read", lambda path, *rest: seen.append(path) or flight.load(path, *rest))
    return seen


def same(one, other):
    for item in fields(one):
        a, b = getattr(one, item.name), getattr(other, item.name)
        if isinstance(a, flight.Series):
            same(a, b)
        elif isinstance(a, np.ndarray):
            assert np.array_equal(a, b)
            assert a.dtype == b.dtype
        else:
            assert a == b, item.name


def test_the_second_time_it_is_not_read_and_yet_the_same(log, reads):
    first = cache.load(log)
    second = cache.load(log)
    assert reads == [log]
    same(first, flight.load(log))
    same(second, first)


def test_another_mapping_another_content_or_a_damaged_file_is_read_anew(log, reads):
    cache.load(log)
    cache.load(log, {"desired": "none"})
    assert len(reads) == 2
    for file in cache.folder().glob("*.npz"):
        file.write_bytes(file.read_bytes()[:1000])
    cache.load(log)
    assert len(reads) == 3
    written(log, 4.0)
    assert cache.load(log).imu.time[-1] > 3.5
    assert len(reads) == 4


def test_old_flights_make_room(log, reads, monkeypatch):
    monkeypatch.setattr(cache, "LIMITS", Limits(kept_flights=1))
    cache.load(log)
    cache.load(log, {"desired": "none"})
    assert len(list(cache.folder().glob("*"))) == 1


def test_a_folder_that_cannot_be_written_keeps_nothing_and_breaks_nothing(log, reads, monkeypatch, tmp_path):
    (tmp_path / "file").write_text("no folder")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    same(cache.load(log), flight.load(log))


def test_a_log_that_is_none_is_told_as_ever(tmp_path):
    with pytest.raises(LogError, match="no such file"):
        cache.load(tmp_path / "none.mcap")


def test_channels_are_everything_in_the_log_on_its_clock(log):
    found = flight.load(log)
    every = channels_of(log, found)
    time, values = every["/imu.angular_velocity.x"]
    assert time == pytest.approx(found.imu.time, abs=1e-9)
    assert values == pytest.approx(found.imu.omega_B[:, 0])
    assert len([name for name in every if name.startswith("/command/actuators.velocity[")]) == 12
    assert not any("header" in name for name in every)


@pytest.mark.skipif(os.name != "posix", reason="modes")
def test_nobody_else_reads_what_is_kept(log, reads):
    """A log of 0600 was copied to 0644 in 0755; what an earlier version left so is tightened, also when it is read."""
    kept = cache.folder()
    kept.mkdir(parents=True)
    kept.chmod(0o755)
    cache.load(log)
    (file,) = kept.glob("*.npz")
    assert [path.stat().st_mode & 0o777 for path in (kept, file)] == [0o700, 0o600]
    kept.chmod(0o755)
    cache.load(log)
    assert kept.stat().st_mode & 0o777 == 0o700
    assert reads == [log]


@pytest.mark.skipif(os.name != "posix", reason="links")
def test_no_link_is_followed(log, reads, tmp_path):
    elsewhere, kept = tmp_path / "elsewhere", cache.folder()
    elsewhere.mkdir(mode=0o755)
    kept.parent.mkdir(parents=True)
    kept.symlink_to(elsewhere)
    cache.load(log)
    assert not list(elsewhere.iterdir())
    assert elsewhere.stat().st_mode & 0o777 == 0o755
    kept.unlink()
    cache.load(log)
    (file,) = kept.glob("*.npz")
    file.rename(tmp_path / "other")
    (tmp_path / "other").write_text("mine")
    file.symlink_to(tmp_path / "other")
    cache.load(log)
    assert (tmp_path / "other").read_text() == "mine"
    assert not file.is_symlink()


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="has no pipes with names")
def test_a_pipe_in_the_place_of_a_kept_flight_is_not_waited_for(log, reads):
    cache.load(log)
    (kept,) = cache.folder().glob("*.npz")
    kept.unlink()
    os.mkfifo(kept)
    cache.load(log)
    assert len(reads) == 2


def test_a_log_that_another_replaces_before_it_is_read_is_not_kept_as_that_one(log, monkeypatch):
    first = log.read_bytes()

    def replaced(path, *rest):
        written(path, 4.0)
        return flight.load(path, *rest)

    with monkeypatch.context() as patched:
        patched.setattr(cache, "read", replaced)
        assert cache.load(log).imu.time[-1] > 3.5
    log.write_bytes(first)
    assert cache.load(log).imu.time[-1] < 3.5


def test_that_a_file_could_not_be_read_whole_is_kept_too(log, reads):
    log.write_bytes(log.read_bytes()[:-200_000])
    first, second = cache.load(log), cache.load(log)
    assert len(reads) == 1
    assert first.damage == second.damage
    assert any("cut short" in said for said in second.damage)
