"""Logs of actuators and IMU: units and orders against what the vehicle did, flown by an engine that shares nothing."""

from dataclasses import replace

import numpy as np
import pytest

import wrenchgap as wg
from benchmarks.meaning.flying import HEX, QUAD, Manner, fly
from wrenchgap.learn.data.opening import open_flight
from wrenchgap.plant import model_file

CALM = Manner(excitation=0.0, reach=0.2)
DEGREES = 180.0 / np.pi


@pytest.fixture(scope="module", params=[(QUAD, Manner()), (QUAD, CALM), (HEX, Manner())], ids=["quad", "calm", "hex"])
def flown(request, tmp_path_factory):
    """Model, and a flight of it."""
    craft, manner = request.param
    path = tmp_path_factory.mktemp("models") / "craft.toml"
    path.write_text(craft.model())
    return model_file.load(path), fly(craft, 16.0, 31, manner)


def alone(flight, **changes):
    """Actuators and IMU."""
    return replace(flight, commanded=None, odometry=None, checks=None, **changes)


def found(flight, model, level="bad"):
    return {c.name: c for c in open_flight(flight, model, gate=False).checks if c.level == level}


def test_a_healthy_log_is_not_flagged(flown):
    model, flight = flown
    assert found(alone(flight), model) == {}
    assert set(found(alone(flight), model, "warn")) == {"roles"}


def test_rotors_in_another_order_are_put_back(flown):
    model, flight = flown
    count = flight.actuators.rotor_speed.shape[1]
    rolled = replace(flight.actuators, rotor_speed=np.roll(flight.actuators.rotor_speed, 1, axis=1))
    (check,) = found(alone(flight, actuators=rolled), model).values()
    order = ",".join(str((k + 1) % count) for k in range(count))
    assert check.name == "rotors"
    assert f"[{order}]" in check.mend


def test_every_spin_turned_over_is_seen_in_the_yaw(flown):
    model, flight = flown
    rotors = model.vehicle.rotors
    turned = replace(model, vehicle=replace(model.vehicle, rotors=replace(rotors, spin=-rotors.spin)))
    flags = found(alone(flight), turned) | found(alone(flight), turned, "warn")
    assert "spin" in flags["rotors"].words


def test_a_gyroscope_in_degrees_is_found_without_an_attitude(flown):
    model, flight = flown
    imu = replace(flight.imu, omega_B=DEGREES * flight.imu.omega_B)
    (check,) = found(alone(flight, imu=imu), model).values()
    assert check.name == "gyroscope"
    assert check.mend.endswith(":deg")


def test_rotor_speeds_in_rpm_contradict_the_commanded_wrench(flown):
    model, flight = flown
    sent = replace(flight.actuators, rotor_speed=flight.actuators.rotor_speed * 30.0 / np.pi)
    check = found(replace(flight, actuators=sent, checks=None), model)["rotor-speed-unit"]
    assert check.mend.endswith(":rpm")


def test_an_odometry_in_millimetres_is_no_accelerometer_in_another_unit(flown):
    model, flight = flown
    lengths = {name: 1e3 * getattr(flight.odometry, name) for name in ("position_E", "velocity_E")}
    flags = found(replace(flight, odometry=replace(flight.odometry, **lengths), checks=None), model)
    assert set(flags) == {"odometry-scale"}
    assert flags["odometry-scale"].mend.endswith(":mm")


def test_one_order_among_twelve_rotors_is_exactly_the_commanded_wrench():
    model = wg.load_model("tilt_hexarotor")
    flight = wg.simulate(model, "multi_axis", duration=12.0, excitation=1.0, seed=5)
    assert found(flight, model) == {}
    rolled = replace(flight.actuators, rotor_speed=np.roll(flight.actuators.rotor_speed, 1, axis=1))
    (check,) = found(replace(flight, actuators=rolled, checks=None), model).values()
    assert check.name == "rotors"
    assert "[1,2,3,4,5,6,7,8,9,10,11,0]" in check.mend
