"""Another inertia."""

import numpy as np
import pytest


def test_larger_inertia_answers_with_less_acceleration(bench):
    """With twice the inertia about x the same torque makes half of the nominal torque appear in the measurement."""
    W = np.array([[0.0, 0, 0, 0.4, 0, 0]])
    reported = bench.model("inertia", {"xx": bench.body.inertia[0, 0]}).report(W, bench.state())
    assert reported[0, 3] == pytest.approx(0.2)


def test_inertia_keeps_the_energy_of_a_free_body(bench):
    """The gyroscopic torque of the changed body does no work: omega . J omega_dot = 0, whatever the products."""
    omega = np.random.default_rng(6).normal(size=(50, 3))
    m = bench.model("inertia", [0.01, 0.005, -0.01, 0.002, -0.001, 0.003])
    domega = m.motion(np.zeros((50, 6)), omega).omega_dot_B
    np.testing.assert_allclose(np.einsum("ni,ij,nj->n", omega, m.body.inertia, domega), 0, atol=1e-12)
