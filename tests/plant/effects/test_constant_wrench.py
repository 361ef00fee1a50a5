"""A wrench fixed in the body."""

import numpy as np

from wrenchgap.flight.so3 import exp

TURNED = exp(np.array([0.5, -0.8, 1.1]))


def test_adds_itself(bench):
    theta = np.array([0.1, -0.2, 0.3, 0.01, -0.02, 0.03])
    np.testing.assert_allclose(bench.added("constant_wrench", theta, x=bench.state(quat=TURNED)), theta, atol=1e-12)
