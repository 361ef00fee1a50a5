"""Thrust grows near the ground, all rotors alike."""

import numpy as np
import pytest

from wrenchgap.flight.so3 import exp

LOW = 0.2


def lift(bench, name, quadrotor, height, quat=(1, 0, 0, 0)):
    """Wrench over that without the effect's thrust."""
    u, x = bench.commands(0.0, 700.0, vehicle=quadrotor), bench.state(position=(0, 0, height), quat=quat)
    return bench.model(name, {"gain": 2.0}, quadrotor).wrench(u, x)[0]


def test_level_it_is_cheeseman_and_bennett_at_the_height_of_the_vehicle(bench, quadrotor):
    grown = lift(bench, "ground_effect_one_height", quadrotor, LOW)
    ratio = 1 / (1 - 2.0 * (quadrotor.rotors.radius[0] / (4 * LOW)) ** 2)
    assert grown[2] == pytest.approx(4 * bench.c_f * 700.0**2 * ratio)


def test_level_both_forms_agree_where_the_hubs_are_at_the_origin(bench, quadrotor):
    forms = [lift(bench, n, quadrotor, LOW) for n in ("ground_effect", "ground_effect_one_height")]
    np.testing.assert_allclose(*forms, atol=1e-12)


def test_rolled_no_torque_rights_it(bench, quadrotor):
    """Where each hub has its own height one does."""
    quat = exp(np.array([np.deg2rad(8), 0, 0]))
    each, one = (lift(bench, n, quadrotor, LOW, quat) for n in ("ground_effect", "ground_effect_one_height"))
    assert each[3] < -1e-3
    np.testing.assert_allclose(one[3:], 0.0, atol=1e-12)
    np.testing.assert_allclose(one, lift(bench, "ground_effect_one_height", quadrotor, LOW), atol=1e-12)
