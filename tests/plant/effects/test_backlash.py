"""Backlash is an arm between two stops."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from wrenchgap.plant.state import Commands

ANGLES = arrays(float, st.integers(1, 60), elements=st.floats(-0.5, 0.5))
PLAY = st.floats(0.0, 0.4)


def two_stops(servo, play):
    """An arm between two stops that the servo carries; it moves only when a stop touches and pushes it."""
    arm, path = servo[0], []
    for angle in servo:
        gap = angle - arm  # how far the servo's middle is ahead of the arm
        if gap > play / 2:
            arm += gap - play / 2
        elif gap < -play / 2:
            arm += gap + play / 2
        path.append(arm)
    return np.array(path)


def through_play(bench, servo, play):
    count = len(servo)
    u = Commands(np.zeros((count, 6)), np.repeat(servo[:, None], 6, axis=1), np.full((count, 12), bench.hover))
    return bench.model("backlash", {"play": play}).command(u, bench.state(count), bench.dt)[0].tilt[:, 2]


@given(ANGLES, PLAY)
def test_is_an_arm_between_two_stops(bench, servo, play):
    np.testing.assert_allclose(through_play(bench, servo, play), two_stops(servo, play), atol=1e-12)


@given(ANGLES, PLAY)
def test_stays_within_the_play_and_rests_inside_it(bench, servo, play):
    arm = through_play(bench, servo, play)
    assert np.all(np.abs(arm - servo) <= play / 2 + 1e-12)
    free = np.abs(servo[1:] - arm[:-1]) < play / 2
    np.testing.assert_array_equal(arm[1:][free], arm[:-1][free])


def test_takes_the_play_off_the_travel(bench):
    """Back and forth by +-A the arm travels +-(A - b/2), and after a reversal it waits for b."""
    servo = 0.1 * np.interp(np.arange(801) % 400, [0, 100, 300, 400], [0, 1, -1, 0])
    arm = through_play(bench, servo, 0.03)
    assert arm[400:].max() == pytest.approx(0.085)
    assert arm[400:].min() == pytest.approx(-0.085)
    waiting = np.flatnonzero(np.abs(arm[500:700] - 0.085) < 1e-9)
    assert servo[500 + waiting[-1]] == pytest.approx(0.1 - 0.03)
