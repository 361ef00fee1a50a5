"""Child processes that open files, with a limit of time for each file and of memory for each process."""

from __future__ import annotations

import multiprocessing
import os
import resource
import shutil
import tempfile
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import psutil

from benchmarks.faults.cases import Case
from benchmarks.faults.opening import Opened, Outcome, judged, opened
from benchmarks.faults.valid import FORMS, LOGS

SECONDS = 20.0
"""Of processor time for one file."""
ASLEEP = 160
"""Seconds in which a process waits for something else than a core, before it counts as hung."""
MEGABYTES = 1500
"""Of address space above what an idle process has after it has opened the valid files."""
FOR_MODEL = 10
"""Every so many logs is opened for a model as well."""


@dataclass(frozen=True)
class Row:
    """What came of one case."""

    form: str
    number: int
    damage: str
    outcome: str
    error: str
    seconds: float


class Worker:
    """One child process, which is replaced when it dies or takes too long."""

    def __init__(self, forms: Sequence[str]) -> None:
        self.forms = forms
        self._start()

    def _start(self) -> None:
        context = multiprocessing.get_context("spawn")
        self.pipe, other = context.Pipe()
        self.process = context.Process(target=_serve, args=(other, tuple(self.forms)), daemon=True)
        self.process.start()
        other.close()
        if not self.pipe.poll(600.0) or self.pipe.recv() != "ready":
            raise RuntimeError("a worker of the benchmark could not open the valid files")

    def row(self, case: Case) -> Row:
        """Open one case."""
        used, asleep = self._processor(), 0
        self.pipe.send(case)
        try:
            while not self.pipe.poll(1.0):
                took, asleep = self._processor() - used, asleep + self._waits()
                if took > SECONDS or asleep > ASLEEP:
                    break
            else:
                outcome, error, damage = self.pipe.recv()
                return Row(case.form, case.number, damage, outcome, error, round(self._processor() - used, 3))
            error = f"took longer than {SECONDS:g} s of processor time, or hung"
        except EOFError:
            self.process.join(10)
            error = f"the process died (exit code {self.process.exitcode})"
        self.close()
        self._start()
        return Row(case.form, case.number, "", Outcome.FAULT.value, error, SECONDS)

    def _processor(self) -> float:
        """Processor time of the child [s]."""
        try:
            times = psutil.Process(self.process.pid).cpu_times()
        except psutil.Error:
            return 0.0
        return float(times.user + times.system)

    def _waits(self) -> bool:
        """Whether the child waits for something else than a core, for which it may wait minutes."""
        try:
            return psutil.Process(self.process.pid).status() != psutil.STATUS_RUNNING
        except psutil.Error:
            return True

    def close(self) -> None:
        """End the process."""
        self.process.kill()
        self.process.join()
        self.pipe.close()


def rows(cases: Sequence[Case]) -> Iterator[Row]:
    """What comes of the cases, one after another in one child process."""
    worker = Worker(sorted({case.form for case in cases}))
    try:
        for case in cases:
            yield worker.row(case)
    finally:
        worker.close()


def _serve(pipe: Connection, forms: tuple[str, ...]) -> None:
    """The child: cases in, outcomes out."""
    os.environ["WRENCHGAP_DEBUG"] = "1"
    with tempfile.TemporaryDirectory(prefix="wrenchgap-faults-") as name:
        folder = Path(name)
        valid, intact = {}, {}
        for form in forms:
            place = folder / "valid" / form
            place.mkdir(parents=True)
            valid[form] = FORMS[form](place)
            intact[form] = opened(form, valid[form])
        # as in the tests: a warning of numpy's that our own code lets through would stand on the user's screen
        warnings.filterwarnings("error", category=RuntimeWarning, module=r"wrenchgap\.")
        _limit_memory()
        pipe.send("ready")
        while True:
            try:
                case = pipe.recv()
            except EOFError:
                return
            pipe.send(_opened(case, valid[case.form], intact[case.form], folder / "case"))


def _limit_memory() -> None:
    now = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (now + MEGABYTES * 2**20, resource.RLIM_INFINITY))


def _opened(case: Case, valid: Path, intact: Opened, folder: Path) -> tuple[str, str, str]:
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    path, damage = case.make(valid, folder)
    before = _content(path)
    outcome, error = judged(case.form, path, intact)
    if outcome in (Outcome.WHOLE, Outcome.RECOVERED, Outcome.ALTERED) and _for_model(case):
        second, why = judged("for model", path, intact)
        if second == Outcome.FAULT:
            outcome, error = second, f"for a model: {why}"
    if _content(path) != before:
        outcome, error = Outcome.FAULT, "the file was changed by being opened"
    return outcome.value, error, damage


def _for_model(case: Case) -> bool:
    return case.form in LOGS and case.number % FOR_MODEL == 0


def _content(path: Path) -> dict[str, Any]:
    """Sizes and times of change of a file, or of all in a folder."""
    files = [path] if path.is_file() else sorted(path.rglob("*"))
    return {str(p): (p.stat().st_size, p.stat().st_mtime_ns) for p in files}
