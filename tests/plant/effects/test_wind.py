"""Drag against air that moves."""

import numpy as np
import pytest

from wrenchgap.flight.so3 import rotate

D_WIND, V_WIND = 0.3, np.array([2.0, -1.5, 0.0])
WIND = [D_WIND, *(D_WIND * V_WIND[:2])]


def test_drifting_with_the_wind_feels_nothing(bench):
    x = bench.state(velocity=V_WIND, quat=bench.turned)
    np.testing.assert_allclose(bench.added("wind", WIND, x=x), 0, atol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_wind_blows_the_vehicle_towards_its_own_velocity(bench, seed):
    x, u = bench.moving(seed)
    force_E = rotate(x.quat_EB[0], bench.added("wind", WIND, u, x)[:3])
    assert force_E @ (x.velocity_E[0] - V_WIND) < 0
    assert np.linalg.norm(force_E) == pytest.approx(D_WIND * np.linalg.norm(x.velocity_E[0] - V_WIND))


def test_standing_in_the_wind_is_pushed_downwind(bench):
    force_E = rotate(bench.turned, bench.added("wind", WIND, x=bench.leaning())[:3])
    np.testing.assert_allclose(force_E, D_WIND * V_WIND, atol=1e-12)
