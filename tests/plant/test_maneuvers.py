"""Moves: derivatives against differences, geometry against scipy's rotations, what every move promises."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wrenchgap.flight.errors import UsageError
from wrenchgap.plant.trajectory.maneuvers import KINDS, Moves, Shake, Shift, Swing, Tilt, Turn
from wrenchgap.plant.vehicle import GRAVITY

HOME = (0.1, -0.2, 1.5)
EVERYTHING = (
    Tilt(1.0, 10.0, np.radians(70.0), np.radians(30.0), 2.0, np.radians(300.0)),
    Turn(2.0, 15.0, np.radians(400.0)),
    Tilt(11.0, 6.0, np.radians(120.0), np.radians(90.0), 1.5),
    Shift(12.0, 9.0, (0.3, 0.0, -1.0)),
    Swing(5.0, 12.0, (1.0, 0.2, 0.0), 3.0, np.radians(90.0)),
    Shake(18.0, 10.0, 0.05, np.radians(5.0), 0.2, 3.0),
)


def rotations(trajectory, time):
    return Rotation.from_quat(trajectory.at(time).quat_ED, scalar_first=True)


def test_rates_and_accelerations_are_the_derivatives():
    flight = Moves(30.0, HOME, EVERYTHING)
    time, h = np.linspace(0.01, 29.9, 1500), 1e-4
    now, before, after = (flight.at(time + s) for s in (0.0, -h, h))
    np.testing.assert_allclose((after.position_E - before.position_E) / (2 * h), now.velocity_E, atol=1e-6)
    np.testing.assert_allclose((after.velocity_E - before.velocity_E) / (2 * h), now.acceleration_E, atol=2e-3)
    turned = (rotations(flight, time - h).inv() * rotations(flight, time + h)).as_rotvec() / (2 * h)
    np.testing.assert_allclose(turned, now.omega_D, atol=1e-5)
    np.testing.assert_allclose((after.omega_D - before.omega_D) / (2 * h), now.omega_dot_D, atol=2e-2)


@pytest.mark.parametrize("move", EVERYTHING, ids=lambda m: m.kind)
def test_every_move_begins_and_ends_at_rest_and_all_but_a_turn_come_back(move):
    flight = Moves(30.0, HOME, (move,))
    ends = flight.at(np.array([move.start, move.stop]))
    for part in (ends.velocity_E, ends.acceleration_E, ends.omega_D, ends.omega_dot_D):
        np.testing.assert_allclose(part, 0.0, atol=1e-9)
    np.testing.assert_allclose(ends.position_E, [HOME, HOME], atol=1e-12)
    if not isinstance(move, Turn):
        np.testing.assert_allclose(np.abs(ends.quat_ED[:, 0]), 1.0, atol=1e-12)


@pytest.mark.parametrize(("azimuth", "towards"), [(0.0, [1, 0]), (90.0, [0, 1]), (225.0, [-np.sqrt(0.5)] * 2)])
def test_a_tilt_leans_body_z_towards_its_azimuth(azimuth, towards):
    flight = Moves(10.0, HOME, (Tilt(0.0, 10.0, np.radians(40.0), np.radians(azimuth)),))
    (z,) = rotations(flight, np.array([5.0])).apply([0.0, 0.0, 1.0])
    lean, up = np.sin(np.radians(40.0)), np.cos(np.radians(40.0))
    np.testing.assert_allclose(z, [lean * towards[0], lean * towards[1], up], atol=1e-12)


def test_a_sweep_carries_the_lean_round_and_leaves_the_heading():
    flight = Moves(10.0, HOME, (Tilt(0.0, 10.0, np.radians(40.0), 0.0, 2.0, 2 * np.pi),))
    z = rotations(flight, np.linspace(2.0, 8.0, 200)).apply([0.0, 0.0, 1.0])
    np.testing.assert_allclose(z[:, 2], np.cos(np.radians(40.0)))
    assert np.ptp(np.unwrap(np.arctan2(z[:, 1], z[:, 0]))) == pytest.approx(2 * np.pi)
    np.testing.assert_allclose(rotations(flight, np.array([10.0])).magnitude(), 0.0, atol=1e-9)


def test_yaw_while_tilted_keeps_the_weight_fixed_in_the_body():
    moves = (Tilt(0.0, 20.0, np.radians(50.0), np.radians(20.0)), Turn(3.0, 14.0, 2 * np.pi))
    down = rotations(Moves(20.0, HOME, moves), np.linspace(3.0, 17.0, 100)).inv().apply([0.0, 0.0, -1.0])
    np.testing.assert_allclose(down, np.tile(down[0], (100, 1)), atol=1e-12)


def test_two_swings_a_quarter_apart_make_a_circle():
    swings = [Swing(0.0, 20.0, by, 4.0, phase) for by, phase in (((0.8, 0, 0), 0.0), ((0, 0.8, 0), np.pi / 2))]
    away = Moves(20.0, HOME, tuple(swings)).at(np.linspace(3.0, 17.0, 200)).position_E - np.array(HOME)
    np.testing.assert_allclose(np.linalg.norm(away, axis=1), 0.8)


def test_a_shake_stays_within_its_size_and_on_its_axes():
    shake = Shake(0.0, 20.0, 0.05, np.radians(5.0), 0.2, 3.0, ("y", "yaw"))
    at = Moves(20.0, HOME, (shake,)).at(np.linspace(0.0, 20.0, 4000))
    away = np.abs(at.position_E - np.array(HOME)).max(axis=0)
    assert away[1] == pytest.approx(0.05, rel=0.1)
    np.testing.assert_allclose(away[[0, 2]], 0.0, atol=1e-12)
    np.testing.assert_allclose(at.omega_D[:, :2], 0.0, atol=1e-12)
    assert np.abs(at.omega_D[:, 2]).max() > 0.1


def test_an_attitude_that_follows_the_thrust_points_along_it():
    moves = (Swing(0.0, 10.0, (0.8, 0.3, 0.0), 3.0), Turn(0.0, 10.0, np.pi))
    flight = Moves(10.0, HOME, moves, follows_thrust=True)
    time = np.linspace(0.5, 9.5, 50)
    thrust = flight.at(time).acceleration_E + np.array([0.0, 0.0, GRAVITY])
    z = rotations(flight, time).apply([0.0, 0.0, 1.0])
    np.testing.assert_allclose(z, thrust / np.linalg.norm(thrust, axis=1, keepdims=True), atol=1e-9)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Tilt(0.0, 3.0, 0.5, 0.0, 2.0), "ramp is 2 s; it comes twice within 3 s"),
        (lambda: Tilt(0.0, 5.0, 4.0), "at most 180 deg"),
        (lambda: Turn(-1.0, 5.0, 1.0), "starts at -1 s"),
        (lambda: Turn(0.0, 5.0, float("nan")), "expected finite numbers"),
        (lambda: Swing(0.0, 5.0, (1, 0, 0), 0.0), "period is 0 s"),
        (lambda: Shake(0.0, 5.0, 0.1, 0.1, 2.0, 1.0), "low_hz above 0 and below high_hz"),
        (lambda: Shake(0.0, 5.0, 0.1, 0.1, 1.0, 2.0, ("w",)), "no axis is called 'w'"),
        (lambda: Moves(4.0, HOME, (Turn(0.0, 5.0, 1.0),)), r"moves\[0\] \(turn\): ends at 5 s, after the flight"),
        (lambda: Moves(9.0, HOME, (Tilt(0.0, 5.0, 0.5), Tilt(4.0, 5.0, 0.5))), "two tilts overlap"),
        (lambda: Moves(9.0, HOME, (Tilt(0.0, 5.0, 0.5),), True), "follows the thrust and cannot be tilted"),
    ],
)
def test_what_cannot_be_flown_is_refused_in_one_line(make, words):
    with pytest.raises(UsageError, match=words) as error:
        make()
    assert "\n" not in str(error.value)


def test_kinds_are_named_after_themselves():
    assert {name: cls.kind for name, cls in KINDS.items()} == {m.kind: m.kind for m in EVERYTHING}
