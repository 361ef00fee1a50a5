"""Numbers of a model file that are known to a tolerance."""

import numpy as np
import pytest

from wrenchgap.flight.errors import ModelError
from wrenchgap.plant import model_file
from wrenchgap.plant.effect_values import with_hidden
from wrenchgap.plant.effects import find

TEXT = """schema = 1
[vehicle]
name = "weighed"
mass = { value = 1.52, tolerance = 0.005 }
inertia = { value = [0.012, 0.012, 0.02], tolerance = [0.001, 0.002, 0.003] }
com = { value = [0.0, 0.0, 0.01], tolerance = 0.002 }
imu_position = [0.02, 0.0, 0.03]
[vehicle.arm]
length = 0.2
tilts = false
[vehicle.rotor]
c_f = 9.0e-6
kappa = 0.016
radius = 0.12
speed_max = 900.0
"""
ARMS = ((45.0, 1), (135.0, -1), (225.0, 1), (315.0, -1))
TEXT += "".join(f"[[vehicle.arms]]\nazimuth_deg = {a}\nrotors = [{{ spin = {s} }}]\n" for a, s in ARMS)


def scales(name, vehicle):
    return {p.name: (p.low, p.scale, p.high) for p in find(name).parameters(vehicle)}


def test_values_are_those_of_bare_numbers():
    vehicle = model_file.loads(TEXT).vehicle
    assert vehicle.body.mass == 1.52
    assert np.allclose(np.diag(vehicle.body.inertia), (0.012, 0.012, 0.02))
    assert np.allclose(vehicle.body.com_B, (0.0, 0.0, 0.01))
    assert vehicle.tolerances.mass == 0.005
    assert vehicle.tolerances.imu_position is None


def test_a_tolerance_is_the_prior_of_what_changes_the_number():
    vehicle = model_file.loads(TEXT).vehicle
    low, scale, high = scales("mass", vehicle)["added"]
    assert (low, scale, high) == pytest.approx((-0.015, 0.005, 0.015))
    inertia = scales("inertia", vehicle)
    assert inertia["yy"][1] == 0.002
    assert inertia["xy"][1] == pytest.approx(0.3 * np.sqrt(0.001 * 0.002))
    assert scales("com_offset", vehicle)["z"][1] == 0.002


@pytest.mark.parametrize("said", ["thrust_tolerance = 15", "thrust_axis_tolerance_deg = 1e12"])
def test_how_well_thrust_is_known_is_a_share_and_an_angle(said):
    """Per cent were taken for a share."""
    with pytest.raises(ModelError, match=r"expected (a share, as 0.1 for 10 %|degrees up to 45)"):
        model_file.loads(TEXT.replace("[vehicle]", f"[vehicle]\n{said}"))


def test_a_change_stays_physical_however_little_is_known():
    text = TEXT.replace("tolerance = [0.001, 0.002, 0.003]", "tolerance = [0.01, 0.01, 0.02]")
    vehicle = model_file.loads(text).vehicle
    lows = np.array([low for low, _, _ in scales("inertia", vehicle).values()])
    changed = find("inertia").apply(vehicle.body, np.concatenate((lows[:3], np.zeros(3))))
    assert np.all(np.linalg.eigvalsh(changed.inertia) > 0.0)


def test_what_is_weighed_is_no_open_question():
    vehicle = model_file.loads(TEXT).vehicle
    assert find("mass").known(vehicle) == "the model file knows the mass to 0.005 kg"
    assert find("inertia").known(vehicle) is None  # 8 % is no measurement
    tight = TEXT.replace("[0.001, 0.002, 0.003]", "[0.0001, 0.0001, 0.0002]")
    assert "moments of inertia to 1 %" in find("inertia").known(model_file.loads(tight).vehicle)
    assert find("mass").known(model_file.loads(TEXT.replace("0.005", "0.05")).vehicle) is None
    assert find("com_offset").known(vehicle) is None
    assert find("com_offset").known(model_file.loads(TEXT.replace("tolerance = 0.002 ", "tolerance = 0.0005 ")).vehicle)


def test_a_simulated_truth_may_contradict_what_the_file_is_sure_of():
    hidden = with_hidden(model_file.loads(TEXT), ["mass=added:0.2"])
    assert hidden.effect("mass").theta == pytest.approx([0.2])


def test_tolerances_survive_writing_from_code():
    from dataclasses import replace

    model = model_file.loads(TEXT)
    again = model_file.loads(model_file.dumps(replace(model, text="")))
    assert again.vehicle.tolerances.mass == 0.005
    assert np.allclose(again.vehicle.tolerances.inertia, model.vehicle.tolerances.inertia)
    assert np.allclose(again.vehicle.tolerances.com, model.vehicle.tolerances.com)
    assert again.vehicle.tolerances.imu_position is None


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("tolerance = 0.005", "tolerance = 0.0", r"vehicle.mass: tolerance: got 0.0, expected one number, positive"),
        ("tolerance = 0.005", "tolerance = 1e308", r"vehicle.mass: tolerance: got 1e\+308, .* from 1e-15 to 1e12"),
        ("tolerance = 0.005", "tolerance = [1.0, 2.0]", r"vehicle.mass: tolerance: got \[1.0, 2.0\]"),
        (
            "tolerance = 0.005",
            "sigma = 0.005",
            r"vehicle.mass: got a table with the keys value, sigma, expected",
        ),
        ("value = 1.52", "value = -1.52", r"vehicle.mass: got -1.52, expected a positive number"),
        ("[0.001, 0.002, 0.003]", "[0.001, 'x', 0.003]", r"vehicle.inertia: tolerance: got \[0.001, 'x', 0.003\]"),
        ("tolerance = 0.002 ", "tolerance = [0.1, 0.2] ", r"vehicle.com: tolerance: .* one number or three"),
    ],
)
def test_says_what_is_wrong_in_one_line(old, new, message):
    assert old in TEXT
    with pytest.raises(ModelError, match=message) as caught:
        model_file.loads(TEXT.replace(old, new, 1))
    assert "\n" not in str(caught.value)


def inertia(text):
    return TEXT.replace("{ value = [0.012, 0.012, 0.02], tolerance = [0.001, 0.002, 0.003] }", text)


def test_a_paper_that_rounds_is_taken_with_a_warning():
    """Izz 1 % above Ixx + Iyy: no rigid body has that, and two digits of a paper do."""
    model = model_file.loads(inertia("[0.01, 0.01, 0.0202]"))
    assert model.vehicle.body.inertia[2, 2] == 0.0202
    assert any("exceeds the sum of the others by 1 %" in note for note in model.notes)
    assert model_file.loads(inertia("[0.01, 0.01, 0.02]")).notes == ()


def test_a_gross_violation_stays_an_error():
    with pytest.raises(ModelError, match="no body has the principal moments"):
        model_file.loads(inertia("[0.01, 0.01, 0.03]"))


def test_a_tolerance_grants_more_than_rounding():
    """10 % above, of moments that are known to 5 % each."""
    told = "{ value = [0.01, 0.01, 0.022], tolerance = [0.0005, 0.0005, 0.0011] }"
    assert "by 10 %" in model_file.loads(inertia(told)).notes[0]
    with pytest.raises(ModelError, match="no body has the principal moments"):
        model_file.loads(inertia(told.replace("0.022", "0.025")))
