"""Signs and frames of the actuation, stated as physics."""

import numpy as np
import pytest

from wrenchgap.plant.actuation import actuation, nominal_wrench, rotor_wrench
from wrenchgap.plant.state import Commands
from wrenchgap.plant.vehicle import GRAVITY


def commands(tilt, speed):
    tilt, speed = np.atleast_2d(tilt).astype(float), np.atleast_2d(speed).astype(float)
    return Commands(np.zeros((len(tilt), 6)), tilt, speed)


def test_hover_balances_weight(hexarotor):
    hover = np.sqrt(4.0 * GRAVITY / (12 * 7.2e-6))
    W = nominal_wrench(hexarotor, commands(np.zeros(6), np.full(12, hover)))
    np.testing.assert_allclose(W, [[0, 0, 4.0 * GRAVITY, 0, 0, 0]], atol=1e-9)


@pytest.mark.parametrize(
    ("tilt", "arms", "expected"),
    [
        # arm 0 points along x; thrust there is a torque about -y, nose up: x cross z = -y
        (0.0, [0], [0, 0, 2, 0, -0.6, 0]),
        # turning z by +90 deg about x gives -y; a force -y at +x is a torque about -z
        (np.pi / 2, [0], [0, -2, 0, 0, 0, -0.6]),
        # every arm then pushes along -(z cross outward), against counter-clockwise
        (0.2, range(6), [0, 0, 12 * np.cos(0.2), 0, 0, -3.6 * np.sin(0.2)]),
    ],
)
def test_tilt_is_right_handed_about_the_outward_axis(hexarotor, tilt, arms, expected):
    running = np.repeat(np.isin(np.arange(6), list(arms)), 2)
    W = nominal_wrench(hexarotor, commands(np.full(6, tilt), 500.0 * running))[0]
    np.testing.assert_allclose(W, 7.2e-6 * 500.0**2 * np.array(expected), atol=1e-12)


def test_drag_torque_turns_the_body_against_the_rotor(hexarotor):
    """A rotor that spins counter-clockwise (+1) pushes the body clockwise, along -n; equal pairs cancel."""
    W = nominal_wrench(hexarotor, commands(np.zeros((12, 6)), 500.0 * np.eye(12)))
    np.testing.assert_allclose(W[:, 5], -hexarotor.rotors.spin * 0.0165 * 7.2e-6 * 500.0**2)
    pair = np.random.default_rng(0).uniform(200, 900, 6)
    assert abs(nominal_wrench(hexarotor, commands(np.zeros(6), np.repeat(pair, 2)))[0, 5]) < 1e-12


def test_wrench_is_the_sum_of_forces_at_hubs(hexarotor):
    """The matrix form equals the elementary sum of r x F and drag over the rotors, hub offsets included."""
    rng = np.random.default_rng(1)
    act = actuation(hexarotor, commands(rng.uniform(-2, 2, (5, 6)), rng.uniform(0, 1200, (5, 12))))
    expected = np.zeros((5, 6))
    for k, r in np.ndindex(5, 12):
        g, alpha = (r // 2) * np.pi / 3, act.tilt[k, r // 2]
        n = np.array([np.sin(g) * np.sin(alpha), -np.cos(g) * np.sin(alpha), np.cos(alpha)])
        hub = 0.3 * np.array([np.cos(g), np.sin(g), 0.0]) + (0.04 if r % 2 == 0 else -0.04) * n
        force = act.thrust[k, r] * n
        expected[k, :3] += force
        expected[k, 3:] += np.cross(hub, force) - hexarotor.rotors.spin[r] * 0.0165 * force
    np.testing.assert_allclose(rotor_wrench(act), expected, atol=1e-10)
    assert act.hub_B.shape == (5, 12, 3)


def test_thrust_is_quadratic_and_reverses_with_speed(hexarotor):
    act = actuation(hexarotor, commands(np.zeros(6), [100.0, -100.0, *[0.0] * 10]))
    assert act.thrust[0, :2] == pytest.approx([0.072, -0.072])
