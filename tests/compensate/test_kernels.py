"""The compiled parts of a step: `numpy.exp`, `learn.process.gp` in plain numpy, closed forms."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from wrenchgap.compensate import kernels
from wrenchgap.compensate.compiling import gaussians
from wrenchgap.compensate.fast import Limits, Stepper, plan
from wrenchgap.compensate.lbfgs import Optimiser
from wrenchgap.compensate.uncertainty import UncertaintyFilter
from wrenchgap.learn.process.gp import GaussianProcess

ROOT = Path(__file__).resolve().parents[2]
TORQUES = ("torque_x", "torque_y", "torque_z")
ROWS = np.array([3, 4, 5])


def process(points, dense=False, seed=0):
    """A process with all numbers different; `dense` with a whitener that is not triangular, as a sparse one has."""
    rng = np.random.default_rng(seed)
    sparse = {}
    if dense:
        sparse = {
            "weights": rng.normal(size=(3, points)),
            "whitener": 0.3 * rng.normal(size=(3, points, points)) / points,
        }
    return GaussianProcess(
        outputs=TORQUES,
        input_mean=rng.normal(size=6),
        input_scale=rng.uniform(0.5, 2.0, 6),
        output_scale=rng.uniform(0.1, 0.5, 3),
        mean_coefficients=rng.normal(size=(3, 7)),
        inputs=rng.normal(size=(points, 6)),
        residuals=rng.normal(size=(points, 3)),
        lengthscales=rng.uniform(0.8, 3.0, (3, 6)),
        signal_variance=rng.uniform(0.5, 2.0, 3),
        noise_variance=rng.uniform(0.01, 0.2, 3),
        sigma_training=np.ones(3),
        mismatch_max=np.ones(3),
        sigma_scale=rng.uniform(0.8, 1.5, 3),
        gain=np.array([1.0, 0.5, 0.8]),
        **sparse,
    )


def stepper(gp):
    """A compensation of a process, and what its functions work on."""
    gate = UncertaintyFilter(np.ones(3, dtype=bool), np.zeros(3), np.ones(3), threshold=1.0, kappa=2.0, decay=0.9)
    bound = np.ones(6)
    made = plan(gp, None, gate, Limits(bound, bound, None, 1e-4, 30, 0.01, False))
    return Stepper(made, Optimiser(-bound, bound), Optimiser(-bound, bound))


@pytest.mark.parametrize("points", [1, 2, 3, 4, 5, 7, 100, 203])
@pytest.mark.parametrize("dense", [False, True])
def test_mean_slope_and_sigma_are_those_of_the_process(points, dense):
    """And the first point again behind all others, whose kernel values are kept as long as the inputs stay."""
    gp = process(points, dense)
    one = stepper(gp)
    c, w = one._compensation, one._room
    mean = np.zeros(3)
    places = gp.input_mean + np.random.default_rng(1).normal(size=(20, 6)) * 2.0
    for xi in (*places, places[0]):
        w.xi[:] = xi
        kernels.process_mean(c.process, w, mean)
        kernels.process_slope(c.process, c.gate, w, w.slope)
        kernels.process_std(c.process, c.gate, w)
        assert mean == pytest.approx(gp.mean(xi[None])[0], rel=1e-9, abs=1e-11)
        assert w.slope == pytest.approx(gp.jacobian(xi[None])[0][:, ROWS], rel=1e-9, abs=1e-11)
        assert w.std == pytest.approx(gp.std(xi[None])[0], rel=1e-9)


def test_kernel_values_are_taken_again_where_an_input_changes():
    gp = process(50)
    one = stepper(gp)
    c, w = one._compensation, one._room
    w.xi[:] = gp.input_mean
    for d in range(6):
        kernels.process_std(c.process, c.gate, w)
        w.xi[d] += 0.7 * gp.input_scale[d]
        kernels.process_std(c.process, c.gate, w)
        assert w.std == pytest.approx(gp.std(w.xi[None])[0], rel=1e-9)


def test_gaussians_are_exp_to_the_last_bit_but_one():
    square = np.concatenate([[0.0, 1e-300], np.geomspace(1e-12, 1415.0, 20_000)])
    found = square.copy()
    gaussians(found)
    assert np.abs(found / np.exp(-0.5 * square) - 1.0).max() < 5e-16


def test_gaussians_far_away_are_nothing_and_what_is_no_number_stays_none():
    found = np.array([1500.0, 1e12, np.inf, np.nan, 2.0])
    gaussians(found)
    assert found[:3].max() < 1e-300
    assert np.isnan(found[3])
    assert found[4] == pytest.approx(np.exp(-1.0), rel=1e-15)


def test_sigma_that_is_no_number_is_not_hidden_by_an_output_that_has_one():
    """The correction is withheld; else beta is the logistic of the largest standard deviation."""
    one = stepper(process(5))
    gate, memory = one.plan.gate, one._memory
    for std in ([0.1, np.nan, 0.2], [0.1, 0.3, 0.2]):
        out = np.zeros(30)
        kernels.pass_gate(gate, np.array(std), memory, np.zeros(6), out)
        hidden = np.isnan(std).any()
        assert np.array_equal(out[kernels.SIGMA], np.nan if hidden else 0.3, equal_nan=True)
        assert out[kernels.BETA] == pytest.approx(1.0 if hidden else 1.0 / (1.0 + np.exp(-2.0 * (0.3 - 1.0))))


def test_what_is_generated_is_what_would_be_printed():
    done = subprocess.run(
        [sys.executable, "-m", "scripts.generate", "--check"], cwd=ROOT, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout
