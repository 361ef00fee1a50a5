"""Bad input of every kind: exit code 2, one line on standard error, no file left behind."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wrenchgap import flight
from wrenchgap.plant import model_file
from wrenchgap.plant.model import make_effect

MODEL = "tilt_hexarotor"
ROOT = Path(__file__).resolve().parents[2]
OUT = ("--json", "out.json", "--figure", "out.png", "--csv", "out.csv")


def model_text(old: str = "", new: str = "") -> str:
    text = (ROOT / "models" / f"{MODEL}.toml").read_text(encoding="utf-8")
    assert old in text
    return text.replace(old, new, 1) if old else text


def no_log(folder: Path, logs: Any) -> tuple[Any, ...]:
    return ("compare", "gone.mcap", "-m", MODEL, *OUT)


def empty_log(folder: Path, logs: Any) -> tuple[Any, ...]:
    (folder / "empty.mcap").write_bytes(b"")
    return ("compare", "empty.mcap", "-m", MODEL, *OUT)


def truncated_log(folder: Path, logs: Any) -> tuple[Any, ...]:
    (folder / "cut.mcap").write_bytes(logs.train.read_bytes()[:300])
    return ("compare", "cut.mcap", "-m", MODEL, *OUT)


def not_a_log(folder: Path, logs: Any) -> tuple[Any, ...]:
    (folder / "notes.txt").write_text("flew well\n")
    return ("compare", "notes.txt", "-m", MODEL, *OUT)


def disguised_log(folder: Path, logs: Any) -> tuple[Any, ...]:
    (folder / "notes.mcap").write_text("flew well\n" * 100)
    return ("explain", "notes.mcap", "-m", MODEL, "--json", "out.json")


def changed(folder: Path, logs: Any, change: Callable[[flight.Flight], flight.Flight]) -> Path:
    path = folder / "changed.mcap"
    return flight.write(change(flight.load(logs.test)), path)


def no_imu(folder: Path, logs: Any) -> tuple[Any, ...]:
    log = changed(folder, logs, lambda f: replace(f, imu=None, odometry=None))
    return ("compare", log, "-m", MODEL, *OUT)


def no_command(folder: Path, logs: Any) -> tuple[Any, ...]:
    log = changed(folder, logs, lambda f: replace(f, commanded=None, desired=None, actuators=None))
    return ("learn", log, "-m", MODEL, "-o", "out.gp")


def nan_imu(folder: Path, logs: Any) -> tuple[Any, ...]:
    def spoil(f: flight.Flight) -> flight.Flight:
        assert f.imu is not None
        return replace(f, odometry=None, imu=replace(f.imu, omega_B=np.full_like(f.imu.omega_B, np.nan)))

    return ("compare", changed(folder, logs, spoil), "-m", MODEL, *OUT)


def too_short(folder: Path, logs: Any) -> tuple[Any, ...]:
    return ("compare", logs.test, "-m", MODEL, "--cutoff", 0.01, *OUT)


def missing_key(folder: Path, logs: Any) -> tuple[Any, ...]:
    (folder / "m.toml").write_text(model_text("mass = 4.0 ", "# "), encoding="utf-8")
    return ("compare", logs.test, "-m", "m.toml", *OUT)


def negative_mass(folder: Path, logs: Any) -> tuple[Any, ...]:
    (folder / "m.toml").write_text(model_text("mass = 4.0 ", "mass = -4.0 "), encoding="utf-8")
    return ("add", "com_offset", "-m", "m.toml", "--from", logs.test, "-o", "out.toml")


def unknown_key(folder: Path, logs: Any) -> tuple[Any, ...]:
    (folder / "m.toml").write_text(model_text("mass = 4.0 ", "mass = 4.0\nweight = 40.0 "), encoding="utf-8")
    return ("compare", logs.test, "-m", "m.toml", *OUT)


def unknown_effect(folder: Path, logs: Any) -> tuple[Any, ...]:
    return ("add", "witchcraft", "-m", MODEL, "--from", logs.test, "-o", "out.toml")


def unknown_effect_to_try(folder: Path, logs: Any) -> tuple[Any, ...]:
    return ("explain", logs.test, "-m", MODEL, "--effects-only", "witchcraft", "--json", "out.json")


def effect_that_is_not_there(folder: Path, logs: Any) -> tuple[Any, ...]:
    return ("remove", "servo_lag", "-m", MODEL, "-o", "out.toml")


def unknown_hidden_parameter(folder: Path, logs: Any) -> tuple[Any, ...]:
    return ("simulate", "-m", MODEL, "-t", "hover", "--hide", "com_offset=q:1", "-o", "out.mcap")


def hidden_not_a_number(folder: Path, logs: Any) -> tuple[Any, ...]:
    return ("simulate", "-m", MODEL, "-t", "hover", "--hide", "com_offset=x:much", "-o", "out.mcap")


def unknown_trajectory(folder: Path, logs: Any) -> tuple[Any, ...]:
    return ("simulate", "-m", MODEL, "-t", "looping", "-o", "out.mcap")


def log_that_is_no_mcap(folder: Path, logs: Any) -> tuple[Any, ...]:
    return ("simulate", "-m", MODEL, "-t", "hover", "-o", "out.bag")


def gp_of_another_vehicle(folder: Path, logs: Any) -> tuple[Any, ...]:
    (folder / "m.toml").write_text(model_text('name = "tilt_hexarotor"', 'name = "another"'), encoding="utf-8")
    return ("compare", logs.test, "-m", "m.toml", "--gp", logs.folder / "some.gp", *OUT)


def not_a_gp(folder: Path, logs: Any) -> tuple[Any, ...]:
    return ("compare", logs.test, "-m", MODEL, "--gp", logs.train, *OUT)


def another_vehicle(folder: Path, logs: Any) -> tuple[Any, ...]:
    return ("compare", logs.test, "-m", "crazyflie", *OUT)


def same_log_twice(folder: Path, logs: Any) -> tuple[Any, ...]:
    return ("explain", logs.test, "-m", MODEL, "--validate", logs.test, "--json", "out.json")


def output_exists(folder: Path, logs: Any) -> tuple[Any, ...]:
    return ("add", "com_offset", "-m", MODEL, "--from", logs.test, "-o", "kept")


def json_exists(folder: Path, logs: Any) -> tuple[Any, ...]:
    return ("compare", logs.test, "-m", MODEL, "--json", "kept")


def output_is_an_input(folder: Path, logs: Any) -> tuple[Any, ...]:
    return ("learn", logs.test, "-m", MODEL, "-o", logs.test, "--force")


def no_folder(folder: Path, logs: Any) -> tuple[Any, ...]:
    return ("compare", logs.test, "-m", MODEL, "--json", "nowhere/out.json")


def topic_without_role(folder: Path, logs: Any) -> tuple[Any, ...]:
    return ("inspect", logs.test, "--topic", "/imu")


def topic_that_is_not_there(folder: Path, logs: Any) -> tuple[Any, ...]:
    return ("inspect", logs.test, "--topic", "imu=/nope", "--json", "out.json")


def unknown_outputs(folder: Path, logs: Any) -> tuple[Any, ...]:
    return ("learn", logs.test, "-m", MODEL, "--outputs", "torque_w", "-o", "out.gp")


def physics_without_effects(folder: Path, logs: Any) -> tuple[Any, ...]:
    return ("learn", logs.test, "-m", MODEL, "--mean", "physics", "-o", "out.gp")


def unknown_mean(folder: Path, logs: Any) -> tuple[Any, ...]:
    return ("learn", logs.test, "-m", MODEL, "--mean", "cubic", "-o", "out.gp")


def unknown_inputs(folder: Path, logs: Any) -> tuple[Any, ...]:
    return ("learn", logs.test, "-m", MODEL, "--inputs", "past,weather", "-o", "out.gp")


def inputs_twice(folder: Path, logs: Any) -> tuple[Any, ...]:
    return ("learn", logs.test, "-m", MODEL, "--inputs", "past,rates,past", "-o", "out.gp")


def inputs_without_pose(folder: Path, logs: Any) -> tuple[Any, ...]:
    log = changed(folder, logs, lambda f: replace(f, odometry=None))
    return ("learn", log, "-m", MODEL, "--inputs", "velocity", "-o", "out.gp")


def effects_without_voltage(folder: Path, logs: Any) -> tuple[Any, ...]:
    sag = make_effect(model_file.load(MODEL).vehicle, "battery_sag", {"sensitivity": 2.0, "per_volt": 0.08})
    model_file.save(model_file.load(MODEL).with_effects([sag]), folder / "sag.toml")
    return ("learn", logs.test, "-m", "sag.toml", "-o", "out.gp")


def counterfactual_without_voltage(folder: Path, logs: Any) -> tuple[Any, ...]:
    return ("counterfactual", logs.test, "-m", MODEL, "--with", "battery_sag=2,0.08", "--json", "out.json")


def lead_without_physics(folder: Path, logs: Any) -> tuple[Any, ...]:
    return ("replay", logs.test, "-m", MODEL, "--gp", logs.folder / "some.gp", "--lead", 0.05, "-o", "out.mcap")


def lead_of_a_counterfactual_without_physics(folder: Path, logs: Any) -> tuple[Any, ...]:
    given = ("--gp", logs.folder / "some.gp", "--lead", 0.05, "-o", "out.mcap")
    return ("counterfactual", logs.test, "-m", MODEL, "--duration", 1, *given)


def lead_without_compensation(folder: Path, logs: Any) -> tuple[Any, ...]:
    return ("counterfactual", logs.test, "-m", MODEL, "--lead", 0.05, "-o", "out.mcap")


def negative_cutoff(folder: Path, logs: Any) -> tuple[Any, ...]:
    return ("compare", logs.test, "-m", MODEL, "--cutoff", -1, *OUT)


def unknown_option(folder: Path, logs: Any) -> tuple[Any, ...]:
    return ("compare", logs.test, "-m", MODEL, "--colour")


def missing_option(folder: Path, logs: Any) -> tuple[Any, ...]:
    return ("compare", logs.test)


def unknown_command(folder: Path, logs: Any) -> tuple[Any, ...]:
    return ("explode",)


CASES: dict[Callable[[Path, Any], tuple[Any, ...]], tuple[str, ...]] = {
    no_log: ("gone.mcap", "no such file"),
    empty_log: ("empty.mcap", "empty"),
    truncated_log: ("cut.mcap",),
    not_a_log: ("notes.txt",),
    disguised_log: ("notes.mcap",),
    no_imu: ("imu", "--topic"),
    no_command: ("commanded", "--topic"),
    nan_imu: ("imu",),
    too_short: ("too short",),
    missing_key: ("m.toml", "mass", "missing"),
    negative_mass: ("m.toml", "mass", "-4"),
    unknown_key: ("weight", "mass"),
    unknown_effect: ("witchcraft", "com_offset"),
    unknown_effect_to_try: ("witchcraft", "com_offset"),
    effect_that_is_not_there: ("servo_lag", "none"),
    unknown_hidden_parameter: ("'q'", "x, y, z"),
    hidden_not_a_number: ("much", "not a number"),
    unknown_trajectory: ("looping", "figure8"),
    log_that_is_no_mcap: ("out.bag", ".mcap"),
    gp_of_another_vehicle: ("another", "tilt_hexarotor", "wrenchgap learn"),
    not_a_gp: ("train.mcap", "GP"),
    another_vehicle: ("rotor speeds", "crazyflie"),
    same_log_twice: ("same flight",),
    output_exists: ("kept", "--force"),
    json_exists: ("kept", "--force"),
    output_is_an_input: ("one of the inputs",),
    no_folder: ("nowhere", "does not exist"),
    topic_without_role: ("ROLE=/TOPIC",),
    topic_that_is_not_there: ("/nope", "/imu"),
    unknown_outputs: ("torque_w", "torque_x"),
    physics_without_effects: ("--mean physics", MODEL, "wrenchgap explain", "--mean zero"),
    unknown_mean: ("cubic", "physics", "zero"),
    unknown_inputs: ("weather", "velocity, rates, position, past"),
    inputs_twice: ("past", "twice"),
    inputs_without_pose: ("velocity", "odometry", "--inputs"),
    effects_without_voltage: ("battery_sag", "--topic battery", "wrenchgap remove battery_sag"),
    counterfactual_without_voltage: ("battery_sag", "--topic battery"),
    lead_without_physics: ("--lead", "without physics", "wrenchgap add"),
    lead_of_a_counterfactual_without_physics: ("--lead", "without physics", "wrenchgap add"),
    lead_without_compensation: ("--lead 0.05", "--gp"),
    negative_cutoff: ("--cutoff -1",),
    unknown_option: ("--colour", "wrenchgap compare --help"),
    missing_option: ("--model", "wrenchgap compare --help"),
    unknown_command: ("explode", "wrenchgap --help"),
}


@pytest.fixture(scope="session")
def with_gp(logs: Any) -> Any:
    """The logs, and a GP beside them."""
    from wrenchgap.learn.data.opening import open_flights
    from wrenchgap.learn.identify.learning import TORQUE, learn_process
    from wrenchgap.learn.process import store
    from wrenchgap.learn.process.gp import FitSettings

    model = model_file.load(MODEL)
    learnt = learn_process(open_flights([logs.ideal], model), model, TORQUE, FitSettings(points=20, restarts=0))
    store.save(learnt.gp, logs.folder / "some.gp")
    return logs


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.__name__)
def test_bad_input_gets_one_line_and_leaves_nothing(case: Any, with_gp: Any, run: Any, tmp_path: Path) -> None:
    (tmp_path / "kept").write_text("kept")
    arguments = case(tmp_path, with_gp)
    before = {path: path.read_bytes() for folder in (tmp_path, with_gp.folder) for path in folder.iterdir()}
    done = run(*arguments)
    assert done.exit_code == 2, done.output
    assert done.stdout == ""
    (line,) = done.stderr.splitlines()
    assert line.startswith("wrenchgap: ")
    for word in CASES[case]:
        assert word in line
    after = {path: path.read_bytes() for folder in (tmp_path, with_gp.folder) for path in folder.iterdir()}
    assert after == before


def test_a_real_process_says_one_line_too(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "wrenchgap", "compare", str(tmp_path / "gone.mcap"), "-m", MODEL]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT)
    assert (done.returncode, done.stdout, len(done.stderr.splitlines())) == (2, "", 1)


def test_a_failed_write_leaves_no_partial_file(logs: Any, run: Any, tmp_path: Path, monkeypatch: Any) -> None:
    import pandas as pd

    def full(self: Any, path: Path, **options: Any) -> None:
        Path(path).write_text("half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(pd.DataFrame, "to_csv", full)
    done = run("compare", logs.test, "-m", MODEL, "--csv", "out.csv", "--quiet")
    assert done.exit_code == 2
    assert "out.csv: cannot be written: No space left on device" in done.stderr
    assert list(tmp_path.iterdir()) == []
