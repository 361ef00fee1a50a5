"""What a model predicts that an IMU reports, against Newton and Euler."""

from dataclasses import replace

import numpy as np
import pytest

from wrenchgap.plant.model import make_effect
from wrenchgap.plant.state import State
from wrenchgap.plant.wrench_model import WrenchModel, forward_dynamics

BODIES = {
    "its own": {},
    "another mass and place of it": {"mass": (0.3,), "com_offset": (0.01, -0.02, 0.015)},
    "another inertia": {"inertia": (0.01, -0.004, 0.006, 0.002, -0.003, 0.001)},
}


def wrenches(count, seed):
    """Random wrenches (N, 6) and a state of random rates."""
    rng = np.random.default_rng(seed)
    still, level = np.zeros((count, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (count, 1))
    omega = rng.normal(scale=2.0, size=(count, 3))
    return rng.normal(scale=8.0, size=(count, 6)), State(np.arange(float(count)), still, level, still, omega)


def test_a_believed_body_that_is_the_true_one_reports_the_wrench_about_its_centre_of_mass(hexarotor):
    """Whatever the rates: what goes in about O comes out, moved by the lever arm of the force."""
    model = WrenchModel(hexarotor)
    wrench, state = wrenches(50, 4)
    expected = wrench.copy()
    expected[:, 3:] -= np.cross(np.broadcast_to(model.body.com_B, (50, 3)), wrench[:, :3])
    np.testing.assert_allclose(model.report(wrench, state), expected, rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize("added", BODIES.values(), ids=BODIES)
def test_momentum_of_the_body_changes_by_the_wrench(hexarotor, added):
    """Euler about the centre of mass and Newton for it, from the accelerations of O, sample by sample."""
    model = WrenchModel(hexarotor, tuple(make_effect(hexarotor, name, values) for name, values in added.items()))
    body, (wrench, state) = model.body, wrenches(20, 3)
    motion = forward_dynamics(body, wrench, state.omega_B)
    for w, omega, turned, felt in zip(wrench, state.omega_B, motion.omega_dot_B, motion.specific_force_B, strict=True):
        spun = body.inertia @ turned + np.cross(omega, body.inertia @ omega)
        np.testing.assert_allclose(spun, w[3:] - np.cross(body.com_B, w[:3]), atol=1e-11)
        of_com = felt + np.cross(turned, body.com_B) + np.cross(omega, np.cross(omega, body.com_B))
        np.testing.assert_allclose(body.mass * of_com, w[:3], atol=1e-11)


def test_a_heavier_body_is_felt_as_less_force(hexarotor):
    """Believed m, true m + dm, no rotation and forces through the centre of mass: an IMU reports m / (m + dm) of F."""
    model = WrenchModel(hexarotor, (make_effect(hexarotor, "mass", (0.5,)),))
    mass = hexarotor.body.mass
    wrench, state = wrenches(20, 5)
    wrench[:, 3:] = np.cross(model.body.com_B, wrench[:, :3])
    reported = model.report(wrench, replace(state, omega_B=np.zeros((20, 3))))
    np.testing.assert_allclose(reported[:, :3], mass / (mass + 0.5) * wrench[:, :3], atol=1e-12)
    np.testing.assert_allclose(reported[:, 3:], 0.0, atol=1e-12)
