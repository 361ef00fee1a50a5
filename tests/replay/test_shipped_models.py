"""The model files that are shipped, and the documented example."""

import re
from pathlib import Path

import numpy as np
import pytest

import wrenchgap as wg
from wrenchgap.plant import model_file
from wrenchgap.plant.actuation import nominal_wrench
from wrenchgap.plant.allocation import Allocation
from wrenchgap.plant.vehicle import GRAVITY

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "model-file.md").read_text(encoding="utf-8")
NAMES = sorted(path.stem for path in (ROOT / "models").glob("*.toml"))


def hover(vehicle, pitch=0.0):
    """Rotor speeds (R,) that carry the weight at a pitch angle [rad] (nose down positive)."""
    force = vehicle.body.mass * GRAVITY * np.array([-np.sin(pitch), 0.0, np.cos(pitch)])
    commands, saturation = Allocation(vehicle).allocate(np.concatenate((force, np.zeros(3)))[None, :])
    assert saturation.rotor_speed == 0
    np.testing.assert_allclose(nominal_wrench(vehicle, commands)[0, :3], force, atol=1e-6)
    return commands.rotor_speed[0]


def test_all_that_are_promised_are_there():
    assert set(NAMES) == {"asymmetric_quadrotor", "crazyflie", "tilt_hexarotor", "variable_tilt_hexacopter", "voliro_x"}
    assert all(f"| `{name}` |" in PAGE for name in NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_writing_a_shipped_model_changes_nothing(name):
    model = model_file.load(name)
    assert model_file.dumps(model) == (ROOT / "models" / f"{name}.toml").read_text(encoding="utf-8")
    assert model.vehicle.name == name


@pytest.mark.parametrize("name", [n for n in NAMES if n != "variable_tilt_hexacopter"])
def test_vehicles_with_rotors_hover_below_their_limits(name):
    vehicle = model_file.load(name).vehicle
    _, rotors = vehicle.geometry()
    speeds = hover(vehicle)
    assert np.all(speeds > 0.1 * rotors.speed_max)
    assert np.all(speeds < 0.9 * rotors.speed_max)


def test_voliro_x_turns_its_rotors_as_fast_as_its_reference_says():
    """Statics: 676 rad/s in hover; at 60 deg pitch 907 on the +-90 deg arms, 676 elsewhere."""
    vehicle = model_file.load("voliro_x").vehicle
    np.testing.assert_allclose(hover(vehicle), 676.0, atol=2.0)
    tilted = hover(vehicle, np.radians(60.0)).reshape(6, 2)[:, 0]
    # A force along x is made by all arms but those along x; there are none at 0 or 180 deg.
    azimuth = np.array([270, 90, 30, 210, 330, 150])
    np.testing.assert_allclose(tilted[np.isin(azimuth, (90, 270))], 907.0, atol=3.0)
    np.testing.assert_allclose(tilted[~np.isin(azimuth, (90, 270))], 676.0, atol=2.0)


def test_spins_of_voliro_x_alternate_with_azimuth_and_within_each_arm():
    arms, rotors = model_file.load("voliro_x").vehicle.geometry()
    upper, lower = rotors.spin[0::2], rotors.spin[1::2]
    around = np.argsort(np.arctan2(arms.position_B[:, 1], arms.position_B[:, 0]) % (2 * np.pi))
    assert np.all(upper[around][1:] == -upper[around][:-1])
    assert np.all(lower == -upper)
    assert np.all(rotors.offset[0::2] > 0)


def test_the_asymmetric_quadrotor_balances_only_with_unequal_speeds():
    """Its example bag hovers at 580, 518, 449, 518 rad/s."""
    vehicle = model_file.load("asymmetric_quadrotor").vehicle
    np.testing.assert_allclose(hover(vehicle), [579.6, 518.4, 448.9, 518.4], rtol=0.01)


def test_the_documented_example_is_a_model():
    (example,) = re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)
    model = model_file.loads(example)
    arms, rotors = model.vehicle.geometry()
    assert (len(arms), len(rotors), arms.tilts.tolist()) == (4, 4, [False, False, False, True])
    assert [e.name for e in model.effects] == ["com_offset"]
    assert model.effects[0].provenance.logs[0][0] == "train.mcap"


def test_the_documented_example_shows_every_key_of_controller_and_sensors():
    model = model_file.load("voliro_x")
    for part in (model.controller, model.sensors):
        assert all(re.search(rf"^{name} = ", PAGE, re.MULTILINE) for name in part.__dataclass_fields__)


def test_a_folder_of_logs_with_the_name_of_a_shipped_model_hides_it_not(tmp_path, monkeypatch):
    (tmp_path / "crazyflie").mkdir()
    (tmp_path / "logs").mkdir()
    monkeypatch.chdir(tmp_path)
    assert wg.load_model("crazyflie").vehicle.name == "crazyflie"
    with pytest.raises(wg.ModelError, match="logs: is a folder"):
        wg.load_model("logs")
