"""Angular momentum of the rotors."""

import numpy as np
import pytest


def test_gyroscopic_torque_of_steady_rotors_does_no_work(bench):
    x = bench.state(omega=(0.7, -1.1, 0.4))
    W = bench.added("rotor_gyroscopic", [4e-5], bench.commands(0.3, 300 + 50 * np.arange(12) ** 1.5 / 3), x)
    assert np.linalg.norm(W[3:]) > 1e-4
    assert W[3:] @ x.omega_B[0] == pytest.approx(0, abs=1e-12)


def test_equal_pairs_have_no_gyroscopic_torque(bench):
    x, u = bench.moving(4)
    np.testing.assert_allclose(bench.added("rotor_gyroscopic", [4e-5], u, x), 0, atol=1e-12)


@pytest.mark.parametrize("omega_0", [(0, 0, 0), (1.0, -2.0, 1.5)])
def test_total_angular_momentum_is_conserved(tumbling, omega_0):
    """Body plus rotors, in E, however they move against each other. Exaggerated inertia."""
    tumbling.conserves("rotor_gyroscopic", omega_0, J_rotor=2e-3)
