"""The motion cannot come before its commands: closed forms of open-loop logs, and a closed loop in gusts."""

from dataclasses import replace

import pytest

import wrenchgap as wg
from tests.learn.test_response_timing import found_in, log
from wrenchgap import flight
from wrenchgap.flight.flight import WrenchSeries
from wrenchgap.learn.data.checks.early_response import early_response
from wrenchgap.learn.data.measurement import prepare
from wrenchgap.plant import model_file
from wrenchgap.replay.present.health import next_command
from wrenchgap.replay.present.statements import statements

MODEL = model_file.load("crazyflie")


def both(**how):
    """The torque about x about y as well."""
    made = log(**how)
    wrench, gyro = made.commanded.wrench_B.copy(), made.imu.omega_B.copy()
    inertia = MODEL.vehicle.body.inertia
    wrench[:, 4], gyro[:, 1] = wrench[:, 3], gyro[:, 0] * inertia[0, 0] / inertia[1, 1]
    return replace(made, commanded=replace(made.commanded, wrench_B=wrench), imu=replace(made.imu, omega_B=gyro))


def checks(made):
    return list(early_response(made, MODEL, [prepare(s, MODEL.vehicle) for s in flight.uniform(made)]))


def test_a_motion_that_comes_before_its_commands_is_said_with_the_time():
    (check,) = checks(both(delay=-0.03))
    assert check.level == "bad"
    assert "torque_x, torque_y" in check.words
    assert "30 ms before" in check.words


@pytest.mark.parametrize("how", [{}, {"delay": 0.03}, {"tau": 0.05}, {"tau": 0.05, "delay": -0.01}])
def test_delays_lags_and_none_of_them_are_no_early_response(how):
    assert not checks(both(**how))


def test_one_axis_is_not_enough():
    assert found_in(log(delay=-0.03))["torque_x"].early == pytest.approx(0.03, abs=2e-3)
    assert not checks(log(delay=-0.03))


def test_a_command_that_balances_a_disturbance_is_none():
    """What it makes is the opposite of what is seen: response over command is -1 over the controller."""
    made = both(delay=-0.03)
    wrench = made.commanded.wrench_B.copy()
    wrench[:, 3:] *= -0.5
    assert not checks(replace(made, commanded=replace(made.commanded, wrench_B=wrench)))


def test_a_snapshot_of_faster_commands_is_early_by_half_its_period():
    """It is said at 25 Hz what was commanded at 250 Hz, and taken for held."""
    made = both()
    rare = WrenchSeries("/command/wrench", made.commanded.time[::10], made.commanded.wrench_B[::10])
    made = replace(made, commanded=rare)
    assert found_in(made)["torque_x"].early == pytest.approx(0.02, abs=3e-3)
    assert not checks(made)


def test_check_says_it_of_the_log_and_not_of_the_model(tmp_path):
    """A model that is made anew would be no better: what is to be looked at is the log."""
    flown = wg.simulate(wg.load_model("crazyflie"), "figure8_level", duration=15, excitation=0.5)
    wg.save_log(flown, tmp_path / "early.mcap")
    found = wg.check([tmp_path / "early.mcap"], MODEL, shifts={"imu": -0.02})
    said = [one.words for one in statements(found.logs[0]) if one.about == "early-response"]
    assert len(said) == 1
    assert "20 ms before" in said[0]
    assert not found.logs[0].contradictions
    assert next_command(found).startswith("wrenchgap inspect ")
