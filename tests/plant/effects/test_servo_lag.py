"""First-order lag of the tilt angles."""

import numpy as np

from wrenchgap.plant.state import Commands


def test_solves_its_differential_equation(bench):
    lagged, u = bench.lag("servo_lag", 0.03)
    np.testing.assert_array_equal(lagged.rotor_speed, u.rotor_speed)
    np.testing.assert_allclose(lagged.tilt[:, 0], bench.solved_lag(u.tilt[:, 0], 0.03), atol=1e-5)


def test_ramp_is_late_by_the_time_constant(bench):
    t = np.arange(400)[:, None] * bench.dt
    u = Commands(np.zeros((400, 6)), 0.5 * t + np.zeros((400, 6)), np.full((400, 12), 600.0))
    lagged, _ = bench.model("servo_lag", {"tau": 0.04}).command(u, bench.state(400), bench.dt)
    np.testing.assert_allclose(lagged.tilt[300:, 0], 0.5 * (t[300:, 0] - 0.04), atol=1e-6)
