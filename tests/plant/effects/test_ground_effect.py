"""Thrust grows near the ground."""

import numpy as np
import pytest

from wrenchgap.flight.so3 import exp


def lift_at(bench, height, quadrotor, gain=1.0, quat=(1, 0, 0, 0)):
    u = bench.commands(0.0, 700.0, vehicle=quadrotor)
    x = bench.state(position=(0, 0, height), quat=quat)
    grown = bench.model("ground_effect", {"gain": gain}, quadrotor).wrench(u, x)[0]
    return grown, 4 * bench.c_f * 700.0**2


@pytest.mark.parametrize(("radii", "ratio"), [(1.0, 16 / 15), (2.0, 64 / 63)])
def test_cheeseman_and_bennett_at_one_and_two_radii(bench, quadrotor, radii, ratio):
    W, thrust = lift_at(bench, radii * 0.115, quadrotor)
    assert W[2] / thrust == pytest.approx(ratio)


def test_falls_with_height_and_is_gone_high_up(bench, quadrotor):
    lift = np.array([lift_at(bench, z, quadrotor, 3.0)[0][2] for z in np.linspace(0.0, 2.0, 60)])
    assert np.all(np.diff(lift) <= 0)
    assert np.all(np.isfinite(lift))
    W, thrust = lift_at(bench, 20.0, quadrotor, 3.0)
    assert W[2] / thrust == pytest.approx(1.0, abs=1e-5)


def test_ground_below_the_origin_of_the_odometry_is_farther_away(bench, quadrotor):
    u, x = bench.commands(0.0, 700.0, vehicle=quadrotor), bench.state(position=(0, 0, 0.13))
    low = bench.model("ground_effect", {"gain": 1.0, "ground": -0.1}, quadrotor).wrench(u, x)
    np.testing.assert_allclose(low[0], lift_at(bench, 0.23, quadrotor)[0])


def test_ground_rights_a_rolled_vehicle(bench, quadrotor):
    """Rolled by +5 deg the right side (-y) is lower and lifts more: torque about -x."""
    W, _ = lift_at(bench, 0.2, quadrotor, 1.0, exp(np.array([np.deg2rad(5), 0, 0])))
    assert W[3] < -1e-3
    assert W[4] == pytest.approx(0, abs=1e-9)
