"""A payload is a point mass: mass, centre of mass and inertia together."""

import numpy as np
import pytest

from wrenchgap.flight.flight import GRAVITY
from wrenchgap.plant.effects import find
from wrenchgap.plant.vehicle import Body


def cloud(bench):
    """Six point masses with the vehicle's mass, centre of mass and (diagonal) inertia: positions, masses."""
    xx, yy, zz = np.diag(bench.body.inertia)
    squared = 3 / bench.body.mass * np.array([yy + zz - xx, xx + zz - yy, xx + yy - zz]) / 2
    return np.vstack((np.diag(np.sqrt(squared)), -np.diag(np.sqrt(squared)))), np.full(6, bench.body.mass / 6)


def test_is_one_more_point_in_a_cloud_of_points(bench):
    points, masses = cloud(bench)
    p, dm = np.array([0.12, -0.2, -0.15]), 0.35
    points, masses = np.vstack((points, p)), np.append(masses, dm)
    centre = masses @ points / masses.sum()
    inertia = sum(w * (r @ r * np.eye(3) - np.outer(r, r)) for w, r in zip(masses, points - centre, strict=True))
    body = bench.model("payload", [dm, *p]).body
    assert body.mass == pytest.approx(bench.body.mass + dm)
    np.testing.assert_allclose(body.com_B, centre, atol=1e-12)
    np.testing.assert_allclose(body.inertia, inertia, atol=1e-12)


def test_on_a_vehicle_whose_centre_of_mass_is_off(bench):
    """Two bodies, each about its own centre, seen from a third place: what parallel axes say of O holds for both."""
    c, p, dm = np.array([0.02, 0.01, -0.03]), np.array([0.12, -0.2, -0.15]), 0.35
    alone = Body(bench.body.mass, bench.body.inertia, c)
    loaded = find("payload").apply(alone, np.array([dm, *p]))

    def about_O(inertia, mass, r):
        return inertia + mass * (r @ r * np.eye(3) - np.outer(r, r))

    whole = about_O(loaded.inertia, loaded.mass, loaded.com_B)
    np.testing.assert_allclose(whole, about_O(bench.body.inertia, bench.body.mass, c) + about_O(0, dm, p), atol=1e-12)


def test_hangs_still_when_thrust_carries_it_and_torque_holds_it(bench):
    """Statics about O: the torque that holds a weight at p is p x (upward force dm g)."""
    p, dm = np.array([0.12, -0.2, -0.15]), 0.35
    W = np.concatenate(([0, 0, (bench.body.mass + dm) * GRAVITY], np.cross(p, [0, 0, dm * GRAVITY])))
    motion = bench.model("payload", [dm, *p]).motion(W[None], np.zeros((1, 3)))
    np.testing.assert_allclose(motion.omega_dot_B, 0, atol=1e-12)
    np.testing.assert_allclose(motion.specific_force_B, [[0, 0, GRAVITY]], atol=1e-12)
