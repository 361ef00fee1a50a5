"""Response behind command: known delays and lags of open-loop logs, and the trap of a closed loop."""

from dataclasses import replace

import numpy as np
import pytest

from wrenchgap import flight
from wrenchgap.flight.flight import Flight, ImuSeries, WrenchSeries
from wrenchgap.flight.offsets import Problem
from wrenchgap.learn.data.measurement import prepare
from wrenchgap.learn.diagnose.response import responses
from wrenchgap.plant import model_file

RATE = 250.0


@pytest.fixture(scope="module")
def vehicle():
    return replace(model_file.load("crazyflie").vehicle)


def rows(seed, count, low, high, size):
    rng = np.random.default_rng(seed)
    return 2 * np.pi * rng.uniform(low, high, count), rng.uniform(0, 2 * np.pi, count), size * rng.normal(size=count)


def log(vehicle, tau=0.0, delay=0.0, seconds=30.0, noise=1.0):
    """Torques about x of many tones and the rates that they make through a lag and a delay; hovering otherwise.

    Commands are held for one period. What acts is the held signal, of which tones below 10 Hz keep their phase at the
    middle of the hold.
    """
    omega, phase, size = rows(3, 120, 0.3, 9.0, 2e-6)
    time = np.arange(0.0, seconds, 1.0 / RATE)
    middle = time + 0.5 / RATE
    torque = np.sin(np.outer(middle, omega) + phase) @ size
    gain, turn = 1.0 / np.sqrt(1 + (omega * tau) ** 2), np.arctan(omega * tau) + omega * delay
    rate = -np.cos(np.outer(time, omega) + phase - turn) @ (size * gain / omega) / vehicle.body.inertia[0, 0]
    rng = np.random.default_rng(0)
    weight = vehicle.body.mass * 9.80665
    wrench = np.zeros((len(time), 6))
    wrench[:, 2], wrench[:, 3] = weight, torque
    gyro = 2e-3 * noise * rng.normal(size=(len(time), 3)) + rate[:, None] * [1.0, 0.0, 0.0]
    force = np.tile([0.0, 0.0, 9.80665], (len(time), 1)) + 0.01 * noise * rng.normal(size=(len(time), 3))
    return Flight(
        "open loop",
        __file__,
        "",
        0,
        commanded=WrenchSeries("/command/wrench", time, wrench),
        imu=ImuSeries("/imu", time, gyro, force),
    )


def found_in(made, vehicle):
    records = [prepare(s, vehicle) for s in flight.uniform(made)]
    return {r.axis: r for r in responses(made, vehicle, records)}


def test_a_perfect_plant_responds_at_once_although_commands_are_held(vehicle):
    found = found_in(log(vehicle), vehicle)
    assert found["torque_x"].offset.seconds == pytest.approx(0.0, abs=3e-4)
    assert not found["torque_x"].matters
    assert found["force_x"].offset.problem is Problem.STILL


def test_a_delay_is_a_delay_and_is_worth_what_it_leaves(vehicle):
    found = found_in(log(vehicle, delay=0.0124), vehicle)["torque_x"]
    assert abs(found.offset.seconds - 0.0124) < found.offset.interval + 1e-4
    assert found.shape == "delay"
    assert found.matters
    assert found.leaves == pytest.approx(found.residual, rel=0.15)  # nothing else is missing


def test_a_first_order_lag_is_told_with_its_time_constant(vehicle):
    found = found_in(log(vehicle, tau=0.03), vehicle)["torque_x"]
    assert found.shape == "lag"
    assert found.lag == pytest.approx(0.03, rel=0.05)
    assert found.offset.seconds < 0.03
    delays = [b.seconds for b in found.offset.bands if b.seconds is not None]
    assert delays == sorted(delays, reverse=True)


def test_a_controller_that_answers_to_disturbances_is_not_taken_for_a_lag(vehicle):
    """U = -k omega and nothing else: the torque that turns the vehicle is a disturbance, the command its echo."""
    made = log(vehicle)
    echo = np.zeros_like(made.commanded.wrench_B)
    echo[:, 2] = made.commanded.wrench_B[:, 2]
    echo[:, 3] = -2e-4 * made.imu.omega_B[:, 0]
    made = replace(made, commanded=replace(made.commanded, wrench_B=echo))
    assert found_in(made, vehicle)["torque_x"].offset.problem is Problem.FEEDBACK


def test_independent_flights_show_their_servo_lag(fly, hexarotor):
    from benchmarks.hidden_effects import engine

    made, _ = engine.fly("none", None, "train", seconds=20.0, seed=2)
    crisp, _ = engine.fly("none", None, "train", seconds=20.0, seed=2, crisp=True)
    slow, quick = (found_in(f, hexarotor.vehicle)["force_z"].offset.seconds for f in (made, crisp))
    assert slow - quick == pytest.approx(engine.ALWAYS["servo_lag"] - 2.5e-3, abs=4e-3)
