"""Arrays of hours of log in temporary files: the same numbers, not resident, nothing left behind."""

import sys
from pathlib import Path

import numpy as np
import pytest

from wrenchgap.flight import memory

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="madvise and /proc are Linux's")


def resident():
    """Bytes of this process that lie in memory."""
    return 4096 * int(Path("/proc/self/statm").read_text().split()[1])


def test_numbers_are_the_same_and_leave_memory_when_they_are_given_back(tmp_path, monkeypatch):
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    values = np.random.default_rng(1).standard_normal((memory.HOURS, 8))  # 64 MB
    kept = memory.on_disk(values)
    assert kept.tobytes() == values.tobytes()
    del values
    memory.give_back(memory.HOURS)  # with what other tests of this process left
    least = resident()
    assert np.isfinite(kept).all()
    full = resident()
    assert full - least > 50e6
    memory.give_back(memory.HOURS)
    assert full - resident() > 50e6
    assert list(tmp_path.iterdir()) == []  # the file has no name


def test_what_is_short_or_on_disk_already_stays_where_it_is(tmp_path, monkeypatch):
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    short = np.zeros((100, 3))
    assert memory.on_disk(short) is short
    kept = memory.on_disk(np.zeros((memory.HOURS, 2)))
    assert memory.on_disk(kept) is kept
    assert np.shares_memory(memory.on_disk(kept[10:, 0]), kept)


def test_one_array_is_let_go_and_others_stay(tmp_path, monkeypatch):
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    values = np.random.default_rng(1).standard_normal((1000, 6000))  # 48 MB, few rows
    assert memory.on_disk(values) is values
    kept, other = memory.on_disk(values, least=1000), memory.empty_on_disk(values.shape, least=1000)
    other[:] = 1.0
    assert np.array_equal(kept, values)
    full = resident()
    memory.let_go(kept[5:, 3])  # a view counts for the whole
    assert 40e6 < full - resident() < 60e6
    memory.let_go(values)  # which is no file
    assert np.array_equal(kept, values)
    assert (other == 1.0).all()


def test_without_room_on_a_disk_it_stays_in_memory(tmp_path, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(memory.os, "posix_fallocate", full)
    values = np.zeros((memory.HOURS, 2))
    assert memory.on_disk(values) is values


def test_an_empty_array_of_hours_is_in_a_file_and_a_short_one_is_not(tmp_path, monkeypatch):
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    for dtype in (float, np.int32, bool):
        long = memory.empty_on_disk((memory.HOURS, 3), dtype)
        assert long.shape == (memory.HOURS, 3)
        assert long.dtype == dtype
        assert memory.on_disk(long) is long  # it is in a file already
        long[5] = 1
        memory.give_back(memory.HOURS)
        assert long[5].all()  # what was written stays
    assert not memory._is_mapped(memory.empty_on_disk((100, 3)))
    assert not memory._is_mapped(memory.empty_on_disk((memory.HOURS, 3), object))
