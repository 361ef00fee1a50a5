"""INDI and L1 on a rigid body with actuators that are simulated here, against closed forms."""

from dataclasses import replace

import numpy as np
import pytest

from wrenchgap.compensate import INDI, L1
from wrenchgap.compensate.reach import reach_of
from wrenchgap.flight import so3
from wrenchgap.flight.errors import UsageError
from wrenchgap.plant import model_file
from wrenchgap.plant.rigid_body import RigidBody, unpack
from wrenchgap.plant.simulation.simulate import simulate
from wrenchgap.plant.trajectory import named
from wrenchgap.plant.vehicle import Body
from wrenchgap.plant.wrench_model import about_origin, forward_dynamics

MODEL = model_file.load("tilt_hexarotor")
VEHICLE = MODEL.vehicle
M, J = VEHICLE.body.mass, VEHICLE.body.inertia
HOVER = np.array([0.0, 0.0, 9.81 * M, 0.0, 0.0, 0.0])
TORQUE = np.array([0.15, -0.1, 0.06])
FORCE_E = np.array([1.5, -2.0, 1.0])
LAWS = [INDI, L1]
TURNED = so3.exp(np.array([0.5, -0.7, 1.2]))
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])


class World:
    """A body, its centre of mass pushed in E and twisted in B, behind a lag and a delay of whole periods."""

    def __init__(self, body=VEHICLE.body, *, quat=LEVEL, omega=(0.0, 0.0, 0.0), lag=0.0, late=0):
        self.body = body
        self.y = np.concatenate((np.zeros(3), quat, np.zeros(3), omega))
        self.lag, self.late, self.parts, self.sent, self.lagged = lag, late, 4 if lag > 0.0 else 1, [], None
        self.felt, self.made = np.full(3, np.nan), np.zeros(6)

    @property
    def state(self):
        return replace(unpack(np.zeros(1), self.y[None].copy()), specific_force_B=self.felt[None].copy())

    def move(self, command, dt, force_E=np.zeros(3), torque_B=np.zeros(3)):
        self.sent = [command, *(self.sent or [command] * self.late)][: self.late + 1]
        u, h = self.sent[-1], dt / self.parts
        self.lagged = u if self.lagged is None else self.lagged
        felt, made = [], []
        for _ in range(self.parts):
            mean, after = u, u
            if self.lag > 0.0:
                after = u + (self.lagged - u) * np.exp(-h / self.lag)
                mean = u + (self.lagged - after) * self.lag / h
            self.lagged = after
            push = np.concatenate((so3.rotate_inverse(self.y[3:7], force_E), torque_B))
            made.append(mean)
            about_O, before = about_origin(self.body, (mean + push)[None]), self.y[10:]
            self.y = RigidBody(self.body).step(self.y, about_O[0], h)
            felt.append(forward_dynamics(self.body, about_O, 0.5 * (before + self.y[10:])[None]).specific_force_B[0])
        self.felt, self.made = np.mean(felt, axis=0), np.mean(made, axis=0)


def flown(law, world, seconds, desired=lambda t: HOVER, **pushed):
    """Times (K,), corrections (K, 6), made wrenches (K, 6), attitudes (K, 4)."""
    time, corrections, made, attitudes = np.arange(round(seconds / law.dt)) * law.dt, [], [], []
    for t in time:
        attitudes.append(world.y[3:7].copy())
        result = law.step(desired(t), world.state)
        world.move(result.wrench_cmd, law.dt, **pushed)
        corrections.append(result.correction)
        made.append(world.made)
    return time, np.array(corrections), np.array(made), np.array(attitudes)


def butterworth_step(t, cutoff_hz):
    """Step response of 1 / (s^2 / w^2 + sqrt(2) s / w + 1)."""
    x = 2.0 * np.pi * cutoff_hz * t / np.sqrt(2.0)
    return 1.0 - np.exp(-x) * (np.cos(x) + np.sin(x))


def first_order_step(t, cutoff_hz):
    return 1.0 - np.exp(-2.0 * np.pi * cutoff_hz * t)


@pytest.mark.parametrize("cutoff_hz", [2.0, 4.0])
@pytest.mark.parametrize(("kind", "step"), [(INDI, butterworth_step), (L1, first_order_step)])
def test_a_constant_wrench_is_cancelled_as_fast_as_the_low_pass_says(kind, step, cutoff_hz):
    law = kind(VEHICLE, 2e-3, cutoff_hz)
    push = {"force_E": FORCE_E, "torque_B": TORQUE}

    def shaken(t):
        return HOVER + np.concatenate(([0.5, 0.3, 0.2], 0.1 * np.sin([3.0 * t, 5.0 * t, 4.0 * t])))

    time, corrections, _, quat = flown(law, World(), 0.6, shaken, **push)
    total = np.hstack((so3.rotate_inverse(quat, np.tile(FORCE_E, (len(quat), 1))), np.tile(TORQUE, (len(quat), 1))))
    expected = -total * step(time, cutoff_hz)[:, None]
    assert np.abs((corrections - expected) / np.abs(total[0]).max()).max() < 0.02


@pytest.mark.parametrize("gain", [1.0, 5.0, 20.0])
def test_l1_finds_exp_of_minus_a_t_of_a_constant(gain):
    law = L1(VEHICLE, 0.005, 4.0, gain=gain)
    _, corrections, _, _ = flown(law, World(), 1.5, torque_B=TORQUE)
    assert corrections[-1, 3:] == pytest.approx(-TORQUE * np.exp(-gain * 0.005), rel=1e-3)


@pytest.mark.parametrize("kind", LAWS)
def test_force_in_e_and_torque_in_b_on_a_turning_vehicle(kind):
    """A rate controller keeps the vehicle turning, so that the force turns in B."""
    omega = np.array([0.6, -0.4, 0.9])
    law, world = kind(VEHICLE, 0.002, 8.0), World(quat=TURNED, omega=omega)

    def wanted(_):
        turning = world.y[10:]
        return np.concatenate((HOVER[:3], np.cross(turning, J @ turning) - 5.0 * J @ (turning - omega)))

    _, corrections, _, quat = flown(law, world, 1.4, wanted, force_E=FORCE_E, torque_B=TORQUE)
    late = slice(200, None)
    assert so3.log(so3.multiply(so3.conjugate(quat[200]), quat[-1])) @ omega > 1.0  # it has turned
    in_B = so3.rotate_inverse(quat[late], np.tile(FORCE_E, (len(quat[late]), 1)))
    np.testing.assert_allclose(corrections[late, :3], -in_B, atol=0.03)
    np.testing.assert_allclose(corrections[late, 3:], np.tile(-TORQUE, (len(in_B), 1)), atol=0.003)


def stepping(t):
    """Steps of force and torque every 0.2 s."""
    sign = np.array([1.0, -1.0, 1.0]) * (1.0 if int(t / 0.2) % 2 else -0.5)
    return HOVER + np.concatenate((4.0 * sign, 0.3 * sign))


@pytest.mark.parametrize(("lag", "late"), [(0.0, 0), (0.06, 0), (0.0, 4), (0.06, 4)])
def test_indi_increments_nothing_where_lag_and_delay_are_as_modelled(lag, late):
    """Measurement and command pass the same filter: what is left is rounding and the order of the integration."""
    dt = 0.005
    law = INDI(VEHICLE, dt, 16.0, lag=lag, delay=late * dt)
    world = World(quat=TURNED, omega=np.array([0.5, -0.3, 0.8]), lag=lag, late=late)
    _, corrections, _, _ = flown(law, world, 1.0, stepping)
    assert np.abs(corrections[:, :3]).max() < 0.01 * 6.0
    assert np.abs(corrections[:, 3:]).max() < 0.01 * 0.45


def test_indi_takes_a_lag_that_it_is_not_told_for_a_disturbance():
    law, world = INDI(VEHICLE, 0.005, 16.0, lag=0.03), World(lag=0.06)
    _, corrections, _, _ = flown(law, world, 1.0, stepping)
    assert np.abs(corrections[:, 3:]).max() > 0.1 * 0.45


def test_indi_told_the_lag_leaves_the_lag_as_it_is():
    """The made torque follows a step of the demand as 1 - exp(-t / tau)."""
    tau, dt = 0.06, 0.005
    law, world = INDI(VEHICLE, dt, 8.0, lag=tau), World(lag=tau)
    time, _, made, _ = flown(law, world, 0.4, lambda t: HOVER + np.array([0.0, 0.0, 0.0, 0.2, 0.0, 0.0]) * (t >= 0.1))
    after = time >= 0.1
    middle = time[after] + 0.5 * dt - 0.1
    np.testing.assert_allclose(made[after, 3], 0.2 * (1.0 - np.exp(-middle / tau)), atol=0.002)


def test_l1_and_a_lag_are_a_loop_of_second_order():
    """Made torque over disturbance: -k / (tau s^2 + s + k), which overshoots by exp(-pi zeta / sqrt(1 - zeta^2))."""
    tau, hz = 0.1, 4.0
    zeta = 1.0 / (2.0 * np.sqrt(2.0 * np.pi * hz * tau))
    law, world = L1(VEHICLE, 1e-3, hz, gain=0.1), World(lag=tau)
    _, _, made, _ = flown(law, world, 0.4, torque_B=TORQUE)
    assert (-made[:, 3] / TORQUE[0]).max() == pytest.approx(
        1.0 + np.exp(-np.pi * zeta / np.sqrt(1 - zeta**2)), rel=0.02
    )


def growth(law, late):
    """Ratio of the correction's swing in two windows, one second apart, under a small constant torque."""
    _, corrections, _, _ = flown(law, World(late=late), 3.0, torque_B=0.02 * TORQUE)
    swings = corrections[750:1000, 3].std(), corrections[1250:, 3].std()
    return swings[1] / swings[0]


@pytest.mark.parametrize(("kind", "margin"), [(INDI, 1.777 / (2.0 * np.pi)), (L1, 0.25)])
def test_delay_that_is_borne_is_that_of_theory(kind, margin):
    """Of an unknown delay: 1.777 / w with the Butterworth filter, a quarter of a period of the cut-off with one of
    first order: |1 - 1 / H(j w)| = 1 and its phase. Sampling at 500 Hz takes two or three milliseconds of it.
    """
    hz = 5.0
    borne = 500.0 * margin / hz
    assert growth(kind(VEHICLE, 2e-3, hz), round(0.9 * borne)) < 0.5
    assert growth(kind(VEHICLE, 2e-3, hz), round(1.1 * borne)) > 1.5


@pytest.mark.parametrize("kind", LAWS)
def test_correction_scales_with_mass_and_inertia(kind):
    """The same motion of a vehicle that is 1.3 times as heavy needs 1.3 times the wrench."""
    heavy = replace(VEHICLE, body=Body(1.3 * M, 1.3 * J, np.zeros(3)))
    found = []
    for vehicle, scale in ((VEHICLE, 1.0), (heavy, 1.3)):
        push = {"force_E": scale * FORCE_E, "torque_B": scale * TORQUE}
        world = World(vehicle.body, quat=TURNED, omega=np.array([0.2, 0.1, -0.3]))
        found.append(flown(kind(vehicle, 0.005, 4.0), world, 0.5, lambda t, s=scale: s * HOVER, **push)[1])
    np.testing.assert_allclose(found[1], 1.3 * found[0], rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("kind", LAWS)
def test_known_centre_of_mass_is_no_disturbance(kind):
    """O, whose velocity and specific force are measured, turns about it: some newtons were it forgotten."""
    displaced = replace(VEHICLE, body=Body(M, J, np.array([0.03, -0.05, 0.02])))
    world = World(displaced.body, quat=TURNED, omega=np.array([2.0, -1.5, 3.0]))
    _, corrections, _, _ = flown(kind(displaced, 0.005, 4.0), world, 0.5, stepping)
    assert np.abs(corrections[:, :3]).max() < 0.1
    assert np.abs(corrections[:, 3:]).max() < 0.005


@pytest.mark.parametrize("kind", LAWS)
def test_correction_is_bounded_and_nothing_winds_up(kind):
    law, most = kind(VEHICLE, 0.005, 4.0), reach_of(VEHICLE).correction_max
    world = World()
    _, corrections, _, _ = flown(law, world, 1.0, torque_B=np.array([2.0 * most[3], 0.0, 0.0]))
    assert np.abs(corrections[:, 3]).max() == pytest.approx(most[3], rel=1e-6)
    world = replaced(world)
    _, after, _, _ = flown(law, world, 0.5)
    assert np.abs(after[-1]).max() < 0.02 * most[3]


def replaced(world):
    """The same actuators on a body at rest."""
    again = World()
    again.felt, again.lagged, again.sent = world.felt, world.lagged, world.sent
    return again


@pytest.mark.parametrize("kind", LAWS)
def test_readings_that_are_none_are_no_disturbance(kind):
    law, world = kind(VEHICLE, 0.005, 4.0), World(quat=TURNED)
    push = {"force_E": FORCE_E, "torque_B": TORQUE}
    flown(law, world, 1.0, **push)
    held = law.step(HOVER, world.state).correction
    for rates in (np.full((1, 3), np.nan), world.state.omega_B + 900.0):
        spoilt = law.step(HOVER, replace(world.state, omega_B=rates))
        assert np.isfinite(spoilt.wrench_cmd).all()
        np.testing.assert_allclose(spoilt.correction, held, atol=0.003)  # the force in E turns in B
        world.move(spoilt.wrench_cmd, law.dt, **push)
    _, corrections, _, quat = flown(law, world, 0.5, **push)
    assert np.abs(corrections[:, 3:] - held[3:]).max() < 0.01
    np.testing.assert_allclose(corrections[-1, :3], -so3.rotate_inverse(quat[-1], FORCE_E), atol=0.06)


def test_state_that_is_none_is_said():
    law = INDI(VEHICLE, 0.005)
    state = replace(World().state, quat_EB=np.full((1, 4), np.nan))
    assert law.step(HOVER, state).trouble.startswith("the state is not finite")


def test_indi_without_an_accelerometer_leaves_forces_alone():
    law, world = INDI(VEHICLE, 0.005), World()
    for _ in range(100):
        result = law.step(HOVER, replace(world.state, specific_force_B=None))
        world.move(result.wrench_cmd, law.dt, force_E=FORCE_E, torque_B=TORQUE)
    assert not result.correction[:3].any()
    assert result.correction[3:] == pytest.approx(-TORQUE, abs=0.002)


@pytest.mark.parametrize("kind", LAWS)
def test_vehicle_that_pushes_along_z_is_corrected_along_z(kind):
    quad = model_file.load("asymmetric_quadrotor").vehicle
    weight = 9.81 * quad.body.mass
    law, world = kind(quad, 0.005, 4.0), World(quad.body)
    push = 0.1 * weight * np.array([1.0, -1.0, 1.0])
    _, corrections, _, quat = flown(law, world, 1.0, lambda t: np.array([0, 0, weight, 0, 0, 0]), force_E=push)
    assert not corrections[:, :2].any()
    assert corrections[-1, 2] == pytest.approx(-push[2], rel=0.03)
    assert np.abs(quat[-1] - LEVEL).max() < 1e-6


@pytest.mark.parametrize("kind", LAWS)
def test_reset_forgets(kind):
    law = kind(VEHICLE, 0.005, 4.0)
    first = flown(law, World(), 0.2, torque_B=TORQUE)[1]
    law.reset()
    assert np.array_equal(flown(law, World(), 0.2, torque_B=TORQUE)[1], first)


@pytest.mark.parametrize("kind", LAWS)
def test_in_the_loop_a_constant_wrench_moves_and_turns_the_vehicle_no_more(kind):
    still = replace(MODEL, controller=replace(MODEL.controller, integral=0.0))
    pushed = np.concatenate((FORCE_E, TORQUE))

    def off(helper):
        more = {"rng": np.random.default_rng(0), "compensator": helper, "disturbance": lambda t: pushed}
        flight = simulate(still, still, named("hover"), 4.0, **more)
        pose, reference = flight.odometry, flight.reference
        away = (pose.position_E[-50:] - reference.position_E[-1]).mean(axis=0)
        return np.abs(away), np.abs(np.sin(so3.log(pose.quat_EB[-50:])).mean(axis=0))

    dt = 1.0 / MODEL.controller.rate_hz
    for before, after in zip(off(None), off(kind(VEHICLE, dt, 2.0)), strict=True):
        assert (after < 0.12 * before).all()


IMPOSSIBLE = [(0.0, 1.0), (0.005, -1.0), (np.nan, 1.0), (0.005, np.inf), (0.005, 40.0)]


@pytest.mark.parametrize("kind", LAWS)
@pytest.mark.parametrize(("dt", "hz"), IMPOSSIBLE)
def test_impossible_settings_are_refused_in_one_line(kind, dt, hz):
    with pytest.raises(UsageError, match="expected positive") as caught:
        kind(VEHICLE, dt, hz)
    assert "\n" not in str(caught.value)


def test_impossible_lags_and_gains_are_refused_in_one_line():
    for asked in (
        lambda: INDI(VEHICLE, 0.005, lag=-1.0),
        lambda: INDI(VEHICLE, 0.005, delay=np.nan),
        lambda: L1(VEHICLE, 0.005, gain=0.0),
        lambda: L1(VEHICLE, 0.005, gain=300.0),
    ):
        with pytest.raises(UsageError, match="expected") as caught:
            asked()
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize("kind", LAWS)
def test_missing_state_gets_one_line(kind):
    with pytest.raises(UsageError, match=r"needs the state: step\(wrench_des, state\)"):
        kind(VEHICLE, 0.005).step(HOVER)
