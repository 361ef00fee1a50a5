"""Vehicles for the plant's tests, built from their geometry here rather than read from the shipped files."""

import numpy as np
import pytest

from wrenchgap.plant.vehicle import Arms, Body, Rotors, Vehicle


def star(arms: int = 6, *, coaxial: bool = True, tilts: bool = True, phase: float = 0.0) -> Vehicle:
    """A planar star of `arms` arms with one or two rotors each."""
    azimuth = phase + 2 * np.pi * np.arange(arms) / arms
    axis = np.stack((np.cos(azimuth), np.sin(azimuth), np.zeros(arms)), axis=1)
    arm = np.repeat(np.arange(arms), 2 if coaxial else 1)
    alternating = np.where(arm % 2 == 0, -1.0, 1.0)
    within = np.tile([1.0, -1.0], arms) if coaxial else np.ones(arms)
    up, limits = np.tile([0.0, 0.0, 1.0], (arms, 1)), (np.full(arms, limit) for limit in (-10.0, 10.0, 50.0))
    rotor = (np.full(len(arm), value) for value in (7.2e-6, 0.0165, 0.115, 0.0, 1250.0))
    return Vehicle(
        "star",
        Body(4.0, np.diag([0.10, 0.11, 0.19]), np.zeros(3)),
        Arms(0.3 * axis, axis, up, np.full(arms, tilts), *limits),
        Rotors(arm, 0.04 * within if coaxial else np.zeros(arms), alternating * within, *rotor),
        np.zeros(3),
    )


@pytest.fixture
def hexarotor() -> Vehicle:
    return star()


@pytest.fixture
def quadrotor() -> Vehicle:
    return star(4, coaxial=False, tilts=False, phase=np.pi / 4)
