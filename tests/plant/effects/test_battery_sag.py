"""Thrust that follows the voltage."""

import numpy as np
import pytest


@pytest.mark.parametrize(("volts", "share"), [(25.0, 1.0), (24.0, (24 / 25) ** 2), (22.5, (22.5 / 25) ** 2)])
def test_open_loop_rotors_follow_the_square_of_the_voltage(bench, volts, share):
    """To first order in the sag, with k = 2; V_0 = 25 V."""
    W = bench.added("battery_sag", {"sensitivity": 2.0, "per_volt": 2.0 / 25}, x=bench.state(volts=volts))
    sag = 1 - volts / 25
    assert W[2] / (bench.weight) == pytest.approx(share - 1, abs=1.01 * sag**2 + 1e-12)
    assert W[2] / (bench.weight) == pytest.approx(-2 * sag, abs=1e-9)


def test_sag_takes_torque_and_side_force_alike(bench):
    _, u = bench.moving(8)
    nominal = bench.model().wrench(u, bench.state())[0]
    W = bench.added("battery_sag", {"sensitivity": 0.8, "per_volt": 0.8 / 24}, u, bench.state(volts=21.0))
    np.testing.assert_allclose(W, -0.1 * nominal, atol=1e-9)
