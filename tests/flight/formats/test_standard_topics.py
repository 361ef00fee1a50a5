"""Values of one topic at another's stamps: exact where they should be, averaged where they must, never invented."""

import numpy as np

from wrenchgap.flight.formats.standard_topics import cubic_at, values_at


def ns(seconds):
    return np.round(1e9 * np.asarray(seconds)).astype(np.int64) + 10**18


def test_a_straight_line_is_met_exactly_and_nothing_is_known_beyond_its_ends():
    slow, fast = np.arange(0, 2, 0.1), np.arange(-0.5, 2.5, 0.01)
    found = values_at(ns(fast), ns(slow), np.stack((3.0 * slow, 1.0 - slow), axis=1))
    inside = (fast >= -1e-9) & (fast <= 1.9 + 1e-9)
    np.testing.assert_allclose(found[inside, 0], 3.0 * fast[inside], atol=1e-7)
    assert np.isnan(found[~inside]).all()


def test_a_gap_of_the_source_is_not_bridged():
    source = np.concatenate((np.arange(0, 1, 0.01), np.arange(2, 3, 0.01)))
    asked = np.arange(0, 2.9, 0.01)
    found = values_at(ns(asked), ns(source), source[:, None])[:, 0]
    assert np.isnan(found[(asked > 1.0) & (asked < 1.99)]).all()
    assert np.isfinite(found[(asked < 0.985) | (asked > 2.005)]).all()


def test_what_is_faster_than_half_the_new_rate_is_averaged_away_and_not_folded_down():
    fast, slow = np.arange(0, 4, 0.001), np.arange(0.5, 3.5, 0.02)
    hum = np.sin(2 * np.pi * 50.0 * fast)  # once per new period: sampled, it would be a constant
    found = values_at(ns(slow), ns(fast), np.stack((hum + 2.0, np.sin(fast)), axis=1))
    np.testing.assert_allclose(found[:, 0], 2.0, atol=1e-3)
    np.testing.assert_allclose(found[:, 1], np.sin(slow), atol=1e-4)


def test_cubics_with_the_logged_velocity_are_of_fourth_order():
    errors = []
    for step in (0.2, 0.1):
        source, asked = np.arange(0, 4, step), np.arange(0, 3.5, 0.01)
        found = cubic_at(ns(asked), ns(source), np.sin(source)[:, None], np.cos(source)[:, None])[:, 0]
        errors.append(np.abs(found - np.sin(asked)).max())
    assert 14.0 < errors[0] / errors[1] < 18.0


def test_a_jump_that_the_velocity_does_not_know_of_is_no_swing():
    source = np.arange(0, 4, 0.1)
    place = np.where(source < 2.0, 0.0, 5.0)[:, None]
    found = cubic_at(ns(np.arange(0, 3.9, 0.01)), ns(source), place, np.zeros_like(place))
    assert found.min() >= 0.0
    assert found.max() <= 5.0


def test_damaged_rows_of_the_source_do_not_count():
    source = np.arange(0, 1, 0.1)
    values = source[:, None].copy()
    values[4] = np.nan
    np.testing.assert_allclose(values_at(ns([0.42]), ns(source), values), [[0.42]], atol=1e-9)
