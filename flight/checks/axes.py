"""The search for the axes: which of 48 ways to name and sign three axes, or which rotation, makes two signals agree.

Signals are truths t (K, 3) and readings r (K, 3) of the same vector. With A = sum t r^T the rotation that brings the
readings closest to the truths is U V^T of A = U S V^T (Schoenemann 1966; Wahba 1965), and what a signed permutation P
achieves is trace(P^T A). Blocks of time tell how well the rotation is known.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wrenchgap.flight.checks.motion import BLOCKS
from wrenchgap.flight.flight import Array
from wrenchgap.flight.meaning import axes_word

PERMUTATIONS: tuple[Array, ...] = tuple(
    np.diag(signs) @ np.eye(3)[list(order)]
    for order in itertools.permutations(range(3))
    for signs in itertools.product((1.0, -1.0), repeat=3)
)
"""All 48; the first is the identity."""
TURNED = 20.0
"""[deg] Rotations below are a mounting error, which is an effect and no mistake in a mapping."""
KNOWN = 10.0
"""[deg] Scatter of the rotation over blocks up to which it is believed."""
EXPLAINS = 0.8
"""Cosine between truths and turned readings from which on they are the same vector."""
BETTER = 0.06
"""By how much the cosine must rise."""

Pair = tuple[Array, Array]


@dataclass(frozen=True)
class Axes:
    """`matrix` (3, 3) with truth = matrix @ reading, the cosine `fits` with it and `as_is`, and its `words`."""

    matrix: Array
    fits: float
    as_is: float
    words: str


def cross(pair: Pair) -> Array:
    """Sum of truth reading^T (3, 3), of signals of length one."""
    truth, reading = pair
    return np.asarray(truth.T @ reading / max(float(np.linalg.norm(truth) * np.linalg.norm(reading)), 1e-30))


def best_axes(pairs: Sequence[Pair]) -> Axes | None:
    """How the readings of all pairs must be turned alike, None where they need not be or nothing can be said.

    The first pair must improve; pairs are weighted alike.
    """
    total = np.sum([cross(pair) for pair in pairs], axis=0)
    leading = cross(pairs[0])
    scores = [float(np.sum(p * total)) for p in PERMUTATIONS]
    chosen = PERMUTATIONS[int(np.argmax(scores))]
    turn = _rotation(total)
    as_is = float(np.trace(leading))
    scatter = _scatter(pairs, turn)
    if angle(turn) > TURNED and scatter < KNOWN and angle(turn @ nearest(turn).T) > 0.75 * TURNED:
        fits = float(np.sum(turn * leading))
        if fits > EXPLAINS and fits > as_is + BETTER and fits > float(np.sum(chosen * leading)) + 0.02:
            return Axes(turn, fits, as_is, rotation_words(turn))
    fits = float(np.sum(chosen * leading))
    if np.array_equal(chosen, np.eye(3)) or fits < EXPLAINS or fits < as_is + BETTER or not _steady(pairs, chosen):
        return None
    return Axes(chosen, fits, as_is, axes_word(chosen))


def nearest(turn: Array) -> Array:
    """The signed permutation that is closest to a matrix."""
    return max(PERMUTATIONS, key=lambda p: float(np.sum(p * turn)))


def angle(turn: Array) -> float:
    """Of a rotation [deg]."""
    return float(np.degrees(np.arccos(np.clip(0.5 * (np.trace(turn) - 1.0), -1.0, 1.0))))


def rotation_words(turn: Array) -> str:
    """Roll, pitch and yaw in degrees, those that matter: the words of a mapping, applied in this order."""
    yaw = np.arctan2(turn[1, 0], turn[0, 0])
    pitch = -np.arcsin(np.clip(turn[2, 0], -1.0, 1.0))
    roll = np.arctan2(turn[2, 1], turn[2, 2])
    found = {"roll": np.degrees(roll), "pitch": np.degrees(pitch), "yaw": np.degrees(yaw)}
    rounded = {name: _round(float(value)) for name, value in found.items()}
    return ",".join(f"{name}={value:g}" for name, value in rounded.items() if value)


def _round(degrees: float) -> float:
    """To what somebody would mount: a multiple of 15 deg where one is near, nothing below 6 deg."""
    grid = 15.0 * round(degrees / 15.0)
    return grid if abs(degrees - grid) < 6.0 else float(round(degrees))


def _rotation(matrix: Array) -> Array:
    u, _, vt = np.linalg.svd(matrix)
    return np.asarray(u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt)


def _blocks(pairs: Sequence[Pair]) -> list[Array]:
    """Summed cross products (3, 3) block by block."""
    parts = [[np.array_split(signal, BLOCKS) for signal in pair] for pair in pairs]
    return [np.sum([cross((t[b], r[b])) for t, r in parts], axis=0) for b in range(BLOCKS)]


def _scatter(pairs: Sequence[Pair], turn: Array) -> float:
    """Median angle [deg] between the rotation and those of blocks."""
    return float(np.median([angle(_rotation(block) @ turn.T) for block in _blocks(pairs)]))


def _steady(pairs: Sequence[Pair], chosen: Array) -> bool:
    """Whether a permutation beats the identity in nearly every block."""
    better = [float(np.sum((chosen - np.eye(3)) * block)) > 0.0 for block in _blocks(pairs)]
    return sum(better) >= BLOCKS - 1
