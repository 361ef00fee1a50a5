"""The loop that everything steps through: what is held, what acts, when it ends."""

from dataclasses import replace

import numpy as np
import pytest

from wrenchgap.flight.errors import UsageError
from wrenchgap.plant import model_file
from wrenchgap.plant.closed_loop import Clock, around_stamps, fly, over_periods, watch
from wrenchgap.plant.flight_computer import FlightComputer
from wrenchgap.plant.flight_log import as_flight
from wrenchgap.plant.state import Commands, State
from wrenchgap.plant.trajectory import Hover
from wrenchgap.plant.vehicle import GRAVITY

MODEL = model_file.load("tilt_hexarotor")
BODY = MODEL.vehicle.body
PLANT = MODEL.wrench_model
COMPUTER = FlightComputer(MODEL.controller, MODEL.vehicle)


def still(x=0.0):
    level, zeros = np.array([[1.0, 0.0, 0.0, 0.0]]), np.zeros((1, 3))
    return State(np.zeros(1), np.array([[x, 0.0, 1.6]]), level, zeros, zeros)


def clock(steps, dt=0.005, per_command=1):
    return Clock(np.arange(steps) * dt, dt, per_command)


def hover(k, now):
    """The command that carries the weight, whatever the state."""
    return COMPUTER.step(k, still(), Hover(1.0).at(np.zeros(1)), 0.005)


def test_a_disturbance_gives_its_impulse():
    """m dv = integral of F dt, and p follows from steps of constant force exactly."""
    push = np.zeros((100, 6))
    push[20:60, 0] = 2.0
    flown = fly(PLANT, still(), clock(100), hover, disturbance=lambda n, now: push[n])
    assert flown.state.velocity_E[-1, 0] == pytest.approx(2.0 * 40 * 0.005 / BODY.mass)
    assert flown.state.position_E[60, 0] == pytest.approx(0.5 * 2.0 / BODY.mass * (40 * 0.005) ** 2)
    np.testing.assert_allclose(flown.state.position_E[:, 2], 1.6, atol=1e-12)
    np.testing.assert_allclose(flown.wrench[:20, 2], BODY.mass * GRAVITY)


def test_a_command_is_held_through_all_steps_of_its_period():
    asked = []

    def command(k, now):
        asked.append((k, float(now.time[0])))
        return Commands(np.array([[0.0, 0.0, BODY.mass * GRAVITY + k, 0.0, 0.0, 0.0]]))

    wrench_only = replace(MODEL, vehicle=replace(MODEL.vehicle, arms=None, rotors=None)).wrench_model
    flown = fly(wrench_only, still(), clock(11, 0.002, per_command=4), command)
    assert asked == [(0, 0.0), (1, 0.008), (2, 0.016)]
    assert flown.command_time == pytest.approx([0.0, 0.008, 0.016])
    np.testing.assert_allclose(flown.wrench[:, 2] - BODY.mass * GRAVITY, [0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2], atol=1e-12)


def test_the_accelerometer_reads_the_mean_around_a_jump():
    push = np.zeros((10, 6))
    push[5:, 0] = BODY.mass
    flown = fly(PLANT, still(), clock(10), hover, disturbance=lambda n, now: push[n])
    reference = Hover(1.0).at(flown.state.time)
    log = as_flight("jump", flown, MODEL, flown.commands.wrench_B, reference, start_ns=0)
    expected = [0, 0, 0, 0, 0, 0.5, 1, 1, 1, 1]
    np.testing.assert_allclose(log.imu.specific_force_B[:, 0], expected, atol=1e-9)


def test_what_is_read_at_stamps_and_what_is_held_between_them_are_each_others_means():
    line = np.arange(6.0)[:, None]
    np.testing.assert_allclose(over_periods(line)[:-1], line[:-1] + 0.5)  # a straight line in the middle of its period
    np.testing.assert_allclose(around_stamps(line)[1:], line[1:] - 0.5)


def test_the_flight_ends_where_control_is_lost_and_says_why():
    tumble = np.array([0.0, 0.0, 0.0, 3.0, 0.0, 0.0])
    reference = Hover(5.0).at(clock(1000).time)

    def tumbling(lost=None):
        return fly(PLANT, still(), clock(1000), hover, disturbance=lambda n, now: tumble, lost=lost)

    flown = tumbling(watch(reference))
    assert flown.lost.what == "attitude"
    assert flown.lost.size > np.radians(100.0)
    assert flown.lost.time == pytest.approx(flown.state.time[-1] + 0.005)
    assert len(flown.state.time) == len(flown.commands.wrench_B) == len(flown.wrench) < 1000
    np.testing.assert_allclose(flown.wrench[:, 3:], np.tile(tumble[3:], (len(flown.wrench), 1)), atol=1e-9)
    # Against a recorded flight that was lost at the same times nothing ends: it shall be repeated as it was.
    again = tumbling(watch(reference, recorded=tumbling().state))
    assert again.lost is None
    assert len(again.state.time) == 1000


def test_a_start_that_is_lost_already_is_refused():
    reference = Hover(1.0).at(clock(10).time)
    with pytest.raises(UsageError, match=r"7\.0 m from the reference: the flight cannot begin there"):
        fly(PLANT, still(7.0), clock(10), hover, lost=watch(reference))
