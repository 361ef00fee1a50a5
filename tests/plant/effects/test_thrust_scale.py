"""A share of the whole wrench."""

import numpy as np


def test_is_a_share_of_the_wrench(bench):
    x, u = bench.moving(0)
    W = bench.added("thrust_scale", {"scale": -0.1}, u, x)
    np.testing.assert_allclose(W, -0.1 * bench.model().wrench(u, x)[0], atol=1e-12)
