"""The wake of the upper rotor takes thrust from the lower one."""

from types import SimpleNamespace

import numpy as np
import pytest

from wrenchgap.plant.effects import find


def test_at_equal_speeds_it_takes_the_share_from_half_of_the_rotors(bench):
    W = bench.added("coaxial_loss_of_wake", {"eta": 0.2})
    assert W[2] == pytest.approx(-0.2 * bench.weight / 2)


def test_a_faster_upper_rotor_costs_the_lower_one_thrust(hexarotor):
    """Momentum theory: four times the upper thrust, twice the velocity of its wake, twice the loss. A loss of lift at a
    given inflow goes with the blade's own speed: a lower rotor at half the speed loses half as much.
    """
    lost = {}
    rotors = hexarotor.rotors
    low = next(r for r in range(len(rotors)) if rotors.offset[r] < rotors.offset[rotors.arm == rotors.arm[r]].max())
    up = next(r for r in np.flatnonzero(rotors.arm == rotors.arm[low]) if r != low)
    for pair in ((1.0, 1.0), (2.0, 1.0), (1.0, 0.5)):
        speed = np.full((1, len(rotors)), 300.0)
        speed[0, [up, low]] *= pair
        thrust = rotors.c_f * speed**2
        actuation = SimpleNamespace(thrust=thrust, rotor_speed=speed)
        after = find("coaxial_loss_of_wake").apply(actuation, np.array([0.2]), SimpleNamespace(vehicle=hexarotor))
        lost[pair] = thrust[0, low] - after[0, low]
        assert after[0, up] == thrust[0, up]
    assert lost[2.0, 1.0] == pytest.approx(2.0 * lost[1.0, 1.0])
    assert lost[1.0, 0.5] == pytest.approx(0.5 * lost[1.0, 1.0])
