"""A wrench fixed in the body."""

import numpy as np


def test_adds_itself(bench):
    theta = np.array([0.1, -0.2, 0.3, 0.01, -0.02, 0.03])
    np.testing.assert_allclose(bench.added("constant_wrench", theta, x=bench.leaning()), theta, atol=1e-12)
