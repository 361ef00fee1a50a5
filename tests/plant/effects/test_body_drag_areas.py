"""Drag in the square of the speed, with an area per axis."""

import numpy as np
import pytest

from wrenchgap.flight.so3 import rotate


def test_a_square_metre_at_ten_metres_a_second(bench):
    """Dynamic pressure of air at sea level: 61 Pa; through the centre of mass, no torque."""
    W = bench.added("body_drag_areas", {"area_x": 1.0}, x=bench.state(velocity=(10.0, 0, 0)))
    np.testing.assert_allclose(W, [-61.25, 0, 0, 0, 0, 0], atol=1e-9)


def test_equal_areas_drag_against_the_velocity_in_any_attitude(bench):
    v = np.array([2.0, -1.0, 0.5])
    x = bench.state(velocity=v, quat=bench.turned)
    W = bench.added("body_drag_areas", [0.2, 0.2, 0.2], x=x)
    force = rotate(bench.turned, W[:3])
    np.testing.assert_allclose(np.cross(force, v), 0.0, atol=1e-12)
    assert np.linalg.norm(force) == pytest.approx(0.5 * 1.225 * 0.2 * (v @ v))
    assert force @ v < 0


def test_takes_power_from_any_motion(bench):
    for seed in range(5):
        x, u = bench.moving(seed)
        assert bench.power(bench.added("body_drag_areas", [0.1, 0.3, 0.2], u, x), x) < 0


def test_differs_from_drag_axis_by_axis_between_the_axes(bench):
    """Along an axis both are c v^2; at 45 deg the other form has 1 / sqrt 2 of it."""
    c = 0.1
    areas, squares = [2 * c / 1.225] * 3, [0, 0, 0, c, c, c, 0, 0, 0]
    for velocity, ratio in (((3.0, 0, 0), 1.0), ((3.0, 3.0, 0), 2**-0.5)):
        x = bench.state(velocity=velocity)
        one, other = (bench.added(*e, x=x)[:3] for e in (("body_drag_areas", areas), ("body_drag", squares)))
        assert np.linalg.norm(other) / np.linalg.norm(one) == pytest.approx(ratio)
