"""Vehicles for the plant's tests, built from their geometry here rather than read from the shipped files."""

import numpy as np
import pytest

from wrenchgap.plant.vehicle import Arms, Body, Rotors, Vehicle


def star(
    arms: int = 6, *, length: float = 0.3, coaxial: bool = True, tilts: bool = True, phase: float = 0.0
) -> Vehicle:
    """A planar star of `arms` arms with one or two rotors each."""
    azimuth = phase + 2 * np.pi * np.arange(arms) / arms
    axis = np.stack((np.cos(azimuth), np.sin(azimuth), np.zeros(arms)), axis=1)
    per_arm = 2 if coaxial else 1
    rotors = arms * per_arm
    arm = np.repeat(np.arange(arms), per_arm)
    alternating = np.where(arm % 2 == 0, -1.0, 1.0)
    within = np.tile([1.0, -1.0], arms) if coaxial else np.ones(arms)
    full = np.ones(rotors)
    return Vehicle(
        "star",
        Body(4.0, np.diag([0.10, 0.11, 0.19]), np.zeros(3)),
        Arms(
            length * axis,
            axis,
            np.tile([0.0, 0.0, 1.0], (arms, 1)),
            np.full(arms, tilts),
            np.full(arms, -10.0),
            np.full(arms, 10.0),
            np.full(arms, 50.0),
        ),
        Rotors(
            arm,
            0.04 * within if coaxial else np.zeros(rotors),
            alternating * within,
            7.2e-6 * full,
            0.0165 * full,
            0.115 * full,
            0.0 * full,
            1250.0 * full,
        ),
        np.zeros(3),
    )


@pytest.fixture
def hexarotor() -> Vehicle:
    return star()


@pytest.fixture
def quadrotor() -> Vehicle:
    return star(4, coaxial=False, tilts=False, phase=np.pi / 4)
