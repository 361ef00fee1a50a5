"""The motion read from IMU and odometry, against the motion that made the readings."""

from dataclasses import replace

import numpy as np
import pytest

from wrenchgap import flight
from wrenchgap.flight import so3
from wrenchgap.flight.errors import LogError
from wrenchgap.flight.flight import OdometrySeries
from wrenchgap.learn.data.recording import integrate_rate, recorded_motion
from wrenchgap.plant import model_file
from wrenchgap.plant.simulation.simulate import simulate
from wrenchgap.plant.trajectory import named

LEVER = np.array([0.05, -0.03, 0.02])
BIAS, ACCEL_BIAS = (0.01, -0.02, 0.005), (0.05, 0.08, -0.1)


def fly(sensors):
    model = model_file.load("tilt_hexarotor")
    model = replace(model, vehicle=replace(model.vehicle, imu_position_B=LEVER))
    path, rng = named("multi_axis", 13.4, excitation=1.0), np.random.default_rng(3)
    return simulate(model, None, path, duration=9.0, rng=rng, feedback="true", sensors=sensors(model.sensors))


@pytest.fixture(scope="module")
def truth():
    return fly(lambda s: s.silent).odometry


@pytest.fixture(scope="module")
def log():
    return fly(lambda s: replace(s, gyro_bias=BIAS, accel_bias=ACCEL_BIAS))


@pytest.fixture(scope="module")
def samples(log):
    return max(flight.resample(log, require=("commanded", "imu", "odometry")).samples, key=len)


@pytest.fixture(scope="module")
def motion(log, samples):
    return recorded_motion(samples, log.odometry, LEVER)


def at_truth(motion, truth):
    """Row numbers of the motion, and of the truth, at common instants away from the ends."""
    rows = np.flatnonzero((motion.state.time > 0.5) & (motion.state.time < 8.5))
    nearest = np.searchsorted(truth.time, motion.state.time[rows] - 1e-6)
    common = np.abs(truth.time[nearest] - motion.state.time[rows]) < 1e-6
    assert common.sum() > 700
    return rows[common], nearest[common]


def test_the_true_motion_is_found_through_biases_noise_and_lever_arm(motion, truth):
    i, j = at_truth(motion, truth)
    turn = so3.log(so3.multiply(so3.conjugate(truth.quat_EB[j]), motion.state.quat_EB[i]))
    # White noise of 0.2 mm and 0.3 mrad at 100 Hz, averaged over knots of 0.25 s, leaves 1/4 of it; what the filter
    # at 25 Hz takes from the motion comes on top, so ask for the noise of a single sample.
    assert np.sqrt(np.mean((motion.state.position_E[i] - truth.position_E[j]) ** 2)) < 2e-4
    assert np.sqrt(np.mean(turn**2)) < 3e-4
    assert np.sqrt(np.mean((motion.state.velocity_E[i] - truth.velocity_E[j]) ** 2)) < 2e-3  # log: 5e-3
    assert np.sqrt(np.mean((motion.state.omega_B[i] - truth.omega_B[j]) ** 2)) < 2e-3  # log: 4e-3


def test_position_velocity_and_acceleration_belong_together(motion):
    state, dt = motion.state, motion.state.time[1] - motion.state.time[0]
    acceleration = so3.rotate(state.quat_EB, motion.motion.specific_force_B) - [0.0, 0.0, 9.80665]
    turned = so3.log(so3.multiply(so3.conjugate(state.quat_EB[:-1]), state.quat_EB[1:]))
    for steps, rate in (
        (np.diff(state.velocity_E, axis=0), acceleration),
        (np.diff(state.position_E, axis=0), state.velocity_E),
        (turned, state.omega_B),
    ):
        assert np.abs(steps / dt - 0.5 * (rate[1:] + rate[:-1])).max() < 1e-3


def test_a_constant_rate_integrates_to_its_rotation():
    rate = np.tile([0.3, -0.5, 0.2], (201, 1))
    quat = integrate_rate(np.array([1.0, 0.0, 0.0, 0.0]), rate, 0.01)
    assert so3.log(quat[-1]) == pytest.approx(2.0 * rate[0], abs=1e-9)


def test_too_little_odometry_is_said(log, samples):
    o = log.odometry
    with pytest.raises(LogError, match=r"/odometry has 3 samples.*at least 10"):
        recorded_motion(samples, OdometrySeries(o.topic, o.time[1:4], o.position_E[1:4], o.quat_EB[1:4]), LEVER)
