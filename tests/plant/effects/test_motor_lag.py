"""First-order lag of the rotor speeds."""

import numpy as np


def test_solves_its_differential_equation(bench):
    lagged, u = bench.lag("motor_lag", 0.03)
    np.testing.assert_array_equal(lagged.tilt, u.tilt)
    np.testing.assert_allclose(lagged.rotor_speed[:, 0], bench.solved_lag(u.rotor_speed[:, 0], 0.03), rtol=1e-5)
