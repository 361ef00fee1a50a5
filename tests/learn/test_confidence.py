"""How sure: the more speaks for a name the surer, never quite sure, and less so where something is left."""

import itertools

import numpy as np
import pytest

from wrenchgap.learn.identify import confidence
from wrenchgap.learn.identify.confidence import FAR, SUREST, nearest
from wrenchgap.learn.identify.confidence import confidence as confidence_in

SEPARATIONS = (-2.0, 0.0, 1.0, 3.0, 6.0, 8.0, 20.0)
EXAMPLE = (0.5, 0.4, 1.0, 0.8, -0.6, -1.2)
"""Coefficients that all count, whatever those in force."""


@pytest.fixture(params=["in force", "example"])
def coefficients(request, monkeypatch):
    if request.param == "example":
        monkeypatch.setattr(confidence, "COEFFICIENTS", EXAMPLE)
    return request.param


def stated(made_up, separation=4.0, share=0.3, evidence=2.0, left=1.5, unknown=False):
    return confidence_in(made_up.member(made_up.rival(separation), share=share, evidence=evidence), left, unknown)


@pytest.mark.parametrize(
    ("key", "values", "rises"),
    [
        ("separation", SEPARATIONS, True),
        ("share", (1e-6, 1e-3, 0.1, 0.9, 1.0), True),
        ("evidence", (0.0, 0.2, 1.0, 5.0, 50.0), True),
        ("left", (0.9, 1.5, 5.0, 30.0, 300.0), False),
        ("unknown", (False, True), False),
    ],
)
def test_goes_the_way_it_must(made_up, coefficients, key, values, rises):
    p = np.array([stated(made_up, **{key: v}) for v in values])
    steps = np.diff(p) if rises else -np.diff(p)
    assert (steps >= 0).all()
    if coefficients == "example":
        assert (steps > 0).sum() >= min(3, len(steps))


def test_stays_between_zero_and_the_surest(made_up, coefficients):
    shares, evidences, left = (0.0, -0.1, 1e-9, 1.0), (-3.0, 0.0, 1e3), (0.0, 1.0, 1e6)
    for case in itertools.product(SEPARATIONS, shares, evidences, left, (False, True)):
        assert 0.0 < stated(made_up, *case) <= SUREST


def test_nothing_is_sure(made_up, monkeypatch):
    monkeypatch.setattr(confidence, "COEFFICIENTS", (40.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    assert stated(made_up) == SUREST < 1


@pytest.mark.parametrize(("separation", "odds"), [(0.0, 0.5), (3.0, 0.75), (-3.0, 0.25)])
def test_even_odds_are_one_half(made_up, monkeypatch, separation, odds):
    """Odds are exp(b . x): at separation 3 with ln(3) / 3 per unit, three to one."""
    monkeypatch.setattr(confidence, "COEFFICIENTS", (0.0, np.log(3) / 3, 0.0, 0.0, 0.0, 0.0))
    assert stated(made_up, separation=separation) == pytest.approx(odds)


def test_nearest_is_the_closest_that_might_be_right_and_is_not_of_the_group(made_up):
    rival, member = made_up.rival, made_up.member
    alike, far = rival(0.1, 0.99, "alike"), rival(5.0, 0.99, "far")
    hopeless = rival(1.0, 0.3, "hopeless", significance=0.5)
    odd = rival(2.0, 0.3, "odd", implausible=("odd.value",))
    assert nearest(member(alike, far, hopeless, odd)) == 5.0
    assert nearest(member(far, rival(3.5, 0.1, "nearer"))) == 3.5
    assert nearest(member(alike)) == FAR
    assert nearest(member()) == FAR


def test_farther_than_far_is_no_surer(made_up, monkeypatch):
    monkeypatch.setattr(confidence, "COEFFICIENTS", EXAMPLE)
    alone = confidence_in(made_up.member(share=0.3, evidence=2.0), 1.5, False)
    assert stated(made_up, separation=FAR + 10) == alone
    assert stated(made_up, separation=FAR - 1) < alone


def test_a_group_is_as_sure_as_what_lies_outside_it(made_up, monkeypatch):
    """A probability is that of the group: one more that looks the same takes nothing away."""
    monkeypatch.setattr(confidence, "COEFFICIENTS", EXAMPLE)
    twin, other = made_up.rival(0.1, 0.999, "twin"), made_up.rival(4.0)
    one, two = made_up.member(other), made_up.member(other, twin)
    assert confidence_in(one, 1.5, False) == confidence_in(two, 1.5, False)
    assert [r.name for r in two.alike] == ["twin"]
