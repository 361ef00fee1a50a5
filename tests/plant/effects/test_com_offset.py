"""The centre of mass beside the origin."""

import numpy as np
import pytest

from wrenchgap.plant.wrench_model import forward_dynamics, measured_wrench


@pytest.mark.parametrize(("axis", "torque"), [("y", [-0.01, 0, 0]), ("x", [0, 0.01, 0])])
def test_to_the_left_rolls_left_and_forward_pitches_the_nose_down(bench, axis, torque):
    """At +y (left): the lift acts to its right and turns the left side down, about -x; nose down is about +y."""
    W = bench.model("com_offset", {axis: 0.01}).predict(bench.commands(), bench.state(), bench.dt)[0]
    np.testing.assert_allclose(W[3:], bench.weight * np.array(torque), atol=1e-9)


def test_accelerometer_away_from_the_centre_of_mass_feels_rotation(bench):
    """Spinning at w about z with the centre of mass at +x: O circles behind it and feels w^2 r towards +x."""
    motion = bench.model("com_offset", {"x": 0.02}).motion(np.zeros((1, 6)), np.array([[0.0, 0.0, 3.0]]))
    np.testing.assert_allclose(motion.specific_force_B, [[0.02 * 9.0, 0, 0]], atol=1e-12)


def test_forward_and_inverse_dynamics_agree_about_a_centre_of_mass_that_is_off(bench):
    rng = np.random.default_rng(5)
    body = bench.model("com_offset", [0.01, -0.02, 0.03]).body
    W, omega = rng.normal(size=(20, 6)), rng.normal(size=(20, 3))
    about_com = measured_wrench(body, forward_dynamics(body, W, omega))
    np.testing.assert_allclose(about_com[:, :3], W[:, :3], atol=1e-12)
    np.testing.assert_allclose(about_com[:, 3:] + np.cross(body.com_B, W[:, :3]), W[:, 3:], atol=1e-12)
