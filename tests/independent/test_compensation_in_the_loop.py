"""Compensation in the loop of an engine that shares no code with `plant`: the error on an unseen flight must fall."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.compensation_in_the_loop import attitude_error, outcome
from benchmarks.hidden_effects.engine import fly

PAPER_SIMULATION = np.array([0.80, 0.80])
"""Least fall of mean |e_R| on x and y (issue 2)."""


@pytest.mark.slow
@pytest.mark.parametrize(("effect", "seed"), [("com_offset", 1), ("wake", 2)])
def test_learnt_compensation_takes_most_of_the_attitude_error(effect, seed):
    """Train, open the log, learn 200 points, fly a figure-8 that was not seen, with another seed."""
    result = outcome(effect, seed, seconds=15.0)
    assert (result.fall[:2] >= PAPER_SIMULATION).all(), result
    assert (result.compensated < result.integral).all(), "the paper's integral does better"
    assert result.accepted > 0.99
    assert result.beta_mean < 0.1, "the uncertainty filter distrusts a flight inside the training envelope"
    assert result.conditioning_min > 0.5


def test_attitude_error_is_the_sine_of_the_angle():
    """A hovering vehicle without effect keeps its attitude; turned by hand, e_R reads the sine on the right axis."""
    _, truth = fly("none", None, "hover", 5.0, seed=1, integral=0.0)
    assert (attitude_error(truth) < 1e-3).all()
    turned = 0.2  # rad about body y
    spin = np.array([np.cos(turned / 2), 0.0, np.sin(turned / 2), 0.0])
    truth = replace(truth, quat_EB=np.tile(spin, (len(truth.time), 1)))
    np.testing.assert_allclose(attitude_error(truth), [0.0, np.sin(turned), 0.0], atol=1e-12)


@pytest.mark.long
@pytest.mark.parametrize("trajectory", ["figure8", "pitch"])
@pytest.mark.parametrize("effect", ["com_offset", "wake", "weak_rotor", "tilt_offset"])
@pytest.mark.parametrize("seed", [4, 5])
def test_more_effects_seeds_and_trajectories(effect, seed, trajectory):
    """The training flight as usually recorded, with the controller's integral on."""
    result = outcome(effect, seed, trajectory=trajectory, train_integral=0.3)
    worth_it = np.isfinite(result.fall[:2])
    assert worth_it.any()
    assert (result.fall[:2][worth_it] >= PAPER_SIMULATION[worth_it]).all(), result
