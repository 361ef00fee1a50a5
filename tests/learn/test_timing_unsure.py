"""Timing says nothing where it cannot see: noise that moves the vehicle through the controller is no delay."""

import numpy as np
import pytest

import wrenchgap as wg
from wrenchgap.flight.compared_signals import sensor_offsets, shifted
from wrenchgap.flight.offsets import Problem, Signal, offset


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


def test_two_frequencies_are_no_band():
    """In a band of half a hertz a delay, a lag and a controller look alike: no number, however well the two agree."""
    time, rng = np.arange(0, 30, 0.01), np.random.default_rng(2)
    signals = []
    for name, delay in (("a", 0.0), ("b", 0.02)):
        tone = np.sin(2 * np.pi * 1.7 * (time - delay)) + 1e-2 * rng.standard_normal(len(time))
        signals.append(Signal(name, time, tone[:, None], ("x",)))
    assert offset(*signals, band=(1.2, 2.4)).problem is Problem.NARROW
