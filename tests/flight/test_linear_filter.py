"""The compiled filter is scipy's."""

import numpy as np
import pytest
from scipy.signal import lfilter

from wrenchgap.flight.linear_filter import filtered


@pytest.mark.parametrize(
    ("b", "a"),
    [([0.3, 0.2], [1.0, -0.5]), ([0.3, 0.2], [2.0, -0.5]), ([0.1], [1.0, -1.2, 0.5]), ([0.5, 0.1, 0.2], [1.0, -0.4])],
)
def test_it_is_scipys_with_and_without_states(b, a):
    rng = np.random.default_rng(1)
    signal, start = rng.standard_normal((300, 4)), rng.standard_normal((max(len(b), len(a)) - 1, 4))
    np.testing.assert_allclose(filtered(np.array(b), np.array(a), signal), lfilter(b, a, signal, axis=0), rtol=1e-12)
    expected = lfilter(b, a, signal, axis=0, zi=start)[0]
    np.testing.assert_allclose(filtered(np.array(b), np.array(a), signal, start), expected, rtol=1e-12, atol=1e-14)


def test_a_constant_leaves_with_the_gain_at_rest():
    b, a = np.array([0.2, 0.1, 0.05]), np.array([1.0, -0.7, 0.1])
    last = filtered(b, a, np.ones((400, 1)))[-1, 0]
    assert last == pytest.approx(b.sum() / a.sum(), rel=1e-12)


def test_what_is_given_is_not_written_to():
    signal, start = np.ones((5, 2)), np.ones((1, 2))
    filtered(np.array([0.5, 0.5]), np.array([1.0, 0.0]), signal, start)
    np.testing.assert_array_equal(signal, np.ones((5, 2)))
    np.testing.assert_array_equal(start, np.ones((1, 2)))
