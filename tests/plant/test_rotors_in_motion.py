"""Tilt angles, thrusts and hubs of many samples, against rigid-body kinematics and sums over rotors."""

import numpy as np
import pytest
from scipy.signal import lfilter

from wrenchgap.plant.actuation import rotor_wrench
from wrenchgap.plant.effects import find
from wrenchgap.plant.effects.effect import Context
from wrenchgap.plant.effects.lag import first_order
from wrenchgap.plant.state import Actuation, Posture, State

COUNT = 2048 + 37


@pytest.fixture
def flying(hexarotor):
    """Random rotors and a random motion of more samples than are worked on at a time."""
    rng = np.random.default_rng(7)
    arms, rotors = hexarotor.geometry()
    tilt = rng.uniform(-4.0, 4.0, (COUNT, len(arms)))
    act = Actuation(
        hexarotor, tilt, rng.uniform(-900, 900, (COUNT, len(rotors))), rng.normal(size=(COUNT, len(rotors)))
    )
    quat = rng.normal(size=(COUNT, 4))
    quat /= np.linalg.norm(quat, axis=1, keepdims=True)
    moving = rng.normal(size=(3, COUNT, 3))
    return act, Context(hexarotor, State(np.arange(float(COUNT)), moving[0], quat, moving[1], moving[2]))


@pytest.mark.parametrize("count", [1, COUNT])
def test_the_wrench_of_rotors_is_that_of_forces_at_hubs(flying, count):
    whole, _ = flying
    act = Actuation(whole.vehicle, whole.tilt[:count], whole.rotor_speed[:count], whole.thrust[:count])
    _, rotors = act.vehicle.geometry()
    found = rotor_wrench(act)
    force = act.thrust[..., None] * act.normal_B
    torque = np.cross(act.hub_B, force) - (rotors.spin * rotors.kappa)[:, None] * force
    np.testing.assert_allclose(found, np.hstack((force.sum(axis=1), torque.sum(axis=1))), atol=1e-12)


def test_hubs_move_as_points_of_a_rigid_body(flying):
    act, context = flying
    expected = context.velocity_through_air_B[:, None] + np.cross(context.state.omega_B[:, None], act.hub_B)
    np.testing.assert_allclose(context.hub_velocity_B(act), expected, atol=1e-14)


def test_rotor_drag_pulls_at_hubs_across_rotors_and_takes_power_from_the_motion(flying):
    act, context = flying
    found = find("rotor_drag").apply(act, np.zeros((COUNT, 6)), np.array([2e-4]), context)
    across = np.cross(act.normal_B, np.cross(context.hub_velocity_B(act), act.normal_B))
    force = -2e-4 * np.abs(act.rotor_speed)[..., None] * across
    expected = np.hstack((force.sum(axis=1), np.cross(act.hub_B, force).sum(axis=1)))
    np.testing.assert_allclose(found, expected, atol=1e-13)
    velocity, omega = context.velocity_through_air_B, context.state.omega_B
    assert np.all(np.sum(found[:, :3] * velocity + found[:, 3:] * omega, axis=1) < 0.0)


def test_a_lag_is_scipys_filter_and_remembers(flying):
    signal = np.asfortranarray(flying[0].rotor_speed)
    tau, dt = 0.03, 0.005
    a = np.exp(-dt / tau)
    q = (1.0 - a) * tau / dt
    start = (a * signal[0] + (q - a) * signal[0])[None]
    found, memory = first_order(signal, tau, dt, None)
    np.testing.assert_allclose(found, lfilter([1.0 - q, q - a], [1.0, -a], signal, axis=0, zi=start)[0], rtol=1e-14)
    later, _ = first_order(signal, tau, dt, memory)
    both, _ = first_order(np.vstack((signal, signal)), tau, dt, None)
    np.testing.assert_allclose(np.vstack((found, later)), both, rtol=1e-12)


def test_rows_of_a_transposed_or_sliced_array_are_the_same(flying):
    act, _ = flying
    sliced = np.repeat(act.tilt, 2, axis=1)[:, ::2]
    np.testing.assert_array_equal(Posture(act.vehicle, sliced).turn, act.posture.turn)
