"""Rotors that climb lose thrust; any motion is damped."""

import numpy as np
import pytest


@pytest.mark.parametrize("turned", [False, True])
def test_climbing_rotors_lose_thrust(bench, turned):
    """Twelve rotors that climb along their thrust at 2 m/s, whatever the attitude."""
    x = bench.leaning((0, 0, 2.0)) if turned else bench.state(velocity=(0, 0, 2.0))
    expected = [0, 0, -12 * 2.3e-4 * bench.hover * 2.0, 0, 0, 0]
    np.testing.assert_allclose(bench.added("axial_inflow", [2.3e-4], x=x), expected, atol=1e-9)


def test_rolling_hexarotor_is_damped_by_its_rising_and_sinking_rotors(bench):
    """sum y^2 over two rotors on each of six arms is 6 L^2."""
    W = bench.added("axial_inflow", [2.3e-4], x=bench.state(omega=(1.5, 0, 0)))
    np.testing.assert_allclose(W, [0, 0, 0, -2.3e-4 * bench.hover * 1.5 * 6 * bench.length**2, 0, 0], atol=1e-9)


def test_rotor_that_turns_backwards_is_damped_too(bench):
    W = bench.added("axial_inflow", [2.3e-4], bench.commands(0.0, -bench.hover), bench.state(velocity=(0, 0, 2.0)))
    assert W[2] == pytest.approx(-12 * 2.3e-4 * bench.hover * 2.0)
