"""Commands that arrive late."""

import numpy as np
import pytest

from wrenchgap.plant.state import Commands


@pytest.mark.parametrize("seconds", [0.0, 0.004, 0.005, 0.013, 0.02])
def test_ramp_is_late_by_the_delay(bench, seconds):
    t = np.arange(100)[:, None] * bench.dt
    ramp = 3.0 * t
    u = Commands(ramp + np.zeros((100, 6)), ramp + np.zeros((100, 6)), 600.0 + ramp + np.zeros((100, 12)))
    late, _ = bench.model("command_delay", {"delay": seconds}).command(u, bench.state(100), bench.dt)
    for name in ("wrench_B", "tilt", "rotor_speed"):
        gone = getattr(u, name)[20:] - getattr(late, name)[20:]
        np.testing.assert_allclose(gone, 3.0 * seconds, atol=1e-9)
