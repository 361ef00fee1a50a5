"""The observer's bandwidth: what a sinusoid leaves in closed form, and what noise and lag do to the choice."""

from dataclasses import replace

import numpy as np
import pytest

from wrenchgap import flight
from wrenchgap.learn.data.measurement import prepare
from wrenchgap.learn.identify.observing import MOST, UNKNOWN, fast_rates, missed, observer_hz
from wrenchgap.plant import model_file
from wrenchgap.plant.model import make_effect
from wrenchgap.plant.simulate import simulate
from wrenchgap.plant.stability import Loop
from wrenchgap.plant.trajectory import named

MODEL = model_file.load("tilt_hexarotor")
DT = 0.005
NONE = np.zeros(6)


@pytest.mark.parametrize(("hz", "tau"), [(1.0, 0.0001), (2.0, 0.06), (4.0, 0.06)])
def test_what_is_left_of_a_sinusoid_is_that_of_the_closed_form(hz, tau):
    """|1 - k / (tau s^2 + s + k)| at s = j w."""
    omega, k, time = 5.0, 2.0 * np.pi * hz, np.arange(8000) * DT
    d = np.sin(omega * time)[:, None] * [1.0, 2.0, 0.0]
    s = 1j * omega
    left = abs(1.0 - k / (tau * s**2 + s + k)) / np.sqrt(2.0)
    assert missed([(d, DT)], hz, tau) == pytest.approx([left, 2.0 * left, 0.0], rel=0.02)


def records(noise=1.0, disturbance=0.2):
    """A hover with a torque that comes and goes, and a gyroscope of so many times the usual noise."""
    sensors = replace(MODEL.sensors, gyro_density=noise * MODEL.sensors.gyro_density)
    pushed = lambda t: np.array([0, 0, 0, *(disturbance * np.sin([2.0 * t, 2.6 * t, 3.1 * t]))])  # noqa: E731
    rng = np.random.default_rng(3)
    log = simulate(MODEL, MODEL, named("hover"), 6.0, rng=rng, disturbance=pushed, sensors=sensors)
    return [prepare(s, MODEL.vehicle) for s in flight.uniform(log)]


@pytest.fixture(scope="module")
def quiet():
    return records()


def loop(lag):
    return Loop(MODEL.controller, MODEL.vehicle.body.inertia, lag, 0.01)


def test_lag_bounds_the_bandwidth(quiet):
    """k tau <= 1.5; a lag that nobody has seen counts as 0.1 s."""
    found = [observer_hz(quiet, MODEL, NONE, loop(lag)) for lag in (0.0, 0.05, 0.14)]
    assert found == pytest.approx([MOST / UNKNOWN / 2 / np.pi, MOST / 0.06 / 2 / np.pi, MOST / 0.15 / 2 / np.pi])


def test_noise_asks_for_less(quiet):
    noisy = records(noise=40.0)
    assert np.all(fast_rates(noisy[0]) > 20.0 * fast_rates(quiet[0]))
    assert observer_hz(noisy, MODEL, NONE, loop(0.05)) < 0.7 * observer_hz(quiet, MODEL, NONE, loop(0.05))


def test_disturbance_that_is_named_asks_for_less(quiet):
    """Nothing but noise is left where nothing was there: the least bandwidth that is tried."""
    assert observer_hz(records(disturbance=0.0), MODEL, NONE, loop(0.05)) < 1.0


def test_named_effects_are_no_disturbance(quiet):
    known = MODEL.with_effects([make_effect(MODEL.vehicle, "com_offset", [0.0, 0.0, 0.0])])
    assert observer_hz(quiet, known, NONE, loop(0.05)) == observer_hz(quiet, MODEL, NONE, loop(0.05))
