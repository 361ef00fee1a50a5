"""Compiled passes over rows against their plain forms, and local cubics against scipy's and a polynomial."""

import numpy as np
import pytest
from scipy.signal import savgol_filter

from wrenchgap.flight import row_kernels
from wrenchgap.flight.derivative import local_cubics
from wrenchgap.flight.stamps import interpolated, spread, thinned


@pytest.fixture
def values():
    """Noise with repeated rows, and a column that stands still."""
    found = np.random.default_rng(0).normal(size=(5000, 3))
    found[100:140] = found[100]
    found[::7, 1] = found[1::7, 1][: len(found[::7])]
    found[:, 2] = 2.0
    return found


def test_the_compiled_passes_are_equal_to_the_plain_ones(values):
    time = np.sort(np.random.default_rng(1).uniform(0.0, 10.0, len(values)))
    np.testing.assert_array_equal(row_kernels.repeats(values), row_kernels.plain_repeats(values))
    np.testing.assert_allclose(
        row_kernels.integral(time, values), row_kernels.plain_integral(time, values), rtol=1e-12, atol=1e-12
    )
    for columns in (1, 2, 3, 4, 6):
        rows = np.random.default_rng(2).normal(size=(2000, 7))[:, :columns]  # not side by side in memory
        np.testing.assert_array_equal(row_kernels.lengths(rows), row_kernels.plain_lengths(rows))
    values[7, 0], values[9, 1] = np.nan, np.inf
    np.testing.assert_array_equal(row_kernels.largest(values), row_kernels.plain_largest(values))
    assert row_kernels.largest(values)[1] == np.inf


@pytest.mark.parametrize(("wrong", "found"), [(1.0, False), (1e13, True), (-np.inf, True), (np.nan, True)])
@pytest.mark.parametrize("row", [0, 4999])
def test_a_value_beyond_a_limit_is_found_wherever_it_is(values, wrong, found, row):
    values[row, 1] = wrong
    assert row_kernels.beyond(values, 1e12) is found
    assert row_kernels.plain_beyond(values, 1e12) is found


def test_interpolation_is_numpys_also_beyond_the_ends_and_where_places_go_back(values):
    rng = np.random.default_rng(2)
    knots = np.sort(rng.uniform(0.0, 10.0, len(values)))
    time = rng.uniform(-1.0, 11.0, 5000)
    time[:3] = knots[[0, 17, -1]]
    for places in (time, np.sort(time)):
        expected = row_kernels.plain_interpolated(places, knots, values)
        np.testing.assert_array_equal(row_kernels.interpolated(places, knots, values), expected)
        np.testing.assert_array_equal(interpolated(places, knots, values), expected)


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
    np.testing.assert_allclose(
        row_kernels.correlated(values, weights), row_kernels.plain_correlated(values, weights), atol=1e-12
    )


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


def test_a_clamped_sum_is_the_plain_one_and_stays_within_its_limit():
    rng = np.random.default_rng(4)
    steps, limit = rng.normal(size=(300, 3)), np.array([0.5, 2.0, 1e9])
    found = row_kernels.clamped_sum(steps, np.array([0.1, 0.0, -3.0]), limit)
    np.testing.assert_array_equal(found, row_kernels.plain_clamped_sum(steps, np.array([0.1, 0.0, -3.0]), limit))
    np.testing.assert_array_equal(np.abs(found).max(axis=0)[:2], limit[:2])
    np.testing.assert_allclose(found[:, 2], -3.0 + np.cumsum(steps[:, 2]) - steps[:, 2], atol=1e-12)
