"""Which effects are tried: those of time not where the commands answer the motion on most of the measured axes."""

from types import SimpleNamespace

import pytest

from wrenchgap.flight.flight import AXES
from wrenchgap.flight.offsets import Problem
from wrenchgap.learn.identify.candidates import LAGS, feedback_dominated


def timing(measured, answering):
    """A flight on which the commands of the first `answering` of `measured` axes answer the motion."""
    problems = [Problem.FEEDBACK] * answering + [None] * (measured - answering)
    responses = [
        SimpleNamespace(axis=a, offset=SimpleNamespace(problem=p)) for a, p in zip(AXES, problems, strict=False)
    ]
    return SimpleNamespace(flight="flight", responses=responses)


@pytest.mark.parametrize(
    ("measured", "answering", "barred"),
    [(6, 3, True), (6, 2, False), (2, 2, True), (2, 1, False), (0, 0, False)],
)
def test_effects_of_time_are_barred_where_most_measured_axes_are_feedback_dominated(measured, answering, barred):
    assert {u.effect for u in feedback_dominated([timing(measured, answering)])} == (set(LAGS) if barred else set())


def test_one_flight_that_shows_them_is_enough():
    assert feedback_dominated([timing(6, 6), timing(6, 0)]) == ()
