"""Limited-memory BFGS against scipy's L-BFGS-B, place by place, and its minima against closed forms."""

import numpy as np
import pytest
from scipy.optimize import minimize, rosen, rosen_der

from wrenchgap.learn.process.lbfgs import minimise


def noting(function, slope):
    """An objective, and the list of places at which it is asked."""
    places = []

    def objective(x):
        places.append(np.array(x))
        return float(function(x)), np.asarray(slope(x))

    return objective, places


def quartic(x):
    """Flat in the middle, steep outside, and another scale in every unknown."""
    return float(np.sum((x - 1.0) ** 4 * np.arange(1, len(x) + 1) + 0.5 * np.cos(3.0 * x)))


def quartic_slope(x):
    return 4.0 * (x - 1.0) ** 3 * np.arange(1, len(x) + 1) - 1.5 * np.sin(3.0 * x)


@pytest.mark.parametrize("size", [2, 5, 8])
@pytest.mark.parametrize(("function", "slope"), [(rosen, rosen_der), (quartic, quartic_slope)])
def test_it_asks_where_scipy_asks(function, slope, size):
    for seed in range(5):
        start = 1.5 * np.random.default_rng(seed).normal(size=size)
        (ours, our_places), (scipys, scipy_places) = noting(function, slope), noting(function, slope)
        value, x = minimise(ours, start, 500)
        found = minimize(scipys, start, jac=True, method="L-BFGS-B", options={"maxiter": 500, "maxfun": 500})
        common = min(len(our_places), len(scipy_places), 30)
        np.testing.assert_allclose(our_places[:common], scipy_places[:common], rtol=1e-6, atol=1e-6)
        assert abs(len(our_places) - len(scipy_places)) <= 2
        assert value == pytest.approx(found.fun, abs=1e-6)
        assert value == pytest.approx(float(function(x)), abs=1e-12)


def test_it_finds_the_minimum_of_a_quadratic_in_closed_form():
    rng = np.random.default_rng(3)
    root = rng.normal(size=(6, 6))
    H, target = root @ root.T + np.eye(6), rng.normal(size=6)
    _, x = minimise(lambda x: (0.5 * float((x - target) @ H @ (x - target)), H @ (x - target)), np.zeros(6), 200)
    np.testing.assert_allclose(x, target, atol=1e-4)


def test_it_stops_where_it_may_not_go_on_and_where_nothing_is_lower():
    objective, places = noting(rosen, rosen_der)
    minimise(objective, np.array([-1.2, 1.0]), 5)
    assert 5 <= len(places) <= 26
    value, x = minimise(lambda x: (float(x.sum()), np.full(2, -1.0)), np.ones(2), 50)  # a slope that is wrong
    assert (value, list(x)) == (2.0, [1.0, 1.0])
    value, x = minimise(lambda x: (1.0, np.zeros(2)), np.ones(2), 50)
    assert (value, list(x)) == (1.0, [1.0, 1.0])
