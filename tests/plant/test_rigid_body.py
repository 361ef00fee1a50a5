"""Newton and Euler on a body whose reference point is not its centre of mass, and the order of the integrator."""

import numpy as np
import pytest

from wrenchgap.flight import so3
from wrenchgap.plant.rigid_body import RigidBody, pack, unpack
from wrenchgap.plant.state import State
from wrenchgap.plant.vehicle import Body
from wrenchgap.plant.wrench_model import forward_dynamics

ASYMMETRIC = Body(
    3.0, np.array([[0.10, 0.01, -0.02], [0.01, 0.14, 0.015], [-0.02, 0.015, 0.2]]), np.array([0.05, -0.08, 0.03])
)


def start(omega, velocity=(0.0, 0.0, 0.0), quat=(1.0, 0.0, 0.0, 0.0)):
    rows = (np.array([row], dtype=float) for row in ((0.0, 0.0, 0.0), quat, velocity, omega))
    return pack(State(np.zeros(1), *rows))


def fly(body, y, wrench, dt, steps, gravity=0.0):
    rigid = RigidBody(body, gravity)
    for _ in range(steps):
        y = rigid.step(y, wrench, dt)
    return unpack(np.array([steps * dt]), y[None])


def top_attitude(quat, omega, transverse, axial, time):
    """Torque-free top: R(t) = exp(h_E t / J_t) R(0) exp(e_z (1 - J_a / J_t) omega_z t), h angular momentum."""
    h_E = so3.rotate(quat, np.array([transverse, transverse, axial]) * omega)
    spin = np.array([0.0, 0.0, (1.0 - axial / transverse) * omega[2] * time])
    return so3.multiply(so3.exp(h_E * time / transverse), so3.multiply(quat, so3.exp(spin)))


def test_the_integrator_is_of_fourth_order_on_the_torque_free_symmetric_top():
    body = Body(1.0, np.diag([0.1, 0.1, 0.25]), np.zeros(3))
    quat, omega = so3.exp(np.array([0.3, -0.5, 0.9])), np.array([2.0, 1.0, 3.0])
    exact = top_attitude(quat, omega, 0.1, 0.25, 1.0)
    ends = [fly(body, start(omega, quat=quat), np.zeros(6), 1.0 / n, n).quat_EB[0] for n in (20, 40, 80, 160)]
    errors = np.array([np.linalg.norm(so3.log(so3.multiply(so3.conjugate(exact), end))) for end in ends])
    assert errors[0] < 1e-2
    np.testing.assert_allclose(np.log2(errors[1:-1] / errors[2:]), 4.0, atol=0.2)


def test_a_free_asymmetric_body_keeps_momentum_and_energy():
    omega, velocity = np.array([1.5, -2.0, 2.5]), np.array([0.4, 0.1, -0.3])

    def invariants(state):
        R = so3.matrix(state.quat_EB[0])
        w, c = state.omega_B[0], ASYMMETRIC.com_B
        v_com = state.velocity_E[0] + R @ np.cross(w, c)
        position_com = state.position_E[0] + R @ c
        h = R @ (ASYMMETRIC.inertia @ w) + ASYMMETRIC.mass * np.cross(position_com, v_com)
        energy = 0.5 * ASYMMETRIC.mass * v_com @ v_com + 0.5 * w @ ASYMMETRIC.inertia @ w
        return np.concatenate((ASYMMETRIC.mass * v_com, h, [energy]))

    y = start(omega, velocity)
    end = fly(ASYMMETRIC, y, np.zeros(6), 2e-3, 2500)
    np.testing.assert_allclose(invariants(end), invariants(unpack(np.zeros(1), y[None])), rtol=0, atol=1e-7)
    assert np.linalg.norm(end.omega_B[0] - omega) > 0.1  # it did tumble


def test_the_quaternion_stays_a_rotation():
    end = fly(ASYMMETRIC, start([8.0, -5.0, 3.0]), np.array([1.0, 2.0, 3.0, 0.1, -0.2, 0.3]), 5e-3, 2000)
    R = so3.matrix(end.quat_EB[0])
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-14)


def test_the_gyroscopic_torque_does_no_work():
    """Without a wrench, d/dt (1/2 omega J omega) = omega . J domega = -omega . (omega x J omega) = 0."""
    rng = np.random.default_rng(1)
    for omega in rng.normal(size=(20, 3)) * 5.0:
        rates = RigidBody(ASYMMETRIC).derivative(start(omega), np.zeros(6))
        assert abs(omega @ ASYMMETRIC.inertia @ rates[10:]) < 1e-12
        assert np.linalg.norm(rates[10:]) > 1e-3


def test_a_force_through_the_centre_of_mass_does_not_turn_the_body():
    force = np.array([1.0, -2.0, 4.0])
    through = np.concatenate((force, np.cross(ASYMMETRIC.com_B, force)))
    rates = RigidBody(ASYMMETRIC, 0.0).derivative(start([0.0, 0.0, 0.0]), through)
    np.testing.assert_allclose(rates[10:], 0.0, atol=1e-14)
    np.testing.assert_allclose(rates[7:10], force / ASYMMETRIC.mass, atol=1e-14)


def test_in_free_fall_the_centre_of_mass_falls_and_the_rate_is_untouched_by_gravity():
    y = start([0.5, 1.0, -0.7])
    falling, floating = (fly(ASYMMETRIC, y, np.zeros(6), 5e-3, 200, gravity=g) for g in (9.81, 0.0))
    np.testing.assert_allclose(falling.omega_B, floating.omega_B, atol=1e-12)
    np.testing.assert_allclose(falling.position_E - floating.position_E, [[0.0, 0.0, -0.5 * 9.81]], atol=1e-9)


def test_the_acceleration_is_the_second_derivative_of_the_path_and_agrees_with_the_imu_equation():
    """Central differences of the integrated path against R f_O + g, f_O from the N-sample forward dynamics."""
    rng = np.random.default_rng(3)
    omega, wrench = rng.normal(size=3) * 2.0, rng.normal(size=6)
    quat, h = so3.exp(rng.normal(size=3)), 1e-3
    body, y = RigidBody(ASYMMETRIC, 9.81), start(omega, quat=quat)
    after, before = (unpack(np.array([dt]), body.step(y, wrench, dt)[None]) for dt in (h, -h))
    motion = forward_dynamics(ASYMMETRIC, wrench[None], omega[None])
    expected = so3.rotate(quat, motion.specific_force_B[0]) - np.array([0.0, 0.0, 9.81])
    second = (after.position_E[0] + before.position_E[0]) / h**2
    np.testing.assert_allclose(second, expected, atol=1e-4)
    np.testing.assert_allclose((after.omega_B - before.omega_B)[0] / (2 * h), motion.omega_dot_B[0], atol=1e-3)


@pytest.mark.parametrize("yaw", [0.7, -2.5])
def test_turning_the_inertial_frame_about_gravity_changes_nothing(yaw):
    turn, omega = so3.exp(np.array([0.0, 0.0, yaw])), [0.3, 0.2, 0.1]
    quat, velocity = so3.exp(np.array([0.4, -0.2, 0.1])), np.array([1.0, -0.5, 0.2])
    starts = start(omega, velocity, quat), start(omega, so3.rotate(turn, velocity), so3.multiply(turn, quat))
    wrench = np.array([3.0, -1.0, 30.0, 0.1, 0.2, -0.1])
    end, turned = (fly(ASYMMETRIC, y, wrench, 1e-2, 100, 9.81) for y in starts)
    np.testing.assert_allclose(turned.position_E[0], so3.rotate(turn, end.position_E[0]), atol=1e-12)
    np.testing.assert_allclose(turned.quat_EB[0], so3.multiply(turn, end.quat_EB[0]), atol=1e-12)
    np.testing.assert_allclose(turned.omega_B, end.omega_B, atol=1e-12)
