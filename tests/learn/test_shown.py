"""Which components of a command a flight shows: cancelled along an axis, along a diagonal, or lost in noise."""

import numpy as np
import pytest

from wrenchgap.learn.process.shown import unshown

RNG = np.random.default_rng(0)
COMMAND = RNG.normal(size=(4000, 3))
NOISE = np.full(3, 0.01)


def shown(response, command=COMMAND):
    return unshown(command, command, command @ np.asarray(response).T + NOISE * RNG.normal(size=command.shape), NOISE)


def test_vehicle_that_does_what_it_is_told_shows_everything():
    assert not shown(np.eye(3)).any()
    assert not shown(np.diag([0.7, 0.9, 1.3])).any()  # with gain errors too


def test_command_that_only_cancels_is_not_shown():
    assert shown(np.diag([1.0, 0.05, 1.0])).tolist() == [False, True, False]


def test_cancelled_diagonal_concerns_both_of_its_axes():
    along = np.array([1.0, -1.0, 0.0]) / np.sqrt(2.0)
    assert shown(np.eye(3) - np.outer(along, along)).tolist() == [True, True, False]


def test_command_below_the_noise_is_not_shown():
    assert shown(np.eye(3), COMMAND * [1.0, 1.0, 0.02]).tolist() == [False, False, True]


@pytest.mark.parametrize("unit", [1e-4, 1.0, 1e3])
def test_size_of_the_vehicle_does_not_matter(unit):
    measured = COMMAND * [1.0, 0.05, 1.0] + NOISE * RNG.normal(size=COMMAND.shape)
    assert unshown(unit * COMMAND, unit * COMMAND, unit * measured, unit * NOISE).tolist() == [False, True, False]
