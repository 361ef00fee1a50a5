"""The compiled sums of a process beside their specification: `numpy.exp`, and `learn.process.gp` in plain numpy."""

import numpy as np
import pytest

from wrenchgap.compensate import compiled
from wrenchgap.compensate.fast import Limits, plan
from wrenchgap.compensate.uncertainty import UncertaintyFilter
from wrenchgap.learn.process.gp import GaussianProcess

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


@pytest.mark.parametrize("points", [1, 2, 3, 4, 5, 7, 100, 203])
@pytest.mark.parametrize("dense", [False, True])
def test_mean_slope_and_sigma_are_those_of_the_process(points, dense):
    gp = process(points, dense)
    kernel = compiled.as_kernel(gp.expansion())
    mean, slope, std = np.zeros(3), np.zeros((3, 3)), np.zeros(3)
    for xi in gp.input_mean + np.random.default_rng(1).normal(size=(20, 6)) * 2.0:
        compiled.expand(kernel, xi, mean, slope, ROWS, True)
        compiled.spread(kernel, xi, std)
        assert mean == pytest.approx(gp.mean(xi[None])[0], rel=1e-9, abs=1e-11)
        assert slope == pytest.approx(gp.jacobian(xi[None])[0][:, ROWS], rel=1e-9, abs=1e-11)
        assert std == pytest.approx(gp.std(xi[None])[0], rel=1e-9)
        compiled.expand(kernel, xi, std, slope, ROWS, False)
        assert np.array_equal(std, mean)


@pytest.mark.parametrize("points", [1, 3, 4, 5, 100, 203])
@pytest.mark.parametrize("dense", [False, True])
def test_sigma_of_many_steps_at_once_is_that_of_each(points, dense):
    gp = process(points, dense)
    kernel = compiled.as_kernel(gp.expansion())
    steps = gp.input_mean + np.random.default_rng(2).normal(size=(compiled.BATCH, 6)) * 2.0
    for b, xi in enumerate(steps):
        compiled.near(kernel, xi)
        kernel.batch[b] = kernel.rows
    for k in range(3):
        compiled.whiten(kernel, k, compiled.BATCH)
    for k in range(3):
        each = [compiled._whitened(kernel.whitener[k], row, kernel.triangular) for row in kernel.batch[:, k]]
        assert kernel.explained[:, k] == pytest.approx(each, rel=1e-12)
        plain = (kernel.batch[:, k] @ kernel.whitener[k].T) ** 2
        assert kernel.explained[:, k] == pytest.approx(plain.sum(axis=1), rel=1e-12)


def test_kernel_values_are_taken_again_where_an_input_changes():
    gp = process(50)
    kernel, std = compiled.as_kernel(gp.expansion()), np.zeros(3)
    xi = gp.input_mean.copy()
    for d in range(6):
        compiled.spread(kernel, xi, std)
        xi[d] += 0.7 * gp.input_scale[d]
        compiled.spread(kernel, xi, std)
        assert std == pytest.approx(gp.std(xi[None])[0], rel=1e-9)


@pytest.mark.parametrize("rows", [ROWS, np.array([0]), np.arange(6), np.array([1, 2, 4, 5])])
@pytest.mark.parametrize("size", [1e-6, 1e-3, 3e-3, 0.03, 0.1, 3.0, np.nan])
def test_moved_kernel_values_are_those_of_the_place(rows, size):
    """Steps for which the series to the 5th and to the 11th power serve, and one for which neither does."""
    gp = process(203)
    moved, fresh = compiled.as_kernel(gp.expansion()), compiled.as_kernel(gp.expansion())
    rng, found = np.random.default_rng(3), np.zeros((2, 3))
    xi = gp.input_mean + rng.normal(size=6)
    compiled.anew(moved, xi)
    for _ in range(20):
        xi[rows] += size * rng.uniform(-1, 1, len(rows)) * gp.input_scale[rows]
        compiled.move(moved, xi, rows)
        compiled.anew(fresh, xi)
        for kernel, mean in zip((moved, fresh), found, strict=True):
            compiled.mean_of(kernel, xi, mean)
        assert moved.rows == pytest.approx(fresh.rows, rel=1e-13, abs=1e-300, nan_ok=True)
        assert found[0] == pytest.approx(found[1], rel=1e-12, abs=1e-13, nan_ok=True)
    if not 3e-3 < size < 3.0:
        assert bool(moved.moved[0]) == (size <= 3e-3)


def test_what_a_search_begins_with_does_not_depend_on_what_was_asked_before():
    gp = process(50)
    kernel = compiled.as_kernel(gp.expansion())
    xi = gp.input_mean + 0.3 * gp.input_scale
    compiled.anew(kernel, xi)
    first = kernel.rows.copy()
    compiled.move(kernel, xi + np.array([0, 0, 0, 0.01, 0, 0.02]), ROWS)
    compiled.move(kernel, xi, ROWS)
    compiled.anew(kernel, xi)
    assert np.array_equal(kernel.rows, first)


def test_hills_are_exp_to_the_last_bit_but_one():
    square = np.concatenate([[0.0, 1e-300], np.geomspace(1e-12, 1415.0, 20_000)])
    found = square.copy()
    compiled.hills(found)
    assert np.abs(found / np.exp(-0.5 * square) - 1.0).max() < 5e-16


def test_hills_far_away_are_nothing_and_what_is_no_number_stays_none():
    found = np.array([1500.0, 1e12, np.inf, np.nan, 2.0])
    compiled.hills(found)
    assert found[:3].max() < 1e-300
    assert np.isnan(found[3])
    assert found[4] == pytest.approx(np.exp(-1.0), rel=1e-15)


def test_sigma_that_is_no_number_is_not_hidden_by_an_output_that_has_one():
    """As `UncertaintyFilter.sigma`, the maximum of which is nan where one is: the correction is withheld."""
    plain = UncertaintyFilter(np.ones(3, dtype=bool), np.zeros(3), np.ones(3), threshold=1.0, kappa=2.0, decay=0.9)
    bound = np.ones(6)
    gate = plan(process(5), None, plain, Limits(bound, bound, None, 1e-4, 30, 0.01, False)).gate
    for std in (np.array([0.1, np.nan, 0.2]), np.array([0.1, 0.3, 0.2])):
        out = np.zeros(29)
        compiled.gated(gate, std, np.zeros(compiled.TILT), np.zeros(6), out)
        assert np.array_equal(out[compiled.SIGMA], plain.sigma(std), equal_nan=True)
    assert out[compiled.BETA] == pytest.approx(plain.beta(0.3))
    compiled.gated(gate, np.array([0.1, np.nan, 0.2]), np.zeros(compiled.TILT), np.zeros(6), out)
    assert out[compiled.BETA] == 1.0
