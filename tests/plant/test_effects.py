"""Every effect: zero is nothing, signs and sizes are physics, one step at a time is all at once, order is nothing."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from wrenchgap.plant import model_file
from wrenchgap.plant.effects import catalogue, find
from wrenchgap.plant.model import make_effect
from wrenchgap.plant.state import Commands, Motion, State
from wrenchgap.plant.wrench_model import ModelEffect, WrenchModel, forward_dynamics, measured_wrench

VEHICLE = model_file.load("tilt_hexarotor").vehicle
MASS, G = 4.0, 9.80665
DT = 0.005


def state(count, *, velocity=(0, 0, 0), omega=(0, 0, 0), quat=(1, 0, 0, 0)):
    def tile(v):
        return np.tile(np.asarray(v, dtype=float), (count, 1))

    return State(
        np.arange(count) * DT, np.zeros((count, 3)), tile(quat), tile(velocity), tile(omega), np.full(count, 22.0)
    )


def commands(count=1, seed=0):
    """Smooth wandering commands around hover."""
    rng = np.random.default_rng(seed)
    t = np.arange(count)[:, None] * DT
    tilt = 0.5 * np.sin(2 * np.pi * rng.uniform(0.3, 2, 6) * t + rng.uniform(0, 6, 6))
    speed = 680 + 80 * np.sin(2 * np.pi * rng.uniform(0.3, 3, 12) * t + rng.uniform(0, 6, 12))
    wrench = rng.normal(size=(1, 6)) * np.sin(t)
    return Commands(wrench + np.zeros((count, 6)), tilt, speed)


def hover(count=1):
    speed = np.sqrt(MASS * G / (12 * 7.2e-6))
    return Commands(np.zeros((count, 6)), np.zeros((count, 6)), np.full((count, 12), speed))


def model(**effects):
    return WrenchModel(VEHICLE, tuple(make_effect(VEHICLE, name, values) for name, values in effects.items()))


def typical(name, seed=1):
    """Values of about a typical size, inside the plausible range."""
    rng = np.random.default_rng(seed)
    parameters = find(name).parameters(VEHICLE)
    low, high = (np.array([getattr(p, k) for p in parameters]) for k in ("low", "high"))
    scale = np.array([p.scale for p in parameters])
    return np.clip(scale * rng.uniform(0.5, 1.0, len(parameters)), low, high)


@pytest.mark.parametrize("name", list(catalogue()))
def test_zero_is_no_effect(name):
    effect = find(name)
    zero = ModelEffect(effect, np.zeros(len(effect.parameters(VEHICLE))))
    u, x = commands(60), state(60, velocity=(1, -2, 0.5), omega=(0.3, -0.2, 0.5))
    nominal = WrenchModel(VEHICLE).predict(u, x, DT)
    np.testing.assert_allclose(WrenchModel(VEHICLE, (zero,)).predict(u, x, DT), nominal, atol=1e-9)


@pytest.mark.parametrize("name", list(catalogue()))
def test_typical_values_do_something(name):
    u, x = commands(60), state(60, velocity=(1, -2, 0.5), omega=(0.3, -0.2, 0.5))
    changed = model(**{name: typical(name)}).predict(u, x, DT) - model().predict(u, x, DT)
    smallest = 0.0 if name == "rotor_interference" else 1e-3
    assert np.abs(changed).max() > smallest


@pytest.mark.parametrize("name", list(catalogue()))
def test_step_by_step_is_all_at_once(name):
    """Simulation (N = 1, memory carried) and identification (N samples) are one function."""
    u, x = commands(80), state(80, velocity=(1, -2, 0.5), omega=(0.3, -0.2, 0.5))
    m = model(**{name: typical(name)})
    together, _ = m.actuate(u, x, DT)
    memory, rows = None, []
    for k in range(80):
        one = Commands(u.wrench_B[k : k + 1], u.tilt[k : k + 1], u.rotor_speed[k : k + 1])
        here = State(*(v[k : k + 1] for v in (x.time, x.position_E, x.quat_EB, x.velocity_E, x.omega_B, x.voltage)))
        wrench, memory = m.actuate(one, here, DT, memory)
        rows.append(wrench[0])
    np.testing.assert_allclose(np.array(rows), together, atol=1e-9)


@pytest.mark.parametrize("name", list(catalogue()))
def test_parameters_are_described(name):
    effect = find(name)
    for p in effect.parameters(VEHICLE):
        assert p.low <= 0.0 <= p.high or p.low <= p.start <= p.high
        assert p.low < p.high
        assert p.scale > 0
        assert p.unit
    assert effect.excited_by
    assert "Source:" in (type(effect).__doc__ or "")


def test_order_of_adding_does_not_matter():
    names = ["tilt_offset", "servo_lag", "command_delay", "com_offset", "rotor_thrust", "coaxial_loss", "body_drag"]
    u, x = commands(60), state(60, velocity=(1, -2, 0.5))
    made = [make_effect(VEHICLE, n, typical(n)) for n in names]
    forward, backward = (WrenchModel(VEHICLE, tuple(e)).predict(u, x, DT) for e in (made, made[::-1]))
    np.testing.assert_array_equal(forward, backward)


def test_com_to_the_left_rolls_left():
    """The centre of mass at +y (left): the lift acts to its right and turns the left side down, torque about -x."""
    W = model(com_offset={"y": 0.01}).predict(hover(), state(1), DT)[0]
    assert W[3] == pytest.approx(-0.01 * MASS * G)
    np.testing.assert_allclose(W[4:], 0, atol=1e-9)


def test_com_forward_pitches_the_nose_down():
    W = model(com_offset={"x": 0.01}).predict(hover(), state(1), DT)[0]
    assert W[4] == pytest.approx(0.01 * MASS * G)  # positive about y: nose down in x forward, y left, z up


def test_accelerometer_away_from_the_centre_of_mass_feels_rotation():
    """Spinning at w about z with the centre of mass at +x: O circles behind it and feels w^2 r towards +x."""
    m = model(com_offset={"x": 0.02})
    motion = m.motion(np.zeros((1, 6)), np.array([[0.0, 0.0, 3.0]]))
    np.testing.assert_allclose(motion.specific_force_B, [[0.02 * 9.0, 0, 0]], atol=1e-12)


def test_larger_inertia_answers_with_less_acceleration():
    """With twice the inertia about x the same torque makes half of the nominal torque appear in the measurement."""
    W = np.array([[0.0, 0, 0, 0.4, 0, 0]])
    J = VEHICLE.body.inertia[0, 0]
    m = model(inertia={"xx": J})
    reported = m.report(W, state(1))
    assert reported[0, 3] == pytest.approx(0.2)


def test_forward_and_inverse_dynamics_agree():
    rng = np.random.default_rng(5)
    body = model(com_offset=[0.01, -0.02, 0.03], inertia=[0.01, 0.005, -0.01, 0.002, -0.001, 0.003]).body
    W, omega = rng.normal(size=(20, 6)), rng.normal(size=(20, 3))
    about_com = measured_wrench(body, forward_dynamics(body, W, omega))
    np.testing.assert_allclose(about_com[:, :3], W[:, :3], atol=1e-12)
    np.testing.assert_allclose(about_com[:, 3:] + np.cross(body.com_B, W[:, :3]), W[:, 3:], atol=1e-12)


def test_gyroscopic_torque_does_no_work():
    rng = np.random.default_rng(6)
    omega = rng.normal(size=(50, 3))
    motion = forward_dynamics(VEHICLE.body, np.zeros((50, 6)), omega)
    power = np.einsum("ni,ij,nj->n", omega, VEHICLE.body.inertia, motion.omega_dot_B)
    np.testing.assert_allclose(power, 0, atol=1e-12)


def test_weak_rotor_lifts_less_and_turns_its_side_down():
    """Rotor 0 sits ahead (+x): weaker, the nose drops (torque about +y)."""
    change = model(rotor_thrust={"rotor_0": -0.2}).predict(hover(), state(1), DT) - model().predict(
        hover(), state(1), DT
    )
    lost = 0.2 * MASS * G / 12
    assert change[0, 2] == pytest.approx(-lost)
    assert change[0, 4] == pytest.approx(0.3 * lost)


def test_coaxial_loss_takes_from_the_lower_rotors_only():
    change = model(coaxial_loss={"eta": 0.2}).predict(hover(), state(1), DT) - model().predict(hover(), state(1), DT)
    assert change[0, 2] == pytest.approx(-0.2 * MASS * G / 2)


def test_thrust_scale_is_a_share_of_the_wrench():
    u = commands(10)
    change = model(thrust_scale={"scale": -0.1}).wrench(u, state(10)) - model().wrench(u, state(10))
    np.testing.assert_allclose(change, -0.1 * model().wrench(u, state(10)), atol=1e-12)


def test_common_tilt_offset_is_a_yaw_torque():
    """All arms tilted by +d push clockwise: M_z = -L sin(d) m g."""
    change = model(tilt_offset=[0.02] * 6).predict(hover(), state(1), DT)[0]
    assert change[5] == pytest.approx(-0.3 * np.sin(0.02) * MASS * G)
    np.testing.assert_allclose(change[:2], 0, atol=1e-9)


def test_drag_opposes_the_motion_and_dissipates():
    rng = np.random.default_rng(7)
    q = rng.normal(size=4)
    x = state(1, velocity=(2.0, -1.0, 0.5), quat=q / np.linalg.norm(q))
    W = model(body_drag=[0.1, 0.2, 0.3, 0.05, 0.05, 0.1, 0, 0, 0]).wrench(hover(), x) - model().wrench(hover(), x)
    from wrenchgap.flight.so3 import rotate

    force_E = rotate(x.quat_EB, W[:, :3])
    assert float(np.sum(force_E * x.velocity_E)) < 0
    isotropic = model(body_drag=[0.3, 0.3, 0.3, 0, 0, 0, 0, 0, 0]).wrench(hover(), x) - model().wrench(hover(), x)
    np.testing.assert_allclose(rotate(x.quat_EB, isotropic[:, :3]), -0.3 * x.velocity_E, atol=1e-12)


def test_drag_above_the_centre_of_mass_pitches_the_nose_up_in_forward_flight():
    x = state(1, velocity=(2.0, 0.0, 0.0))
    W = model(body_drag=[0.5, 0, 0, 0, 0, 0, 0, 0, 0.1]).wrench(hover(), x) - model().wrench(hover(), x)
    assert W[0, 0] == pytest.approx(-1.0)  # backward, 0.1 m above
    assert W[0, 4] == pytest.approx(-0.1)  # about -y: in FLU the nose goes up


def test_wake_hurts_only_who_stands_downstream():
    """All arms tilted by +90 deg blow around the circle: everybody stands in somebody's wake. At hover nobody does."""
    m = model(rotor_interference={"loss": 0.3, "width": 1.2})
    assert model().wrench(hover(), state(1))[0, 2] == pytest.approx(m.wrench(hover(), state(1))[0, 2], rel=5e-3)
    around = Commands(np.zeros((1, 6)), np.full((1, 6), np.pi / 2), hover().rotor_speed)
    assert abs(m.wrench(around, state(1))[0, 5]) < 0.99 * abs(model().wrench(around, state(1))[0, 5])


def test_wake_of_one_arm_reaches_the_arm_it_blows_at():
    """Arm 0 (at +x) tilted by -90 deg thrusts along +y, so its wake leaves along -y, away from arm 1 (60 deg)."""
    m = model(rotor_interference={"loss": 0.5, "width": 3.0})
    speed = np.zeros((1, 12))
    speed[:, :4] = 700.0
    for tilt, hit in ((-np.pi / 2, False), (np.pi / 2, True)):
        angles = np.zeros((1, 6))
        angles[0, 0] = tilt
        u = Commands(np.zeros((1, 6)), angles, speed)
        lost = model().wrench(u, state(1))[0, 2] - m.wrench(u, state(1))[0, 2]
        assert (lost > 0.05) == hit


def ode_lag(signal, tau):
    """First-order lag by a general ODE solver, on the signal as straight lines between samples."""
    t = np.arange(len(signal)) * DT
    solution = solve_ivp(
        lambda s, y: (np.interp(s, t, signal) - y) / tau,
        (0, t[-1]),
        [signal[0]],
        t_eval=t,
        max_step=DT / 2,
        rtol=1e-9,
        atol=1e-11,
    )
    return solution.y[0]


@pytest.mark.parametrize(("name", "signal"), [("servo_lag", "tilt"), ("motor_lag", "rotor_speed")])
def test_lag_solves_its_differential_equation(name, signal):
    u = commands(200)
    m = model(**{name: {"tau": 0.03}})
    lagged, _ = m.command(u, state(200), DT)
    other = "rotor_speed" if signal == "tilt" else "tilt"
    np.testing.assert_array_equal(getattr(lagged, other), getattr(u, other))
    expected = ode_lag(getattr(u, signal)[:, 0], 0.03)
    scale = np.abs(expected).max()
    np.testing.assert_allclose(getattr(lagged, signal)[:, 0] / scale, expected / scale, atol=1e-5)


def test_lag_of_a_ramp_is_late_by_its_time_constant():
    t = np.arange(400)[:, None] * DT
    u = Commands(np.zeros((400, 6)), 0.5 * t + np.zeros((400, 6)), np.full((400, 12), 600.0))
    lagged, _ = model(servo_lag={"tau": 0.04}).command(u, state(400), DT)
    np.testing.assert_allclose(lagged.tilt[300:, 0], 0.5 * (t[300:, 0] - 0.04), atol=1e-6)


@pytest.mark.parametrize("seconds", [0.0, 0.004, 0.005, 0.013, 0.02])
def test_delay_of_a_ramp_is_the_delay(seconds):
    t = np.arange(100)[:, None] * DT
    ramp = 3.0 * t
    u = Commands(ramp + np.zeros((100, 6)), ramp + np.zeros((100, 6)), 600.0 + ramp + np.zeros((100, 12)))
    late, _ = model(command_delay={"delay": seconds}).command(u, state(100), DT)
    for name in ("wrench_B", "tilt", "rotor_speed"):
        gone = getattr(u, name)[20:] - getattr(late, name)[20:]
        np.testing.assert_allclose(gone, 3.0 * seconds, atol=1e-9)


def test_constant_wrench_adds_itself():
    theta = np.array([0.1, -0.2, 0.3, 0.01, -0.02, 0.03])
    W = model(constant_wrench=theta).predict(hover(), state(1), DT) - model().predict(hover(), state(1), DT)
    np.testing.assert_allclose(W[0], theta, atol=1e-12)


def test_prediction_in_the_nominal_case_is_the_commanded_wrench():
    """With nothing missing, what the IMU's processing reports is h(u), whatever the body rate."""
    u = commands(30)
    x = state(30, omega=(0.5, -1.0, 0.7))
    np.testing.assert_allclose(model().predict(u, x, DT), model().wrench(u, x), atol=1e-9)


def test_motion_effect_on_sensor_side_is_identity_without_sensor_effects():
    motion = Motion(np.ones((2, 3)), np.ones((2, 3)), np.ones((2, 3)))
    assert model().read_imu(motion, state(2)) is motion
