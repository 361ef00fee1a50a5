"""Closed-loop flights: balance, response, offsets, alignment of what is logged."""

from dataclasses import replace

import numpy as np
import pytest

from wrenchgap.flight import so3
from wrenchgap.flight.errors import UsageError
from wrenchgap.plant.controller import ControllerGains
from wrenchgap.plant.model import Model, make_effect
from wrenchgap.plant.sensors import SensorNoise
from wrenchgap.plant.simulate import simulate
from wrenchgap.plant.state import Motion, State
from wrenchgap.plant.trajectory import Hover, Tilts, named
from wrenchgap.plant.vehicle import GRAVITY, Arms, Body, Rotors, Vehicle
from wrenchgap.plant.wrench_model import measured_wrench

J = np.array([0.10, 0.11, 0.19])
MASS = 4.0


def hexarotor(tilts=True, rate=1e3):
    """Six coaxial arms in a star."""
    azimuth = np.radians(60.0 * np.arange(6))
    outward = np.stack((np.cos(azimuth), np.sin(azimuth), np.zeros(6)), axis=-1)
    six, twelve = np.ones(6), np.ones(12)
    arms = Arms(
        0.3 * outward, outward, np.tile([0.0, 0.0, 1.0], (6, 1)), np.full(6, tilts), -1e3 * six, 1e3 * six, rate * six
    )
    spin = np.array([1.0, -1.0, -1.0, 1.0] * 3)
    if not tilts:  # no coaxial pairs: upper and lower alike, alternating from arm to arm, so that yaw is possible
        spin = np.repeat([1.0, -1.0] * 3, 2)
    rotors = Rotors(
        np.repeat(np.arange(6), 2), np.tile([0.035, -0.035], 6), spin, 7.2e-6 * twelve, 0.0165 * twelve,
        0.115 * twelve, 0.0 * twelve, 1250.0 * twelve,
    )  # fmt: skip
    return Vehicle("hexarotor", Body(MASS, np.diag(J), np.zeros(3)), arms, rotors, np.zeros(3))


def model(*effects, gains=None, sensors=None, vehicle=None):
    vehicle = hexarotor() if vehicle is None else vehicle
    plain = Model(vehicle, controller=gains or ControllerGains(), sensors=sensors or SensorNoise())
    return plain.with_effects([make_effect(vehicle, name, values) for name, values in effects])


def fast(rate=1000.0, **gains):
    """A nominal setting without noise, at a high rate."""
    silent = replace(SensorNoise().silent, imu_rate_hz=rate, pose_rate_hz=rate)
    return {"gains": ControllerGains(rate_hz=rate, integral=0.0, **gains), "sensors": silent}


def rng(seed=0):
    return np.random.default_rng(seed)


def test_hover_balances_the_weight():
    flight = simulate(model(**fast(200.0)), None, Hover(2.0), rng=rng())
    np.testing.assert_allclose(flight.commanded.wrench_B, np.tile([0, 0, MASS * GRAVITY, 0, 0, 0], (400, 1)), atol=1e-9)
    np.testing.assert_allclose(flight.odometry.position_E, np.tile([0.0, 0.0, 1.6], (400, 1)), atol=1e-9)
    np.testing.assert_allclose(flight.imu.specific_force_B, np.tile([0.0, 0.0, GRAVITY], (400, 1)), atol=1e-9)
    thrust = 7.2e-6 * flight.actuators.rotor_speed**2
    np.testing.assert_allclose(thrust.sum(axis=1), MASS * GRAVITY)
    assert flight.notes == ()


def second_order(t, zeta, omega, x0):
    """x'' + 2 zeta omega x' + omega^2 x = 0 from x0 at rest."""
    roots = np.roots([1.0, 2.0 * zeta * omega, omega**2]).astype(complex)
    a, b = roots
    return np.real(x0 * (a * np.exp(b * t) - b * np.exp(a * t)) / (a - b))


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_an_attitude_error_dies_as_the_damped_second_order_system(axis):
    offset = 0.02 * np.eye(3)[axis]
    quat = so3.exp(offset)[None]
    zeros = np.zeros((1, 3))
    initial = State(np.zeros(1), np.array([[0.0, 0.0, 1.6]]), quat, zeros, zeros)
    flight = simulate(
        model(**fast()), None, Hover(2.0), rng=rng(), initial=initial, physics_rate=1000.0, feedback="true"
    )
    angle = so3.log(flight.odometry.quat_EB)[:, axis]
    expected = second_order(flight.odometry.time, (1.3, 1.3, 0.74)[axis], 3.5, 0.02)
    np.testing.assert_allclose(angle, expected, atol=0.02 * 0.005)


def test_a_position_error_dies_as_the_damped_second_order_system():
    zeros = np.zeros((1, 3))
    initial = State(np.zeros(1), np.array([[0.1, -0.05, 1.7]]), np.array([[1.0, 0, 0, 0]]), zeros, zeros)
    flight = simulate(model(**fast()), None, Hover(2.0), rng=rng(), initial=initial, physics_rate=1000.0)
    expected = second_order(flight.odometry.time[:, None], 0.707, 3.5, np.array([0.1, -0.05, 0.1]))
    np.testing.assert_allclose(flight.odometry.position_E - [0.0, 0.0, 1.6], expected, atol=5e-4)


def test_a_hidden_centre_of_mass_tilts_the_vehicle_by_the_torque_over_the_stiffness():
    """At rest M_cmd = c x F with M_cmd = -J w^2 e_R and F = R_EB^T (0, 0, m g)."""
    c = np.array([0.0012, -0.0007, 0.0])
    flight = simulate(
        model(("com_offset", {"x": c[0], "y": c[1], "z": 0.0}), **fast(200.0)), None, Hover(8.0), rng=rng()
    )
    quat = flight.odometry.quat_EB[-1]
    force = so3.rotate_inverse(quat, np.array([0.0, 0.0, MASS * GRAVITY]))
    error = so3.vee(so3.matrix(quat))
    np.testing.assert_allclose(error, -np.cross(c, force) / (J * 3.5**2), atol=1e-6)
    assert error[0] > 0.015  # -c_y m g / (J_x w^2) = 0.0224 to first order


def test_the_integral_removes_that_tilt():
    hidden = ("com_offset", {"x": 0.001, "y": 0.0, "z": 0.0})
    setting = fast(200.0)
    setting["gains"] = ControllerGains(integral=1.0, integral_limit=1.0)
    flight = simulate(model(hidden, **setting), None, Hover(10.0), rng=rng())
    error = np.abs(so3.vee(so3.matrix(flight.odometry.quat_EB)))
    assert error[:1000].max() > 0.01
    assert error[-1].max() < 5e-4


def test_without_effects_the_imu_measures_the_command_without_any_lag():
    """Commands are held from their stamp on; their mean around a stamp is what the IMU there must report."""
    trajectory = named("multi_axis", 8.0, 1.0)
    flight = simulate(model(**fast(200.0)), None, trajectory, rng=rng())
    body = hexarotor().body
    held = flight.commanded.wrench_B
    around = 0.5 * (held[1:-1] + held[:-2])
    omega = flight.imu.omega_B
    omega_dot = (omega[2:] - omega[:-2]) * 100.0
    measured = measured_wrench(body, Motion(omega[1:-1], omega_dot, flight.imu.specific_force_B[1:-1]))
    error = np.abs(measured - around)
    assert error[:, :3].max() < 0.02  # N of 60
    assert error[:, 3:].max() < 0.01  # Nm of 0.7
    late = np.abs(measured - held[1:-1])  # a half-sample shift would be larger by far
    assert late[:, 3:].max() > 3.0 * error[:, 3:].max()


def test_halving_the_physics_step_hardly_changes_a_flight():
    effects = (("servo_lag", {"tau": 0.05}), ("com_offset", {"x": 0.003, "y": 0.0, "z": 0.0}))
    trajectory = named("multi_axis", 6.0, 1.0)
    flights = [
        simulate(model(*effects, **fast(200.0)), None, trajectory, rng=rng(), physics_rate=r) for r in (400.0, 800.0)
    ]
    apart = so3.log(so3.multiply(so3.conjugate(flights[0].odometry.quat_EB), flights[1].odometry.quat_EB))
    assert np.degrees(np.abs(apart).max()) < 0.2


def test_seeds_repeat_and_noise_has_its_size():
    trajectory = named("pitch", 2.0, 1.0)
    one, same, other = (simulate(model(), None, trajectory, rng=rng(s)) for s in (3, 3, 4))
    assert one.content_hash == same.content_hash != other.content_hash
    np.testing.assert_array_equal(one.imu.omega_B, same.imu.omega_B)
    assert len(one.imu.time) == 400
    assert len(one.odometry.time) == 200
    jitter = np.diff(one.imu.omega_B - other.imu.omega_B, axis=0)
    assert jitter.std() == pytest.approx(2.4e-4 * 10.0 * 2.0, rel=0.25)


def test_a_disturbance_pushes_and_the_controller_leans_against_it():
    push = np.array([2.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    flight = simulate(model(**fast(200.0)), None, Hover(6.0), rng=rng(), disturbance=lambda t: push)
    np.testing.assert_allclose(flight.odometry.position_E[-1, 0], 2.0 / (MASS * 3.5**2), rtol=1e-3)
    np.testing.assert_allclose(flight.commanded.wrench_B[-1, 0], -2.0, rtol=1e-3)


def test_a_compensator_that_knows_the_offset_removes_the_error():
    class Knows:
        def step(self, wrench_des, state):
            self.wrench_cmd = wrench_des + np.array([0.0, 0.0, 0.0, 0.0, -0.04, 0.0])
            return self

    torque = ("constant_wrench", [0.0, 0.0, 0.0, 0.0, 0.04, 0.0])
    plain = simulate(model(torque, **fast(200.0)), None, Hover(4.0), rng=rng())
    helped = simulate(model(torque, **fast(200.0)), None, Hover(4.0), rng=rng(), compensator=Knows())
    assert so3.log(plain.odometry.quat_EB[-1])[1] == pytest.approx(0.04 / (J[1] * 3.5**2), rel=1e-2)
    np.testing.assert_allclose(helped.odometry.quat_EB[-1], [1, 0, 0, 0], atol=1e-9)
    np.testing.assert_allclose((helped.commanded.wrench_B - helped.desired.wrench_B)[:, 4], -0.04, atol=1e-12)


def test_turning_the_inertial_frame_about_gravity_turns_the_flight():
    yaw = so3.exp(np.array([0.0, 0.0, 2.0]))
    effects = (("com_offset", {"x": 0.003, "y": -0.002, "z": 0.001}), ("servo_lag", {"tau": 0.03}))
    tilts = Tilts(4.0, np.array([[0.0, 1.0, 0.0]]), np.radians(40.0), acceleration=3.0, period=4.0)

    class Turned(Tilts):
        def at(self, time):
            r = super().at(time)
            return replace(
                r,
                position_E=so3.rotate(yaw, r.position_E),
                quat_ED=so3.multiply(np.tile(yaw, (len(time), 1)), r.quat_ED),
            )

    turned = Turned(tilts.duration, tilts.axes, tilts.angle, tilts.acceleration, tilts.period)
    plain, other = (simulate(model(*effects, **fast(200.0)), None, t, rng=rng()) for t in (tilts, turned))
    np.testing.assert_allclose(other.imu.omega_B, plain.imu.omega_B, atol=1e-8)
    np.testing.assert_allclose(other.odometry.position_E, so3.rotate(yaw, plain.odometry.position_E), atol=1e-8)
    np.testing.assert_allclose(other.commanded.wrench_B, plain.commanded.wrench_B, atol=1e-7)


def test_a_lost_vehicle_is_reported_and_its_flight_ends_there():
    flight = simulate(model(("constant_wrench", [0.0, 0.0, 0.0, 3.0, 0.0, 0.0])), None, Hover(5.0), rng=rng())
    assert "control was lost" in flight.notes[0]
    assert flight.commanded.time[-1] < 4.0
    assert len(flight.commanded.time) == len(flight.reference.time) == len(flight.actuators.time)


def test_saturation_is_counted_in_the_notes():
    slow = hexarotor(rate=0.2)
    flight = simulate(model(vehicle=slow), None, named("multi_axis", 7.0, 1.0), rng=rng())
    assert any(note.startswith("tilt rate was limited in") for note in flight.notes)


def test_fixed_rotors_fly_a_circle_by_leaning():
    vehicle = hexarotor(tilts=False)
    gains = ControllerGains(omega_position=2.0, omega_attitude=(12.0, 12.0, 4.0), zeta_attitude=(0.8, 0.8, 0.8))
    flight = simulate(model(vehicle=vehicle, gains=gains), None, named("circle", 9.0), rng=rng(), physics_rate=400.0)
    reference = np.stack(
        [np.interp(flight.odometry.time, flight.reference.time, c) for c in flight.reference.position_E.T]
    )
    assert np.linalg.norm(flight.odometry.position_E - reference.T, axis=1).max() < 0.1
    assert np.degrees(so3.tilt_angle(flight.odometry.quat_EB)).max() > 5.0
    np.testing.assert_allclose(flight.commanded.wrench_B[:, :2], 0.0)


def test_a_vehicle_of_which_only_the_wrench_is_known_flies_too():
    vehicle = Vehicle(
        "box", Body(MASS, np.diag(J), np.array([0.002, 0.0, 0.0])), None, None, np.array([0.02, 0.0, 0.01])
    )
    flight = simulate(
        model(vehicle=vehicle, **fast(200.0)), None, named("figure8", 10.0), rng=rng(), voltage=lambda t: 24 - t
    )
    assert flight.actuators is None
    np.testing.assert_allclose(flight.battery.voltage, 24.0 - flight.battery.time)
    error = so3.multiply(so3.conjugate(flight.reference.quat_ED), flight.odometry.quat_EB)
    assert np.degrees(np.abs(so3.log(error))).max() < 2.0


def test_progress_is_told_and_ends_at_one():
    heard = []
    simulate(model(), None, Hover(2.0), rng=rng(), progress=heard.append)
    assert heard == sorted(heard)
    assert heard[-1] == 1.0
    assert len(heard) > 3


def test_rates_that_do_not_divide_and_vehicles_that_do_not_match_are_named():
    with pytest.raises(UsageError, match=r"500 Hz is not a whole multiple of controller\.rate_hz 200 Hz"):
        simulate(model(), None, Hover(1.0), rng=rng(), physics_rate=500.0)
    with pytest.raises(UsageError, match="must agree"):
        simulate(model(), Model(Vehicle("box", hexarotor().body, None, None, np.zeros(3))), Hover(1.0), rng=rng())
    with pytest.raises(UsageError, match="expected a positive number"):
        simulate(model(), None, Hover(1.0), -2.0, rng=rng())
