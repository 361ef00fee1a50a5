"""`wrenchgap where` as a user runs it, and the figures it draws."""

import json
from dataclasses import replace

import numpy as np
import pytest

import wrenchgap as wg
from wrenchgap.flight.flight import AXES
from wrenchgap.replay.present.tables import Line
from wrenchgap.replay.present.where import parts

MODEL = "tilt_hexarotor"


@pytest.fixture(scope="module")
def found(logs, small_processes):
    """The flight with a hidden offset of the centre of mass."""
    model = wg.load_model(MODEL)
    return wg.where(wg.open_flights(logs.train, model), model)


def test_a_centre_of_mass_offset_is_a_torque_that_goes_with_tilt(found):
    """M = -r x F: a function of the commanded force alone, which a process of the command takes off entirely."""
    shares = found.budget.shares()
    assert (shares["process"][3:] > 0.9).all()
    assert found.budget.source == "fitted"
    assert found.relevance.chosen[0].name in {"attitude", "command"}
    assert not any(a.white for a in found.whiteness.autocorrelation if a.axis.startswith("torque"))


def test_what_is_left_of_the_right_model_is_noise(logs, run, small_processes, tmp_path):
    """With the effect in the model, its part is the physics' part, and nothing is left to map."""
    assert run("add", "-m", MODEL, "--value", "com_offset=-0.004,0.007,-0.005", "-o", "good.toml").exit_code == 0
    model = wg.load_model(tmp_path / "good.toml")
    found = wg.where(wg.open_flights(logs.test, model), model)
    assert found.name == "good"
    assert (found.budget.shares()["physics"][3:] > 0.9).all()
    assert found.budget.whole()["unexplained"] < 0.05
    assert [d.name for d in found.failure_map.significant if d.score > 0.2] == []
    assert found.rms == pytest.approx(np.sqrt(found.budget.nominal - found.budget.physics))


def test_command_prints_writes_and_draws(logs, run, tmp_path, monkeypatch):
    few = ("--points", 40, "--restarts", 0, "--outputs", "torque_x,torque_z")
    assert run("learn", logs.train, "-m", MODEL, *few, "-o", "t.gp").exit_code == 0
    monkeypatch.setenv("COLUMNS", "120")
    asked = ("where", logs.test, logs.train, "-m", MODEL, "--gp", "t.gp")
    done = run(*asked, "--figure", "w.png", "--json", "w.json")
    assert done.exit_code == 0, done.output
    assert 100 < max(len(line.rstrip()) for line in done.output.splitlines()) <= 120
    result = json.loads((tmp_path / "w.json").read_text(encoding="utf-8"))
    assert result["schema"] == "wrenchgap.where/1"
    assert [i["role"] for i in result["inputs"]] == ["log", "log", "model", "gp"]
    assert result["axes"] == list(AXES)
    assert result["flights"] == ["test", "train"]
    assert result["model"] == "nominal+GP"
    assert any("learnt on train" in note for note in result["notes"])
    budget = result["budget"]["mean_square"]
    assert result["budget"]["process_source"] == "given"
    parts = np.sum([budget[k] for k in ("noise", "physics", "process", "unexplained")], axis=0)
    assert parts == pytest.approx(np.array(budget["nominal"]))
    assert budget["process"][4] == 0.0  # not among the outputs of the GP
    assert budget["process"][3] > 0.0
    quantities = result["failure_map"]["quantities"]
    assert {q["quantity"] for q in quantities} >= {"tilt", "thrust", "rate", "speed", "height", "time", "arm_rate"}
    for q in quantities:
        assert sum(q["bins"]["time_share"]) == pytest.approx(1.0)
    assert [row["quantity"] for row in result["failure_map"]["lacking"]] == ["voltage"]
    assert all(0.5 < s["stop"] - s["start"] < 1.5 for s in result["worst"])
    assert len(result["whiteness"]["autocorrelation"]) == 6
    assert {g["name"] for g in result["relevance"]["groups"]} >= {"command", "heading", "height", "velocity"}
    assert (tmp_path / "w.png").read_bytes().startswith(b"\x89PNG")


def test_a_flight_of_seconds_is_told_to_be_too_short(found):
    """Blocks of held-out time would be shorter than half of their usual length."""
    lines = {
        seconds: [p.text for p in parts(replace(found, seconds=seconds)) if isinstance(p, Line)] for seconds in (2.2, 8)
    }
    assert any(text.startswith("warning: Only 2.2 s of flight") for text in lines[2.2])
    assert not any("too short" in text for text in lines[8])
