"""Passes over rows against closed forms and scipy's own functions, and local cubics against a polynomial."""

from itertools import groupby

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid
from scipy.ndimage import correlate1d
from scipy.signal import savgol_filter

from wrenchgap.flight import row_kernels
from wrenchgap.flight.filters import local_cubics
from wrenchgap.flight.stamps import interpolated, spread, thinned


@pytest.fixture
def values():
    """Noise with repeated rows, and a column that stands still."""
    found = np.random.default_rng(0).normal(size=(5000, 3))
    found[100:140] = found[100]
    found[::7, 1] = found[1::7, 1][: len(found[::7])]
    found[:, 2] = 2.0
    return found


def test_repeats_are_counted_and_the_longest_run_is_found(values):
    runs = [[len(list(same)) - 1 for _, same in groupby(column.tolist())] for column in values.T]
    assert row_kernels.repeats(values).T.tolist() == [[sum(lengths), max(lengths)] for lengths in runs]
    assert row_kernels.repeats(np.full((3, 1), np.nan)).tolist() == [[0], [0]]
    assert row_kernels.repeats(np.zeros((0, 2))).tolist() == [[0, 0], [0, 0]]


def test_integrals_are_the_trapezoid_rules(values):
    time = np.sort(np.random.default_rng(1).uniform(0.0, 10.0, len(values)))
    expected = cumulative_trapezoid(values, time, axis=0, initial=0.0)
    np.testing.assert_allclose(row_kernels.integral(time, values), expected, rtol=1e-12, atol=1e-12)


def test_interpolation_holds_the_ends_and_needs_a_knot():
    knots, values = np.array([0.0, 1.0, 3.0]), np.array([[0.0, 5.0], [2.0, 5.0], [4.0, 5.0]])
    found = interpolated(np.array([2.0, -1.0, 9.0]), knots, values)
    np.testing.assert_array_equal(found, [[3.0, 5.0], [0.0, 5.0], [4.0, 5.0]])
    with pytest.raises(ValueError, match="nothing to interpolate"):
        interpolated(knots, knots[:0], values[:0])


def test_columns_that_change_and_columns_without_a_number_are_told_apart():
    values = np.zeros((5000, 4))
    values[4999, 0] = 1.0
    values[:, 2] = np.nan
    values[1:, 3] = np.nan
    assert row_kernels.varying(values).tolist() == [True, False, False, True]
    assert row_kernels.empty(values).tolist() == [False, False, True, False]


@pytest.mark.parametrize("points", [5, 7, 31])
@pytest.mark.parametrize("derivative", [0, 1])
def test_local_cubics_are_savitzkys_and_golays(values, points, derivative):
    expected = savgol_filter(values, points, 3, deriv=derivative, axis=0)
    np.testing.assert_allclose(local_cubics(values, points, derivative), expected, atol=1e-12)
    weights = np.random.default_rng(3).normal(size=points)
    expected = correlate1d(values, weights, axis=0)[points // 2 : -(points // 2)]
    np.testing.assert_allclose(row_kernels.correlated(values, weights), expected, atol=1e-12)


def test_local_cubics_leave_a_cubic_as_it_is_up_to_both_ends():
    x = np.arange(40.0) / 10.0
    np.testing.assert_allclose(local_cubics(x**3 - 2 * x, 9, 0), x**3 - 2 * x, atol=1e-12)
    np.testing.assert_allclose(10.0 * local_cubics(x**3 - 2 * x, 9, 1), 3 * x**2 - 2, atol=1e-11)


def test_rows_that_are_looked_at_are_spread_from_the_first_to_the_last():
    assert spread(900, 1000, 100) == [slice(0, 900)]
    runs = spread(10_000, 1000, 100)
    assert len(runs) == 10
    assert (runs[0].start, runs[-1].stop) == (0, 10_000)
    assert all(run.stop - run.start == 100 for run in runs)
    rows = thinned(10_000, 1000)
    assert (rows[0], rows[-1], len(rows)) == (0, 9999, 1000)
    assert thinned(10, 1000) == slice(None)


def test_a_clamped_sum_stays_within_its_limit_and_leaves_it_at_once():
    """What goes beyond is forgotten: each sum is the one before plus its step, or a limit that this would cross."""
    rng = np.random.default_rng(4)
    steps, limit = rng.normal(size=(300, 3)), np.array([0.5, 2.0, 1e9])
    found = row_kernels.clamped_sum(steps, np.array([0.1, 0.0, -3.0]), limit)
    np.testing.assert_array_equal(found[0], [0.1, 0.0, -3.0])
    np.testing.assert_array_equal(np.abs(found).max(axis=0)[:2], limit[:2])
    np.testing.assert_array_equal(found[1:], np.clip(found[:-1] + steps[:-1], -limit, limit))
    np.testing.assert_allclose(found[:, 2], -3.0 + np.cumsum(steps[:, 2]) - steps[:, 2], atol=1e-12)
    one = row_kernels.clamped_sum(np.array([[3.0], [4.0], [-1.0], [-9.0], [0.0]]), np.zeros(1), np.array([5.0]))
    assert one[:, 0].tolist() == [0.0, 3.0, 5.0, 4.0, -5.0]
