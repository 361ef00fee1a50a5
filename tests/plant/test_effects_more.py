"""Physics of eighteen effects: conservation, dissipation, limits and closed forms, none taken from their code."""

from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.integrate import quad, solve_ivp

from wrenchgap.flight.so3 import exp, matrix, multiply, rotate, rotate_inverse
from wrenchgap.plant import model_file
from wrenchgap.plant.actuation import actuation
from wrenchgap.plant.effects import find
from wrenchgap.plant.effects.effect import Context
from wrenchgap.plant.model import make_effect
from wrenchgap.plant.state import Actuation, Commands, Motion, Rates, State
from wrenchgap.plant.vehicle import Arms, Body, Rotors, Vehicle
from wrenchgap.plant.wrench_model import WrenchModel

VEHICLE = model_file.load("tilt_hexarotor").vehicle
BODY = VEHICLE.body
MASS, L, G, C_F = 4.0, 0.3, 9.80665, 7.2e-6
HOVER = np.sqrt(MASS * G / (12 * C_F))
DT = 0.005
TURNED = exp(np.array([0.5, -0.8, 1.1]))


def state(count=1, *, position=(0, 0, 0), velocity=(0, 0, 0), omega=(0, 0, 0), quat=(1, 0, 0, 0), voltage=22.0):
    def tile(v):
        return np.tile(np.asarray(v, dtype=float), (count, 1))

    volts = np.broadcast_to(np.asarray(voltage, dtype=float), (count,))
    return State(np.arange(count) * DT, tile(position), tile(quat), tile(velocity), tile(omega), volts)


def commands(tilt=0.0, speed=HOVER, *, vehicle=VEHICLE):
    arms, rotors = vehicle.geometry()
    tilt = np.broadcast_to(np.asarray(tilt, dtype=float), (1, len(arms)))
    return Commands(np.zeros((1, 6)), tilt, np.broadcast_to(np.asarray(speed, dtype=float), (1, len(rotors))))


def only(rotor, speed=HOVER):
    """Speeds with one rotor running."""
    return np.where(np.arange(12) == rotor, speed, 0.0)


def model(name, values, vehicle=VEHICLE):
    return WrenchModel(vehicle, (make_effect(vehicle, name, values),))


def added(name, values, u=None, x=None, vehicle=VEHICLE):
    """What the effect adds to the wrench about O, (6,), in one sample."""
    u, x = u or commands(vehicle=vehicle), x or state()
    with_it, _ = model(name, values, vehicle).actuate(u, x, DT)
    without, _ = WrenchModel(vehicle).actuate(u, x, DT)
    return (with_it - without)[0]


def power(W, x):
    """Power [W] of a wrench about O on the moving body."""
    velocity_B = rotate_inverse(x.quat_EB, x.velocity_E)[0]
    return float(W[:3] @ velocity_B + W[3:] @ x.omega_B[0])


def moving(seed):
    """A random attitude, velocity and body rate, and tilt angles with speeds equal within each pair."""
    rng = np.random.default_rng(seed)
    x = state(quat=exp(rng.normal(size=3)), velocity=rng.normal(size=3) * 2, omega=rng.normal(size=3))
    return x, commands(rng.uniform(-1.5, 1.5, 6), np.repeat(rng.uniform(400, 900, 6), 2))


TYPICAL = {
    "mass": {"added": (0.05, 0.2)},
    "drag_torque": {"change": (0.1, 0.5)},
    "backlash": {"play": np.deg2rad((0.1, 0.5))},
    "arm_twist": {"twist": (0.3 / 300, 0.3 / 50)},
    "axial_inflow": {"k_z": (1e-4, 4e-4)},
    "translational_lift": {"k_h": (2e-3, 5e-3)},
    "rotor_drag": {"coefficient": (8e-5, 1.8e-4)},
    "rotational_drag": {"linear_x": (0.01, 0.1), "linear_z": (0.01, 0.1), "quadratic": (0.01, 0.1)},
    "ground_effect": {"gain": (1, 4)},
    "tether": {"force_x": (0.1, 1.0)},
    "wind": {"drag": (0.01, 0.5)},
    "imu_misalignment": {"x": np.deg2rad((0.5, 2.0))},
    "imu_lever_arm": {"x": (0.01, 0.05)},
    "rotor_gyroscopic": {"inertia": (3e-5, 6e-5)},
    "arm_reaction": {"inertia": (3.4e-4, 1e-3)},
    "downwash_blockage": {"loss": (0.03, 0.2)},
}
"""Sizes of the references on vehicles like this one; for the blockage C_D w / (pi R) of booms 1 to 5 cm wide."""


@pytest.mark.parametrize("name", TYPICAL)
def test_typical_sizes_are_those_of_this_class_of_vehicle(name):
    scale = {p.name: p.scale for p in find(name).parameters(VEHICLE)}
    for parameter, (low, high) in TYPICAL[name].items():
        assert low <= scale[parameter] <= high


# mass and payload


def test_heavier_vehicle_hovers_on_more_thrust_but_reports_its_nominal_weight():
    m = model("mass", {"added": 0.3})
    hovering = np.array([[0, 0, (MASS + 0.3) * G, 0, 0, 0]])
    np.testing.assert_allclose(m.motion(hovering, np.zeros((1, 3))).specific_force_B, [[0, 0, G]], atol=1e-12)
    np.testing.assert_allclose(m.report(hovering, state())[0, :3], [0, 0, MASS * G], atol=1e-9)


def test_mass_alone_does_not_change_how_torque_turns_the_body():
    W = np.array([[1.0, -2.0, 40.0, 0.1, 0.2, -0.3]])
    omega = np.array([[0.4, -0.5, 0.6]])
    turned = model("mass", {"added": 0.3}).motion(W, omega).omega_dot_B
    np.testing.assert_allclose(turned, WrenchModel(VEHICLE).motion(W, omega).omega_dot_B, atol=1e-12)


def cloud():
    """Six point masses with the vehicle's mass, centre of mass and (diagonal) inertia: positions, masses."""
    xx, yy, zz = np.diag(BODY.inertia)
    squared = 3 / MASS * np.array([yy + zz - xx, xx + zz - yy, xx + yy - zz]) / 2
    return np.vstack((np.diag(np.sqrt(squared)), -np.diag(np.sqrt(squared)))), np.full(6, MASS / 6)


def test_payload_is_one_more_point_in_a_cloud_of_points():
    points, masses = cloud()
    p, dm = np.array([0.12, -0.2, -0.15]), 0.35
    points, masses = np.vstack((points, p)), np.append(masses, dm)
    centre = masses @ points / masses.sum()
    inertia = sum(w * (r @ r * np.eye(3) - np.outer(r, r)) for w, r in zip(masses, points - centre, strict=True))
    body = model("payload", [dm, *p]).body
    assert body.mass == pytest.approx(MASS + dm)
    np.testing.assert_allclose(body.com_B, centre, atol=1e-12)
    np.testing.assert_allclose(body.inertia, inertia, atol=1e-12)


def test_payload_on_a_vehicle_whose_centre_of_mass_is_off():
    """Two bodies, each about its own centre, seen from a third place: what parallel axes say of O holds for both."""
    c, p, dm = np.array([0.02, 0.01, -0.03]), np.array([0.12, -0.2, -0.15]), 0.35
    alone = Body(MASS, BODY.inertia, c)
    loaded = find("payload").apply(alone, np.array([dm, *p]))

    def about_O(inertia, mass, r):
        return inertia + mass * (r @ r * np.eye(3) - np.outer(r, r))

    whole = about_O(loaded.inertia, loaded.mass, loaded.com_B)
    np.testing.assert_allclose(whole, about_O(BODY.inertia, MASS, c) + about_O(0, dm, p), atol=1e-12)


def test_payload_hangs_still_when_thrust_carries_it_and_torque_holds_it():
    """Statics about O: the torque that holds a weight at p is p x (upward force dm g)."""
    p, dm = np.array([0.12, -0.2, -0.15]), 0.35
    W = np.concatenate(([0, 0, (MASS + dm) * G], np.cross(p, [0, 0, dm * G])))
    motion = model("payload", [dm, *p]).motion(W[None], np.zeros((1, 3)))
    np.testing.assert_allclose(motion.omega_dot_B, 0, atol=1e-12)
    np.testing.assert_allclose(motion.specific_force_B, [[0, 0, G]], atol=1e-12)


# drag torque


def test_twice_the_drag_torque_is_the_drag_torque_once_more():
    """Rotor 1 turns counter-clockwise about its thrust; the body is turned clockwise, along -n."""
    assert VEHICLE.rotors.spin[1] == 1
    for tilt, n in ((0.0, [0, 0, 1]), (np.pi / 2, [0, -1, 0])):  # arm 0 along x: tilted, it thrusts along -y
        W = added("drag_torque", {"change": 1.0}, commands(tilt, only(1)))
        np.testing.assert_allclose(W[:3], 0, atol=1e-12)
        np.testing.assert_allclose(W[3:], -0.0165 * C_F * HOVER**2 * np.array(n), atol=1e-12)


def test_drag_torque_of_equal_pairs_cancels_at_any_tilt():
    _, u = moving(3)
    np.testing.assert_allclose(added("drag_torque", {"change": 0.7}, u), 0, atol=1e-12)


# downwash blockage


def blocked(tilt, loss=0.2):
    """Share of thrust that each arm loses, (6,)."""
    u = commands(tilt)
    act = actuation(VEHICLE, u)
    left = find("downwash_blockage").apply(act, np.array([loss]), Context(VEHICLE, state()))
    return 1 - (left / act.thrust)[0, ::2]


def test_level_rotors_blow_at_nothing():
    np.testing.assert_allclose(blocked(0.0), 0, atol=1e-12)


@pytest.mark.parametrize(("tilt", "side"), [(np.pi / 2, 1.0), (-np.pi / 2, -1.0), (1.0, 1.0)])
def test_blockage_is_the_integral_over_the_booms_downstream(tilt, side):
    """Arm 0 lies along x; tilted by +90 deg it thrusts along -y, so its wake leaves along +y, over arms 1 and 2."""
    hub, R, loss = np.array([L, 0, 0]), 0.115, 0.2
    wake = np.array([0, side * abs(np.sin(tilt)), -np.cos(tilt)])

    def density(s, along):
        apart = s * along - hub
        return np.exp(-np.sum(np.cross(wake, apart) ** 2) / R**2) if wake @ apart > 0 else 0.0

    booms = [np.array([np.cos(a), np.sin(a), 0]) for a in np.deg2rad([60, 120, 180, 240, 300])]
    expected = loss / R * sum(quad(density, 0, L, args=(boom,))[0] for boom in booms)
    only_first = np.where(np.arange(6) == 0, tilt, 0.0)
    lost = blocked(only_first, loss)
    assert lost[0] == pytest.approx(expected, rel=0.05)
    np.testing.assert_allclose(lost[1:], 0, atol=1e-12)


def test_wake_blows_away_from_the_thrust():
    """Of two arms, at 0 and 60 deg: the first blows at the second when it thrusts towards -y, not towards +y."""
    arms, rotors = VEHICLE.geometry()
    first = {f.name: getattr(arms, f.name)[:2] for f in fields(Arms)}
    four = {f.name: getattr(rotors, f.name)[:4] for f in fields(Rotors)}
    pair = Vehicle("pair", BODY, Arms(**first), Rotors(**four), np.zeros(3))
    for tilt, blocked_one in ((np.pi / 2, True), (-np.pi / 2, False)):
        u = commands([tilt, 0.0], vehicle=pair)
        thrusts_along_y = WrenchModel(pair).wrench(u, state())[0, 1]
        assert (thrusts_along_y < 0) == blocked_one
        left = find("downwash_blockage").apply(actuation(pair, u), np.array([0.2]), Context(pair, state()))
        assert (left[0, 0] < actuation(pair, u).thrust[0, 0]) == blocked_one


def test_tilting_further_blocks_more():
    shares = np.array([blocked(t).sum() for t in np.linspace(0, np.pi / 2, 10)])
    assert np.all(np.diff(shares) > 0)
    assert 0.001 < shares[-1] / 6 < 0.05


# backlash


def two_stops(servo, play):
    """An arm between two stops that the servo carries; it moves only when a stop touches and pushes it."""
    arm, path = servo[0], []
    for angle in servo:
        gap = angle - arm  # how far the servo's middle is ahead of the arm
        if gap > play / 2:
            arm += gap - play / 2
        elif gap < -play / 2:
            arm += gap + play / 2
        path.append(arm)
    return np.array(path)


def through_play(servo, play):
    count = len(servo)
    u = Commands(np.zeros((count, 6)), np.repeat(servo[:, None], 6, axis=1), np.full((count, 12), HOVER))
    return model("backlash", {"play": play}).command(u, state(count), DT)[0].tilt[:, 2]


ANGLES = arrays(float, st.integers(1, 60), elements=st.floats(-0.5, 0.5))
PLAY = st.floats(0.0, 0.4)


@given(ANGLES, PLAY)
def test_backlash_is_an_arm_between_two_stops(servo, play):
    np.testing.assert_allclose(through_play(servo, play), two_stops(servo, play), atol=1e-12)


@given(ANGLES, PLAY)
def test_backlash_stays_within_the_play_and_rests_inside_it(servo, play):
    arm = through_play(servo, play)
    assert np.all(np.abs(arm - servo) <= play / 2 + 1e-12)
    free = np.abs(servo[1:] - arm[:-1]) < play / 2
    np.testing.assert_array_equal(arm[1:][free], arm[:-1][free])


@given(ANGLES, PLAY)
def test_backlash_step_by_step_is_all_at_once(servo, play):
    m, memory, path = model("backlash", {"play": play}), None, []
    for angle in servo:
        moved, memory = m.command(commands(angle), state(), DT, memory)
        path.append(moved.tilt[0, 2])
    np.testing.assert_array_equal(path, through_play(servo, play))


def test_backlash_takes_the_play_off_the_travel():
    """Back and forth by +-A the arm travels +-(A - b/2), and after a reversal it waits for b."""
    servo = 0.1 * np.interp(np.arange(801) % 400, [0, 100, 300, 400], [0, 1, -1, 0])
    arm = through_play(servo, 0.03)
    assert arm[400:].max() == pytest.approx(0.085)
    assert arm[400:].min() == pytest.approx(-0.085)
    waiting = np.flatnonzero(np.abs(arm[500:700] - 0.085) < 1e-9)
    assert servo[500 + waiting[-1]] == pytest.approx(0.1 - 0.03)


# arm twist


@pytest.mark.parametrize("speed", [500.0, 900.0, -700.0])
def test_arm_is_a_torsion_spring(speed):
    """k dalpha = lever T. Arm 0 lies along x: turned by +dalpha its thrust leans towards -y; reversed, both flip."""
    stiffness, lever = 100.0, 0.2
    T = C_F * speed * abs(speed)
    W = added("arm_twist", {"twist": lever / stiffness}, commands(0.0, only(0, speed)))
    assert W[1] == pytest.approx(-T * np.sin(lever * T / stiffness), rel=1e-9)
    assert W[1] < 0


def test_twist_turns_about_the_arm_and_takes_no_thrust_away():
    W = WrenchModel(VEHICLE).wrench(commands(0.4, only(4, 800.0)), state())[0, :3]
    twisted = model("arm_twist", {"twist": 0.004}).actuate(commands(0.4, only(4, 800.0)), state(), DT)[0][0, :3]
    axis = VEHICLE.arms.axis_B[2]
    assert np.linalg.norm(twisted) == pytest.approx(np.linalg.norm(W))
    assert twisted @ axis == pytest.approx(0, abs=1e-12)
    angle = np.arctan2(np.cross(W, twisted) @ axis, W @ twisted)
    assert angle == pytest.approx(0.004 * C_F * 800.0**2)


# rotors in moving air


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("name", ["axial_inflow", "rotor_drag"])
def test_rotors_in_moving_air_damp_any_motion(name, seed):
    x, u = moving(seed)
    assert power(added(name, [2e-4], u, x), x) < 0


@pytest.mark.parametrize("quat", [(1.0, 0, 0, 0), TURNED])
def test_climbing_rotors_lose_thrust(quat):
    """Twelve rotors that climb along their thrust at 2 m/s, whatever the attitude."""
    x = state(quat=quat, velocity=rotate(np.asarray(quat, dtype=float), np.array([0, 0, 2.0])))
    expected = [0, 0, -12 * 2.3e-4 * HOVER * 2.0, 0, 0, 0]
    np.testing.assert_allclose(added("axial_inflow", [2.3e-4], x=x), expected, atol=1e-9)


def test_rolling_hexarotor_is_damped_by_its_rising_and_sinking_rotors():
    """sum y^2 over two rotors on each of six arms is 6 L^2."""
    W = added("axial_inflow", [2.3e-4], x=state(omega=(1.5, 0, 0)))
    np.testing.assert_allclose(W, [0, 0, 0, -2.3e-4 * HOVER * 1.5 * 6 * L**2, 0, 0], atol=1e-9)


def test_rotor_that_turns_backwards_is_damped_too():
    W = added("axial_inflow", [2.3e-4], commands(0.0, -HOVER), state(velocity=(0, 0, 2.0)))
    assert W[2] == pytest.approx(-12 * 2.3e-4 * HOVER * 2.0)


@pytest.mark.parametrize("heading", [0.0, 1.0, 2.5])
def test_level_flight_lifts_by_the_square_of_the_speed_in_every_direction(heading):
    velocity = 3.0 * np.array([np.cos(heading), np.sin(heading), 0])
    W = added("translational_lift", [3.4e-3], x=state(velocity=velocity))
    np.testing.assert_allclose(W, [0, 0, 12 * 3.4e-3 * 9.0, 0, 0, 0], atol=1e-9)


def test_translational_lift_needs_air_from_the_side():
    x = state(quat=TURNED, velocity=rotate(TURNED, np.array([0, 0, 3.0])))
    np.testing.assert_allclose(added("translational_lift", [3.4e-3], x=x), 0, atol=1e-9)


def test_translational_lift_leans_with_tilted_rotors():
    """All arms tilted by 90 deg thrust along the circle; climbing blows across them, and the yaw torque grows."""
    x, u = state(velocity=(0, 0, 3.0)), commands(np.pi / 2)
    nominal = WrenchModel(VEHICLE).wrench(u, x)[0, 5]
    assert nominal == pytest.approx(-L * MASS * G)
    assert added("translational_lift", [3.4e-3], u, x)[5] == pytest.approx(-L * 12 * 3.4e-3 * 9.0)


def test_backward_rotors_lift_backwards():
    W = added("translational_lift", [3.4e-3], commands(0.0, -HOVER), state(velocity=(3.0, 0, 0)))
    assert W[2] == pytest.approx(-12 * 3.4e-3 * 9.0)


def test_rotor_drag_against_level_flight_has_no_torque_about_the_middle():
    """The upper rotors pull as much above O as the lower ones below."""
    W = added("rotor_drag", [1e-4], x=state(quat=TURNED, velocity=rotate(TURNED, np.array([2.0, -1.0, 0]))))
    np.testing.assert_allclose(W, [-12e-4 * HOVER * 2.0, 12e-4 * HOVER, 0, 0, 0, 0], atol=1e-9)


def test_rotor_drag_lets_rotors_climb():
    x = state(quat=TURNED, velocity=rotate(TURNED, np.array([0, 0, 2.0])))
    np.testing.assert_allclose(added("rotor_drag", [1e-4], x=x), 0, atol=1e-12)


def test_rotor_drag_against_yaw():
    W = added("rotor_drag", [1e-4], x=state(omega=(0, 0, 1.2)))
    np.testing.assert_allclose(W, [0, 0, 0, 0, 0, -12e-4 * HOVER * 1.2 * L**2], atol=1e-9)


def test_rotor_drag_shows_in_yaw_as_in_flight_but_not_at_rest():
    effect = find("rotor_drag")
    assert effect.unexcited(Context(VEHICLE, state(5))) is not None
    assert effect.unexcited(Context(VEHICLE, state(5, omega=(0, 0, 1.5)))) is None
    assert effect.unexcited(Context(VEHICLE, state(5, velocity=(0, 0.5, 0)))) is None


# rotational drag


@pytest.mark.parametrize("seed", range(5))
def test_rotational_drag_takes_energy(seed):
    x, u = moving(seed)
    W = added("rotational_drag", [0.02, 0.03, 0.04, 0.03], u, x)
    np.testing.assert_allclose(W[:3], 0, atol=1e-12)
    assert W[3:] @ x.omega_B[0] < 0


@pytest.mark.parametrize(
    ("theta", "decay"),
    [
        ([0, 0, 0.04, 0], lambda t, J: np.exp(-0.04 * t / J)),
        ([0, 0, 0, 0.03], lambda t, J: 1 / (1 + 2.0 * 0.03 * t / J)),
    ],
)
def test_spinning_body_slows_down(theta, decay):
    """J domega = -d_1 omega is an exponential, J domega = -d_2 omega^2 a hyperbola."""
    m = model("rotational_drag", theta)
    still = commands(0.0, 0.0)

    def rate(_, omega):
        x = state(omega=omega)
        return m.motion(m.wrench(still, x), x.omega_B).omega_dot_B[0]

    spun = solve_ivp(rate, (0, 3.0), [0, 0, 2.0], rtol=1e-9, atol=1e-12).y[2, -1]
    assert spun == pytest.approx(2.0 * decay(3.0, BODY.inertia[2, 2]), rel=1e-6)


# ground effect


def lift_at(height, quadrotor, gain=1.0, quat=(1, 0, 0, 0)):
    u = commands(0.0, 700.0, vehicle=quadrotor)
    x = state(position=(0, 0, height), quat=quat)
    grown = model("ground_effect", {"gain": gain}, quadrotor).wrench(u, x)[0]
    return grown, 4 * C_F * 700.0**2


def test_cheeseman_and_bennett_at_one_and_two_radii(quadrotor):
    R = 0.115
    for radii, ratio in ((1.0, 16 / 15), (2.0, 64 / 63)):
        W, thrust = lift_at(radii * R, quadrotor)
        assert W[2] / thrust == pytest.approx(ratio)


def test_ground_effect_falls_with_height_and_is_gone_high_up(quadrotor):
    lift = np.array([lift_at(z, quadrotor, 3.0)[0][2] for z in np.linspace(0.0, 2.0, 60)])
    assert np.all(np.diff(lift) <= 0)
    assert np.all(np.isfinite(lift))
    W, thrust = lift_at(20.0, quadrotor, 3.0)
    assert W[2] / thrust == pytest.approx(1.0, abs=1e-5)


def test_ground_below_the_origin_of_the_odometry_is_farther_away(quadrotor):
    u = commands(0.0, 700.0, vehicle=quadrotor)
    low = model("ground_effect", {"gain": 1.0, "ground": -0.1}, quadrotor).wrench(u, state(position=(0, 0, 0.13)))
    np.testing.assert_allclose(low[0], lift_at(0.23, quadrotor)[0])


def test_ground_rights_a_rolled_vehicle(quadrotor):
    """Rolled by +5 deg the right side (-y) is lower and lifts more: torque about -x."""
    W, _ = lift_at(0.2, quadrotor, 1.0, exp(np.array([np.deg2rad(5), 0, 0])))
    assert W[3] < -1e-3
    assert W[4] == pytest.approx(0, abs=1e-9)


# battery


@pytest.mark.parametrize(("volts", "share"), [(25.0, 1.0), (24.0, (24 / 25) ** 2), (22.5, (22.5 / 25) ** 2)])
def test_open_loop_rotors_follow_the_square_of_the_voltage(volts, share):
    """To first order in the sag, with k = 2; V_0 = 25 V."""
    W = added("battery_sag", {"sensitivity": 2.0, "per_volt": 2.0 / 25}, x=state(voltage=volts))
    sag = 1 - volts / 25
    assert W[2] / (MASS * G) == pytest.approx(share - 1, abs=1.01 * sag**2 + 1e-12)
    assert W[2] / (MASS * G) == pytest.approx(-2 * sag, abs=1e-9)


def test_sag_takes_torque_and_side_force_alike():
    _, u = moving(8)
    nominal = WrenchModel(VEHICLE).wrench(u, state())[0]
    W = added("battery_sag", {"sensitivity": 0.8, "per_volt": 0.8 / 24}, u, state(voltage=21.0))
    np.testing.assert_allclose(W, -0.1 * nominal, atol=1e-9)


# tether and wind


@pytest.mark.parametrize("seed", range(5))
def test_tether_pulls_in_the_world_and_works_where_its_point_moves(seed):
    """Power of the wrench is the force times the velocity of the attachment point, differentiated numerically."""
    rng = np.random.default_rng(seed)
    F, p = rng.normal(size=3), rng.normal(size=3) * 0.2
    x, u = moving(seed)
    W = added("tether", [*F, *p], u, x)
    np.testing.assert_allclose(rotate(x.quat_EB[0], W[:3]), F, atol=1e-12)
    h = 1e-5

    def point(t):
        turned = multiply(x.quat_EB[0], exp(x.omega_B[0] * t))
        return x.velocity_E[0] * t + rotate(turned, p)

    velocity = (point(h) - point(-h)) / (2 * h)
    assert power(W, x) == pytest.approx(F @ velocity, rel=1e-6)


def test_tether_through_the_origin_makes_no_torque():
    F = np.array([0.4, -0.3, 0.8])
    W = added("tether", [*F, *(0.25 * rotate_inverse(TURNED, F))], x=state(quat=TURNED))
    np.testing.assert_allclose(W[3:], 0, atol=1e-12)
    assert np.linalg.norm(W[:3]) == pytest.approx(np.linalg.norm(F))


def test_weight_on_a_string_needs_the_support_of_a_payload():
    p, dm, x = np.array([0.12, -0.2, -0.15]), 0.35, state(quat=TURNED)
    up = rotate_inverse(TURNED, np.array([0, 0, 1.0]))
    support = np.concatenate(((MASS + dm) * G * up, np.cross(p, dm * G * up)))
    pulled = support + added("tether", [0, 0, -dm * G, *p], x=x)
    hanging = WrenchModel(VEHICLE).motion(pulled[None], np.zeros((1, 3)))
    carried = model("payload", [dm, *p]).motion(support[None], np.zeros((1, 3)))
    for motion in (hanging, carried):
        np.testing.assert_allclose(motion.omega_dot_B, 0, atol=1e-12)
        np.testing.assert_allclose(motion.specific_force_B[0], G * up, atol=1e-12)


D_WIND, V_WIND = 0.3, np.array([2.0, -1.5, 0.0])
WIND = [D_WIND, *(D_WIND * V_WIND[:2])]


def test_drifting_with_the_wind_feels_nothing():
    np.testing.assert_allclose(added("wind", WIND, x=state(velocity=V_WIND, quat=TURNED)), 0, atol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_wind_blows_the_vehicle_towards_its_own_velocity(seed):
    x, u = moving(seed)
    force_E = rotate(x.quat_EB[0], added("wind", WIND, u, x)[:3])
    assert force_E @ (x.velocity_E[0] - V_WIND) < 0
    assert np.linalg.norm(force_E) == pytest.approx(D_WIND * np.linalg.norm(x.velocity_E[0] - V_WIND))


def test_standing_in_the_wind_is_pushed_downwind():
    force_E = rotate(TURNED, added("wind", WIND, x=state(quat=TURNED))[:3])
    np.testing.assert_allclose(force_E, D_WIND * V_WIND, atol=1e-12)


# sensors


def test_imu_turned_nose_down_reads_lift_as_a_pull_backwards():
    """Turned by +e about y its x axis points below the horizon, so that hover shows as a negative x force."""
    W = model("imu_misalignment", {"y": 0.02}).report(np.array([[0, 0, MASS * G, 0, 0, 0]]), state())[0]
    assert W[0] == pytest.approx(-MASS * G * 0.02)
    assert W[2] == pytest.approx(MASS * G)


def test_misalignment_is_a_rotation_to_second_order():
    rng = np.random.default_rng(2)
    motion = Motion(*rng.normal(size=(3, 40, 3)))
    direction, errors = np.array([0.6, -0.5, 0.62]), []
    for angle in (0.08, 0.04, 0.02):
        read = model("imu_misalignment", angle * direction).read_imu(motion, state(40))
        turned = exp(angle * direction)
        errors.append(
            max(
                np.abs(getattr(read, n) - rotate_inverse(turned, getattr(motion, n))).max()
                for n in ("omega_B", "omega_dot_B", "specific_force_B")
            )
        )
    np.testing.assert_allclose(np.log2(np.array(errors[:-1]) / errors[1:]), 2.0, atol=0.05)
    assert errors[-1] < 1e-3


def test_accelerometer_away_from_its_place_moves_with_the_body():
    """Second derivative of the path of a point on a body that tumbles, against the derivative of the path of O."""
    r = np.array([0.03, -0.02, 0.05])

    def quat(t):
        return multiply(exp(np.array([0.5, 1.0, -0.3]) * np.sin(2 * t)), exp(np.array([0.2, -0.4, 0.9]) * t**2))

    def path(t):
        return matrix(quat(t)) @ r

    def omega(t, h=1e-4):
        dR = (matrix(quat(t + h)) - matrix(quat(t - h))) / (2 * h)
        S = matrix(quat(t)).T @ dR
        return np.array([S[2, 1], S[0, 2], S[1, 0]])

    t, h = 0.7, 1e-3
    acceleration_E = (path(t + h) - 2 * path(t) + path(t - h)) / h**2
    motion = Motion(omega(t)[None], ((omega(t + h) - omega(t - h)) / (2 * h))[None], np.array([[0.1, 0.2, 9.8]]))
    read = model("imu_lever_arm", r).read_imu(motion, state())
    felt = read.specific_force_B[0] - motion.specific_force_B[0]
    assert np.linalg.norm(felt) > 0.1
    np.testing.assert_allclose(felt, matrix(quat(t)).T @ acceleration_E, atol=2e-5)
    np.testing.assert_array_equal(read.omega_B, motion.omega_B)


# angular momentum inside the body


def arm_angles(t):
    """Tilt (6,), its rate and acceleration at time t."""
    amplitude, rate = np.array([0.8, -0.5, 0.3, 0.9, -0.2, 0.6]), np.array([2.0, 3.0, 1.5, 2.5, 4.0, 1.0])
    s, c = np.sin(rate * t), np.cos(rate * t)
    return amplitude * (1 - c), amplitude * rate * s, amplitude * rate**2 * c


def rotor_speeds(t):
    """Speeds (12,) and their rates, unequal within pairs."""
    amplitude, rate = np.linspace(20, 250, 12), np.linspace(1, 4, 12)
    return 600 + amplitude * np.sin(rate * t), amplitude * rate * np.cos(rate * t)


def inside(t, J_rotor, J_arm):
    """Angular momentum (3,) that rotors and arms have relative to the body."""
    alpha, dalpha, _ = arm_angles(t)
    speed, _ = rotor_speeds(t)
    h = np.zeros(3)
    for i, azimuth in enumerate(np.deg2rad(60.0 * np.arange(6))):
        a = np.array([np.cos(azimuth), np.sin(azimuth), 0])
        n = np.cos(alpha[i]) * np.array([0, 0, 1]) + np.sin(alpha[i]) * np.cross(a, [0, 0, 1])
        for r in (2 * i, 2 * i + 1):
            h += VEHICLE.rotors.spin[r] * J_rotor * speed[r] * n
        h += J_arm * dalpha[i] * a
    return h


def tumble(name, inertia, omega_0, duration=1.5):
    """Free body with moving arms and rotors, nothing but the effect acting: final attitude and body rate."""
    effect, J = find(name), BODY.inertia

    def rate(t, y):
        quat, omega = y[:4], y[4:]
        alpha, dalpha, d2alpha = arm_angles(t)
        speed, dspeed = rotor_speeds(t)
        rates = Rates(dalpha[None], d2alpha[None], dspeed[None])
        act = Actuation(VEHICLE, alpha[None], speed[None], np.zeros((1, 12)), rates)
        x = state(quat=quat, omega=omega)
        M = effect.apply(act, np.zeros((1, 6)), np.array([inertia]), Context(VEHICLE, x))[0]
        assert not M[:3].any()
        domega = np.linalg.solve(J, M[3:] - np.cross(omega, J @ omega))
        return np.concatenate((0.5 * multiply(quat, np.append(0.0, omega)), domega))

    y = solve_ivp(rate, (0, duration), [1, 0, 0, 0, *omega_0], rtol=1e-8, atol=1e-10).y[:, -1]
    return y[:4] / np.linalg.norm(y[:4]), y[4:]


@pytest.mark.parametrize(("name", "J_rotor", "J_arm"), [("rotor_gyroscopic", 2e-3, 0), ("arm_reaction", 0, 0.02)])
@pytest.mark.parametrize("omega_0", [(0, 0, 0), (1.0, -2.0, 1.5)])
def test_total_angular_momentum_is_conserved(name, J_rotor, J_arm, omega_0):
    """Body plus rotors plus arms, in E, however they move against each other. Exaggerated inertias."""
    quat, omega = tumble(name, J_rotor or J_arm, omega_0)
    start = BODY.inertia @ np.array(omega_0) + inside(0.0, J_rotor, J_arm)
    end = rotate(quat, BODY.inertia @ omega + inside(1.5, J_rotor, J_arm))
    assert np.linalg.norm(omega - omega_0) > 0.05  # the parts do push the body about
    np.testing.assert_allclose(end, start, atol=1e-6)


def test_gyroscopic_torque_of_steady_rotors_does_no_work():
    x = state(omega=(0.7, -1.1, 0.4))
    W = added("rotor_gyroscopic", [4e-5], commands(0.3, 300 + 50 * np.arange(12) ** 1.5 / 3), x)
    assert np.linalg.norm(W[3:]) > 1e-4
    assert W[3:] @ x.omega_B[0] == pytest.approx(0, abs=1e-12)


def test_equal_pairs_have_no_gyroscopic_torque():
    x, u = moving(4)
    np.testing.assert_allclose(added("rotor_gyroscopic", [4e-5], u, x), 0, atol=1e-12)


def test_pitching_arms_turn_the_body_back():
    """Arms 0 (+x) and 3 (-x) swung by +-d turn the body about x by -2 J_a d / J, then everything rests."""
    count = 400
    s = np.linspace(0, 1, count)
    swing = 0.8 * (s - np.sin(2 * np.pi * s) / (2 * np.pi))
    tilt = np.outer(swing, [1, 0, 0, -1, 0, 0])
    u = Commands(np.zeros((count, 6)), tilt, np.zeros((count, 12)))
    torque = model("arm_reaction", [1e-3]).actuate(u, state(count), DT)[0][:, 3:]
    np.testing.assert_allclose(torque[:, 1:], 0, atol=1e-12)
    rate = np.cumsum(torque[:, 0]) * DT / BODY.inertia[0, 0]
    turned = np.sum(rate) * DT
    assert turned == pytest.approx(-2 * 1e-3 * 0.8 / BODY.inertia[0, 0], rel=1e-4)
    assert rate[-1] == pytest.approx(0, abs=1e-4 * np.abs(rate).max())
