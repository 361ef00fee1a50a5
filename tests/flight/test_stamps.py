"""Peaks survive, edges are kept, nothing is sent that a screen cannot show."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wrenchgap.flight.stamps import envelope, gaps_of, nominal_period


def test_a_peak_of_one_sample_in_an_hour_is_still_there():
    time = np.arange(0.0, 3600.0, 0.005)
    values = np.zeros((2, len(time)))
    values[0, 345678], values[1, 12345] = 7.0, -3.0
    x, y = envelope(time, values, 0.0, 3600.0)
    assert len(x) <= 2 * 450 + 2
    assert y[0].max() == 7.0
    assert y[1].min() == -3.0
    assert x[y[0].argmax()] == pytest.approx(time[345678], abs=3600.0 / 450)


@given(st.integers(2, 5000), st.integers(1, 60), st.integers(0, 2**32 - 1))
def test_extremes_of_every_line_are_kept_and_times_increase(number, bins, seed):
    random = np.random.default_rng(seed)
    time = np.cumsum(random.uniform(1e-3, 1.0, number))
    values = random.normal(size=(3, number))
    x, y = envelope(time, values, time[0], time[-1], bins)
    assert y.max(axis=1) == pytest.approx(values.max(axis=1))
    assert y.min(axis=1) == pytest.approx(values.min(axis=1))
    assert len(x) <= max(2 * bins + 2, 2)
    assert (np.diff(x) > 0).all()


def test_a_short_range_is_shown_sample_by_sample_with_one_neighbour_on_either_side():
    time = np.arange(0.0, 100.0, 0.1)
    x, y = envelope(time, np.sin(time)[None], 10.05, 20.05)
    assert x[0] == pytest.approx(10.0)
    assert x[-1] == pytest.approx(20.1)
    assert y[0] == pytest.approx(np.sin(x))


def test_unknown_samples_do_not_hide_known_ones():
    time = np.arange(0.0, 100.0, 0.01)
    values = np.where(time < 50.0, np.nan, 1.0)[None]
    x, y = envelope(time, values, 0.0, 100.0)
    assert np.isnan(y[0, x < 49.0]).all()
    assert (y[0, x > 51.0] == 1.0).all()


@pytest.mark.parametrize(("count", "every", "jump"), [(9, 8, 1.4e9), (200, 9, 1e8), (2, 1, 4e9), (1000, 9, 61.0)])
def test_a_clock_that_is_set_leaves_a_gap_however_few_samples_there_are(count, every, jump):
    """Eight samples and one of a real-time clock were a stretch of 44 years: 7 GB, a minute, the end of the process."""
    number = np.arange(count)
    time = 0.01 * number + jump * (number // every)
    jumps = np.flatnonzero(np.diff(number // every))
    assert [(gap.start, gap.stop) for gap in gaps_of(time)] == [(time[k], time[k + 1]) for k in jumps]
    if every > 1:
        assert nominal_period(time) == pytest.approx(0.01, abs=1e-6)
