"""A weak rotor."""

import pytest


def test_weak_rotor_lifts_less_and_turns_its_side_down(bench):
    """Rotor 0 sits ahead (+x): weaker, the nose drops (torque about +y)."""
    W = bench.added("rotor_thrust", {"rotor_0": -0.2})
    lost = 0.2 * bench.weight / 12
    assert W[2] == pytest.approx(-lost)
    assert W[4] == pytest.approx(bench.length * lost)
