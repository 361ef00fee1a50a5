"""Timing says nothing where it cannot see: noise that moves the vehicle through the controller is no delay."""

import numpy as np
import pytest

import wrenchgap as wg
from wrenchgap.flight.offsets import Problem, Signal, offset
from wrenchgap.flight.shift import shifted
from wrenchgap.flight.topic_offsets import sensor_offsets


@pytest.mark.parametrize("trajectory", ["hover", "pitch"])
def test_every_number_on_a_quiet_flight_holds_the_truth(trajectory):
    """Nothing is late in a simulated flight; what follows the noise of the velocity is the controller."""
    flown = wg.simulate(wg.load_model("tilt_hexarotor"), trajectory, duration=15.0, seed=3)
    for found in sensor_offsets(flown):
        assert found.seconds is None or abs(found.seconds) < 1.5 * found.interval, found


def test_what_is_late_is_still_seen_where_it_can_be():
    flown = wg.simulate(wg.load_model("tilt_hexarotor"), "hover", duration=16.0, excitation=1.0, seed=3)
    found = {o.second: o for o in sensor_offsets(shifted(flown, {"odometry": 0.012})) if o.first == "gyroscope"}
    attitude = found["odometry attitude"]
    assert abs(attitude.seconds - 0.012) < 1.5 * attitude.interval
    assert attitude.interval < 4e-3


def test_one_frequency_is_no_band():
    """Two noisy records of one sine agree at any delay that differs by a period, and a lag looks the same."""
    time, rng = np.arange(0, 30, 0.01), np.random.default_rng(2)
    both = [
        np.sin(2 * np.pi * 1.5 * (time - d))[:, None] + 1e-2 * rng.standard_normal((len(time), 1)) for d in (0, 0.02)
    ]
    signals = [Signal(n, time, v, ("x",)) for n, v in zip("ab", both, strict=True)]
    found = offset(*signals, coherent=0.999)
    assert found.seconds is None
    assert found.problem in (Problem.NARROW, Problem.AMBIGUOUS)
