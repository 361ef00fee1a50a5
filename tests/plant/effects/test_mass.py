"""Mass: more weight to carry, the same torque to turn."""

import numpy as np

from wrenchgap.flight.flight import GRAVITY


def test_heavier_vehicle_hovers_on_more_thrust_but_reports_its_nominal_weight(bench):
    m = bench.model("mass", {"added": 0.3})
    hovering = np.array([[0, 0, (bench.body.mass + 0.3) * GRAVITY, 0, 0, 0]])
    np.testing.assert_allclose(m.motion(hovering, np.zeros((1, 3))).specific_force_B, [[0, 0, GRAVITY]], atol=1e-12)
    np.testing.assert_allclose(m.report(hovering, bench.state())[0, :3], [0, 0, bench.weight], atol=1e-9)


def test_alone_does_not_change_how_torque_turns_the_body(bench):
    W = np.array([[1.0, -2.0, 40.0, 0.1, 0.2, -0.3]])
    omega = np.array([[0.4, -0.5, 0.6]])
    turned = bench.model("mass", {"added": 0.3}).motion(W, omega).omega_dot_B
    np.testing.assert_allclose(turned, bench.model().motion(W, omega).omega_dot_B, atol=1e-12)
