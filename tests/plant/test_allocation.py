"""The allocation: closed form for six arms, inverse of the actuation, saturation."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wrenchgap.plant import model_file
from wrenchgap.plant.actuation import nominal_wrench
from wrenchgap.plant.allocation import Allocation, angle_in_range

HEXAROTOR = model_file.load("tilt_hexarotor").vehicle
WRENCHES = st.lists(st.floats(-1, 1), min_size=6, max_size=6)
SIZE = np.array([15.0, 15.0, 15.0, 1.5, 1.5, 1.0])
WEIGHT = np.array([0.0, 0.0, 39.0, 0.0, 0.0, 0.0])


@settings(max_examples=60, deadline=None)
@given(WRENCHES)
def test_actuation_undoes_allocation(values):
    wrench = (np.array(values) * SIZE + WEIGHT)[None]
    commands, saturation = Allocation(HEXAROTOR).allocate(wrench)
    assert saturation.rotor_speed == 0
    np.testing.assert_allclose(nominal_wrench(HEXAROTOR, commands), wrench, atol=1e-8)


def test_agrees_with_the_closed_form(hexarotor):
    """lat = (sin g Fx - cos g Fy)/3 - Mz/(6L), ver = Fz/6 + (sin g Mx - cos g My)/(3L)."""
    rng = np.random.default_rng(2)
    W = rng.normal(size=(50, 6)) * SIZE + WEIGHT
    commands, _ = Allocation(hexarotor).allocate(W)
    g = np.arange(6) * np.pi / 3
    L = 0.3
    lat = (np.sin(g) * W[:, :1] - np.cos(g) * W[:, 1:2]) / 3 - W[:, 5:] / (6 * L)
    ver = W[:, 2:3] / 6 + (np.sin(g) * W[:, 3:4] - np.cos(g) * W[:, 4:5]) / (3 * L)
    wrapped = np.angle(np.exp(1j * (commands.tilt - np.arctan2(lat, ver))))
    np.testing.assert_allclose(wrapped, 0, atol=1e-9)
    speed = np.sqrt(np.hypot(lat, ver) / (2 * 7.2e-6))
    np.testing.assert_allclose(commands.rotor_speed, np.repeat(speed, 2, axis=1), rtol=1e-9)


def test_matrix_of_the_regular_star_has_the_known_gram(hexarotor):
    A = Allocation(hexarotor).matrix
    L = 0.3
    np.testing.assert_allclose(A @ A.T, np.diag([3, 3, 6, 3 * L**2, 3 * L**2, 6 * L**2]), atol=1e-12)


def test_fixed_quadrotor_makes_thrust_and_torque_but_no_side_force(quadrotor):
    allocation = Allocation(quadrotor)
    assert allocation.rank == 4
    W = np.array([[0.0, 0.0, 30.0, 0.3, -0.2, 0.05]])
    commands, _ = allocation.allocate(W)
    np.testing.assert_allclose(nominal_wrench(quadrotor, commands), W, atol=1e-9)
    np.testing.assert_allclose(allocation.achievable(np.array([[5.0, 3.0, 0, 0, 0, 0]])), 0, atol=1e-9)


def test_unwraps_through_half_a_turn(hexarotor):
    """A force that rotates once about x turns the forward arm once round, without jumps."""
    angle = np.linspace(0, 2 * np.pi, 400)
    W = np.zeros((400, 6))
    W[:, 0], W[:, 1], W[:, 2] = 8.0, 40 * np.sin(angle), 40 * np.cos(angle)
    tilt = Allocation(hexarotor).allocate(W)[0].tilt
    assert np.abs(np.diff(tilt, axis=0)).max() < 0.2
    assert abs(tilt[-1, 0] - tilt[0, 0]) == pytest.approx(2 * np.pi, abs=0.1)


def with_stops(vehicle, least_deg, most_deg):
    """The hexarotor with arms that turn from one stop to another."""
    arms = replace(
        vehicle.arms,
        tilt_min=np.full_like(vehicle.arms.tilt_min, np.radians(least_deg)),
        tilt_max=np.full_like(vehicle.arms.tilt_max, np.radians(most_deg)),
    )
    return replace(vehicle, arms=arms)


@pytest.mark.parametrize("stops", [(-200.0, 200.0), (-300.0, 300.0), (-120.0, 170.0), (-90.0, 90.0)])
def test_an_arm_at_a_stop_is_turned_round_where_its_range_has_the_direction(hexarotor, stops):
    """A force turns one and a half times about x and back: what is in range is made, at once and in steps."""
    angle = np.radians(np.concatenate((np.arange(0, 540), np.arange(540, -1, -1))))
    W = np.zeros((len(angle), 6))
    W[:, 0], W[:, 1], W[:, 2] = 8.0, 40 * np.sin(angle), 40 * np.cos(angle)
    vehicle = with_stops(hexarotor, *stops)
    allocation, free = Allocation(vehicle), Allocation(hexarotor).allocate(W)[0].tilt
    asked = np.angle(np.exp(1j * free))
    tilt = allocation.allocate(W)[0].tilt
    least, most = np.radians(stops)
    assert (tilt >= least - 1e-9).all()
    assert (tilt <= most + 1e-9).all()
    reachable = np.zeros(asked.shape, dtype=bool)
    for turns in (-1, 0, 1):
        reachable |= (asked + 2 * np.pi * turns >= least) & (asked + 2 * np.pi * turns <= most)
    made = np.abs(np.angle(np.exp(1j * (tilt - asked)))) < 1e-9
    assert (made | ~reachable).all()
    assert reachable.all() == (most - least >= 2 * np.pi)
    assert tilt[-1] == pytest.approx(free[0], abs=1e-9)
    rows = [None]
    for w in W:
        rows.append(allocation.allocate(w[None], previous_tilt=rows[-1])[0].tilt[-1])
    np.testing.assert_allclose(rows[1:], tilt, atol=1e-9)


@settings(max_examples=300, deadline=None)
@given(st.floats(-50, 50), st.floats(-20, 0), st.floats(0.01, 20))
def test_into_range_keeps_the_direction_and_is_in_range_where_any_is(angle, least, width):
    most = least + width
    found = angle_in_range(np.array(angle), least, most)
    assert np.cos(found - angle) == pytest.approx(1.0, abs=1e-12)
    exists = any(least <= angle + 2 * np.pi * k <= most for k in range(-20, 21))
    assert (least - 1e-8 <= found <= most + 1e-8) or not exists
    if least <= angle <= most:
        assert found == angle


def test_one_at_a_time_is_the_same_as_all_at_once(hexarotor):
    W = np.cumsum(np.random.default_rng(3).normal(size=(200, 6)), axis=0) * 0.4 * SIZE / 15 + WEIGHT
    allocation = Allocation(hexarotor)
    rows = [None]
    for w in W:
        rows.append(allocation.allocate(w[None], previous_tilt=rows[-1], dt=0.005)[0].tilt[-1])
    np.testing.assert_allclose(rows[1:], allocation.allocate(W, dt=0.005)[0].tilt, atol=1e-9)


def test_holds_the_angle_of_an_arm_without_thrust(hexarotor):
    leaning = [3.0, *WEIGHT[1:]]
    W = np.array([leaning, [0, 0, 0.1, 0, 0, 0], leaning])
    commands, saturation = Allocation(hexarotor).allocate(W)
    np.testing.assert_allclose(commands.tilt[1], commands.tilt[0])
    assert saturation.held == 1


def test_limits_speed_and_rate_and_a_fixed_rotor_does_not_pull(hexarotor, quadrotor):
    W = np.array([[0, 0, 39.0, 0, 0, 0], [0, 0, 500.0, 0, 0, 0], [30.0, 0, 0.0, 0, 0, 0]])
    commands, saturation = Allocation(hexarotor).allocate(W, dt=0.001)
    assert commands.rotor_speed.max() == 1250.0
    assert saturation.rotor_speed == 1
    assert np.abs(np.diff(commands.tilt, axis=0)).max() <= 50.0 * 0.001 + 1e-12
    assert saturation.tilt_rate >= 1
    commands, saturation = Allocation(quadrotor).allocate(np.array([[0, 0, -5.0, 0, 0, 0]]))
    assert (commands.rotor_speed == 0).all()
    assert saturation.rotor_speed == 1
