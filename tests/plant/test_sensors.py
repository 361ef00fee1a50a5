"""Sensor models: geometry and statistics."""

from dataclasses import replace

import numpy as np
import pytest

from wrenchgap.flight import so3
from wrenchgap.flight.errors import ModelError
from wrenchgap.flight.resample import resample
from wrenchgap.plant import model_file
from wrenchgap.plant.sensors import SensorNoise, imu_errors, pose_errors, read_imu, read_pose
from wrenchgap.plant.simulation.simulate import simulate
from wrenchgap.plant.state import Motion, State
from wrenchgap.plant.trajectory import named


@pytest.mark.parametrize(
    ("omega_z", "omega_dot_z", "felt"),
    [(4.0, 0.0, [-1.6, 0.0, 9.81]), (0.0, 5.0, [0.0, 0.5, 9.81])],
    ids=["centripetal acceleration", "angular acceleration"],
)
def test_an_accelerometer_off_the_axis_feels_the_rotation(omega_z, omega_dot_z, felt):
    """Spinning at w about z, an IMU at radius r along x reads -w^2 r along x (towards the axis), and +g up."""
    motion = Motion(*(np.array([[0.0, 0.0, z]]) for z in (omega_z, omega_dot_z, 9.81)))
    np.testing.assert_allclose(read_imu(motion, np.array([0.1, 0.0, 0.0]), np.zeros((1, 6)))[1], [felt])


@pytest.mark.parametrize("rate", [100.0, 400.0])
def test_white_noise_has_its_density_whatever_the_rate_and_silent_sensors_none(rate):
    noise, rng = SensorNoise(imu_rate_hz=rate, gyro_bias=(0.01, 0.0, 0.0)), np.random.default_rng(0)
    errors = imu_errors(noise, 40000, rng)
    density = np.sqrt(2.0 * np.var(errors, axis=0) / rate)  # one-sided, spread over rate / 2
    np.testing.assert_allclose(density, [2.4e-4] * 3 + [2.3e-3] * 3, rtol=0.03)
    assert errors[:, 0].mean() == pytest.approx(0.01, abs=1e-4)
    assert noise.silent.imu_rate_hz == rate
    assert not imu_errors(noise.silent, 10, rng).any()


def test_pose_noise_has_its_size_and_keeps_rotations_rotations():
    n, noise = 20000, SensorNoise()
    quat = np.tile(so3.exp(np.array([0.5, 1.0, -0.2])), (n, 1))
    zeros = np.zeros((n, 3))
    errors = pose_errors(noise, n, np.random.default_rng(1))
    read = read_pose(State(np.arange(n, dtype=float), zeros, quat, zeros, zeros), errors)
    np.testing.assert_allclose(read.position_E.std(axis=0), noise.position_std, rtol=0.05)
    np.testing.assert_allclose(read.velocity_E.std(axis=0), noise.velocity_std, rtol=0.05)
    np.testing.assert_allclose(read.omega_B.std(axis=0), noise.rate_std, rtol=0.05)
    tilt = so3.log(so3.multiply(so3.conjugate(quat), read.quat_EB))
    np.testing.assert_allclose(tilt.std(axis=0), noise.attitude_std, rtol=0.05)
    np.testing.assert_allclose(np.linalg.norm(read.quat_EB, axis=1), 1.0, atol=1e-12)


@pytest.mark.parametrize(
    "bad", [{"gyro_density": -1.0}, {"imu_rate_hz": 0.0}, {"accel_bias": (0.0, float("nan"), 0.0)}]
)
def test_senseless_sensors_are_named(bad):
    with pytest.raises(ModelError, match=f"sensors.{next(iter(bad))}"):
        SensorNoise(**bad)


def test_odometry_alone_says_the_same_specific_force_as_the_imu():
    """A vehicle at rest, simulated without noise: the two agree far below the noise of an accelerometer."""
    made = model_file.load("tilt_hexarotor")
    silent = made.sensors.silent
    flown = simulate(made, None, named("hover", 6.0), rng=np.random.default_rng(0), feedback="true", sensors=silent)
    by_imu, by_odometry = (resample(f).samples[0].specific_force_B for f in (flown, replace(flown, imu=None)))
    np.testing.assert_allclose(by_odometry.mean(axis=0), by_imu.mean(axis=0), atol=1e-6)
