"""Torque against the body rate."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp


def test_makes_no_force(bench):
    x, u = bench.moving(0)
    np.testing.assert_allclose(bench.added("rotational_drag", [0.02, 0.03, 0.04, 0.03], u, x)[:3], 0, atol=1e-12)


LAWS = {(0, 0, 0.04, 0): lambda s: np.exp(-0.04 * s), (0, 0, 0, 0.03): lambda s: 1 / (1 + 2.0 * 0.03 * s)}


@pytest.mark.parametrize("theta", LAWS)
def test_spinning_body_slows_down(bench, theta):
    """J domega = -d_1 omega is an exponential, J domega = -d_2 omega^2 a hyperbola, of s = t / J."""
    m, still = bench.model("rotational_drag", theta), bench.commands(0.0, 0.0)

    def rate(_, omega):
        x = bench.state(omega=omega)
        return m.motion(m.wrench(still, x), x.omega_B).omega_dot_B[0]

    spun = solve_ivp(rate, (0, 3.0), [0, 0, 2.0], rtol=1e-9, atol=1e-12).y[2, -1]
    assert spun == pytest.approx(2.0 * LAWS[theta](3.0 / bench.body.inertia[2, 2]), rel=1e-6)
