"""What a vehicle can do, against what its allocation makes, and the nearest wrench, against scipy's SLSQP."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize

import wrenchgap as wg
from wrenchgap.compensate import Combined, Compensator, DisturbanceObserver, PhysicsMismatch, Settings
from wrenchgap.compensate.kernels import FAR
from wrenchgap.compensate.reach import NEAR, SHARE, THRUST_TO_WEIGHT, reach_of
from wrenchgap.flight.errors import ModelError, UsageError
from wrenchgap.plant.actuation import nominal_wrench
from wrenchgap.plant.allocation import Allocation
from wrenchgap.plant.model import make_effect
from wrenchgap.plant.state import State
from wrenchgap.plant.vehicle import GRAVITY
from wrenchgap.plant.wrench_model import about_origin

NAMES = ("tilt_hexarotor", "voliro_x", "crazyflie", "asymmetric_quadrotor", "variable_tilt_hexacopter")
TORQUES = ("torque_x", "torque_y", "torque_z")
REST = State(np.zeros(1), np.zeros((1, 3)), np.array([[1.0, 0, 0, 0]]), np.zeros((1, 3)), np.zeros((1, 3)))


def demands(reach, count=60, seed=0):
    rng = np.random.default_rng(seed)
    size = rng.choice([0.05, 0.3, 1.0, 20.0], size=(count, 1))
    return size * rng.normal(size=(count, 6)) * reach.authority


def limited_by_the_allocation(vehicle, wrench):
    _, said = Allocation(vehicle).allocate(about_origin(vehicle.body, wrench[None]))
    return said.rotor_speed > 0 or said.tilt_range > 0


@pytest.mark.parametrize("name", NAMES[:4])
def test_inside_is_what_the_allocation_makes_without_a_limit(name):
    vehicle = wg.load_model(name).vehicle
    reach = reach_of(vehicle)
    made = Allocation(vehicle)
    told = 0
    for wrench in demands(reach):
        wanted = made.achievable(about_origin(vehicle.body, wrench[None]))[0]
        wanted[3:] -= np.cross(vehicle.body.com_B, wanted[:3])  # about the centre of mass again
        if np.any(np.abs(wanted) > 0.999 * reach.authority):
            continue
        told += 1
        assert reach.inside(wanted) is not limited_by_the_allocation(vehicle, wanted)
    assert told > 20


def fixed(spins, speed_min=0.0, speed_max=900.0):
    """The shipped quadrotor's frame of four rotors that turn so."""
    vehicle = wg.load_model("asymmetric_quadrotor").vehicle
    rotors = vehicle.rotors
    limits = {"speed_min": np.full(4, speed_min), "speed_max": np.full(4, speed_max)}
    return replace(vehicle, rotors=replace(rotors, spin=np.array(spins, dtype=float), c_f=np.full(4, 1e-5), **limits))


def test_a_fixed_rotor_that_idles_pushes():
    """A rotor at 400 rad/s pushes c_f 400^2 = 1.6 N: less is not made, and who weighs less cannot hover."""
    vehicle = fixed([1, -1, 1, -1], speed_min=400.0)
    reach = reach_of(vehicle)
    up = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    least = (Allocation(vehicle).inverse @ about_origin(vehicle.body, up[None])[0]).min()  # N of one rotor, a newton up
    for share, made in ((0.1, False), (0.98, False), (1.02, True), (1.5, True)):
        assert reach.inside(share * 1e-5 * 400.0**2 / least * up) is made
    light = replace(vehicle.body, mass=4 * 1e-5 * 400.0**2 / GRAVITY * 0.9)
    with pytest.raises(ModelError, match="speed_min"):
        reach_of(replace(vehicle, body=light))


def test_yaw_of_rotors_that_all_turn_one_way_is_no_axis_of_its_own():
    assert reach_of(fixed([1, -1, 1, -1])).coupled == ()
    assert reach_of(fixed([1, 1, 1, 1])).coupled == ("force_z", "torque_z")
    for name in NAMES:
        assert reach_of(wg.load_model(name).vehicle).coupled == ()


def test_authority_of_a_star_of_tilting_arms_in_closed_form():
    """Six arms of radius L with 2 c_f Omega^2 each: all up m g; all along their tangents, T L about z plus drag of none
    (the two rotors of an arm turn against each other)."""
    vehicle = wg.load_model("tilt_hexarotor").vehicle
    thrust = 2 * 7.2e-6 * 1250.0**2
    authority = reach_of(vehicle).authority
    assert authority[2] == pytest.approx(6 * thrust)
    assert authority[5] == pytest.approx(6 * thrust * 0.30)
    assert authority[4] == pytest.approx(thrust * 0.30 * sum(abs(np.cos(k * np.pi / 3)) for k in range(6)))


@pytest.mark.parametrize("name", NAMES)
def test_the_nearest_wrench_is_reachable_and_none_is_nearer(name):
    reach = reach_of(wg.load_model(name).vehicle)
    table, d = reach.table, len(reach.table.middle)
    for wrench in demands(reach, 25, seed=4):
        found, other = reach.nearest(wrench)
        assert reach.inside(found)
        assert other is not reach.inside(wrench)
        wanted = np.clip(wrench / reach.authority, -FAR, FAR)

        def limits(w):
            x = table.rows @ w
            discs = 1 - np.sum(x[: 2 * d].reshape(d, 2) ** 2, axis=1)
            return np.concatenate((discs, x[2 * d :] - table.low, table.high - x[2 * d :]))

        best = minimize(
            lambda w, wanted=wanted: 0.5 * np.sum((w - wanted) ** 2),
            table.hover,
            jac=lambda w, wanted=wanted: w - wanted,
            constraints=[{"type": "ineq", "fun": limits}],
            method="SLSQP",
            options={"maxiter": 500, "ftol": 1e-12},
        )
        assert np.linalg.norm(found / reach.authority - wanted) <= np.linalg.norm(best.x - wanted) + NEAR


def test_a_limited_range_of_tilt_is_kept():
    """A hexarotor whose arms tilt by 30 deg at most cannot push sideways with more than sin 30 deg of their thrust."""
    model = wg.load_model("tilt_hexarotor").vehicle
    arms, _ = model.geometry()
    small = replace(model, arms=replace(arms, tilt_min=np.full(6, -np.pi / 6), tilt_max=np.full(6, np.pi / 6)))
    reach = reach_of(small)
    weight = model.body.mass * GRAVITY
    assert reach.inside(np.array([0.2 * weight, 0, weight, 0, 0, 0]))
    sideways = np.array([weight, 0, 0.2 * weight, 0, 0, 0])
    assert not reach.inside(sideways)
    found, _ = reach.nearest(sideways)
    assert not limited_by_the_allocation(small, found)


def test_a_vehicle_without_rotors_has_a_stated_authority():
    vehicle = replace(wg.load_model("crazyflie").vehicle, arms=None, rotors=None)
    reach = reach_of(vehicle)
    weight = vehicle.body.mass * GRAVITY
    assert reach.authority[:3] == pytest.approx(THRUST_TO_WEIGHT * weight)
    lever = np.sqrt(np.linalg.eigvalsh(vehicle.body.inertia)[-1] / vehicle.body.mass)
    assert reach.authority[3:] == pytest.approx(THRUST_TO_WEIGHT * weight * lever)
    assert np.abs(reach.nearest(np.full(6, 1e300))[0]) == pytest.approx(reach.authority)


def compensations():
    model = wg.load_model("tilt_hexarotor")
    moved = model.with_effects([make_effect(model.vehicle, "com_offset", [0.004, -0.007, 0.005])])
    physics = PhysicsMismatch(moved.wrench_model, ("torque_x", "torque_y", "torque_z"))
    return {
        "newton": lambda: Compensator(physics, Settings(dt=0.005)),
        "lbfgs": lambda: Compensator(physics, Settings(dt=0.005, solver="lbfgs")),
        "observer": lambda: DisturbanceObserver(model.vehicle, 0.005),
        "combined": lambda: Combined(model.vehicle, 0.005, 2.0, Compensator(physics, Settings(dt=0.005))),
    }


HOVER = np.array([0, 0, 39.2266, 0, 0, 0])
GARBAGE = {
    "saturating": ([8.08, -9.5, 26.5, -17.2, 17.8, 14.6], REST),
    "huge": ([1e300] * 6, REST),
    "not a number": ([np.nan, 0, 39.2, 0, 0, 0], REST),
    "infinite": ([0, 0, np.inf, 0, 0, 0], REST),
    "rates of 1e6 rad/s": (HOVER, replace(REST, omega_B=np.full((1, 3), 1e6))),
    "velocity that is none": (HOVER, replace(REST, velocity_E=np.full((1, 3), np.nan))),
}


@pytest.mark.parametrize("kind", ["newton", "lbfgs", "observer", "combined"])
@pytest.mark.parametrize("garbage", GARBAGE)
def test_hover_after_garbage_is_hover_after_a_fresh_start(kind, garbage):
    one, fresh = (compensations()[kind]() for _ in range(2))
    wanted = fresh.step(HOVER, REST).wrench_cmd
    wrench, state = GARBAGE[garbage]
    try:
        said = one.step(wrench, state)
    except UsageError:
        assert not np.isfinite(wrench).all()
    else:
        assert reach_of(wg.load_model("tilt_hexarotor").vehicle).inside(said.wrench_cmd)
        assert said.limited or said.trouble
        assert np.all(np.abs(said.correction) <= one.correction_max)
    assert one.step(HOVER, REST).wrench_cmd == pytest.approx(wanted, abs=1e-6)


def test_the_correction_of_effects_is_at_most_half_of_the_authority():
    """A centre of mass 2 m off asks for 78 Nm, three times what the rotors have."""
    model = wg.load_model("tilt_hexarotor")
    broken = model.with_effects([make_effect(model.vehicle, "com_offset", [2.0, 0.0, 0.0])])
    one = Compensator(PhysicsMismatch(broken.wrench_model, ("torque_x", "torque_y", "torque_z")), Settings(dt=0.005))
    said = one.step(HOVER, REST)
    authority = reach_of(model.vehicle).authority
    assert not said.accepted
    assert np.all(np.abs(said.correction[3:]) <= SHARE * authority[3:])
    assert np.isfinite(one.correction_max).all()


def test_an_observer_does_not_learn_a_rate_that_jumps():
    """10 rad/s within 5 ms would take J omega / dt = 200 Nm: no vehicle, so the estimate stays."""
    one = DisturbanceObserver(wg.load_model("tilt_hexarotor").vehicle, 0.005)
    for _ in range(3):
        one.step(HOVER, REST)
    one.step(HOVER, replace(REST, omega_B=np.full((1, 3), 10.0)))
    assert one.estimate == pytest.approx(np.zeros(3), abs=1e-12)
    assert one.step(HOVER, REST).wrench_cmd == pytest.approx(HOVER, abs=1e-9)


def test_an_estimate_that_makes_every_demand_unreachable_is_given_up():
    """One sample of the gyroscope 0.6 rad/s off: the yaw of a quadrotor was commanded against its demand for ever."""
    vehicle = wg.load_model("asymmetric_quadrotor").vehicle
    dt, J = 0.01, vehicle.body.inertia
    weight = np.array([0, 0, vehicle.body.mass * GRAVITY, 0, 0, 0])
    one = Combined(vehicle, dt, 2.0, None, torque_max=0.3)
    omega, yaw, late = 0.0, 0.0, []
    for k in range(600):
        wanted = weight + np.array([0, 0, 0, 0, 0, np.clip(-0.2 * yaw - 0.2 * omega, -0.05, 0.05)])
        read = np.array([[0.0, 0.0, omega + 0.6 * (k == 100)]])
        said = one.step(wanted, replace(REST, omega_B=read))
        omega += dt * said.wrench_cmd[5] / J[2, 2]
        yaw += dt * omega
        late.append([said.limited, abs(one.estimate[2]), abs(omega)])
    limited, estimate, rate = np.array(late).T
    assert estimate[100:110].max() > 0.1
    assert limited[130:].sum() == 0
    assert max(estimate[-100:].max(), rate[-100:].max()) < 0.02


@pytest.mark.parametrize("stops", [(-200.0, 200.0), (-300.0, 300.0)])
@pytest.mark.parametrize("solver", ["newton", "onboard"])
def test_a_slow_somersault_of_the_thrust_leaves_no_arm_at_its_stop(stops, solver):
    """Every demand can be reached; afterwards hover is that of a fresh start, and the allocation makes it."""
    model = wg.load_model("tilt_hexarotor")
    arms = model.vehicle.arms
    wide = {"tilt_min": np.full(6, np.radians(stops[0])), "tilt_max": np.full(6, np.radians(stops[1]))}
    vehicle = replace(model.vehicle, arms=replace(arms, **wide))
    model = replace(model, vehicle=vehicle)
    model = model.with_effects([make_effect(vehicle, "com_offset", [0.004, -0.007, 0.005])])

    def made():
        return Compensator(PhysicsMismatch(model.wrench_model, TORQUES), Settings(dt=0.005, solver=solver))

    weight = vehicle.body.mass * GRAVITY
    one, allocation, before = made(), Allocation(vehicle), None
    angles = np.linspace(0.0, np.radians(229.0), 300)
    for angle in angles:
        said = one.step(weight * np.array([np.sin(angle), 0, np.cos(angle), 0, 0, 0]), REST)
        assert not said.limited
        before = allocation.allocate(about_origin(vehicle.body, said.wrench_cmd[None]), previous_tilt=before)[0].tilt[0]
    hover = np.array([0, 0, weight, 0, 0, 0])
    after = one.step(hover, REST).wrench_cmd
    assert after == pytest.approx(made().step(hover, REST).wrench_cmd, abs=1e-6)
    commands, saturation = allocation.allocate(about_origin(vehicle.body, after[None]), previous_tilt=before)
    assert saturation.tilt_range == 0
    assert nominal_wrench(vehicle, commands)[0] == pytest.approx(about_origin(vehicle.body, after[None])[0], abs=1e-6)


@pytest.mark.parametrize("voltage", [np.nan, np.inf, 1e300, None])
@pytest.mark.parametrize("observed", [False, True])
def test_a_voltage_that_is_none_leaves_nothing_behind(voltage, observed):
    model = wg.load_model("tilt_hexarotor")
    effects = {"battery_sag": [0.5, 0.02], "com_offset": [0.004, -0.007, 0.005]}
    model = model.with_effects([make_effect(model.vehicle, name, values) for name, values in effects.items()])
    hover = np.array([0, 0, model.vehicle.body.mass * GRAVITY, 0, 0, 0])
    powered = replace(REST, voltage=np.full(1, 15.0))

    def made():
        known = Compensator(PhysicsMismatch(model.wrench_model, TORQUES), Settings(dt=0.005))
        return Combined(model.vehicle, 0.005, 2.0, known) if observed else known

    one = made()
    one.step(hover + np.array([3.0, -4.0, 0.0, 1.0, -1.0, 0.5]), powered)
    odd = replace(REST, voltage=None if voltage is None else np.full(1, voltage))
    if voltage is None:
        with pytest.raises(UsageError, match="needs the voltage"):
            one.step(hover, odd)
    else:
        assert np.isnan(one.step(hover, odd).cost)
    fresh = made()
    if observed:
        fresh._observed.estimate[:] = one.estimate
    assert one.step(hover, powered).wrench_cmd == pytest.approx(fresh.step(hover, powered).wrench_cmd, abs=1e-6)


def test_a_vehicle_that_cannot_hover_is_not_compensated():
    """Thrust coefficients per rpm^2: a demand of the weight was answered with a thirtieth of it."""
    model = wg.load_model("tilt_hexarotor")
    rotors = model.vehicle.rotors
    weak = replace(model.vehicle, rotors=replace(rotors, c_f=rotors.c_f * (2 * np.pi / 60) ** 2))
    with pytest.raises(ModelError, match=r"cannot hover within its own limits.*check mass"):
        reach_of(weak)


@pytest.mark.parametrize(("lag", "delay"), [(0.03, 0.0), (0.0, 0.05), (0.03, 0.05)])
def test_an_observer_forgets_what_was_asked_before_a_refused_period(lag, delay):
    """A roll torque was asked for, then nothing for a thousand periods: it is not taken to be made still."""
    vehicle = wg.load_model("tilt_hexarotor").vehicle

    def made():
        return Combined(vehicle, 0.005, 4.0, None, lag=lag, delay=delay)

    one = made()
    for _ in range(30):
        one.step(HOVER + np.array([0, 0, 0, 0.4 * reach_of(vehicle).authority[3], 0, 0]), REST)
    for _ in range(1000):
        with pytest.raises(UsageError):
            one.step([np.nan] * 6, REST)
    fresh = made()
    fresh._observed.estimate[:] = one.estimate
    for _ in range(60):
        wanted = fresh.step(HOVER, REST).wrench_cmd
        assert one.step(HOVER, REST).wrench_cmd == pytest.approx(wanted, abs=1e-6)


@pytest.mark.parametrize("solver", ["newton", "lbfgs"])
def test_a_quaternion_that_turns_nothing_is_no_state(solver):
    model = wg.load_model("tilt_hexarotor")
    model = model.with_effects([make_effect(model.vehicle, "com_offset", [0.004, -0.007, 0.005])])
    one = Compensator(PhysicsMismatch(model.wrench_model, TORQUES), Settings(dt=0.005, solver=solver))
    said = one.step(HOVER, replace(REST, quat_EB=np.zeros((1, 4))))
    assert np.isnan(said.cost)
    assert np.all(said.correction == 0.0)
