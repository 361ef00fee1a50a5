"""Angular momentum of the arms."""

import numpy as np
import pytest

from wrenchgap.plant.state import Commands


def test_pitching_arms_turn_the_body_back(bench):
    """Arms 0 (+x) and 3 (-x) swung by +-d turn the body about x by -2 J_a d / J, then everything rests."""
    count = 400
    s = np.linspace(0, 1, count)
    swing = 0.8 * (s - np.sin(2 * np.pi * s) / (2 * np.pi))
    tilt = np.outer(swing, [1, 0, 0, -1, 0, 0])
    u = Commands(np.zeros((count, 6)), tilt, np.zeros((count, 12)))
    torque = bench.model("arm_reaction", [1e-3]).actuate(u, bench.state(count), bench.dt)[0][:, 3:]
    np.testing.assert_allclose(torque[:, 1:], 0, atol=1e-12)
    rate = np.cumsum(torque[:, 0]) * bench.dt / bench.body.inertia[0, 0]
    turned = np.sum(rate) * bench.dt
    assert turned == pytest.approx(-2 * 1e-3 * 0.8 / bench.body.inertia[0, 0], rel=1e-4)
    assert rate[-1] == pytest.approx(0, abs=1e-4 * np.abs(rate).max())


@pytest.mark.parametrize("omega_0", [(0, 0, 0), (1.0, -2.0, 1.5)])
def test_total_angular_momentum_is_conserved(tumbling, omega_0):
    """Body plus arms, in E, however they move against each other. Exaggerated inertia."""
    tumbling.conserves("arm_reaction", omega_0, J_arm=0.02)
