"""Stated probabilities against observed frequencies: the check of `Posterior.probability`, fitted to nothing."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from benchmarks.hidden_effects.engine import ALWAYS
from wrenchgap.plant.effects import family

Row = dict[str, Any]
EDGES = (0.0, 0.5, 0.7, 0.8, 0.9, 0.96, 1.0)
SURE = 0.8
"""Stated probability from which on a wrong name counts as firm."""


def named(rows: list[Row]) -> list[tuple[float, bool]]:
    """Of every effect that was named: the probability stated, and whether it, or one of its group, was there."""
    out = []
    for row in rows:
        if "error" in row:
            continue
        true = truth(row)
        groups = {g[0]: {n for name in g for n in name.split(" + ")} for g in row["groups"]}
        for m in row["members"]:
            listed = {family(n) for n in groups.get(m["effect"], {m["effect"]})}
            out.append((m["probability"], bool(listed & true)))
    return out


def truth(row: Row) -> set[str]:
    """Families of all that is really there."""
    accepted = {a for answers in row["answers"] for a in answers}
    if not row["case"].endswith(".crisp"):
        accepted |= set(ALWAYS)
    return {family(a) for a in accepted}


def firm_and_wrong(rows: list[Row]) -> list[str]:
    """Cases in which an effect that is not there, nor anything of its group, is stated at `SURE` or more."""
    return [r["case"] for r in rows if "error" not in r and any(p >= SURE and not ok for p, ok in named([r]))]


def bins(rows: list[Row]) -> list[tuple[str, int, float, float]]:
    """By bins of the stated probability: label, number of names, mean stated, share that was right."""
    pairs = np.array(named(rows), dtype=float).reshape(-1, 2)
    out = []
    for low, high in pairwise(EDGES):
        inside = (pairs[:, 0] >= low) & ((pairs[:, 0] < high) | (high == EDGES[-1]))
        if inside.any():
            stated, right = pairs[inside].mean(axis=0)
            out.append((f"{100 * low:.0f}-{100 * high:.0f} %", int(inside.sum()), float(stated), float(right)))
    return out
