"""Arms that turn further than commanded."""

import numpy as np
import pytest


def test_arms_that_turn_further_push_less_up_and_twist_more(bench):
    """All arms at (1 + s) a: F_z = m g cos((1 + s) a), M_z = -length m g sin((1 + s) a)."""
    tilt, further = 0.3, 1.1 * 0.3
    W = bench.added("tilt_scale", [0.1], bench.commands(tilt))
    assert W[2] == pytest.approx(bench.weight * (np.cos(further) - np.cos(tilt)))
    assert W[5] == pytest.approx(-bench.length * bench.weight * (np.sin(further) - np.sin(tilt)))
    np.testing.assert_allclose(W[:2], 0, atol=1e-9)


def test_level_arms_stay_level(bench):
    np.testing.assert_allclose(bench.added("tilt_scale", [0.1]), 0, atol=1e-9)
