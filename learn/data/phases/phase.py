"""What the phases of a flight are called, and which of them an analysis leaves out."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.errors import UsageError
from wrenchgap.flight.flight import Array

NAMES: dict[str, str] = {
    "ground": "standing still on the ground",
    "held": "moved while something else than the rotors carries it: a hand, a stand, a landing on the side",
    "take-off": "from the ground until it is out of the ground's reach",
    "landing": "from the ground's reach down to it",
    "impact": "struck something, and flew on",
    "crash": "motion contradicts the commands until the end, or the vehicle comes to lie",
    "saturation": "commands at or beyond the limits of the model file",
}
"""Every phase besides flight, in the spelling of `--keep`, and what it is; docs/checks.md."""
EVERY = "all"


@dataclass(frozen=True)
class Phase:
    """A part of a flight from `start` to `stop` [s] that is no ordinary flight: its `name` (of `NAMES`), and `why`.

    `left_out` says whether the analyses do without it: not where `--keep` names it, nor where it changes nothing.
    """

    name: str
    start: float
    stop: float
    why: str
    left_out: bool = True


def phase_names(names: Iterable[str], said: str = "--keep") -> tuple[str, ...]:
    """Names of phases, however they are spelt, "all" for all of them; raises UsageError for one that there is not."""
    found = [name.strip().lower().replace(" ", "-").replace("_", "-") for name in names]
    found = ["take-off" if name == "takeoff" else name for name in found]
    wrong = [name for name in found if name not in NAMES and name != EVERY]
    if wrong:
        raise UsageError(f"{said} {wrong[0]}: no phase is called so; phases: {', '.join(NAMES)}, {EVERY}")
    return tuple(NAMES) if EVERY in found else tuple(dict.fromkeys(found))


def used_samples(time: Array, phases: Sequence[Phase]) -> NDArray[np.bool_]:
    """Which of the samples at `time` (N,) [s] lie in no phase that is left out."""
    keep = np.ones(len(time), dtype=bool)
    for phase in phases:
        if phase.left_out:
            keep &= (time < phase.start) | (time > phase.stop)
    return keep


def runs(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First index and one past the last of every run of true values (N,)."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], flags, [False])).astype(int)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def closed(flags: NDArray[np.bool_], most: int) -> NDArray[np.bool_]:
    """Flags (N,) with interruptions of up to `most` samples between true values filled."""
    out = flags.copy()
    for a, b in runs(~flags):
        if a > 0 and b < len(flags) and b - a <= most:
            out[a:b] = True
    return out
