"""Arms that stand askew."""

import numpy as np
import pytest


def test_common_offset_is_a_yaw_torque(bench):
    """All arms tilted by +d push clockwise: M_z = -bench.length sin(d) m g."""
    W = bench.added("tilt_offset", [0.02] * 6)
    assert W[5] == pytest.approx(-bench.length * np.sin(0.02) * bench.weight)
    np.testing.assert_allclose(W[:2], 0, atol=1e-9)
