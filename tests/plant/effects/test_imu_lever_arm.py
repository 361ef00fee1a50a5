"""An accelerometer away from its place."""

import numpy as np

from wrenchgap.flight.so3 import exp, matrix, multiply
from wrenchgap.plant.state import Motion


def test_accelerometer_away_from_its_place_moves_with_the_body(bench):
    """Second derivative of the path of a point on a body that tumbles, against the derivative of the path of O."""
    r = np.array([0.03, -0.02, 0.05])

    def quat(t):
        return multiply(exp(np.array([0.5, 1.0, -0.3]) * np.sin(2 * t)), exp(np.array([0.2, -0.4, 0.9]) * t**2))

    def path(t):
        return matrix(quat(t)) @ r

    def omega(t, h=1e-4):
        dR = (matrix(quat(t + h)) - matrix(quat(t - h))) / (2 * h)
        S = matrix(quat(t)).T @ dR
        return np.array([S[2, 1], S[0, 2], S[1, 0]])

    t, h = 0.7, 1e-3
    acceleration_E = (path(t + h) - 2 * path(t) + path(t - h)) / h**2
    motion = Motion(omega(t)[None], ((omega(t + h) - omega(t - h)) / (2 * h))[None], np.array([[0.1, 0.2, 9.8]]))
    read = bench.model("imu_lever_arm", r).read_imu(motion, bench.state())
    felt = read.specific_force_B[0] - motion.specific_force_B[0]
    assert np.linalg.norm(felt) > 0.1
    np.testing.assert_allclose(felt, matrix(quat(t)).T @ acceleration_E, atol=2e-5)
    np.testing.assert_array_equal(read.omega_B, motion.omega_B)
