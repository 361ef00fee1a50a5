"""Work in a process of its own: result, progress and errors come back, and whoever cancels ends all of it."""

import contextlib
import os
import time
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from wrenchgap.flight.errors import FitError
from wrenchgap.learn.parallel import each
from wrenchgap.replay.session.worker import worker_result

silent = Mock()


def test_result_and_progress_come_back_from_another_process():
    told = []

    def work(report):
        report(0.5, "half")
        return os.getpid(), np.arange(3.0)

    pid, values = worker_result(work, lambda share, words: told.append((share, words)))
    assert pid != os.getpid()
    assert np.array_equal(values, [0.0, 1.0, 2.0])
    assert (0.5, "half") in told


def test_errors_of_the_work_are_raised_here():
    def work(report):
        raise FitError("too short")

    with pytest.raises(FitError, match="too short"):
        worker_result(work, silent)

    def broken(report):
        return {}["missing"]

    with pytest.raises(RuntimeError, match="KeyError"):
        worker_result(broken, silent)


def test_a_child_that_dies_is_told_not_waited_for():
    with pytest.raises(FitError, match="without a result"):
        worker_result(lambda report: os._exit(1), silent)


def test_cancelling_ends_the_child_and_its_workers(tmp_path):
    def sleep(name):
        (tmp_path / name).write_text(str(os.getpid()))
        time.sleep(60.0)

    def work(report):
        (tmp_path / "leader").write_text(str(os.getpid()))
        return list(each(sleep, ["a", "b"], jobs=2))

    def report(share, words):
        if all((tmp_path / name).exists() and (tmp_path / name).read_text() for name in ("leader", "a")):
            cancelled.append(time.monotonic())
            raise KeyboardInterrupt

    cancelled = []
    with pytest.raises(KeyboardInterrupt):
        worker_result(work, report)
    assert time.monotonic() - cancelled[0] < 20.0
    for name in ("leader", "a"):
        status = Path("/proc", (tmp_path / name).read_text(), "status")
        deadline = time.monotonic() + 5.0
        with contextlib.suppress(FileNotFoundError, ProcessLookupError):  # or it is there, and a zombie
            while "State:\tZ" not in status.read_text():
                assert time.monotonic() < deadline
                time.sleep(0.05)
