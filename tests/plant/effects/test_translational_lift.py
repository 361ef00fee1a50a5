"""Air from the side lifts."""

import numpy as np
import pytest


@pytest.mark.parametrize("heading", [0.0, 1.0, 2.5])
def test_level_flight_lifts_by_the_square_of_the_speed_in_every_direction(bench, heading):
    velocity = 3.0 * np.array([np.cos(heading), np.sin(heading), 0])
    W = bench.added("translational_lift", [3.4e-3], x=bench.state(velocity=velocity))
    np.testing.assert_allclose(W, [0, 0, 12 * 3.4e-3 * 9.0, 0, 0, 0], atol=1e-9)


def test_needs_air_from_the_side(bench):
    W = bench.added("translational_lift", [3.4e-3], x=bench.leaning((0, 0, 3.0)))
    np.testing.assert_allclose(W, 0, atol=1e-9)


def test_leans_with_tilted_rotors(bench):
    """All arms tilted by 90 deg thrust along the circle; a climb blows across them, and the yaw torque grows."""
    x, u = bench.state(velocity=(0, 0, 3.0)), bench.commands(np.pi / 2)
    nominal = bench.model().wrench(u, x)[0, 5]
    assert nominal == pytest.approx(-bench.length * bench.weight)
    assert bench.added("translational_lift", [3.4e-3], u, x)[5] == pytest.approx(-bench.length * 12 * 3.4e-3 * 9.0)


def test_backward_rotors_lift_backwards(bench):
    x, u = bench.state(velocity=(3.0, 0, 0)), bench.commands(0.0, -bench.hover)
    assert bench.added("translational_lift", [3.4e-3], u, x)[2] == pytest.approx(-12 * 3.4e-3 * 9.0)
