"""What pushes where one rotor pushes is that rotor's; what pushes everywhere is nobody's."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wrenchgap.learn.diagnose.one_rotor import one_rotor

RADIUS, HEIGHT, KAPPA = 0.30, 0.035, 0.0165
"""The tilting hexarotor: six arms every 60 deg, two rotors on each, one above the other along the tilted axis [m]."""


def push(data, arm, spin):
    """Wrench (K, 6) of one newton of a rotor: Rodrigues' rotation of the vertical about the arm's outward axis."""
    outward = np.array([np.cos(np.radians(60 * arm)), np.sin(np.radians(60 * arm)), 0.0])
    tilt = np.concatenate([r.commands.tilt[r.keep, arm] for r in data.records])
    axis = Rotation.from_rotvec(tilt[:, None] * outward).apply([0.0, 0.0, 1.0])
    torque = np.cross(RADIUS * outward, axis) - spin * KAPPA * axis
    return np.hstack((axis, torque))


def slips(data, seed):
    """Now and then half a second of less thrust [N]."""
    time = np.concatenate([r.time for r in data.records])
    rng = np.random.default_rng(seed)
    return -2.0 * np.any([(time > t) & (time < t + 0.5) for t in rng.uniform(time[0], time[-1], 8)], axis=0)


def white(data, seed):
    return np.random.default_rng(seed).standard_normal(data.measured.shape) * data.noise


@pytest.mark.parametrize(("rotor", "spin"), [(0, 1), (3, 1), (6, 1), (11, 1)])
def test_a_rotor_that_slips_is_found_with_the_one_on_its_shaft(plain, hexarotor, rotor, spin):
    arm = rotor // 2
    spins = hexarotor.vehicle.rotors.spin
    left = white(plain, rotor) + slips(plain, rotor)[:, None] * push(plain, arm, spins[rotor])
    found = one_rotor(plain, hexarotor.vehicle, left)
    assert found is not None
    assert rotor in found.rotors
    assert {k // 2 for k in found.rotors} == {arm}
    assert found.share > 0.95


def test_what_pushes_at_two_arms_is_not_one_rotors(plain, hexarotor):
    left = white(plain, 1)
    for rotor, seed in ((0, 1), (5, 2)):
        left += slips(plain, seed)[:, None] * push(plain, rotor // 2, 1.0)
    assert one_rotor(plain, hexarotor.vehicle, left) is None


@pytest.mark.parametrize("seed", range(4))
def test_gusts_do_not_hide_a_rotor_that_slips(plain, hexarotor, seed):
    """Gusts on all axes alike, a third of what the rotor makes."""
    rng = np.random.default_rng(50 + seed)
    slip = slips(plain, seed)[:, None] * push(plain, 2, hexarotor.vehicle.rotors.spin[4])
    gust = np.cumsum(rng.standard_normal(plain.measured.shape), axis=0)
    gust = (gust - gust.mean(axis=0)) / gust.std(axis=0) / plain.weights / np.sqrt(6.0)  # one newton over all axes
    gust *= np.sqrt(np.mean(np.sum((slip * plain.weights) ** 2, axis=1))) / 3.0
    found = one_rotor(plain, hexarotor.vehicle, white(plain, seed) + slip + gust)
    assert found is not None
    assert {k // 2 for k in found.rotors} == {2}
    assert 0.75 < found.share < 0.97


@pytest.mark.parametrize("seed", range(5))
def test_noise_and_gusts_are_nobodys(plain, hexarotor, seed):
    """A gust: force and torque of equal strength along every axis, changing slowly."""
    rng = np.random.default_rng(seed)
    gust = np.cumsum(rng.standard_normal(plain.measured.shape), axis=0)
    gust *= 20 * plain.noise / gust.std(axis=0)
    assert one_rotor(plain, hexarotor.vehicle, white(plain, seed)) is None
    assert one_rotor(plain, hexarotor.vehicle, white(plain, seed) + gust) is None


def test_without_rotors_or_a_torque_nothing_is_said(plain, hexarotor):
    left = slips(plain, 3)[:, None] * push(plain, 1, 1.0)
    bare = replace(hexarotor.vehicle, arms=None, rotors=None)
    assert one_rotor(plain, bare, left) is None
    blind = replace(plain, weights=np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0]))
    assert one_rotor(blind, hexarotor.vehicle, left) is None
