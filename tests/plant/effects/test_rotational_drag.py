"""Torque against the body rate."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp


@pytest.mark.parametrize("seed", range(5))
def test_takes_energy(bench, seed):
    x, u = bench.moving(seed)
    W = bench.added("rotational_drag", [0.02, 0.03, 0.04, 0.03], u, x)
    np.testing.assert_allclose(W[:3], 0, atol=1e-12)
    assert W[3:] @ x.omega_B[0] < 0


@pytest.mark.parametrize(
    ("theta", "decay"),
    [
        ([0, 0, 0.04, 0], lambda t, J: np.exp(-0.04 * t / J)),
        ([0, 0, 0, 0.03], lambda t, J: 1 / (1 + 2.0 * 0.03 * t / J)),
    ],
)
def test_spinning_body_slows_down(bench, theta, decay):
    """J domega = -d_1 omega is an exponential, J domega = -d_2 omega^2 a hyperbola."""
    m = bench.model("rotational_drag", theta)
    still = bench.commands(0.0, 0.0)

    def rate(_, omega):
        x = bench.state(omega=omega)
        return m.motion(m.wrench(still, x), x.omega_B).omega_dot_B[0]

    spun = solve_ivp(rate, (0, 3.0), [0, 0, 2.0], rtol=1e-9, atol=1e-12).y[2, -1]
    assert spun == pytest.approx(2.0 * decay(3.0, bench.body.inertia[2, 2]), rel=1e-6)
