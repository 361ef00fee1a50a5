"""Short simulated flights, made once for all tests of this folder, and the command line in this process."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from wrenchgap import flight
from wrenchgap.plant import model_file
from wrenchgap.plant.flight_plan import Plan, fly, provenance
from wrenchgap.replay.cli.main import app

OFFSET = "com_offset=x:-0.004,y:0.007,z:-0.005"


class Logs:
    """A folder with logs of one vehicle: train and test hide a centre-of-mass offset, ideal hides nothing."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.train, self.test, self.ideal = (folder / f"{name}.mcap" for name in ("train", "test", "ideal"))

    def fly(self) -> Logs:
        """Write the logs."""
        self.folder.mkdir()
        believed = model_file.load("tilt_hexarotor")
        for path, trajectory, seconds, hidden in (
            (self.train, "multi_axis", 14.0, (OFFSET,)),
            (self.test, "figure8", 12.0, (OFFSET,)),
            (self.ideal, "multi_axis", 12.0, ()),
        ):
            plan = Plan(believed, trajectory, seconds, 1.0 if path != self.test else 0.0, 1, None, hidden)
            flight.write(fly(plan, name=path.stem), path, metadata=provenance(plan))
        return self


@pytest.fixture(scope="session")
def logs(shared_folder: Path, once: Callable[[str, Callable[[], Path]], Path]) -> Logs:
    """The logs; nobody writes to this folder."""

    def made() -> Path:
        return Logs(shared_folder / "logs").fly().folder

    return Logs(once("logs of the replay tests", made))


Run = Callable[..., Result]


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    """Run a command in an empty folder, in this process."""
    monkeypatch.chdir(tmp_path)
    runner = CliRunner()
    return lambda *arguments: runner.invoke(app, [str(a) for a in arguments], prog_name="wrenchgap")


@pytest.fixture
def result_of(run: Run, tmp_path: Path) -> Callable[..., dict[str, Any]]:
    """Run a command with --json, expect success, and return what it wrote."""

    def wrapped(*arguments: object) -> dict[str, Any]:
        path = tmp_path / "result.json"
        path.unlink(missing_ok=True)
        done = run(*arguments, "--json", path)
        assert done.exit_code == 0, done.output
        return json.loads(path.read_text(encoding="utf-8"))  # type: ignore[no-any-return]

    return wrapped


@pytest.fixture
def refused(run: Run) -> Callable[..., str]:
    """Run a command that must end with exit code 2, and return its one line on standard error."""

    def wrapped(*arguments: object) -> str:
        done = run(*arguments)
        assert (done.exit_code, done.stdout) == (2, ""), done.output
        (line,) = done.stderr.splitlines()
        assert line.startswith("wrenchgap: ")
        return str(line)

    return wrapped


@pytest.fixture(scope="session")
def grounded() -> Callable[[flight.Flight, float], flight.Flight]:
    """`grounded(log, until)` is the same log as if the rotors had stood still until a time [s]."""

    def wrapped(log: flight.Flight, until: float) -> flight.Flight:
        parts = {"commanded": "wrench_B", "desired": "wrench_B", "actuators": "rotor_speed"}
        series = {role: getattr(log, role) for role in parts}
        still = {role: np.where(s.time[:, None] < until, 0.0, getattr(s, parts[role])) for role, s in series.items()}
        return replace(log, **{role: replace(s, **{parts[role]: still[role]}) for role, s in series.items()})

    return wrapped
