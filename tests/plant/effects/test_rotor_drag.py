"""In-plane drag of the rotors."""

import numpy as np

from wrenchgap.plant.effects import find
from wrenchgap.plant.effects.effect import Context


def test_against_level_flight_has_no_torque_about_the_middle(bench):
    """The upper rotors pull as much above O as the lower ones below."""
    W = bench.added("rotor_drag", [1e-4], x=bench.leaning((2.0, -1.0, 0)))
    np.testing.assert_allclose(W, [-12e-4 * bench.hover * 2.0, 12e-4 * bench.hover, 0, 0, 0, 0], atol=1e-9)


def test_lets_rotors_climb(bench):
    np.testing.assert_allclose(bench.added("rotor_drag", [1e-4], x=bench.leaning((0, 0, 2.0))), 0, atol=1e-12)


def test_against_yaw(bench):
    W = bench.added("rotor_drag", [1e-4], x=bench.state(omega=(0, 0, 1.2)))
    np.testing.assert_allclose(W, [0, 0, 0, 0, 0, -12e-4 * bench.hover * 1.2 * bench.length**2], atol=1e-9)


def test_shows_in_yaw_as_in_flight_but_not_at_rest(bench):
    effect = find("rotor_drag")
    assert effect.unexcited(Context(bench.vehicle, bench.state(5))) is not None
    assert effect.unexcited(Context(bench.vehicle, bench.state(5, omega=(0, 0, 1.5)))) is None
    assert effect.unexcited(Context(bench.vehicle, bench.state(5, velocity=(0, 0.5, 0)))) is None
