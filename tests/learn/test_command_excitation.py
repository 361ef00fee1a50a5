"""Which components of a command a flight shows: cancelled along an axis, along a diagonal, or lost in noise."""

import numpy as np
import pytest

from wrenchgap.learn.identify.guard import unshown
from wrenchgap.learn.process.gp import FitSettings
from wrenchgap.learn.process.train import fit
from wrenchgap.plant.mismatch import conditioning

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


def trap(count=600):
    """The measured torque is noise whatever is commanded: M_cmd = -d(F) + n, z = -M_cmd. And d(F)."""
    rng = np.random.default_rng(7)
    command = np.zeros((count, 6))
    command[:, :3] = rng.normal(size=(count, 3)) * [4.0, 4.0, 1.0] + [0.0, 0.0, 39.0]
    d = 0.05 * command[:, [0]] + 0.1 * np.sin(0.5 * command[:, [1]])
    command[:, [4]] = -d + 0.05 * rng.normal(size=d.shape)
    return command, -command[:, [4]] + 0.002 * rng.normal(size=d.shape), d


def test_process_that_is_blind_to_an_unshown_component_does_not_fall_into_the_trap():
    """As fitted the slope is -1 and I + dmu/dW is 0; blind it is exactly I, and the function is that of the force."""
    command, z, d = trap()
    known = {"points": 80, "restarts": 0, "calibrate": False}
    assert unshown(command[:, [4]], command[:, [4]], command[:, [4]] + z, np.array([0.002])).all()
    seeing = fit(command, z, ("torque_y",), FitSettings(**known))
    blind = fit(command, z, ("torque_y",), FitSettings(**known, blind=("torque_y",)))
    assert np.median(conditioning(seeing, command).real_min) < 0.1
    assert conditioning(blind, command).real_min == pytest.approx(np.ones(len(command)), abs=1e-5)
    assert np.std(blind.mean(command) - d) < 0.2 * np.std(d)
    line = fit(command, z, ("torque_y",), FitSettings(**known, mean="linear", blind=("torque_y",)))
    assert conditioning(line, command).real_min == pytest.approx(np.ones(len(command)), abs=1e-5)
