"""A quadratic within bounds: scipy's answer, and the conditions of its minimum."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from wrenchgap.learn.identify.bounded import bounded_minimum


def problem(seed, size):
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(size + 3, size)) * 10.0 ** rng.uniform(-1, 2, size)
    H = root.T @ root + np.eye(size)
    return H, H @ rng.normal(size=size) * 2.0, rng.uniform(-1.5, -0.01, size), rng.uniform(0.01, 1.5, size)


@pytest.mark.parametrize("size", [1, 3, 7, 15])
def test_it_is_scipys_minimum(size):
    bound = 0
    for seed in range(30):
        H, g, low, high = problem(seed, size)
        x = bounded_minimum(H, g, low, high)
        L = np.linalg.cholesky(H)
        theirs = lsq_linear(L.T, np.linalg.solve(L, g), bounds=(low, high), method="bvls", tol=1e-14).x
        np.testing.assert_allclose(x, theirs, atol=1e-7)
        slope, at_low, at_high = H @ x - g, x <= low, x >= high
        small = 1e-9 * np.abs(g).max()
        assert np.all(np.abs(slope[~at_low & ~at_high]) <= small)
        assert np.all(slope[at_low] >= -small)
        assert np.all(slope[at_high] <= small)
        bound += int((at_low | at_high).any())
    assert bound > 5


def test_within_the_bounds_it_is_the_solution():
    H, g, _, _ = problem(1, 4)
    np.testing.assert_allclose(bounded_minimum(H, g, np.full(4, -1e9), np.full(4, 1e9)), np.linalg.solve(H, g))


def test_an_unknown_without_room_stays():
    H, g, low, high = problem(2, 4)
    low[1] = high[1] = 0.3
    x = bounded_minimum(H, g, low, high)
    assert x[1] == 0.3
    assert np.all((x >= low) & (x <= high))
