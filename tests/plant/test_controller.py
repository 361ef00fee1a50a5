"""Signs and identities of the control law."""

from dataclasses import replace

import numpy as np
import pytest

from wrenchgap.flight import so3
from wrenchgap.flight.errors import ModelError
from wrenchgap.plant.controller import (
    ControllerGains,
    attitude_error,
    control_law,
    integral_series,
    next_integral,
    pushes_along_z_only,
)
from wrenchgap.plant.state import State
from wrenchgap.plant.trajectory import Reference
from wrenchgap.plant.vehicle import GRAVITY, Arms, Body, Vehicle

BODY = Body(4.0, np.array([[0.10, 0.004, 0.0], [0.004, 0.11, -0.003], [0.0, -0.003, 0.19]]), np.zeros(3))
GAINS = ControllerGains()


def state(n=1, **parts):
    """At rest in the origin but for `parts`."""
    level, zeros = np.tile([1.0, 0.0, 0.0, 0.0], (n, 1)), np.zeros((n, 3))
    return replace(State(np.zeros(n), zeros, level, zeros, zeros), **parts)


def reference(n=1, **parts):
    level, zeros = np.tile([1.0, 0.0, 0.0, 0.0], (n, 1)), np.zeros((n, 3))
    return replace(Reference(np.zeros(n), zeros, zeros, zeros, level, zeros, zeros), **parts)


def wrench_of(known, asked, integral=None, gains=GAINS):
    """Of the control law, (N, 6)."""
    return control_law(gains, BODY, known, asked, np.zeros((len(known.time), 3)) if integral is None else integral)[0]


def vehicle(normals, tilts):
    """With arms of these thrust directions at zero tilt."""
    axes, ones = np.eye(3)[: len(normals)], np.ones(len(normals))
    arms = Arms(axes, axes, np.array(normals, float), np.array(tilts), -ones, ones, ones)
    return Vehicle("test", BODY, arms, None, np.zeros(3))


@pytest.mark.parametrize("angle", [1e-4, np.radians(40.0)])
def test_the_error_is_the_sine_of_the_angle_about_its_axis(angle):
    """A small rotation of the body is the error itself."""
    axis, quat_ED = np.array([0.0, 0.6, 0.8]), so3.exp(np.array([0.5, 1.0, -0.3]))
    quat_EB = so3.multiply(quat_ED, so3.exp(angle * axis))
    np.testing.assert_allclose(attitude_error(quat_EB, quat_ED), np.sin(angle) * axis, atol=1e-14)


def test_the_rate_error_is_the_rate_of_the_attitude_error():
    """Small e_R: its finite difference equals omega_B - R_EB^T R_ED omega_D, found from the torque of a unit body."""
    rng = np.random.default_rng(0)
    omega_B, omega_D, h = rng.normal(size=3), rng.normal(size=3), 1e-5
    quat_ED = so3.exp(rng.normal(size=3))

    def error(t):
        body = so3.multiply(quat_ED, so3.exp(omega_B * t))
        return attitude_error(body, so3.multiply(quat_ED, so3.exp(omega_D * t)))

    rate = (error(h) - error(-h)) / (2 * h)
    np.testing.assert_allclose(rate, omega_B - omega_D, atol=1e-8)


def test_hovering_asks_for_the_weight_and_no_torque():
    quat = so3.exp(np.array([[0.0, np.radians(60.0), 0.0]]))
    wrench = wrench_of(state(quat_EB=quat), reference(quat_ED=quat))[0]
    np.testing.assert_allclose(so3.rotate(quat[0], wrench[:3]), [0.0, 0.0, 4.0 * GRAVITY], atol=1e-12)
    np.testing.assert_allclose(wrench[3:], 0.0, atol=1e-14)


@pytest.mark.parametrize("k", range(3))
def test_every_error_is_answered_against_its_direction(k):
    axis = np.eye(3)[[k]]
    assert wrench_of(state(position_E=axis), reference())[0, k] < 4.0 * GRAVITY * (k == 2)
    assert wrench_of(state(quat_EB=so3.exp(0.1 * axis)), reference())[0, 3 + k] < 0
    assert wrench_of(state(), reference(), axis)[0, 3 + k] < 0


def test_on_the_reference_the_torque_is_the_inverse_dynamics():
    """Perfect tracking of a turning reference: omega_dot_B = omega_dot_D, so M = J omega_dot + omega x J omega."""
    omega, omega_dot = np.array([[1.0, -2.0, 0.5]]), np.array([[0.3, 0.1, -0.4]])
    quat = so3.exp(np.array([[0.2, 0.4, -0.1]]))
    asked = reference(quat_ED=quat, omega_D=omega, omega_dot_D=omega_dot)
    expected = BODY.inertia @ omega_dot[0] + np.cross(omega[0], BODY.inertia @ omega[0])
    np.testing.assert_allclose(wrench_of(state(quat_EB=quat, omega_B=omega), asked)[0, 3:], expected, atol=1e-14)


def test_the_transport_term_makes_the_rate_error_a_second_order_system():
    """d/dt (R_EB^T R_ED omega_D) = R_EB^T R_ED omega_dot_D - omega_B x (R_EB^T R_ED omega_D): by finite differences."""
    rng = np.random.default_rng(5)
    omega_B, omega_D, h = rng.normal(size=3), rng.normal(size=3), 1e-5
    quat_EB, quat_ED = so3.exp(rng.normal(size=3)), so3.exp(rng.normal(size=3))

    def seen(t):
        body, ref = so3.multiply(quat_EB, so3.exp(omega_B * t)), so3.multiply(quat_ED, so3.exp(omega_D * t))
        return so3.rotate_inverse(body, so3.rotate(ref, omega_D))

    rate = (seen(h) - seen(-h)) / (2 * h)  # omega_dot_D = 0
    known = state(quat_EB=quat_EB[None], omega_B=omega_B[None])
    asked = reference(quat_ED=quat_ED[None], omega_D=omega_D[None])
    with_term, without = (wrench_of(known, asked, gains=ControllerGains(transport=w))[0, 3:] for w in (1.0, 0.0))
    np.testing.assert_allclose(np.linalg.solve(BODY.inertia, with_term - without), rate, atol=1e-8)


def test_turning_the_inertial_frame_about_gravity_leaves_the_wrench():
    rng = np.random.default_rng(2)
    p, v, pd, vd, ad, omega, omega_D, omega_dot_D, *turns = rng.normal(size=(10, 5, 3))
    quat_EB, quat_ED = (so3.exp(turn) for turn in turns)

    def wrench(yaw):
        q = np.tile(so3.exp(np.array([0.0, 0.0, yaw])), (5, 1))
        known = State(np.zeros(5), so3.rotate(q, p), so3.multiply(q, quat_EB), so3.rotate(q, v), omega)
        wanted = (so3.rotate(q, x) for x in (pd, vd, ad))
        return wrench_of(known, Reference(np.zeros(5), *wanted, so3.multiply(q, quat_ED), omega_D, omega_dot_D))

    np.testing.assert_allclose(wrench(1.1), wrench(0.0), atol=1e-11)


def test_the_integral_is_clamped_and_reset():
    gains, integral = ControllerGains(integral_limit=0.05), np.zeros(3)
    error = control_law(
        gains, BODY, state(quat_EB=so3.exp(np.array([[0.1, 0.0, 0.0]]))), reference(), np.zeros((1, 3))
    )[1]
    np.testing.assert_allclose(next_integral(gains, integral, error[0], 0.005), [np.sin(0.1) * 0.005, 0.0, 0.0])
    for _ in range(200):
        integral = next_integral(gains, integral, error[0], 0.005)
    np.testing.assert_allclose(integral, [0.05, 0.0, 0.0], atol=1e-15)


def test_a_recorded_error_gives_back_the_integral_that_the_loop_had():
    gains = ControllerGains(integral_limit=0.004)
    quats = so3.exp(0.2 * np.random.default_rng(4).normal(size=(60, 3)))
    wrenches, now = np.zeros((60, 6)), np.zeros(3)
    for k, q in enumerate(quats):
        wrench, error = control_law(gains, BODY, state(quat_EB=q[None]), reference(), now[None])
        wrenches[k], now = wrench[0], next_integral(gains, now, error[0], 0.005)
    known, asked = state(60, quat_EB=quats), reference(60)
    integral = integral_series(gains, control_law(gains, BODY, known, asked, np.zeros((60, 3)))[1], 0.005)
    assert np.any(np.abs(integral) == 0.004)
    np.testing.assert_allclose(wrench_of(known, asked, integral, gains), wrenches, atol=1e-13)


def test_a_vehicle_that_pushes_along_z_leans_towards_where_it_must_go():
    fixed = vehicle([[0, 0, 1], [0, 0, 1]], [False, False])
    assert pushes_along_z_only(fixed)
    behind = state(position_E=np.array([[-1.0, 0.0, 0.0]]))
    wrench = control_law(GAINS, fixed.body, behind, reference(), np.zeros((1, 3)), along_z=True)[0][0]
    np.testing.assert_allclose(wrench[:2], 0.0)
    omega_dot = np.linalg.solve(BODY.inertia, wrench[3:])
    assert omega_dot[1] > 0  # wants to go to +x: leans there, which is a positive rotation about y
    np.testing.assert_allclose(omega_dot[[0, 2]], 0.0, atol=1e-12)


@pytest.mark.parametrize(("normals", "tilts"), [([[0, 0, 1]], [True]), ([[0, 0, 1], [0, 0.6, 0.8]], [False, False])])
def test_a_vehicle_with_other_thrust_directions_keeps_its_attitude_reference(normals, tilts):
    assert not pushes_along_z_only(vehicle(normals, tilts))


@pytest.mark.parametrize(
    "bad", [{"omega_position": 0.0}, {"zeta_attitude": (1.0, -1.0, 1.0)}, {"integral": float("nan")}]
)
def test_senseless_gains_are_named(bad):
    with pytest.raises(ModelError, match=f"controller.{next(iter(bad))}"):
        ControllerGains(**bad)
