"""One comparison as a row: what was hidden, what the answer says of it, whether a firm name is wrong."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.changed.fleet import Case, Hidden, flown
from wrenchgap import open_flights
from wrenchgap.learn.changed.changed import Baseline, Changed, Verdict
from wrenchgap.plant import model_file
from wrenchgap.plant.effects import family
from wrenchgap.plant.model import Model

Row = dict[str, Any]
SURE = 0.9
"""Probability of one rotor or arm from which on the answer stands for it."""


def model_of(vehicle: str) -> Model:
    """What the users of a vehicle have."""
    if vehicle == "hexa":
        return model_file.load("tilt_hexarotor")
    from benchmarks.field.vehicles import vehicle as believed  # needs RotorPy's side of the field

    return believed(vehicle).model


def baseline(cases: Sequence[Case], folder: Path | None) -> Baseline:
    """Of these healthy flights."""
    model = model_of(cases[0].vehicle)
    return Baseline(open_flights([flown(c, folder)[0] for c in cases], model), model, jobs=1)


def judged(case: Case, usual: Baseline, name: str, folder: Path | None) -> Row:
    """The answer on one flight against a baseline, which the row calls `name`."""
    flight, hidden = flown(case, folder)
    start = time.process_time()
    found = usual.against(open_flights([flight], usual.model))
    row = {"case": case.name, "baseline": name, "vehicle": case.vehicle, "effect": case.effect, "size": case.size}
    return row | answer(found, hidden) | {"cpu_seconds": round(time.process_time() - start, 1)}


def answer(found: Changed, hidden: Hidden) -> Row:
    """What is read of an answer.

    `found`: something changed, and a set of the heaviest class says what was hidden. `wrong`: firm names that are not
    it, and a rotor or arm that is sure and is another. `pulls`: changes less the truth over their uncertainty.
    """
    right = {family(n) for n in hidden.answers}
    wrong = [n for n in found.firm if family(n) not in right]
    truth = hidden.parameters if found.firm else {}
    wrong += [
        f"{p.effect} at {p.where}"
        for p in found.places
        if p.effect == hidden.effect and p.effect in found.firm and p.probability >= SURE and p.parameter not in truth
    ]
    named = {family(n) for c in found.classes[:1] for s in c.sets for n in s.names}
    listed = {p.name: p for p in found.parameters if p.effect == hidden.effect}
    return {
        "verdict": str(found.verdict),
        "nothing": found.nothing,
        "firm": list(found.firm),
        "found": found.verdict is Verdict.CHANGED and bool(named & right),
        "wrong": wrong,
        "truth": hidden.parameters,
        "answer": {n: [p.change, float(np.hypot(p.std, p.scatter))] for n, p in listed.items()},
        "odd": [o.flight for o in found.odd],
    }
