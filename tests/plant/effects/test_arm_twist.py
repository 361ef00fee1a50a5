"""An arm is a torsion spring."""

import numpy as np
import pytest


@pytest.mark.parametrize("speed", [500.0, 900.0, -700.0])
def test_arm_is_a_torsion_spring(bench, speed):
    """k dalpha = lever T. Arm 0 lies along x: turned by +dalpha its thrust leans towards -y; reversed, both flip."""
    stiffness, lever = 100.0, 0.2
    T = bench.c_f * speed * abs(speed)
    W = bench.added("arm_twist", {"twist": lever / stiffness}, bench.commands(0.0, bench.only(0, speed)))
    assert W[1] == pytest.approx(-T * np.sin(lever * T / stiffness), rel=1e-9)
    assert W[1] < 0


def test_twist_turns_about_the_arm_and_takes_no_thrust_away(bench):
    u = bench.commands(0.4, bench.only(4, 800.0))
    W = bench.model().wrench(u, bench.state())[0, :3]
    twisted = W + bench.added("arm_twist", {"twist": 0.004}, u)[:3]
    axis = bench.vehicle.arms.axis_B[2]
    assert np.linalg.norm(twisted) == pytest.approx(np.linalg.norm(W))
    assert twisted @ axis == pytest.approx(0, abs=1e-12)
    angle = np.arctan2(np.cross(W, twisted) @ axis, W @ twisted)
    assert angle == pytest.approx(0.004 * bench.c_f * 800.0**2)
