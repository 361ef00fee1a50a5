"""A turned IMU."""

import numpy as np
import pytest

from wrenchgap.flight.so3 import exp, rotate_inverse
from wrenchgap.plant.state import Motion


def test_imu_turned_nose_down_reads_lift_as_a_pull_backwards(bench):
    """Turned by +e about y its x axis points below the horizon, so that hover shows as a negative x force."""
    W = bench.model("imu_misalignment", {"y": 0.02}).report(np.array([[0, 0, bench.weight, 0, 0, 0]]), bench.state())[0]
    assert W[0] == pytest.approx(-bench.weight * 0.02)
    assert W[2] == pytest.approx(bench.weight)


def test_misalignment_is_a_rotation_to_second_order(bench):
    vectors, errors = np.random.default_rng(2).normal(size=(3, 40, 3)), []
    for turn in np.outer([0.08, 0.04, 0.02], [0.6, -0.5, 0.62]):
        read = bench.model("imu_misalignment", turn).read_imu(Motion(*vectors), bench.state(40))
        found = np.array([read.omega_B, read.omega_dot_B, read.specific_force_B])
        errors.append(np.abs(found - rotate_inverse(exp(turn), vectors.reshape(-1, 3)).reshape(3, 40, 3)).max())
    np.testing.assert_allclose(np.log2(np.array(errors[:-1]) / errors[1:]), 2.0, atol=0.05)
    assert errors[-1] < 1e-3
