"""The loop that everything flies in: what is held, what acts, when it ends."""

from dataclasses import replace

import numpy as np
import pytest

from wrenchgap.flight.errors import UsageError
from wrenchgap.plant import model_file
from wrenchgap.plant.simulation.closed_loop import (
    Clock,
    command_stage,
    fly,
    loss_of_control,
    loss_of_control_stage,
    mean_around_stamps,
    mean_over_periods,
)
from wrenchgap.plant.simulation.loop import Stage
from wrenchgap.plant.simulation.simulate import as_flight
from wrenchgap.plant.state import Commands, State
from wrenchgap.plant.trajectory import Hover
from wrenchgap.plant.vehicle import GRAVITY

HEXAROTOR = model_file.load("tilt_hexarotor")
MODEL = replace(HEXAROTOR, vehicle=replace(HEXAROTOR.vehicle, arms=None, rotors=None))  # the wrench is the command
BODY = MODEL.vehicle.body
WEIGHT = np.array([0.0, 0.0, BODY.mass * GRAVITY, 0.0, 0.0, 0.0])


def still(x=0.0):
    level, zeros = np.array([[1.0, 0.0, 0.0, 0.0]]), np.zeros((1, 3))
    return State(np.zeros(1), np.array([[x, 0.0, 1.6]]), level, zeros, zeros)


def clock(steps, dt=0.005, per_command=1):
    return Clock(np.arange(steps) * dt, dt, per_command)


def flown(time, start=None, commands=None, push=None, stages=(), **options):
    """A flight on commands (K, 6), by default the weight, whatever the state, with a push (S, 6)."""
    steps = len(time.time)
    given = np.tile(WEIGHT, (-(-steps // time.per_command), 1)) if commands is None else commands
    command, signals = command_stage(Commands(given), time.per_command)
    pushed = Stage("push", lambda now, row: {"disturbance": row}, np.zeros((steps, 6)) if push is None else push)
    return fly(MODEL.wrench_model, start or still(), time, [*stages, command, pushed], signals, **options)[0]


@pytest.mark.parametrize("compiled", [True, False])
def test_a_disturbance_gives_its_impulse(compiled):
    """m dv = integral of F dt, and p follows from steps of constant force exactly."""
    push = np.zeros((100, 6))
    push[20:60, 0] = 2.0
    found = flown(clock(100), push=push, compiled=compiled)
    assert found.state.velocity_E[-1, 0] == pytest.approx(2.0 * 40 * 0.005 / BODY.mass)
    assert found.state.position_E[60, 0] == pytest.approx(0.5 * 2.0 / BODY.mass * (40 * 0.005) ** 2)
    np.testing.assert_allclose(found.state.position_E[:, 2], 1.6, atol=1e-12)
    np.testing.assert_allclose(found.wrench[:20, 2], BODY.mass * GRAVITY)
    np.testing.assert_allclose(found.disturbance, push)


def test_a_command_is_held_through_all_steps_of_its_period():
    commands = WEIGHT + np.arange(3.0)[:, None] * [0, 0, 1, 0, 0, 0]
    found = flown(clock(11, 0.002, per_command=4), commands=commands)
    assert found.command_time == pytest.approx([0.0, 0.008, 0.016])
    np.testing.assert_allclose(found.commands.wrench_B, commands)
    np.testing.assert_allclose(found.wrench[:, 2] - BODY.mass * GRAVITY, [0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2], atol=1e-12)


def test_the_accelerometer_reads_the_mean_around_a_jump():
    push = np.zeros((10, 6))
    push[5:, 0] = BODY.mass
    found = flown(clock(10), push=push)
    reference = Hover(1.0).at(found.state.time)
    log = as_flight("jump", found, MODEL, found.commands.wrench_B, reference, start_ns=0)
    expected = [0, 0, 0, 0, 0, 0.5, 1, 1, 1, 1]
    np.testing.assert_allclose(log.imu.specific_force_B[:, 0], expected, atol=1e-9)


def test_what_is_read_at_stamps_and_what_is_held_between_them_are_each_others_means():
    line = np.arange(6.0)[:, None]
    np.testing.assert_allclose(
        mean_over_periods(line)[:-1], line[:-1] + 0.5
    )  # a straight line in the middle of its period
    np.testing.assert_allclose(mean_around_stamps(line)[1:], line[1:] - 0.5)


def test_the_flight_ends_where_control_is_lost_and_says_why():
    tumble = np.tile([0.0, 0.0, 0.0, 3.0, 0.0, 0.0], (1000, 1))
    time = clock(1000)
    reference = Hover(5.0).at(time.time)

    def tumbling(*stages):
        return flown(time, push=tumble, stages=stages)

    found = tumbling(loss_of_control_stage(reference, time))
    assert found.lost.what == "attitude"
    assert found.lost.size > np.radians(100.0)
    assert found.lost.time == pytest.approx(found.state.time[-1] + 0.005)
    assert len(found.state.time) == len(found.commands.wrench_B) == len(found.wrench) < 1000
    np.testing.assert_allclose(found.wrench[:, 3:], tumble[: len(found.wrench), 3:], atol=1e-9)
    # Against a recorded flight that was lost at the same times nothing ends: it shall be repeated as it was.
    recorded = tumbling().state
    again = tumbling(loss_of_control_stage(reference, time, loss_of_control(recorded, reference)[0] > 0.0))
    assert again.lost is None
    assert len(again.state.time) == 1000


def test_what_control_is_lost_in():
    turned = np.array([[np.cos(np.radians(55.0)), np.sin(np.radians(55.0)), 0.0, 0.0]])
    reference = Hover(1.0).at(np.zeros(1))
    level = replace(still(), position_E=reference.position_E)
    cases = [
        level, replace(level, position_E=level.position_E + np.array([6.0, 0, 0])), replace(level, quat_EB=turned),
        replace(level, omega_B=np.full((1, 3), np.nan)), replace(level, position_E=np.full((1, 3), np.inf)),
    ]  # fmt: skip
    kinds, sizes = zip(*(loss_of_control(state, reference) for state in cases), strict=True)
    assert [float(kind[0]) for kind in kinds] == [0.0, 2.0, 3.0, 1.0, 1.0]
    assert [float(size[0]) for size in sizes[1:3]] == pytest.approx([6.0, np.radians(110.0)])


def test_a_start_that_is_lost_already_is_refused():
    time = clock(10)
    with pytest.raises(UsageError, match=r"7\.0 m from the reference: the flight cannot begin there"):
        flown(time, still(7.0), stages=[loss_of_control_stage(Hover(1.0).at(time.time), time)])
