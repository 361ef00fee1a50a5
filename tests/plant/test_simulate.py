"""Closed-loop flights: balance, response, offsets, alignment of what is logged."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from wrenchgap.flight import so3
from wrenchgap.flight.errors import ModelError, UsageError
from wrenchgap.plant import model_file
from wrenchgap.plant.controller import ControllerGains
from wrenchgap.plant.model import Model, make_effect
from wrenchgap.plant.sensors import SensorNoise
from wrenchgap.plant.simulation.simulate import physics_rate, simulate
from wrenchgap.plant.state import Motion, State
from wrenchgap.plant.trajectory import Hover, Tilts, named
from wrenchgap.plant.vehicle import GRAVITY, Vehicle
from wrenchgap.plant.wrench_model import measured_wrench

HEXAROTOR = model_file.load("tilt_hexarotor").vehicle
MASS, J = HEXAROTOR.body.mass, np.diag(HEXAROTOR.body.inertia)


def model(*effects, gains=None, sensors=None, vehicle=HEXAROTOR):
    plain = Model(vehicle, controller=gains or ControllerGains(), sensors=sensors or SensorNoise())
    return plain.with_effects([make_effect(vehicle, name, values) for name, values in effects])


def fast(rate=200.0):
    """A nominal setting without noise."""
    silent = replace(SensorNoise().silent, imu_rate_hz=rate, pose_rate_hz=rate)
    return {"gains": ControllerGains(rate_hz=rate, integral=0.0), "sensors": silent}


def flown(made, trajectory, **options):
    return simulate(made, None, trajectory, rng=np.random.default_rng(0), **options)


def start(position=(0.0, 0.0, 1.6), turn=(0.0, 0.0, 0.0)):
    """At rest."""
    zeros = np.zeros((1, 3))
    return State(np.zeros(1), np.array([position]), so3.exp(np.array([turn])), zeros, zeros)


def test_hover_balances_the_weight():
    flight = flown(model(**fast()), Hover(2.0))
    np.testing.assert_allclose(flight.commanded.wrench_B, np.tile([0, 0, MASS * GRAVITY, 0, 0, 0], (400, 1)), atol=1e-9)
    np.testing.assert_allclose(flight.odometry.position_E, np.tile([0.0, 0.0, 1.6], (400, 1)), atol=1e-9)
    np.testing.assert_allclose(flight.imu.specific_force_B, np.tile([0.0, 0.0, GRAVITY], (400, 1)), atol=1e-9)
    thrust = 7.2e-6 * flight.actuators.rotor_speed**2
    np.testing.assert_allclose(thrust.sum(axis=1), MASS * GRAVITY)
    assert flight.notes == ()


def second_order(t, zeta, omega, x0):
    """x'' + 2 zeta omega x' + omega^2 x = 0 from x0 at rest."""
    a, b = np.roots([1.0, 2.0 * zeta * omega, omega**2]).astype(complex)
    return np.real(x0 * (a * np.exp(b * t) - b * np.exp(a * t)) / (a - b))


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_an_attitude_error_dies_as_the_damped_second_order_system(axis):
    initial = start(turn=0.02 * np.eye(3)[axis])
    flight = flown(model(**fast(1000.0)), Hover(2.0), initial=initial, physics_rate=1000.0, feedback="true")
    angle = so3.log(flight.odometry.quat_EB)[:, axis]
    expected = second_order(flight.odometry.time, (1.3, 1.3, 0.74)[axis], 3.5, 0.02)
    np.testing.assert_allclose(angle, expected, atol=0.02 * 0.005)


def test_a_position_error_dies_as_the_damped_second_order_system():
    flight = flown(model(**fast(1000.0)), Hover(2.0), initial=start((0.1, -0.05, 1.7)), physics_rate=1000.0)
    expected = second_order(flight.odometry.time[:, None], 0.707, 3.5, np.array([0.1, -0.05, 0.1]))
    np.testing.assert_allclose(flight.odometry.position_E - [0.0, 0.0, 1.6], expected, atol=5e-4)


def test_a_hidden_centre_of_mass_tilts_the_vehicle_by_the_torque_over_the_stiffness():
    """At rest M_cmd = c x F with M_cmd = -J w^2 e_R and F = R_EB^T (0, 0, m g)."""
    c = np.array([0.0012, -0.0007, 0.0])
    quat = flown(model(("com_offset", c), **fast()), Hover(8.0)).odometry.quat_EB[-1]
    force = so3.rotate_inverse(quat, np.array([0.0, 0.0, MASS * GRAVITY]))
    error = so3.vee(so3.matrix(quat))
    np.testing.assert_allclose(error, -np.cross(c, force) / (J * 3.5**2), atol=1e-6)
    assert error[0] > 0.015  # -c_y m g / (J_x w^2) = 0.0217 to first order


def test_the_integral_removes_that_tilt():
    setting = fast() | {"gains": ControllerGains(integral=1.0, integral_limit=1.0)}
    flight = flown(model(("com_offset", {"x": 0.001}), **setting), Hover(10.0))
    error = np.abs(so3.vee(so3.matrix(flight.odometry.quat_EB)))
    assert error[:1000].max() > 0.01
    assert error[-1].max() < 5e-4


def test_without_effects_the_imu_measures_the_command_without_any_lag():
    """Commands are held from their stamp on; their mean around a stamp is what the IMU there must report."""
    flight = flown(model(**fast()), named("multi_axis", 8.0, 1.0))
    held, omega = flight.commanded.wrench_B, flight.imu.omega_B
    omega_dot = (omega[2:] - omega[:-2]) * 100.0
    motion = Motion(omega[1:-1], omega_dot, flight.imu.specific_force_B[1:-1])
    measured = measured_wrench(HEXAROTOR.body, motion)
    error = np.abs(measured - 0.5 * (held[1:-1] + held[:-2]))
    assert error[:, :3].max() < 0.02  # N of 60
    assert error[:, 3:].max() < 0.01  # Nm of 0.7
    late = np.abs(measured - held[1:-1])  # a half-sample shift would be larger by far
    assert late[:, 3:].max() > 3.0 * error[:, 3:].max()


def test_halving_the_physics_step_hardly_changes_a_flight():
    made = model(("servo_lag", {"tau": 0.05}), ("com_offset", {"x": 0.003}), **fast())
    flights = [flown(made, named("multi_axis", 6.0, 1.0), physics_rate=rate) for rate in (400.0, 800.0)]
    apart = so3.log(so3.multiply(so3.conjugate(flights[0].odometry.quat_EB), flights[1].odometry.quat_EB))
    assert np.degrees(np.abs(apart).max()) < 0.2


def test_seeds_repeat_and_noise_has_its_size():
    seeds, trajectory = (np.random.default_rng(s) for s in (3, 3, 4)), named("pitch", 2.0, 1.0)
    one, same, other = (simulate(model(), None, trajectory, rng=rng) for rng in seeds)
    assert one.content_hash == same.content_hash != other.content_hash
    np.testing.assert_array_equal(one.imu.omega_B, same.imu.omega_B)
    assert (len(one.imu.time), len(one.odometry.time)) == (400, 200)
    jitter = np.diff(one.imu.omega_B - other.imu.omega_B, axis=0)
    assert jitter.std() == pytest.approx(2.4e-4 * 10.0 * 2.0, rel=0.25)


def test_a_disturbance_pushes_and_the_controller_leans_against_it():
    push = np.array([2.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    flight = flown(model(**fast()), Hover(6.0), disturbance=lambda t: push)
    np.testing.assert_allclose(flight.odometry.position_E[-1, 0], 2.0 / (MASS * 3.5**2), rtol=1e-3)
    np.testing.assert_allclose(flight.commanded.wrench_B[-1, 0], -2.0, rtol=1e-3)


def test_a_compensator_that_knows_the_offset_removes_the_error():
    class Knows:
        def step(self, wrench_des, state):
            return SimpleNamespace(wrench_cmd=wrench_des - torque)

    torque = np.array([0.0, 0.0, 0.0, 0.0, 0.04, 0.0])
    made = model(("constant_wrench", torque), **fast())
    plain, helped = (flown(made, Hover(4.0), compensator=c) for c in (None, Knows()))
    assert so3.log(plain.odometry.quat_EB[-1])[1] == pytest.approx(0.04 / (J[1] * 3.5**2), rel=1e-2)
    np.testing.assert_allclose(helped.odometry.quat_EB[-1], [1, 0, 0, 0], atol=1e-9)
    np.testing.assert_allclose((helped.commanded.wrench_B - helped.desired.wrench_B)[:, 4], -0.04, atol=1e-12)


def test_turning_the_inertial_frame_about_gravity_turns_the_flight():
    yaw = so3.exp(np.array([0.0, 0.0, 2.0]))
    made = model(("com_offset", [0.003, -0.002, 0.001]), ("servo_lag", {"tau": 0.03}), **fast())

    class Turned(Tilts):
        def at(self, time):
            r, turn = super().at(time), np.tile(yaw, (len(time), 1))
            return replace(r, position_E=so3.rotate(yaw, r.position_E), quat_ED=so3.multiply(turn, r.quat_ED))

    tilts = (4.0, np.array([[0.0, 1.0, 0.0]]), np.radians(40.0), 3.0, 4.0)
    plain, other = (flown(made, kind(*tilts)) for kind in (Tilts, Turned))
    np.testing.assert_allclose(other.imu.omega_B, plain.imu.omega_B, atol=1e-8)
    np.testing.assert_allclose(other.odometry.position_E, so3.rotate(yaw, plain.odometry.position_E), atol=1e-8)
    np.testing.assert_allclose(other.commanded.wrench_B, plain.commanded.wrench_B, atol=1e-7)


def test_a_lost_vehicle_is_reported_and_its_flight_ends_there():
    flight = flown(model(("constant_wrench", [0.0, 0.0, 0.0, 3.0, 0.0, 0.0])), Hover(5.0))
    assert "control was lost" in flight.notes[0]
    assert flight.commanded.time[-1] < 4.0
    assert len(flight.commanded.time) == len(flight.reference.time) == len(flight.actuators.time)


def test_saturation_is_counted_in_the_notes():
    slow = replace(HEXAROTOR, arms=replace(HEXAROTOR.arms, tilt_rate_max=np.full(6, 0.2)))
    flight = flown(model(vehicle=slow), named("multi_axis", 7.0, 1.0))
    assert any(note.startswith("tilt rate was limited in") for note in flight.notes)


def test_fixed_rotors_fly_a_circle_by_leaning():
    arms = replace(HEXAROTOR.arms, tilts=np.full(6, False))
    rotors = replace(HEXAROTOR.rotors, spin=np.repeat([1.0, -1.0] * 3, 2))  # alike in a pair, so that yaw is possible
    gains = ControllerGains(omega_position=2.0, omega_attitude=(12.0, 12.0, 4.0), zeta_attitude=(0.8, 0.8, 0.8))
    made = model(vehicle=replace(HEXAROTOR, arms=arms, rotors=rotors), gains=gains)
    flight = flown(made, named("circle", 9.0), physics_rate=400.0)
    true, asked = flight.odometry, flight.reference
    wanted = np.stack([np.interp(true.time, asked.time, c) for c in asked.position_E.T], axis=1)
    assert np.linalg.norm(true.position_E - wanted, axis=1).max() < 0.1
    assert np.degrees(so3.tilt_angle(true.quat_EB)).max() > 5.0
    np.testing.assert_allclose(flight.commanded.wrench_B[:, :2], 0.0)


def test_a_vehicle_of_which_only_the_wrench_is_known_flies_too():
    body = replace(HEXAROTOR.body, com_B=np.array([0.002, 0.0, 0.0]))
    box = Vehicle("box", body, None, None, np.array([0.02, 0.0, 0.01]))
    flight = flown(model(vehicle=box, **fast()), named("figure8", 10.0), voltage=lambda t: 24 - t)
    assert flight.actuators is None
    np.testing.assert_allclose(flight.battery.voltage, 24.0 - flight.battery.time)
    error = so3.multiply(so3.conjugate(flight.reference.quat_ED), flight.odometry.quat_EB)
    assert np.degrees(np.abs(so3.log(error))).max() < 2.0


def test_progress_is_told_and_ends_at_one():
    heard = []
    flown(model(), Hover(2.0), progress=heard.append)
    assert heard == sorted(heard)
    assert heard[-1] == 1.0
    assert len(heard) > 3


def test_rates_that_do_not_divide_and_vehicles_that_do_not_match_are_named():
    with pytest.raises(UsageError, match=r"500 Hz is not a whole multiple of controller\.rate_hz 200 Hz"):
        flown(model(), Hover(1.0), physics_rate=500.0)
    box, rng = Model(Vehicle("box", HEXAROTOR.body, None, None, np.zeros(3))), np.random.default_rng(0)
    with pytest.raises(UsageError, match="must agree"):
        simulate(model(), box, Hover(1.0), rng=rng)
    with pytest.raises(UsageError, match=r"expected two control periods, 0\.01 s, at least"):
        simulate(model(), None, Hover(1.0), -2.0, rng=rng)


def test_rates_whose_common_multiple_takes_all_memory_are_refused():
    """Of 1000.003 kHz and 200 Hz it is 200 MHz: a second of flight took 18 GB."""
    made = model(sensors=replace(SensorNoise(), imu_rate_hz=1_000_003.0))
    with pytest.raises(UsageError, match=r"more than 1,500,000 steps"):
        flown(made, Hover(1.0), physics_rate=physics_rate(made))


def test_an_effect_of_the_voltage_is_refused_where_there_is_no_battery():
    sagging = model(("battery_sag", {"sensitivity": 0.5, "per_volt": 0.02}))
    with pytest.raises(ModelError, match=r"battery_sag: needs the battery's voltage"):
        flown(sagging, Hover(1.0))
    assert len(flown(sagging, Hover(1.0), voltage=lambda t: 25.0).imu.time)
