"""An accelerometer with an offset."""

import numpy as np
import pytest


def test_a_bias_reads_as_a_force_of_the_mass_times_it_and_no_torque(bench):
    """0.3 m/s^2 forward on 4 kg: 1.2 N, whatever the attitude and the rotation."""
    bias = np.array([0.3, -0.1, 0.2])
    wrench = np.array([[1.0, 2.0, bench.weight, 0.1, -0.2, 0.05]])
    for state in (bench.state(), bench.state(quat=bench.turned, omega=(1.0, -2.0, 0.5))):
        plain, biased = (bench.model("accelerometer_bias", b).report(wrench, state)[0] for b in (0 * bias, bias))
        assert biased[:3] - plain[:3] == pytest.approx(bench.body.mass * bias)
        assert biased[3:] == pytest.approx(plain[3:], abs=1e-12)


def test_upside_down_the_half_sum_is_the_bias_and_the_half_difference_is_gravity(bench):
    from wrenchgap.plant.state import Motion

    model, still = bench.model("accelerometer_bias", {"z": 0.2}), np.zeros((1, 3))
    up, down = (model.read_imu(Motion(still, still, np.array([[0.0, 0.0, g]])), bench.state()) for g in (9.81, -9.81))
    a, b = (m.specific_force_B[0, 2] for m in (up, down))
    assert (a + b) / 2 == pytest.approx(0.2)
    assert (a - b) / 2 == pytest.approx(9.81)
