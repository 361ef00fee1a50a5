"""Turn the benchmark's rows into the numbers of `confidence` and `fit.MISFIT` in `learn.identify`, and check them.

    python -m benchmarks.hidden_effects.calibrate docs/hidden-effects.json

Prints the coefficients fitted to all flights, and how stated probabilities compare with observed frequencies when each
hidden effect's flights are predicted by coefficients that were fitted without them.
"""

from __future__ import annotations

import json
import sys
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from benchmarks.hidden_effects.engine import ALWAYS
from wrenchgap.flight.flight import Array
from wrenchgap.learn.identify.confidence import FAR, SUREST, features

Row = dict[str, Any]
RIDGE = 0.5


def members(rows: list[Row]) -> tuple[Array, NDArray[np.bool_], list[str]]:
    """Features (M, 6), whether right (M,), and the hidden effects, of everything that was named."""
    X, right, hidden = [], [], []
    for row in rows:
        if "error" in row:
            continue
        accepted = {a for answers in row["answers"] for a in answers}
        if not row["case"].endswith(".crisp"):
            accepted |= set(ALWAYS)
        left = row["left"]
        groups = {g[0]: set(g) for g in row["groups"]}
        for m in row["members"]:
            group = groups.get(m["effect"], {m["effect"]})
            near = [s for name, s, _, worthy in m["rivals"] if worthy and name not in group]
            X.append(features(min(near, default=FAR), m["share"], m["evidence"], left, row["verdict"] == "unknown"))
            right.append(bool(group & accepted))
            hidden.append("+".join(row["hidden"]) or "none")
    return np.array(X), np.array(right), hidden


def fit(X: Array, right: NDArray[np.bool_]) -> Array:
    """Ridge logistic regression; the constant is not shrunk. Signs are held to what they must mean."""
    sign = np.where(right, 1.0, -1.0)
    shrink = np.array([0.0, *np.full(X.shape[1] - 1, RIDGE)])

    def loss(b: Array) -> float:
        return float(np.sum(np.logaddexp(0.0, -sign * (X @ b))) + np.sum(shrink * b**2))

    bounds = [(None, None), (0, None), (0, None), (0, None), (None, 0), (None, 0)]
    return np.asarray(minimize(loss, np.zeros(X.shape[1]), bounds=bounds).x)


def probability(X: Array, b: Array) -> Array:
    """As `learn.identify.confidence.probability`."""
    return np.asarray(np.minimum(SUREST, 1.0 / (1.0 + np.exp(-X @ b))))


def left_out(X: Array, right: NDArray[np.bool_], hidden: list[str]) -> Array:
    """Probability of each member by coefficients that were fitted without its hidden effect."""
    names = np.array(hidden)
    out = np.empty(len(X))
    for name in set(hidden):
        test = names == name
        out[test] = probability(X[test], fit(X[~test], right[~test]))
    return out


def reliability(p: Array, right: NDArray[np.bool_]) -> list[tuple[str, int, float, float]]:
    """(range, members, mean stated, observed)."""
    edges = (0.0, 0.5, 0.75, 0.9, 0.95, 1.01)
    rows = []
    for low, high in pairwise(edges):
        inside = (p >= low) & (p < high)
        if inside.any():
            label = f"{100 * low:.0f}-{min(100, 100 * high):.0f} %"
            rows.append((label, int(inside.sum()), float(p[inside].mean()), float(right[inside].mean())))
    return rows


def main() -> None:
    """See the module."""
    rows = json.loads(Path(sys.argv[1]).read_text())["rows"]
    X, right, hidden = members(rows)
    b = fit(X, right)
    out = sys.stdout.write
    out(f"{len(X)} members, {right.sum()} right\nCOEFFICIENTS = ({', '.join(f'{x:.3f}' for x in b)})\n")
    p = left_out(X, right, hidden)
    for label, count, stated, observed in reliability(p, right):
        out(f"{label}: {count} members, stated {stated:.3f}, observed {observed:.3f}\n")
    out(f"Brier score {np.mean((p - right) ** 2):.4f}, of the base rate {right.mean() * (1 - right.mean()):.4f}\n")


if __name__ == "__main__":
    main()
