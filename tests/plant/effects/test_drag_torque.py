"""Drag torque: along -spin n, gone in equal pairs."""

import numpy as np


def test_twice_the_drag_torque_is_the_drag_torque_once_more(bench):
    """Rotor 1 turns counter-clockwise about its thrust; the body is turned clockwise, along -n."""
    assert bench.vehicle.rotors.spin[1] == 1
    for tilt, n in ((0.0, [0, 0, 1]), (np.pi / 2, [0, -1, 0])):  # arm 0 along x: tilted, it thrusts along -y
        W = bench.added("drag_torque", {"change": 1.0}, bench.commands(tilt, bench.only(1)))
        np.testing.assert_allclose(W[:3], 0, atol=1e-12)
        np.testing.assert_allclose(W[3:], -bench.kappa * bench.c_f * bench.hover**2 * np.array(n), atol=1e-12)


def test_of_equal_pairs_cancels_at_any_tilt(bench):
    _, u = bench.moving(3)
    np.testing.assert_allclose(bench.added("drag_torque", {"change": 0.7}, u), 0, atol=1e-12)
