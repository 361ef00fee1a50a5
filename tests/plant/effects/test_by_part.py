"""Numbers of single rotors and arms: alike on all they are the effect of the catalogue, on one they move that one."""

from dataclasses import replace

import numpy as np
import pytest

from tests.plant.conftest import star
from wrenchgap.plant.actuation import actuation
from wrenchgap.plant.effects import Context, catalogue, find, part_effects
from wrenchgap.plant.state import Commands, State

VEHICLE, DT, COUNT = star(), 0.01, 200


def flown(seed=3):
    rng = np.random.default_rng(seed)
    tilt = 0.3 * np.cumsum(rng.normal(size=(COUNT, 6)), axis=0) * DT**0.5
    speed = 600.0 + 40.0 * np.cumsum(rng.normal(size=(COUNT, 12)), axis=0) * DT**0.5
    zero = np.zeros((COUNT, 3))
    state = State(DT * np.arange(COUNT), zero, np.tile([1.0, 0.0, 0.0, 0.0], (COUNT, 1)), zero, zero)
    return Commands(np.zeros((COUNT, 6)), tilt, speed), Context(VEHICLE, state)


SIZES = {"motor_lag_by_rotor": 0.03, "servo_lag_by_arm": 0.05, "backlash_by_arm": 0.02}


def applied(name, theta, commands, context):
    return find(name).apply(commands, np.atleast_1d(theta), context, DT, None)[0]


@pytest.mark.parametrize("name", SIZES)
def test_alike_on_all_it_is_the_effect_of_the_catalogue(name):
    commands, context = flown()
    count = len(find(name).parameters(VEHICLE))
    ours = applied(name, np.full(count, SIZES[name]), commands, context)
    whole = applied(find(name).of_parts, SIZES[name], commands, context)
    np.testing.assert_allclose(ours.tilt, whole.tilt, atol=1e-12)
    np.testing.assert_allclose(ours.rotor_speed, whole.rotor_speed, atol=1e-9)


@pytest.mark.parametrize("name", SIZES)
def test_on_one_it_moves_that_one_alone(name):
    commands, context = flown()
    theta = SIZES[name] * (np.arange(len(find(name).parameters(VEHICLE))) == 2)
    ours = applied(name, theta, commands, context)
    moved = np.hstack((ours.tilt - commands.tilt, ours.rotor_speed - commands.rotor_speed))
    place = 2 if find(name).parameters(VEHICLE)[2].name == "arm_2" else 6 + 2
    assert np.abs(moved[:, place]).max() > 1e-4
    np.testing.assert_array_equal(np.delete(moved, place, axis=1), 0.0)


@pytest.mark.parametrize("name", SIZES)
def test_one_by_one_it_is_the_same_as_all_at_once(name):
    commands, context = flown()
    theta = SIZES[name] * np.linspace(0.0, 1.5, len(find(name).parameters(VEHICLE)))
    memory, rows = None, []
    for k in range(COUNT):
        one, memory = find(name).apply(commands.take(slice(k, k + 1)), theta, context, DT, memory)
        rows.append(np.hstack((one.tilt[0], one.rotor_speed[0])))
    whole = applied(name, theta, commands, context)
    np.testing.assert_allclose(rows, np.hstack((whole.tilt, whole.rotor_speed)), atol=1e-9)


def test_drag_torque_of_one_rotor_is_about_its_thrust():
    """-s k kappa T n of rotor 4, on arm 2, tilted by 0.5 rad."""
    tilt, speed = np.full((1, 6), 0.5), np.full((1, 12), 700.0)
    act = actuation(VEHICLE, Commands(np.zeros((1, 6)), tilt, speed))
    _, context = flown()
    found = find("drag_torque_by_rotor").apply(act, np.zeros((1, 6)), 0.3 * (np.arange(12) == 4), context)[0]
    arm, rotors = VEHICLE.arms, VEHICLE.rotors
    normal = np.cos(0.5) * arm.normal_B[2] + np.sin(0.5) * np.cross(arm.axis_B[2], arm.normal_B[2])
    torque = -rotors.spin[4] * 0.3 * rotors.kappa[4] * rotors.c_f[4] * 700.0**2 * normal
    np.testing.assert_allclose(found, [0.0, 0.0, 0.0, *torque], atol=1e-12)


def test_no_search_tries_them():
    assert set(part_effects()) == {*SIZES, "drag_torque_by_rotor"}
    assert not set(part_effects()) & set(catalogue())
    assert {effect.of_parts for effect in part_effects().values()} <= set(catalogue())


def test_arms_that_do_not_tilt_have_no_servo():
    fixed = replace(VEHICLE, arms=replace(VEHICLE.arms, tilts=np.arange(6) < 4))
    assert [p.name for p in find("backlash_by_arm").parameters(fixed)] == ["arm_0", "arm_1", "arm_2", "arm_3"]
