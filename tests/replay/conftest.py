"""The command line in this process, and logs that begin on the ground."""

import json
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import jsonschema
import numpy as np
import pytest
from typer.testing import CliRunner, Result

from scripts.json_documents import schema
from tests.replay import autopilot_logs
from wrenchgap.learn.diagnose import where
from wrenchgap.replay import report as contents
from wrenchgap.replay.cli import requests
from wrenchgap.replay.cli.main import app
from wrenchgap.replay.present import documents

Run = Callable[..., Result]


@pytest.fixture(scope="session", autouse=True)
def json_as_its_schema_says():
    """Every JSON that a command writes has the keys and types of its schema, and no others."""
    write = documents.write_json

    def checked(path, result, *, force):
        command = result["schema"].split(".")[1].split("/")[0]
        jsonschema.validate(result, schema(command, strict=True))
        write(path, result, force=force)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(documents, "write_json", checked)
        yield


@pytest.fixture
def run(tmp_path, monkeypatch):
    """Run a command in an empty folder, in this process, on a wide terminal."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    runner = CliRunner()
    return lambda *arguments: runner.invoke(app, [str(a) for a in arguments], prog_name="wrenchgap")


@pytest.fixture
def result_of(run, tmp_path):
    """Run a command with --json, expect success, and return what it wrote."""

    def wrapped(*arguments):
        path = tmp_path / "result.json"
        path.unlink(missing_ok=True)
        done = run(*arguments, "--json", path)
        assert done.exit_code == 0, done.output
        return json.loads(path.read_text(encoding="utf-8"))

    return wrapped


@pytest.fixture
def refused(run, monkeypatch):
    """Run a command that must end with exit code 2, and return its one line on standard error."""
    monkeypatch.setattr(requests, "PATIENCE", np.inf)  # no lines of progress on a busy machine

    def wrapped(*arguments):
        done = run(*arguments)
        assert (done.exit_code, done.stdout) == (2, ""), done.output
        assert done.stderr.count("\n") == 1, done.stderr
        line = done.stderr.rstrip("\n")
        assert line.startswith("wrenchgap: ")
        assert "Value error" not in line  # pydantic's words
        return line

    return wrapped


@pytest.fixture(scope="session")
def autopilot_flights(once):
    """Two flights of the vehicle of `autopilot_logs`, whose centre of mass is elsewhere than its files say."""
    return [once(f"autopilot flight {seed}", partial(autopilot_logs.flight, seed)) for seed in (1, 2)]


@pytest.fixture(scope="module")
def small_processes():
    """Processes of the error budget with 30 points: for tests that are not about how much they explain."""
    small = partial(where.held_out_process, points=30)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(where, "held_out_process", small)
        patch.setattr(contents, "held_out_process", small)
        yield


@pytest.fixture(scope="session")
def grounded():
    """`grounded(log, until)` is the same log as if the rotors had stood still until a time [s]."""

    def wrapped(log, until):
        parts = {"commanded": "wrench_B", "desired": "wrench_B", "actuators": "rotor_speed"}
        series = {role: getattr(log, role) for role in parts}
        still = {role: np.where(s.time[:, None] < until, 0.0, getattr(s, parts[role])) for role, s in series.items()}
        return replace(log, **{role: replace(s, **{parts[role]: still[role]}) for role, s in series.items()})

    return wrapped
