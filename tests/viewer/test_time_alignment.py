"""Two records of one manoeuvre find each other; two different ones do not."""

import numpy as np
import pytest

from wrenchgap.flight import so3
from wrenchgap.viewer.panels.scene import delay_between
from wrenchgap.viewer.session import Motion


def flown(start, stop, shift=0.0, noise=0.0):
    """A flight that rolls and climbs in its own way, recorded from `start` to `stop` of a clock that is ahead."""
    time = np.arange(start, stop, 0.02)
    angle = 0.6 * np.sin(0.7 * time) + 0.3 * np.sin(1.9 * time + 1.0) + 0.1 * time
    zero = np.zeros_like(time)
    height = np.cos(0.4 * time) + noise * np.random.default_rng(1).normal(size=len(time))
    return Motion(time + shift, np.stack((zero, zero, height), axis=1), so3.exp(np.stack((angle, zero, zero), axis=1)))


@pytest.mark.parametrize("shift", [0.0, 3.28, -17.5, 1000.0])
def test_a_delay_is_found_whatever_part_was_recorded(shift):
    fixed, late = flown(0.0, 40.0), flown(4.0, 34.0, shift, noise=0.02)
    assert delay_between(late, fixed) == pytest.approx(-shift, abs=0.021)


def test_flights_that_never_move_alike_are_not_aligned():
    time = np.arange(0.0, 20.0, 0.02)
    zero = np.zeros_like(time)
    still = Motion(time, np.stack((zero, zero, zero), axis=1), np.tile([1.0, 0.0, 0.0, 0.0], (len(time), 1)))
    assert delay_between(still, flown(0.0, 20.0)) is None
