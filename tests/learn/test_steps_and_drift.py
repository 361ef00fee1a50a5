"""Steps and drifts of a number over flights: what is found, how often it is chance, what intervals hold."""

import numpy as np
import pytest

from wrenchgap.flight.errors import UsageError
from wrenchgap.learn.identify.steps_and_drift import COURSE, Verdict, course


def flown(rng, count, level=0.0):
    """Values of `count` flights that scatter by 1 about a level, each known to 0.3."""
    return level + rng.normal(size=count), np.full(count, 0.3)


def stepped(rng, count, at, size):
    values, errors = flown(rng, count)
    return values + size * (np.arange(count) >= at), errors


def test_a_step_is_found_at_its_flight_with_its_size():
    """Means 1 and 3 over 5 and 4 flights; the residual sum of squares is 0.04 + 0.02, on 7 degrees of freedom."""
    values = np.array([0.9, 1.1, 0.9, 1.1, 1.0, 3.1, 2.9, 3.0, 3.0])
    found = course(values, np.full(9, 1e-3))
    assert found.verdict is Verdict.STEPS
    (step,) = found.steps
    assert step.flight == 5
    assert (step.before, step.after, step.size) == pytest.approx((1.0, 3.0, 2.0))
    scatter = np.sqrt(0.06 / 7)
    assert found.scatter == pytest.approx(scatter)
    error = scatter * np.sqrt(1 / 5 + 1 / 4)
    assert step.t == pytest.approx(2.0 / error)
    assert (step.low, step.high) == pytest.approx((2.0 - 2.3646 * error, 2.0 + 2.3646 * error), rel=1e-4)  # t table, 7
    np.testing.assert_allclose(found.level, [1.0] * 5 + [3.0] * 4)


def test_two_steps_that_cancel_are_two_steps():
    values = np.array([0.0, 0.1, -0.1, 0.0, 2.0, 2.1, 1.9, 2.0, 0.1, -0.1, 0.0, 0.0])
    found = course(values, np.full(12, 1e-3))
    assert [step.flight for step in found.steps] == [4, 8]
    assert [round(step.size) for step in found.steps] == [2, -2]


def test_wear_is_a_drift_and_no_staircase():
    rng = np.random.default_rng(2)
    for count in (8, 15, 30):
        values = 10.0 * np.arange(count) / count + 0.3 * rng.normal(size=count)
        found = course(values, np.full(count, 0.1))
        assert found.verdict is Verdict.DRIFT
        assert found.drift.low < 10.0 / count < found.drift.high


@pytest.mark.parametrize("count", [1, 2, 3])
def test_of_few_flights_nothing_is_said(count):
    values = np.array([0.0, 100.0, 0.0])[:count]
    found = course(values, np.full(count, 1e-6))
    assert count < COURSE.fewest
    assert found.verdict is Verdict.FEW
    assert (found.steps, found.drift) == ((), None)


def test_one_odd_flight_is_no_step():
    values = np.array([0.0, 0.1, -0.1, 8.0, 0.0, 0.1, -0.1, 0.0, 0.05, 0.0])
    found = course(values, np.full(10, 1e-3))
    assert (found.verdict, found.steps, found.apart) == (Verdict.SCATTERED, (), (3,))


def test_a_defect_that_comes_and_goes_lies_apart():
    """A propeller that is exchanged for a cut one on four flights of thirteen, by 17 of the scatter's 2 %."""
    cut, rng = [3, 4, 8, 11], np.random.default_rng(2)
    values = 0.02 * rng.normal(size=13)
    values[cut] -= 0.17
    found = course(values, np.full(13, 0.02))
    assert (found.verdict, found.apart) == (Verdict.SCATTERED, tuple(cut))


def test_groups_of_one_size_differ_and_none_lies_apart():
    values, errors = 0.1 * np.tile([1.0, -1.0], 5), np.full(10, 0.02)
    found = course(values, errors)
    assert (found.verdict, found.apart) == (Verdict.SCATTERED, ())
    assert course(values, 3.0 * errors).verdict is Verdict.STEADY


@pytest.mark.parametrize("count", [4, 6, 12, pytest.param(25, marks=pytest.mark.slow)])
def test_errors_that_are_true_are_seldom_taken_for_flights_that_differ(count):
    """At 1 % each, apart or by size; the first whatever the errors are, as tiny ones say nothing of outliers."""
    rng = np.random.default_rng(100 + count)
    values = rng.normal(size=(1000, count))
    differ = sum(course(v, np.ones(count)).verdict is Verdict.SCATTERED for v in values)
    apart = sum(bool(course(v, np.full(count, 1e-6)).apart) for v in values)
    assert max(differ, apart) <= 10 + 3 * np.sqrt(10)


def test_a_step_within_the_flights_own_errors_is_none():
    """Values that agree by chance to 0.001, each known to 1 only, show no step of 0.5."""
    values = np.r_[np.full(5, 0.0), np.full(5, 0.5)] + 1e-3 * np.tile([1.0, -1.0], 5)
    assert course(values, np.full(10, 1.0)).verdict is Verdict.STEADY
    assert course(values, np.full(10, 1e-3)).verdict is Verdict.STEPS


def test_units_and_direction_of_time_do_not_matter():
    values, errors = stepped(np.random.default_rng(5), 12, 7, 9.0)
    one, micro, back = course(values, errors), course(1e-6 * values, 1e-6 * errors), course(values[::-1], errors[::-1])
    assert one.steps[0].flight == micro.steps[0].flight == 12 - back.steps[0].flight == 7
    assert micro.steps[0].t == pytest.approx(one.steps[0].t)
    assert micro.steps[0].size == pytest.approx(1e-6 * one.steps[0].size)
    assert back.steps[0].t == pytest.approx(-one.steps[0].t)


def test_values_that_are_all_the_same_are_steady():
    assert course(np.full(8, 0.25), np.zeros(8)).verdict is Verdict.STEADY


@pytest.mark.parametrize("count", [4, 6, 12, 25])
def test_chance_is_seldom_taken_for_a_change(count):
    """Two questions, steps and a line, of 1 % each: of 300 seasons without a change 6 are expected to be called one."""
    rng = np.random.default_rng(count)
    wrong = sum(course(*flown(rng, count)).verdict in (Verdict.STEPS, Verdict.DRIFT) for _ in range(300))
    assert wrong <= 300 * 2 * COURSE.significant + 3 * np.sqrt(300 * 2 * COURSE.significant)


def test_more_parameters_need_more_evidence():
    values, errors = stepped(np.random.default_rng(1), 8, 4, 6.0)
    alone, among = course(values, errors, looks=1), course(values, errors, looks=4)
    assert among.steps[0].p == pytest.approx(4.0 * alone.steps[0].p)


def test_intervals_hold_the_true_size_as_often_as_they_say():
    """Of steps that are clear wherever they are; 95 % of 200 is 190, three standard deviations are 9."""
    rng = np.random.default_rng(3)
    found = [course(*stepped(rng, 12, 6, 12.0)).steps for _ in range(200)]
    held = sum(any(s.low < 12.0 < s.high for s in steps if s.flight == 6) for steps in found)
    assert 181 <= held <= 199


def test_a_search_that_would_take_minutes_is_refused():
    count = COURSE.most + 1
    with pytest.raises(UsageError, match=f"got {count} flights, expected {COURSE.most} at most"):
        course(np.zeros(count), np.ones(count))
