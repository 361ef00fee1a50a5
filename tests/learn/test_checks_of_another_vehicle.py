"""A model that is not this vehicle's is asked about; no factor makes it fit."""

from dataclasses import replace

import numpy as np
import pytest

import wrenchgap as wg
from benchmarks.meaning.flying import QUAD, fly
from wrenchgap.flight.autopilot import Autopilot
from wrenchgap.flight.errors import LogError
from wrenchgap.learn.data.opening import open_flight
from wrenchgap.plant import model_file


def of_name(flight, model, name):
    return [c for c in open_flight(flight, model, gate=False).checks if c.name == name]


def with_rotors(model, **changes):
    return replace(model, vehicle=replace(model.vehicle, rotors=replace(model.vehicle.rotors, **changes)))


@pytest.fixture(scope="module")
def tilting():
    model = wg.load_model("tilt_hexarotor")
    return model, wg.simulate(model, "multi_axis", duration=12.0, excitation=1.0, seed=5)


def test_actuators_of_another_vehicle_do_not_make_the_commanded_wrench(tilting):
    _, flight = tilting
    (check,) = of_name(flight, wg.load_model("voliro_x"), "actuation")
    assert check.level == "bad"
    assert "is voliro_x the model of this vehicle?" in check.words


@pytest.mark.parametrize(("factor", "level"), [(1.0, "ok"), (0.7, "warn"), (1.4, "warn")])
def test_one_factor_on_every_thrust_is_a_c_f_and_no_other_vehicle(tilting, factor, level):
    """T = c_f Omega^2: h(u) has the right direction throughout, and is 30 or 40 % off."""
    model, flight = tilting
    (check,) = of_name(flight, with_rotors(model, c_f=factor * model.vehicle.rotors.c_f), "actuation")
    assert check.level == level


def test_a_mass_twice_too_large_is_told_from_a_unit_of_the_commands(tilting):
    """The rotors make the commanded force by themselves: c_f knows its unit, and what it carries is the mass."""
    model, flight = tilting
    body = replace(model.vehicle.body, mass=2.0 * model.vehicle.body.mass)
    (check,) = of_name(flight, replace(model, vehicle=replace(model.vehicle, body=body)), "force-unit")
    assert check.level == "bad"
    assert check.mend is None
    assert "carry 4 kg: correct vehicle.mass" in check.words


def test_arms_twice_too_long_are_told_from_an_inertia(tilting):
    """M = J domega holds for the commanded torque, and not for what the arms make of the thrusts."""
    model, flight = tilting
    arms = replace(model.vehicle.arms, position_B=2.0 * model.vehicle.arms.position_B)
    (*_, check) = of_name(flight, replace(model, vehicle=replace(model.vehicle, arms=arms)), "inertia")
    assert check.level == "bad"
    assert "as the model's inertia says" in check.words
    assert "correct the arms' length" in check.words
    body = replace(model.vehicle.body, inertia=3.0 * model.vehicle.body.inertia)
    (*_, check) = of_name(flight, replace(model, vehicle=replace(model.vehicle, body=body)), "inertia")
    assert "correct vehicle.inertia" in check.words


@pytest.mark.parametrize("factor", [1.03, 0.95])
def test_one_rotor_whose_logged_speed_is_off_is_said_and_is_no_weak_rotor(tilting, factor):
    """The commanded wrench of the same log needs another speed of it: T = c_f Omega^2 at (1 / factor) times that."""
    model, flight = tilting
    speed = flight.actuators.rotor_speed * np.where(np.arange(flight.actuators.rotor_speed.shape[1]) == 4, factor, 1.0)
    (check,) = of_name(replace(flight, actuators=replace(flight.actuators, rotor_speed=speed)), model, "actuation")
    assert check.level == "bad"
    rotor = model.vehicle.rotor_name(4)
    assert (
        f"the logged speed of {rotor} alone makes it, {factor:.3f} times the one that the wrench needs" in check.words
    )


def test_tilts_that_are_logged_with_an_error_are_told_where_the_vehicle_followed_its_wrench(tilting):
    """The measured wrench is the commanded one: encoders with an eccentricity of 1.7 deg made a thrust curve firm."""
    model, flight = tilting
    tilt = flight.actuators.tilt + 0.03 * np.sin(2.0 * flight.actuators.tilt)
    (check,) = of_name(replace(flight, actuators=replace(flight.actuators, tilt=tilt)), model, "actuation")
    assert check.level == "warn"
    assert "the vehicle followed W_cmd" in check.words
    weak = wg.simulate(model, "multi_axis", duration=12.0, excitation=1.0, seed=5, hide=("rotor_thrust=rotor_3:-0.2",))
    assert [c.level for c in of_name(weak, model, "actuation")] == ["ok"]


def test_a_model_with_one_rotor_that_lifts_less_is_asked_about_too(tilting):
    """c_f 20 % too low for one rotor is one speed that is 1 / sqrt(1 / 0.8) times what the wrench needs."""
    model, flight = tilting
    c_f = model.vehicle.rotors.c_f * np.where(np.arange(len(model.vehicle.rotors.c_f)) == 2, 0.8, 1.0)
    (check,) = of_name(flight, with_rotors(model, c_f=c_f), "actuation")
    assert check.level == "bad"
    assert f"{0.8**0.5:.3f} times" in check.words


@pytest.mark.parametrize(("share", "level"), [(1.0, "ok"), (1.2, "warn"), (1.4, "warn"), (1.6, "bad"), (0.6, "bad")])
def test_commands_that_carry_another_weight_are_another_vehicles(tilting, share, level):
    """In flight the mean commanded force is m g: a model of a vehicle 1.6 times lighter is not this one's."""
    model, flight = tilting
    body = replace(model.vehicle.body, mass=model.vehicle.body.mass / share)
    found = of_name(flight, replace(model, vehicle=replace(model.vehicle, body=body)), "weight")
    assert {c.level for c in found if "commanded" in c.words} == {level}


@pytest.fixture(scope="module")
def bare(tmp_path_factory):
    """Model, and a log of it without an attitude."""
    path = tmp_path_factory.mktemp("models") / "craft.toml"
    path.write_text(QUAD.model())
    return model_file.load(path), replace(fly(QUAD, 16.0, 31), odometry=None, checks=None)


def test_thrusts_that_no_unit_explains_ask_for_the_model_and_propose_no_factor(bare):
    model, flight = bare
    unsaid = replace(flight, commanded=None)
    found = of_name(unsaid, with_rotors(model, c_f=12.0 * model.vehicle.rotors.c_f), "weight")
    (check,) = [c for c in found if "no usual unit" in c.words]
    assert check.level == "bad"
    assert check.mend is None
    assert f"is {model.vehicle.name} the model of this vehicle?" in check.words


@pytest.mark.parametrize(("unit", "word"), [(30.0 / np.pi, "rpm"), (0.5 / np.pi, "6.283185")])
def test_a_known_unit_is_still_proposed(bare, unit, word):
    model, flight = bare
    sent = replace(flight.actuators, rotor_speed=unit * flight.actuators.rotor_speed)
    found = of_name(replace(flight, actuators=sent), model, "rotor-speed-unit")
    assert any(c.level == "bad" and word in c.mend for c in found)


def test_speeds_as_shares_of_the_largest_are_normalised(bare):
    model, flight = bare
    most = model.vehicle.rotors.speed_max[0]
    sent = replace(flight.actuators, rotor_speed=flight.actuators.rotor_speed / most)
    found = of_name(replace(flight, actuators=sent), model, "rotor-speed-unit")
    (check,) = [c for c in found if c.level == "bad"]
    factor = float(check.mend.split("*")[1].strip("'"))
    assert factor == pytest.approx(most, rel=0.1)


@pytest.mark.parametrize("size", [0.0, 1e-200])
def test_of_rotors_that_stand_still_no_factor_is_proposed(bare, size):
    """It was infinite, and numpy's warning of it stood on the screen."""
    model, flight = bare
    sent = replace(flight.actuators, rotor_speed=size * flight.actuators.rotor_speed)
    with np.errstate(divide="raise"):
        found = of_name(replace(flight, actuators=sent), model, "rotor-speed-unit")
    (check,) = [c for c in found if c.level == "bad"]
    assert check.mend is None
    assert "the logged rotors stand still" in check.words


X_CLOCKWISE = {"FRAME_CLASS": 1, "FRAME_TYPE": 14}
"""ArduPilot's: motors 1 to 4 from the front right on, clockwise seen from above, as the Crazyflie's are."""
PX4_CLOCKWISE = {"CA_ROTOR_COUNT": 4} | {
    f"CA_ROTOR{k}_P{axis}": value
    for k, place in enumerate([(1.0, 0.4), (-1.0, 0.4), (-1.0, -0.4), (1.0, -0.4)])  # forward, right
    for axis, value in zip("XY", place, strict=True)
}


@pytest.mark.parametrize(
    ("parameters", "level"),
    [
        (X_CLOCKWISE, "ok"),
        (PX4_CLOCKWISE, "ok"),
        (X_CLOCKWISE | {"FRAME_TYPE": 1}, "bad"),  # motor 2 at the back left
        (X_CLOCKWISE | {"FRAME_TYPE": 0}, "bad"),  # a plus
        (PX4_CLOCKWISE | {"CA_ROTOR0_PY": -0.4, "CA_ROTOR3_PY": 0.4}, "bad"),
    ],
)
def test_a_model_whose_motors_are_elsewhere_than_the_parameters_say_is_asked_about(parameters, level):
    model = wg.load_model("crazyflie")
    flight = wg.simulate(model, "multi_axis", duration=6.0, excitation=1.0, seed=5)
    flight = replace(flight, autopilot=Autopilot("of a test", parameters=parameters))
    (check,) = of_name(flight, model, "frame")
    assert check.level == level
    if level == "bad":
        with pytest.raises(LogError, match="--accept frame"):
            open_flight(flight, model)
        assert open_flight(flight, model, accept=["frame"]).records


def test_parameters_that_say_no_place_or_of_another_number_of_motors_are_no_frame():
    model = wg.load_model("crazyflie")
    flight = wg.simulate(model, "multi_axis", duration=6.0, excitation=1.0, seed=5)
    for parameters in ({}, {"FRAME_CLASS": 2, "FRAME_TYPE": 1}, {"FRAME_CLASS": 17, "FRAME_TYPE": 1}):
        assert of_name(replace(flight, autopilot=Autopilot("of a test", parameters=parameters)), model, "frame") == []


@pytest.mark.parametrize(("columns", "asked"), [("", True), ("[0,1,2,3]", True), ("[0,2,1,3]", False)])
def test_columns_that_a_user_put_in_order_are_his(columns, asked):
    model = wg.load_model("crazyflie")
    flight = wg.simulate(model, "multi_axis", duration=6.0, excitation=1.0, seed=5)
    flight = replace(flight, autopilot=Autopilot("of a test", parameters=X_CLOCKWISE | {"FRAME_TYPE": 1}))
    flight = replace(flight, mapping={**flight.mapping, "rotor_speed": f"/motors{columns}"})
    assert bool(of_name(flight, model, "frame")) == asked


def test_the_crazyflie_counts_its_motors_as_its_firmware_does():
    """M1 at the front right, then clockwise: a model with motors 1 and 2 exchanged is another one."""
    model = wg.load_model("crazyflie")
    flight = replace(wg.simulate(model, "multi_axis", duration=6.0, excitation=1.0, seed=5), firmware="Crazyflie")
    (check,) = of_name(flight, model, "frame")
    assert check.level == "ok"
    places = model.vehicle.arms.position_B[[1, 0, 2, 3]]
    other = replace(model, vehicle=replace(model.vehicle, arms=replace(model.vehicle.arms, position_B=places)))
    (check,) = of_name(flight, other, "frame")
    assert check.level == "bad"
    assert "90 deg from where the log has motor 1" in check.words


def test_of_a_small_vehicle_that_flies_gently_another_wrench_is_seen_too():
    """Its torques are a thousandth of a large one's: what h(u) and W_cmd may differ by goes with weight and arm."""
    model = wg.load_model("crazyflie")
    flight = wg.simulate(model, "hover", duration=20.0, excitation=1.0, seed=5)
    assert [c.level for c in of_name(flight, model, "actuation")] == ["ok"]
    torque = flight.commanded.wrench_B[::-1, 3:]
    wrench = np.hstack([flight.commanded.wrench_B[:, :3], torque])
    other = replace(flight, commanded=replace(flight.commanded, wrench_B=wrench), checks=None)
    assert [c.level for c in of_name(other, model, "actuation")] == ["bad"]
