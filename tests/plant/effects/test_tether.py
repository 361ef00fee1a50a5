"""A force fixed in E at a point of the body."""

import numpy as np
import pytest

from wrenchgap.flight.flight import GRAVITY
from wrenchgap.flight.so3 import exp, multiply, rotate, rotate_inverse
from wrenchgap.plant.effects import find


@pytest.mark.parametrize("seed", range(5))
def test_pulls_in_the_world_and_works_where_its_point_moves(bench, seed):
    """Power of the wrench is the force times the velocity of the attachment point, differentiated numerically."""
    rng = np.random.default_rng(seed)
    F, p = rng.normal(size=3), rng.normal(size=3) * 0.2
    x, u = bench.moving(seed)
    W = bench.added("tether", [*F, *p], u, x)
    np.testing.assert_allclose(rotate(x.quat_EB[0], W[:3]), F, atol=1e-12)
    h = 1e-5

    def point(t):
        turned = multiply(x.quat_EB[0], exp(x.omega_B[0] * t))
        return x.velocity_E[0] * t + rotate(turned, p)

    velocity = (point(h) - point(-h)) / (2 * h)
    assert bench.power(W, x) == pytest.approx(F @ velocity, rel=1e-6)


def test_tether_through_the_origin_makes_no_torque(bench):
    F = np.array([0.4, -0.3, 0.8])
    W = bench.added("tether", [*F, *(0.25 * rotate_inverse(bench.turned, F))], x=bench.leaning())
    np.testing.assert_allclose(W[3:], 0, atol=1e-12)
    assert np.linalg.norm(W[:3]) == pytest.approx(np.linalg.norm(F))


def test_weight_on_a_string_needs_the_support_of_a_payload(bench):
    p, dm, x = np.array([0.12, -0.2, -0.15]), 0.35, bench.leaning()
    up = rotate_inverse(bench.turned, np.array([0, 0, 1.0]))
    support = np.concatenate(((bench.body.mass + dm) * GRAVITY * up, np.cross(p, dm * GRAVITY * up)))
    pulled = support + bench.added("tether", [0, 0, -dm * GRAVITY, *p], x=x)
    hanging = bench.model().motion(pulled[None], np.zeros((1, 3)))
    carried = bench.model("payload", [dm, *p]).motion(support[None], np.zeros((1, 3)))
    for motion in (hanging, carried):
        np.testing.assert_allclose(motion.omega_dot_B, 0, atol=1e-12)
        np.testing.assert_allclose(motion.specific_force_B[0], GRAVITY * up, atol=1e-12)


def test_rope_pulls_down_or_aside_and_hardly_up(bench):
    """A load of a quarter of the vehicle's mass hangs on a rope; nothing like it pulls it up."""
    known = {p.name: p for p in find("tether").parameters(bench.vehicle)}
    load = 0.25 * bench.weight
    assert all(known[f"force_{a}"].low < -load and known[f"force_{a}"].high > load for a in "xy")
    assert known["force_z"].low < -load
    assert 0.0 < known["force_z"].high < 0.06 * bench.weight
