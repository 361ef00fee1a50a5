"""Products of every pair once, beside sums over whole symmetric matrices."""

import numpy as np
import pytest

from wrenchgap.learn.posterior.score import Products


@pytest.fixture
def products():
    """Means of products of 9 quantities in 3 bands and on 2 axes."""
    x = np.random.default_rng(4).normal(size=(3, 2, 9, 20))
    return x @ x.transpose(0, 1, 3, 2) / 20.0


def laws(products):
    """Of each candidate its rows, their products, and the share to which its law is known."""
    return [(m, products[:, :, ROWS[m][:, None], ROWS[m]], a) for m, a in zip(MEMBERS, ACCURACY, strict=True)]


ROWS = np.array([7, 2, 3, 0, 5])
MEMBERS, ACCURACY = [np.array([0, 4]), np.array([1, 2, 3])], [0.1, 0.03]


def test_mean_squares_are_those_of_the_weighted_sum(products):
    """w' P w is the mean square of w' x; what laws may be off by adds up as magnitudes do."""
    weights = np.random.default_rng(5).normal(size=5)
    left, inexact = Products(products, ROWS, laws(products)).mean_squares(weights)
    every = np.zeros(9)
    every[ROWS] = weights
    assert left == pytest.approx(np.einsum("klpq,p,q->kl", products, every, every))
    sizes = 0.0
    for m, share in zip(MEMBERS, ACCURACY, strict=True):
        own = np.zeros(9)
        own[ROWS[m]] = weights[m]
        sizes = sizes + share * np.sqrt(np.einsum("klpq,p,q->kl", products, own, own))
    assert inexact == pytest.approx(sizes**2)


def test_weighed_is_the_sum_over_bands_and_axes(products):
    over = np.random.default_rng(6).uniform(size=(3, 2))
    found = Products(products, ROWS, laws(products)).weighed(over)
    assert found == pytest.approx(np.einsum("kl,klpq->pq", over, products)[np.ix_(ROWS, ROWS)])
    assert np.array_equal(found, found.T)


def test_a_set_of_nothing_has_no_law_to_be_off(products):
    left, inexact = Products(products, ROWS[:1], []).mean_squares(np.array([2.0]))
    assert left == pytest.approx(4.0 * products[:, :, 7, 7])
    assert not inexact.any()
