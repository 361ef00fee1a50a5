"""Flights whose rotor commands are throttles: the same flight in newtons, through the curve of the model file."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import wrenchgap as wg
from benchmarks.hidden_effects import engine
from wrenchgap.flight.errors import LogError
from wrenchgap.flight.flight import BatterySeries
from wrenchgap.learn.data.opening import NoFlight
from wrenchgap.plant import model_file

FULL = 9.0
"""Thrust of one rotor at full throttle and full battery [N]."""
FULL_VOLTAGE, EMPTY = 16.8, 14.0


@pytest.fixture(scope="module")
def quadrotor():
    return model_file.load("asymmetric_quadrotor")


@pytest.fixture(scope="module")
def flown(quadrotor):
    return wg.simulate(quadrotor, "hover", duration=6.0, excitation=0.5, seed=3)


def with_command(model, text):
    return model_file.loads(f"{model.text}\n[command]\n{text}\n")


def as_throttle(flown, model, battery=True):
    """The flight as an autopilot logs it: the root of T = FULL (V / V_full)^2 u^2, and a battery that runs down."""
    sent = flown.actuators
    voltage = np.interp(sent.time, (sent.time[0], sent.time[-1]), (FULL_VOLTAGE, EMPTY)) if battery else FULL_VOLTAGE
    _, rotors = model.vehicle.geometry()
    newtons = rotors.c_f * sent.rotor_speed**2
    throttle = np.sqrt(newtons / FULL) / np.reshape(voltage / FULL_VOLTAGE, (-1, 1))
    measured = BatterySeries("/battery", sent.time, voltage) if battery else None
    return replace(
        flown,
        commanded=None,
        desired=None,
        actuators=replace(sent, rotor_speed=throttle, unit="normalised"),
        battery=measured,
    )


CURVE = (
    f'unit = "normalised"\nthrust_max = {FULL}\nfactor = 1.0\nvoltage = {{ nominal = {FULL_VOLTAGE}, exponent = 2.0 }}'
)


def test_the_same_flight_comes_out_of_throttles_and_voltage(flown, quadrotor):
    """Speeds and the predicted wrench agree with those of the log in rad/s."""
    model = with_command(quadrotor, CURVE + '\nsource = "bench of Monday"')
    plain = wg.open_flights(replace(flown, commanded=None, desired=None), quadrotor)[0]
    found = wg.open_flights(as_throttle(flown, quadrotor), model)[0]
    assert found.flight.actuators.unit == "rad/s"
    assert np.allclose(found.records[0].commands.rotor_speed, plain.records[0].commands.rotor_speed, rtol=2e-3)
    assert np.allclose(found.records[0].commanded, plain.records[0].commanded, atol=0.02)
    assert any("thrust by [command] of" in note and "bench of Monday" in note for note in found.notes)


def test_without_a_battery_the_nominal_voltage_is_assumed_and_said(flown, quadrotor):
    model = with_command(quadrotor, CURVE)
    found = wg.open_flights(as_throttle(flown, quadrotor, battery=False), model)[0]
    plain = wg.open_flights(replace(flown, commanded=None, desired=None), quadrotor)[0]
    assert np.allclose(found.records[0].commanded, plain.records[0].commanded, atol=1e-6)
    assert any("no battery voltage in the log" in note for note in found.notes)


def test_a_log_in_speeds_is_left_as_it_is(flown, quadrotor):
    model = with_command(quadrotor, CURVE)
    found = wg.open_flights(flown, model)[0]
    assert np.array_equal(found.flight.actuators.rotor_speed, flown.actuators.rotor_speed)


def test_without_a_curve_the_remedy_is_said(flown, quadrotor):
    with pytest.raises(LogError, match="wrenchgap model new --from"):
        wg.open_flights(as_throttle(flown, quadrotor), quadrotor)


def test_another_unit_than_the_curve_is_for_is_refused(flown, quadrotor):
    throttle = as_throttle(flown, quadrotor)
    pulses = replace(throttle, actuators=replace(throttle.actuators, unit="pwm"))
    with pytest.raises(LogError, match=r"are pulse widths in us, and \[command\] of .* is for normalised") as caught:
        wg.open_flights(pulses, with_command(quadrotor, CURVE))
    assert "\n" not in str(caught.value)


def test_a_bench_table_that_is_left_is_counted(flown, quadrotor):
    rows = "command = [0.3, 0.6], thrust = [1.0, 4.0]"
    model = with_command(quadrotor, f'unit = "normalised"\ntable = {{ {rows} }}')
    sent = as_throttle(flown, quadrotor, battery=False)
    far = sent.actuators.rotor_speed.copy()
    far[::10] = 0.9
    found = wg.open_flights(replace(sent, actuators=replace(sent.actuators, rotor_speed=far)), model)[0]
    assert any("lie outside the bench table" in note for note in found.notes)


def test_inspect_says_why_rotors_in_revolutions_per_second_never_carry_the_weight(tmp_path):
    """Without a wrench nothing else tells: thrusts are 1 / (2 pi)^2 of what they were, and no flight is found."""
    model = wg.load_model("tilt_hexarotor")
    flown = wg.simulate(model, "multi_axis", duration=20.0, excitation=1.0, seed=3)
    turns = replace(flown.actuators, rotor_speed=flown.actuators.rotor_speed / (2.0 * np.pi))
    path = wg.save_log(replace(flown, commanded=None, desired=None, actuators=turns), tmp_path / "turns.mcap")
    bad = {check.name: check for check in wg.inspect(path, model).model_checks if check.level == "bad"}
    assert set(bad) == {"rotor-speed-unit", "model"}
    assert "revolutions per second" in bad["rotor-speed-unit"].words
    assert "*6.283185" in bad["rotor-speed-unit"].remedy
    assert "no 2 s of flight" in bad["model"].words
    assert "rotor speeds in rad/s?" in bad["model"].words
    error = pickle.loads(pickle.dumps(NoFlight("none", tuple(bad.values()))))
    assert error.checks == tuple(bad.values())  # as a worker of `batch` hands it on


def test_a_hover_without_torque_does_not_say_how_rotors_stand():
    """What is commanded is how the log rounds, and so is what the actuators make: neither is like the other."""
    flight = engine.fly("none", None, "hover", seed=30000, seconds=12)[0]
    checks = {c.name for c in wg.open_flights([flight], model_file.load("tilt_hexarotor"))[0].checks}
    assert "weight" in checks
    assert "rotors" not in checks


def test_an_attitude_in_another_frame_is_said_where_there_is_no_imu(flown, quadrotor):
    """A hover pushes against gravity: with the attitude turned over, the measured force points down in B."""
    odometry = flown.odometry
    turned = Rotation.from_quat(odometry.quat_EB, scalar_first=True) * Rotation.from_rotvec([np.pi, 0.0, 0.0])
    upside_down = replace(odometry, quat_EB=turned.as_quat(scalar_first=True))
    wg.open_flights([replace(flown, imu=None, commanded=None)], quadrotor)
    with pytest.raises(LogError, match=r"inertial-frame: The nominal force is .*, and points the other way"):
        wg.open_flights([replace(flown, imu=None, commanded=None, odometry=upside_down)], quadrotor)
