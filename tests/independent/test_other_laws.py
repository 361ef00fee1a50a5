"""The plants of `benchmarks.other_laws`: their curves and motors against closed forms, and flights in equilibrium."""

import importlib.util
import json
import os
import subprocess
import sys

import numpy as np
import pytest

from benchmarks.autopilot_logs.engine import GRAVITY, QUAD, RPM, Case, Laws, curve, motors_follow

HOVER = QUAD.hover_speed / RPM
HOVERING = """
import json
from benchmarks.autopilot_logs.engine import Case, Laws, fly
given = Laws(), Laws(thrust_linear=0.15), Laws(imu_early=0.002)
flights = fly([Case("a", "hover", 400.0, 200.0, gusts=0.0, seconds=6.0, seed=1, laws=laws) for laws in given])
print(json.dumps([(f.imu.specific_force_B.mean(axis=0).tolist(), f.imu.time.tolist()) for f in flights]))
"""


def test_a_curve_is_as_believed_at_hover_with_the_slope_of_its_linear_share():
    """T = T_h (s w/w_h + (1 - s) (w/w_h)^2), of which the slope at w_h is T_h (2 - s) / w_h."""
    c = curve(3.0, [0.0, 0.15])[..., 0]
    np.testing.assert_allclose(c[0] + c[1] * HOVER + c[2] * HOVER**2, 3.0)
    np.testing.assert_allclose((c[1] + 2.0 * c[2] * HOVER) * HOVER, [6.0, 3.0 * 1.85])


def test_motors_that_follow_with_squared_speed_have_their_lags_at_hover():
    """dw/dt = c (cmd^2 - w^2) is about w_h a first-order lag of 1 / (2 c w_h)."""
    linear, up, other, down = motors_follow(Case("x", laws=Laws(squared=(0.02, 0.04))))
    assert (linear, other) == (0.0, 0.0)
    np.testing.assert_allclose([1.0 / (2.0 * up * HOVER), 1.0 / (2.0 * down * HOVER)], [0.02, 0.04])


@pytest.mark.slow
@pytest.mark.skipif(importlib.util.find_spec("drone_models") is None, reason="needs the extra `benchmark`")
def test_in_calm_hover_weight_is_felt_and_the_imu_is_stamped_early():
    """Thrust carries the weight, so the specific force is g upwards whatever the curve; stamps are 2 ms early."""
    environment = os.environ | {"SCIPY_ARRAY_API": "1"}
    done = subprocess.run([sys.executable, "-c", HOVERING], capture_output=True, text=True, check=True, env=environment)
    (force, time), (curved, _), (_, early) = json.loads(done.stdout)
    for felt in (force, curved):
        np.testing.assert_allclose(felt, [0.0, 0.0, GRAVITY], atol=0.05)
    np.testing.assert_allclose(np.array(time) - early, 0.002)
