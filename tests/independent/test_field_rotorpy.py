"""RotorPy under the field's glue: frames, signs and units, asked of what a user of the log would compute from it."""

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="the hexarotor's engine needs MuJoCo (a development dependency)")
pytest.importorskip("rotorpy", reason="RotorPy is not installed; run: pip install -e '.[benchmark]'")

from scipy.spatial.transform import Rotation

from benchmarks.field import oracle, quadrotor
from benchmarks.field.cases import Case
from benchmarks.field.craft import Craft, start
from benchmarks.field.engine import fly, recorded
from benchmarks.field.flying import RATE
from benchmarks.field.hidden import HIDDEN, build
from benchmarks.field.judge import flown
from benchmarks.field.outside import Slosh, SlungLoad
from benchmarks.field.truth import Truth
from benchmarks.field.vehicles import GRAVITY, VEHICLES, vehicle
from wrenchgap import open_flights

FLOWN_BY_ROTORPY = [name for name in VEHICLES if name != "hexa"]
QUAD = vehicle("quad")


def wrenches(truth, kind="excited", seconds=3.0, seed=1):
    """Wrench measured from true readings with the model's mass and inertia about O, and the one commanded (N, 6)."""
    seen = fly(truth, kind, seconds, seed)
    J, w = np.array(truth.vehicle.inertia), seen.imu[:, :3]
    force, torque = truth.vehicle.mass * seen.imu[:, 3:6], J * seen.imu[:, 6:] + np.cross(w, J * w)
    before = np.vstack((seen.commanded[:1], seen.commanded[:-1]))
    return np.hstack((force, torque)), (seen.commanded + before) / 2.0, seen


@pytest.mark.parametrize("name", FLOWN_BY_ROTORPY)
def test_with_nothing_hidden_the_measured_wrench_is_the_commanded_one(name):
    measured, commanded, _ = wrenches(Truth(vehicle(name)), seconds=1.0)
    scale = np.abs(commanded).max(axis=0) + 1e-9
    assert (np.abs(measured - commanded)[1:] / scale.max()).max() < 1e-6


@pytest.mark.parametrize("name", FLOWN_BY_ROTORPY)
def test_a_hovering_vehicle_feels_its_weight_upwards(name):
    seen = fly(Truth(vehicle(name)), "turbulence", 0.5, 1)
    np.testing.assert_allclose(seen.imu[1:, 3:6], [[0.0, 0.0, GRAVITY]] * (len(seen.imu) - 1), atol=1e-6)
    weight = vehicle(name).mass * GRAVITY
    np.testing.assert_allclose(seen.commanded[1:], [[0, 0, weight, 0, 0, 0]] * (len(seen.imu) - 1), atol=1e-6 * weight)


def test_a_mass_five_per_cent_larger_needs_that_much_more_thrust_than_the_model_feels():
    measured, commanded, _ = wrenches(Truth(QUAD).with_params(mass=1.05 * QUAD.mass), seconds=1.0)
    np.testing.assert_allclose(1.05 * measured[1:, :3], commanded[1:, :3], atol=1e-6)
    np.testing.assert_allclose(measured[1:, 3:], commanded[1:, 3:], atol=1e-6)


def test_gyroscope_and_accelerometer_are_the_derivatives_of_the_recorded_motion():
    """A turned, displaced IMU would not be; here it is O's own."""
    truth = build(Truth(QUAD), ("beside", "weak_rotor"), (1.0, 1.0), 3)
    flight = recorded(fly(truth, "excited", 1.5, 1), truth, "x")
    odometry, imu = flight.odometry, flight.imu
    R = Rotation.from_quat(odometry.quat_EB, scalar_first=True)
    rate = (R[:-2].inv() * R[2:]).as_rotvec() * RATE / 4.0
    np.testing.assert_allclose(rate, odometry.omega_B[1:-1], atol=0.01)
    speed = (odometry.position_E[2:] - odometry.position_E[:-2]) * RATE / 4.0
    np.testing.assert_allclose(speed, odometry.velocity_E[1:-1], atol=0.01)
    change = (odometry.velocity_E[2:] - odometry.velocity_E[:-2]) * RATE / 4.0 + [0.0, 0.0, GRAVITY]
    felt = R[1:-1].apply(change, inverse=True)
    between = [np.interp(odometry.time[1:-1], imu.time, imu.specific_force_B[:, k]) for k in range(3)]
    np.testing.assert_allclose(felt, np.transpose(between), atol=0.25)  # the command's steps within 20 ms


def test_a_weak_rotor_lets_its_corner_sink():
    """Rotor 0 is front left: less thrust there is a torque to the left (-x) and forward (+y)."""
    craft = Craft(Truth(QUAD).but(gains=np.array([0.9, 1.0, 1.0, 1.0])))
    v_dot, w_dot = craft.accelerations(start(craft.truth, np.array((0.0, 0.0, 2.0))))
    lost = 0.1 * QUAD.mass * GRAVITY / 4
    x, y, _ = QUAD.places_B[0]
    drag = 0.1 * QUAD.k_m * QUAD.hover_speed**2 * QUAD.directions[0]
    np.testing.assert_allclose(v_dot, [0.0, 0.0, -lost / QUAD.mass], atol=1e-9)
    np.testing.assert_allclose(w_dot * QUAD.inertia, [-y * lost, x * lost, -drag], atol=1e-9)


def test_a_centre_of_mass_in_front_pitches_the_nose_down_and_o_is_what_moves():
    com = np.array((0.01, 0.0, 0.0))
    craft = Craft(Truth(QUAD).but(com_B=com))
    state = start(craft.truth, np.array((0.0, 0.0, 2.0)))
    np.testing.assert_allclose(craft.of_origin(state)[0], [0.0, 0.0, 2.0])
    _, w_dot = craft.accelerations(state)
    np.testing.assert_allclose(w_dot * QUAD.inertia, [0.0, 0.01 * QUAD.mass * GRAVITY, 0.0], atol=1e-9)
    felt = craft.imu(state)[3:6]  # O, behind the centre of mass, goes up as the nose goes down
    np.testing.assert_allclose(felt, [0.0, 0.0, GRAVITY + 0.01 * w_dot[1]], atol=1e-9)


def test_wind_from_behind_pushes_forward_and_drag_brakes():
    truth = build(Truth(QUAD), ("rotor_drag",), (1.0,), 1)
    place = np.array((0.0, 0.0, 2.0))
    blown = Craft(truth.but(wind_E=np.array((3.0, 0.0, 0.0))))
    v_dot, _ = blown.accelerations(start(blown.truth, place))
    assert v_dot[0] == pytest.approx(3.0 * 0.025 * GRAVITY, rel=1e-6)
    craft = Craft(truth)
    moving = {**start(truth, place), "v": np.array((3.0, 0.0, 0.0))}
    assert craft.accelerations(moving)[0][0] == pytest.approx(-3.0 * 0.025 * GRAVITY, rel=1e-6)


def test_an_imu_that_is_turned_and_moved_reads_what_it_would_there():
    turn, lever = np.array((0.0, 0.02, 0.0)), np.array((0.1, 0.0, 0.0))
    craft = Craft(Truth(QUAD).but(imu_rotvec=turn, imu_B=lever))
    state = {**start(craft.truth, np.array((0.0, 0.0, 2.0))), "w": np.array((0.0, 0.0, 2.0))}
    rate, felt = np.split(craft.imu(state)[:6], 2)
    back = Rotation.from_rotvec(turn).inv()
    np.testing.assert_allclose(rate, back.apply([0.0, 0.0, 2.0]), atol=1e-12)
    np.testing.assert_allclose(felt, back.apply([-0.1 * 4.0, 0.0, GRAVITY]), atol=1e-9)


def test_a_parcel_adds_its_own_weight_lever_and_inertia():
    """Against the parallel axis theorem about O, of both bodies."""
    truth = build(Truth(QUAD), ("parcel",), (1.0,), 5)
    mass, com = truth.param("mass"), truth.com_B
    added = mass - QUAD.mass
    at = com * mass / added
    about_O = {k: truth.param(k) + mass * (com @ com - com["xyz".index(k[1])] ** 2) for k in ("Ixx", "Iyy", "Izz")}
    for k, (name, moment) in enumerate(about_O.items()):
        assert moment == pytest.approx(QUAD.inertia[k] + added * (at @ at - at[k] ** 2), rel=1e-9), name
    assert truth.param("Ixy") - mass * com[0] * com[1] == pytest.approx(-added * at[0] * at[1], rel=1e-9)


def test_rotors_that_lag_and_commands_that_queue_are_what_the_log_shows_them_to_be():
    truth = Truth(QUAD).but(tau=(0.05, 0.05), delay=3)
    measured, _, seen = wrenches(truth, seconds=1.5)
    speed = np.vstack([QUAD.hover_speed * np.ones(4)] + [seen.speed[0]] * 3 + [*seen.speed])[: len(seen.speed)]
    out = np.empty_like(speed)
    out[0] = QUAD.hover_speed
    for k in range(1, len(out)):  # exact for a held command
        out[k] = speed[k] + (out[k - 1] - speed[k]) * np.exp(-1.0 / RATE / 0.05)
    thrust = QUAD.k_eta * (out**2).sum(axis=1)
    np.testing.assert_allclose(measured[5:, 2], thrust[5:], rtol=2e-4)


def test_the_oracle_s_wrench_is_the_flown_one_and_an_effect_that_is_not_there_cannot_be_told():
    bare, effects = Truth(QUAD).but(gusts=0.5), ("beside", "wind", "slow_motors")
    truth = build(bare, effects, (1.0,) * 3, 5)
    seen = fly(truth, "excited", 1.2, 1)
    J, k = np.array(QUAD.inertia), np.arange(oracle.EVERY, len(seen.speed), oracle.EVERY)
    w = seen.imu[k, :3]
    flown_wrench = np.hstack((QUAD.mass * seen.imu[k, 3:6], J * seen.imu[k, 6:] + np.cross(w, J * w)))
    np.testing.assert_allclose(oracle.wrenches(truth, seen), flown_wrench, atol=2e-3)
    sizes = oracle.amplitudes(bare, effects, (1.0, 1.0, 0.0), 5, seen, "good")
    assert min(sizes[:2]) > 1.0
    assert sizes[2] == 0.0


def test_an_effect_is_told_less_well_by_a_worse_imu():
    bare = Truth(QUAD)
    seen = fly(build(bare, ("beside",), (1.0,), 5), "excited", 1.0, 1)
    good, cheap = (oracle.amplitudes(bare, ("beside",), (1.0,), 5, seen, imu)[0] for imu in ("good", "cheap"))
    assert good > cheap > 0.0


@pytest.mark.slow
@pytest.mark.parametrize("name", [n for n, h in HIDDEN.items() if "low" not in h.flying])
def test_every_hidden_effect_leaves_a_trace_and_the_vehicle_in_the_air(name):
    truth = build(Truth(vehicle("x8")), (name,), (1.0,), 2)
    kind = HIDDEN[name].flying[0]
    measured, commanded, _ = wrenches(truth, kind, 1.2 if kind == "excited" else 3.5)
    weight = vehicle("x8").mass * GRAVITY
    gap = (measured - commanded) / np.repeat((weight, 0.25 * weight), 3)
    assert 2e-4 < np.sqrt((gap[60:] ** 2).mean(axis=0)).max() < 0.5


def test_ground_lifts_by_cheesemans_and_bennetts_factor():
    craft = Craft(build(Truth(QUAD), ("ground",), (1.0,), 1))
    v_dot, _ = craft.accelerations(start(craft.truth, np.array((0.0, 0.0, QUAD.radius))))
    assert v_dot[2] == pytest.approx(GRAVITY * (1.0 / (1.0 - 1.0 / 16.0) - 1.0), rel=1e-6)


def test_a_load_on_a_rope_hangs_with_its_weight_and_does_not_push():
    load, level = SlungLoad(0.1, 0.5), {"q": np.array((0.0, 0.0, 0.0, 1.0))}
    place = np.array((0.0, 0.0, 2.0))
    force, _ = load.step(0.005, place, np.zeros(3), level, np.zeros(3))
    np.testing.assert_allclose(force, [0.0, 0.0, -0.1 * GRAVITY], atol=1e-6)
    fallen, _ = load.step(0.005, place - (0.0, 0.0, 0.4), np.zeros(3), level, np.zeros(3))
    np.testing.assert_array_equal(fallen, 0.0)


def test_a_sloshing_mass_at_rest_asks_for_nothing_and_an_accelerated_one_lags():
    def held_by(reading):
        return Slosh(0.3, 1.5, 0.1).step(0.005, *[np.zeros(3)] * 2, {}, np.array(reading))

    up, still = GRAVITY, (0.0, 0.0, 0.0)
    np.testing.assert_array_equal(held_by((*still, 0.0, 0.0, up, *still)), np.zeros((2, 3)))
    force, _ = held_by((*still, 1.0, 0.0, up, *still))
    assert force[0] == pytest.approx(0.3, rel=0.05)  # it stays behind: the hull is lighter by it
    force, _ = held_by((*still, 0.0, 0.0, up, 0.0, 2.0, 0.0))  # nose down: the tank, 0.1 m below, is moved back
    assert force[0] == pytest.approx(-0.3 * 0.2, rel=0.05)


def test_a_vehicle_of_which_the_wrench_alone_is_known_shows_no_rotors():
    flight, _, model = flown(Case("blind", "excited", "good", "one", ("heavier",), (1.0,), 4, 2.5))
    assert flight.actuators is None
    assert not model.vehicle.has_rotors
    record = open_flights(flight, model)[0].records[0]
    assert np.isfinite(record.commanded).all()


def test_flights_are_repeatable_and_the_log_has_what_was_hidden_in_it():
    case = Case("nano", "turbulence", "cheap", "one", ("battery",), (1.0,), 4, 1.5)
    (one, told, _), (other, _, _) = flown(case), flown(case)
    assert one.content_hash == other.content_hash
    assert one.battery is not None
    assert np.all(np.diff(one.battery.voltage) < 0)
    assert told.answers == ((frozenset({"battery_sag"}), frozenset({"thrust_fade"})),)
    assert quadrotor.surroundings(case).gusts > 0
