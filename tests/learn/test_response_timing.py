"""Response behind command: known delays and lags of open-loop logs, and the trap of a closed loop."""

from dataclasses import replace

import numpy as np
import pytest

from wrenchgap import flight
from wrenchgap.flight.flight import GRAVITY, Flight, ImuSeries, WrenchSeries
from wrenchgap.flight.offsets import Offset, Problem
from wrenchgap.learn.data.measurement import prepare
from wrenchgap.learn.data.response import Response, responses
from wrenchgap.learn.diagnose.timing import FlightTiming, answering_axes, following_axes
from wrenchgap.plant import model_file

RATE = 250.0


VEHICLE = model_file.load("crazyflie").vehicle


def log(tau=0.0, delay=0.0):
    """Torques about x of many tones and the rates that they make through a lag and a delay; hovering otherwise.

    Commands are held for one period. What acts is the held signal, of which tones below 10 Hz keep their phase at the
    middle of the hold.
    """
    rng = np.random.default_rng(3)
    omega, phase = 2 * np.pi * rng.uniform(0.3, 9.0, 120), rng.uniform(0, 2 * np.pi, 120)
    size = 2e-6 * rng.normal(size=120)
    time = np.arange(0.0, 30.0, 1.0 / RATE)
    wrench, gyro, force = np.zeros((len(time), 6)), *np.zeros((2, len(time), 3))
    wrench[:, 2], force[:, 2] = VEHICLE.body.mass * GRAVITY, GRAVITY
    wrench[:, 3] = np.sin(np.outer(time + 0.5 / RATE, omega) + phase) @ size
    gain, turn = 1.0 / np.sqrt(1 + (omega * tau) ** 2), np.arctan(omega * tau) + omega * delay
    gyro[:, 0] = -np.cos(np.outer(time, omega) + phase - turn) @ (size * gain / omega) / VEHICLE.body.inertia[0, 0]
    noise = np.random.default_rng(0).normal(size=(2, len(time), 3))
    imu = ImuSeries("/imu", time, gyro + 2e-3 * noise[0], force + 0.01 * noise[1])
    return Flight("open loop", __file__, "", 0, commanded=WrenchSeries("/command/wrench", time, wrench), imu=imu)


def found_in(made, vehicle=VEHICLE):
    records = [prepare(s, vehicle) for s in flight.uniform(made)]
    return {r.axis: r for r in responses(made, vehicle, records)}


def test_where_one_torque_answers_the_others_do_unless_they_plainly_follow():
    """One controller makes all three. torque_z has no response of its own; torque_x and torque_y are what is said."""

    def axes(x, y, z=None):
        made = {"force_z": None, "torque_x": x, "torque_y": y, "torque_z": z}
        answers = tuple(response(*row) for row in made.items())
        return answering_axes([FlightTiming("flight", 30.0, (), (), responses=answers)])

    follows, vague, answers = "plain", None, Problem.FEEDBACK
    assert axes(answers, vague) == (3, 4, 5)
    assert axes(answers, follows, follows) == (3,)
    assert axes(answers, follows) == (3, 4, 5)
    assert axes(follows, follows) == ()
    assert axes(vague, vague) == ()


def test_actuator_dynamics_show_where_commands_change_and_none_of_the_flights_may_answer():
    """Of two flights: the thrust plainly follows, one torque answers on the second, one never changes."""
    first = {"force_x": Problem.STILL, "force_z": "plain", "torque_x": "plain", "torque_y": Problem.SHORT}
    second = first | {"torque_x": Problem.FEEDBACK}

    def axes(*flights):
        each = (tuple(response(*row) for row in made.items()) for made in flights)
        return following_axes([FlightTiming("flight", 30.0, (), (), responses=answers) for answers in each])

    assert axes(first) == (2, 3, 4)
    assert axes(first, second) == (2, 4)
    assert axes({"torque_x": Problem.FEEDBACK, "torque_y": Problem.UNCLEAR}) == ()


def response(axis, kind):
    problem = kind if isinstance(kind, Problem) else None
    seconds = 0.01 if kind == "plain" else None
    return Response(axis, Offset("commanded", "measured", seconds, problem=problem), plain=kind == "plain")


def test_a_perfect_plant_responds_at_once_although_commands_are_held():
    found = found_in(log())
    assert found["torque_x"].offset.seconds == pytest.approx(0.0, abs=3e-4)
    assert not found["torque_x"].matters
    assert found["force_x"].offset.problem is Problem.STILL


def test_a_delay_is_a_delay_and_is_worth_what_it_leaves():
    found = found_in(log(delay=0.0124))["torque_x"]
    assert abs(found.offset.seconds - 0.0124) < found.offset.interval + 1e-4
    assert found.shape == "delay"
    assert found.matters
    assert found.leaves == pytest.approx(found.residual, rel=0.15)  # nothing else is missing


def test_a_first_order_lag_is_told_with_its_time_constant():
    found = found_in(log(tau=0.03))["torque_x"]
    assert found.shape == "lag"
    assert found.lag == pytest.approx(0.03, rel=0.05)
    assert found.offset.seconds < 0.03
    delays = [b.seconds for b in found.offset.bands if b.seconds is not None]
    assert delays == sorted(delays, reverse=True)


def test_a_controller_that_answers_to_disturbances_is_not_taken_for_a_lag():
    """U = -k omega and nothing else: the torque that turns the vehicle is a disturbance, the command its echo."""
    made = log()
    echo = np.zeros_like(made.commanded.wrench_B)
    echo[:, 2] = made.commanded.wrench_B[:, 2]
    echo[:, 3] = -2e-4 * made.imu.omega_B[:, 0]
    made = replace(made, commanded=replace(made.commanded, wrench_B=echo))
    assert found_in(made)["torque_x"].offset.problem is Problem.FEEDBACK


def test_independent_flights_show_their_servo_lag(fly, hexarotor):
    from benchmarks.hidden_effects import engine

    made, _ = engine.fly("none", None, "train", seconds=20.0, seed=2)
    crisp, _ = engine.fly("none", None, "train", seconds=20.0, seed=2, crisp=True)
    slow, quick = (found_in(f, hexarotor.vehicle)["force_z"].offset.seconds for f in (made, crisp))
    assert slow - quick == pytest.approx(engine.ALWAYS["servo_lag"] - 2.5e-3, abs=4e-3)
