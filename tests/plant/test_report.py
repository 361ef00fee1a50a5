"""The reported wrench of many samples at once against one at a time, and against Newton and Euler about a com."""

import numpy as np
import pytest

from wrenchgap.plant.model import make_effect
from wrenchgap.plant.state import State
from wrenchgap.plant.wrench_model import WrenchModel

BODIES = {
    "its own": {},
    "another mass and place of it": {"mass": (0.3,), "com_offset": (0.01, -0.02, 0.015)},
    "another inertia": {"inertia": (0.01, -0.004, 0.006, 0.002, -0.003, 0.001)},
    "all, and an IMU that is turned": {
        "mass": (0.2,),
        "com_offset": (0.0, 0.01, 0.02),
        "imu_misalignment": (0.02, 0.01, -0.03),
    },
}


def wrenches(count, seed):
    """Random wrenches (N, 6) and a state of random rates."""
    rng = np.random.default_rng(seed)
    still, level = np.zeros((count, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (count, 1))
    omega = np.asfortranarray(rng.normal(scale=2.0, size=(count, 3)))  # as a thinned record has it: not in a row
    return rng.normal(scale=8.0, size=(count, 6)), State(np.arange(float(count)), still, level, still, omega)


def one_by_one(model, wrench, state, body=None):
    parts = [slice(k, k + 1) for k in range(len(wrench))]
    return np.concatenate([model.report(wrench[part], state.take(part), body) for part in parts])


@pytest.mark.parametrize("added", BODIES.values(), ids=BODIES)
def test_many_samples_at_once_are_the_same_as_one_at_a_time(hexarotor, added):
    model = WrenchModel(hexarotor, tuple(make_effect(hexarotor, name, values) for name, values in added.items()))
    wrench, state = wrenches(100, 3)
    np.testing.assert_allclose(model.report(wrench, state), one_by_one(model, wrench, state), rtol=1e-12, atol=1e-12)
    other = WrenchModel(hexarotor, (make_effect(hexarotor, "mass", (-0.4,)),)).body
    expected = one_by_one(model, wrench, state, other)
    np.testing.assert_allclose(model.report(wrench, state, other), expected, rtol=1e-12, atol=1e-12)


def test_a_believed_body_that_is_the_true_one_reports_the_wrench_about_its_centre_of_mass(hexarotor):
    """Whatever the rates: what goes in about O comes out, moved by the lever arm of the force."""
    model = WrenchModel(hexarotor)
    wrench, state = wrenches(100, 4)
    expected = wrench.copy()
    expected[:, 3:] -= np.cross(np.broadcast_to(model.body.com_B, (100, 3)), wrench[:, :3])
    np.testing.assert_allclose(model.report(wrench, state), expected, rtol=1e-11, atol=1e-11)
