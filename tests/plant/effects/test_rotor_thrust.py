"""A weak rotor."""

import pytest

from wrenchgap.plant.effects import find


def test_weak_rotor_lifts_less_and_turns_its_side_down(bench):
    """Rotor 0 sits ahead (+x): weaker, the nose drops (torque about +y)."""
    W = bench.added("rotor_thrust", {"rotor_0": -0.2})
    lost = 0.2 * bench.weight / 12
    assert W[2] == pytest.approx(-lost)
    assert W[4] == pytest.approx(bench.length * lost)


def test_a_blade_can_break_but_not_grow(bench):
    """Scatter of a few per cent is believed both ways, a loss of half the thrust too, a gain of 15 % not."""
    for p in find("rotor_thrust").parameters(bench.vehicle):
        assert p.low <= -0.5
        assert 0.05 <= p.high < 0.15
