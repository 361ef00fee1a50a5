"""`model new`, `model show` and `calibrate` as a user calls them, and what is refused."""

import tomllib
from dataclasses import replace

import numpy as np
import pytest

import wrenchgap as wg
from tests.replay.autopilot_logs import (
    FACTOR,
    FULL,
    INERTIA,
    MASS,
    PLACES,
    true_vehicle,
    write_dataflash,
    write_ulog,
)
from wrenchgap.plant import model_file
from wrenchgap.plant.vehicle import GRAVITY
from wrenchgap.replay.present.model import hover_command


@pytest.fixture(scope="module")
def ulog(autopilot_flights, tmp_path_factory):
    """A flight of a vehicle whose centre of mass is 6 mm ahead and 4 mm to the left."""
    return write_ulog(autopilot_flights[0], tmp_path_factory.mktemp("px4") / "flight1.ulg")


NEW = ("model", "new", "--mass", MASS, "--mass-tolerance", 0.005, "-o", "vehicle.toml", "--from")


@pytest.fixture
def model(run, ulog, tmp_path):
    done = run(*NEW, ulog)
    assert done.exit_code == 0, done.output
    return model_file.load(tmp_path / "vehicle.toml")


def test_a_log_becomes_a_model(model, tmp_path):
    """Geometry of the parameters; the curve, of which PX4 knows nothing here, from the flight."""
    arms, rotors = model.vehicle.geometry()
    assert arms.position_B == pytest.approx(np.array([(x, -y, 0.0) for x, y, _ in PLACES]), abs=1e-6)
    assert rotors.spin.tolist() == [1, 1, -1, -1]
    assert rotors.kappa == pytest.approx(np.full(4, 0.02))
    full = rotors.c_f * model.command.speeds(np.ones((1, 4)), None, model.vehicle) ** 2
    assert full[0] == pytest.approx(np.full(4, FULL), rel=0.06)
    share = (FACTOR - 1 + np.sqrt((1 - FACTOR) ** 2 + 4 * FACTOR * MASS * GRAVITY / 4 / FULL)) / (2 * FACTOR)
    assert hover_command(model) == pytest.approx(share, abs=0.02)
    away = (np.array(INERTIA) - np.diag(model.vehicle.body.inertia)) / np.diag(model.vehicle.tolerances.inertia)
    assert np.all(np.abs(away) < 3.0)
    assert "fitted: " in (tmp_path / "vehicle.toml").read_text()


def test_the_budget_of_the_log_is_that_of_the_command(run, ulog):
    refused = run(*NEW, ulog, "--budget", "1kB")
    assert refused.exit_code == 2
    assert "the budget is 1 kB" in refused.output
    assert "--budget" in refused.output


def test_the_new_model_flies(model):
    flown = wg.simulate(model, "hover", duration=4.0)
    away = np.linalg.norm(flown.odometry.position_E - flown.odometry.position_E[0], axis=1)
    assert away.max() < 0.3


def test_an_ardupilot_log_becomes_a_model_with_its_level(run, autopilot_flights, tmp_path):
    """Motors in the order of the frame; the level is that of 1.5 kg over the pulses, whatever MOT_THST_HOVER says."""
    path = write_dataflash(autopilot_flights[1], tmp_path / "quad.bin")
    done = run("model", "new", "--from", path, "--mass", MASS, "--arm", 0.26, "-o", "quad.toml")
    assert done.exit_code == 0, done.output
    model = model_file.load(tmp_path / "quad.toml")
    _, rotors = model.vehicle.geometry()
    assert rotors.spin.tolist() == [1, 1, -1, -1]
    full = rotors.c_f * model.command.speeds(np.full((1, 4), 2000.0), None, model.vehicle) ** 2
    assert full[0] == pytest.approx(np.full(4, FULL), rel=0.02)
    opened = wg.open_flights(path, model)[0]
    assert np.median(opened.records[0].commanded[:, 2]) == pytest.approx(MASS * GRAVITY, rel=0.03)


def test_model_new_says_what_it_assumed_and_writes_its_json(result_of, ulog, tmp_path):
    result = result_of(*NEW, ulog, "--name", "mine", "--figure", "top.png")
    assert result["schema"] == "wrenchgap.model/1"
    assert result["name"] == "mine"
    assert [i["role"] for i in result["inputs"]] == ["source"]
    assert any(line.startswith("inertia: estimated") for line in result["assumed"])
    assert len(result["rotors"]) == 4
    assert result["tolerances"]["mass"] == 0.005
    assert result["command"]["unit"] == "normalised"
    assert (tmp_path / "top.png").read_bytes().startswith(b"\x89PNG")
    text = (tmp_path / "vehicle.toml").read_text()
    assert "wrenchgap model new --output vehicle.toml" in text
    assert tomllib.loads(text)["vehicle"]["mass"] == {"value": MASS, "tolerance": 0.005}


def test_model_show_prints_what_was_understood(result_of, run, model, tmp_path):
    assert result_of("model", "show", "vehicle.toml", "--figure", "v.png")["mass"] == MASS
    printed = run("model", "show", "vehicle.toml").output
    assert "counter-clockwise" in printed
    assert "hover at" in printed
    assert run("model", "show", "crazyflie").exit_code == 0


def test_a_model_without_rotors_is_shown(run, tmp_path):
    done = run("model", "show", "variable_tilt_hexacopter")
    assert done.exit_code == 0, done.output


def test_answers_make_a_model(tmp_path, monkeypatch):
    """Mass, its tolerance, frame, arm, radius, thrust; then the turning of nothing, since the frame says it."""
    from typer.testing import CliRunner

    from wrenchgap.replay.cli.main import app

    monkeypatch.chdir(tmp_path)
    answers = "\n".join(["-1", "2.4", "", "hexa_x", "0.35", "0.15", "12.0"])
    done = CliRunner().invoke(
        app, ["model", "new", "-i", "-o", "hexa.toml"], input=answers + "\n", prog_name="wrenchgap"
    )
    assert done.exit_code == 0, done.output
    made = model_file.load(tmp_path / "hexa.toml")
    _, rotors = made.vehicle.geometry()
    assert len(rotors) == 6
    assert made.vehicle.body.mass == 2.4
    assert rotors.radius == pytest.approx(np.full(6, 0.15))
    assert rotors.c_f * rotors.speed_max**2 == pytest.approx(np.full(6, 12.0), rel=1e-4)


def test_nothing_that_helps_leaves_the_model_as_it_is(run, tmp_path):
    """The vehicle flown as its model file has it, without noise in the plant: nothing to trim."""
    true = true_vehicle()
    model_file.save(replace(true, path=None), tmp_path / "true.toml")
    wg.save_log(wg.simulate(true, "multi_axis", duration=12.0, excitation=0.5, seed=3), tmp_path / "right.mcap")
    done = run("calibrate", "right.mcap", "-m", "true.toml", "-o", "same.toml")
    assert done.exit_code == 0, done.output
    same = model_file.load(tmp_path / "same.toml")
    moved = [v for e in same.snapshot for v in e.values if v.unit != "s" and abs(v.value) > 3.0 * v.std]
    assert moved == []
    if not same.effects:
        assert "wrote unchanged copy of the model same.toml" in done.output
        assert same.history == model_file.load(tmp_path / "true.toml").history


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("-o", "x.toml"), "nothing to start from; say --from SOURCE, or --mass KG"),
        (("--frame", "quad_x", "--arm", "0.2", "-o", "x.toml"), "model new: say --mass KG too, or --interactive"),
        (("--frame", "quad_x", "--arm", "0.25", "--mass", "1500", "-o", "x.toml"), "say the mass in kilograms"),
        (("--from", "nix.ulg", "-o", "x.toml"), "no such file; expected .ulg"),
        (("--from", "here.param", "-o", "x.toml"), "say --mass KG"),
        (("--from", "here.param", "--mass", "0", "-o", "x.toml"), "--mass 0: expected a positive number"),
        (("--from", "here.param", "--rotor-radius", "1e-308", "-o", "x.toml"), "--rotor-radius 1e-308: expected a pos"),
        (("--from", "here.param", "--arm", "1e308", "-o", "x.toml"), r"--arm 1e\+308: expected a positive number"),
        (("--from", "here.param", "--mass", "1", "-o", "here.param"), "is read by this command|exists|input"),
    ],
)
def test_wrong_use_is_told_in_one_line(refused, tmp_path, arguments, message):
    import re

    (tmp_path / "here.param").write_text("MOT_PWM_MIN,1000\n")
    assert re.search(message, refused("model", "new", *arguments))


def test_a_log_that_is_no_log_is_refused(refused, tmp_path):
    (tmp_path / "bad.ulg").write_bytes(b"not a log at all")
    assert "not a PX4 log" in refused("model", "new", "--from", "bad.ulg", "--mass", "1", "-o", "x.toml")
    (tmp_path / "bad.bin").write_bytes(b"\xa3\x95nothing")
    assert "bad.bin" in refused("model", "new", "--from", "bad.bin", "--mass", "1", "-o", "x.toml")


def test_a_frame_its_arm_and_a_mass_are_a_model(run, tmp_path):
    """Thrust at hover of four rotors that carry 1.5 kg; a shipped model is copied as it is."""
    done = run("model", "new", "--frame", "quad_x", "--arm", "0.25", "--mass", "1.5", "-o", "quad.toml")
    assert done.exit_code == 0, done.output
    made = model_file.load(tmp_path / "quad.toml").vehicle
    assert made.body.mass == 1.5
    assert np.linalg.norm(made.arms.position_B, axis=1) == pytest.approx(np.full(4, 0.25), rel=1e-5)
    assert run("model", "show", "crazyflie", "-o", "mine.toml").exit_code == 0
    assert (tmp_path / "mine.toml").read_text() == model_file.find_model("crazyflie").read_text()
    assert run("model", "show", "crazyflie", "-o", "mine.toml").exit_code == 2
