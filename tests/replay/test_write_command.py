"""`wrenchgap write`: the file, the JSON, and what is refused in one line."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import wrenchgap as wg
from wrenchgap.plant.model import make_effect
from wrenchgap.plant.targets import TARGETS
from wrenchgap.replay.cli.commands.model import Target


@pytest.fixture
def fitted(tmp_path):
    """A model file with a fitted thrust and a lag that was set by hand."""
    model = wg.load_model("crazyflie")
    thrust = replace(make_effect(model.vehicle, "thrust_scale", [0.05]), std=np.array([0.01]))
    lag = make_effect(model.vehicle, "motor_lag", [0.03])
    wg.save_model(model.with_effects([thrust, lag]), tmp_path / "fitted.toml", before=model)
    return tmp_path


def test_the_file_loads_with_what_was_set_as_a_comment(result_of, fitted):
    (fitted / "set.params").write_text("# QGroundControl\n1\t1\tMPC_THR_HOVER\t0.47\t9\n1\t1\tTHR_MDL_FAC\t0\t9\n")
    said = result_of("write", "fitted.toml", "--to", "px4", "--parameters", "set.params", "-o", "out.params")
    [row] = said["parameters"]
    assert (row["name"], row["before"], row["effects"]) == ("MPC_THR_HOVER", 0.47, ["thrust_scale"])
    assert any("motor_lag: PX4 has no parameter for the lag" in words for words in said["not_in_it"])
    lines = (fitted / "out.params").read_text().splitlines()
    assert [line.split("\t")[2] for line in lines if not line.startswith("#")] == ["MPC_THR_HOVER"]
    assert any(line.startswith("# MPC_THR_HOVER: +-") and "was 0.47; thrust_scale" in line for line in lines)


@pytest.mark.parametrize("target", ["ardupilot", "crazyflie", "mjcf", "sdf", "urdf", "rotorpy", "drone-models"])
def test_every_target_has_a_file(result_of, fitted, target):
    said = result_of("write", "fitted.toml", "--to", target, "-o", "out.txt")
    assert (fitted / "out.txt").read_text() == said["text"]


@pytest.mark.parametrize(("target", "name"), [("rotorpy", "out.py"), ("drone-models", "out.toml")])
def test_what_a_package_gets_reads_back(result_of, fitted, target, name):
    result_of("write", "fitted.toml", "--to", target, "-o", name)
    result_of("model", "new", "--from", name, "-o", "again.toml")
    before, again = wg.load_model("fitted.toml"), wg.load_model("again.toml")
    assert again.vehicle.body.mass == pytest.approx(before.vehicle.body.mass, rel=1e-5)
    np.testing.assert_allclose(again.vehicle.rotors.c_f, 1.05 * before.vehicle.rotors.c_f, rtol=1e-5)
    np.testing.assert_array_equal(again.vehicle.rotors.spin, before.vehicle.rotors.spin)
    [lag] = again.effects
    assert (lag.name, lag.provenance.method.split(" of ")[0]) in {
        ("motor_lag", "tau_m"),
        ("motor_lag", "rotor_dyn_coef"),
    }
    np.testing.assert_allclose(lag.theta, 0.03, rtol=1e-6)


def test_without_a_file_the_text_is_shown(run, refused, fitted):
    said = run("write", "fitted.toml", "--to", "rotorpy").output
    assert "'tau_m': 0.03," in said
    assert "'tau_m'" not in run("write", "fitted.toml", "--to", "rotorpy", "-o", "out.py").output
    assert "is a simulator and takes no parameters" in refused(
        "write", "fitted.toml", "--to", "sdf", "--parameters", "set.params"
    )


def test_effectiveness_is_printed_drawn_and_written(result_of, run, refused, fitted):
    said = result_of("effectiveness", "fitted.toml", "--figure", "e.png", "--csv", "e.csv")
    np.testing.assert_allclose(np.array(said["matrix"])[2], 1.05)  # the scale of thrust
    np.testing.assert_allclose(np.array(said["allocation"]), np.array(said["nominal_allocation"]) / 1.05, atol=1e-9)
    assert {path.name for path in fitted.iterdir()} >= {"e.png", "e.csv"}
    assert "force_z 105 +-1.0 %" in run("effectiveness", "fitted.toml").output
    assert "no effect of the model changes" in run("effectiveness", "tilt_hexarotor", "--tilt", "20").output
    assert "expected degrees" in refused("effectiveness", "fitted.toml", "--tilt", "flat")
    assert "does not tilt" in refused("effectiveness", "fitted.toml", "--tilt", "5")


def test_effectiveness_writes_the_allocation_and_says_what_it_gains(result_of, run, refused, fitted):
    said = result_of("effectiveness", "fitted.toml", "-o", "alloc", "--precision", "float")
    assert (said["folder"], said["margins"]["null_space"]) == ("alloc", 0)
    assert "#define WGA_FLOAT" in (fitted / "alloc/wrenchgap_allocation.h").read_text()
    assert "exists already" in refused("effectiveness", "fitted.toml", "-o", "alloc")
    assert "is in --output alloc" in refused("effectiveness", "fitted.toml", "-o", "alloc", "--csv", "alloc/e.csv")
    assert "make -C alloc test" in run("effectiveness", "fitted.toml", "-o", "alloc", "--force").output
    spoken = run("effectiveness", "tilt_hexarotor").output
    assert "Null space of 6, used for margin" in spoken
    assert result_of("effectiveness", "tilt_hexarotor")["folder"] is None
    assert "add [[vehicle.arms]]" in refused("effectiveness", "variable_tilt_hexacopter", "-o", "other")


def test_a_vehicle_that_cannot_hover_has_a_matrix_and_no_allocation(result_of, refused, fitted):
    text = (Path(wg.__file__).parent / "models/tilt_hexarotor.toml").read_text()
    (fitted / "heavy.toml").write_text(text.replace("mass = 4.0", "mass = 24.0"))
    assert result_of("effectiveness", "heavy.toml")["margins"] is None
    assert "cannot hover within its own limits" in refused("effectiveness", "heavy.toml", "-o", "alloc")
    assert not (fitted / "alloc").exists()


def test_the_command_knows_every_target():
    assert [target.value for target in Target] == list(TARGETS)


def test_what_cannot_be_written_is_one_line(refused, fitted):
    (fitted / "other.param").write_text("FRAME_CLASS,1\n")
    (fitted / "notes.txt").write_text("none")
    assert "expected parameters of an autopilot" in refused(
        "write", "fitted.toml", "--to", "px4", "--parameters", "notes.txt"
    )
    assert "none of PX4's" in refused("write", "fitted.toml", "--to", "px4", "--parameters", "other.param")
    assert "no such file" in refused("write", "fitted.toml", "--to", "px4", "--parameters", "gone.ulg")
    assert refused("write", "fitted.toml", "--to", "betaflight") == (
        "wrenchgap: Invalid value for '--to': 'betaflight' is not one of 'px4', 'ardupilot', 'crazyflie', 'mjcf', "
        "'sdf', 'urdf', 'rotorpy', 'drone-models'; see `wrenchgap write --help`"
    )
    (fitted / "nasty.py").write_text("import os\nos.system('touch ran')\nquad_params = {}\n")
    assert "nasty.py, line 1: got 'import os'" in refused("model", "new", "--from", "nasty.py", "-o", "m.toml")
    assert not (fitted / "ran").exists()
    assert refused("write", "fitted.toml", "--to").endswith("requires an argument; see `wrenchgap write --help`")
    assert "nothing identified" in refused("write", "crazyflie", "--to", "px4")
    assert "do not point up" in refused("write", "tilt_hexarotor", "--to", "rotorpy")
    assert "add [[vehicle.arms]]" in refused("write", "variable_tilt_hexacopter", "--to", "sdf")
    (fitted / "out.txt").write_text("mine")
    assert "out.txt" in refused("write", "fitted.toml", "--to", "mjcf", "-o", "out.txt")
    assert (fitted / "out.txt").read_text() == "mine"
