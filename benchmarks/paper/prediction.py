"""Table I and the torque figure: how well a GP on 100 points predicts the torque of unseen flights, and its band.

Train: pitch 0-60-0 deg with sinusoidal excitation, 60 s. Unseen: 10 s of the same pitch without excitation (the
paper's table), and an excited flight with another excitation, where the 3 sigma band is put to the test. Errors are
means over time of |commanded or predicted - measured torque|, medians over the seeds.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.paper import methods as m
from benchmarks.paper.figures import prediction_figure
from benchmarks.paper.flying import as_log, fly
from benchmarks.paper.methods import Knowledge, Method
from benchmarks.paper.plants import vehicle
from benchmarks.paper.running import Keep, Output, Report, change, in_parallel, main, median, table, triple
from wrenchgap.flight.flight import Array
from wrenchgap.learn.data.measurement import Record
from wrenchgap.learn.data.prediction import Predictor
from wrenchgap.learn.process.held_out_time import Coverage
from wrenchgap.plant.trajectory import named

POINTS = 100
TRAINING, VALIDATION = 60.0, 20.0
"""Lengths of the flights [s]; the last 10 s of the unexcited one are the validation trajectory."""
PAPER = {"nominal": ((0.21, 0.23, 0.50), (0.16, 0.16, 0.17)), "learned": ((0.08, 0.07, 0.13), (0.06, 0.05, 0.09))}

ROWS = (m.CONSTANT, m.LINEAR, m.OBSERVER, m.PHYSICS, m.PAPERS, m.GP, m.ON_A_LINE, m.SPARSE, m.PAST, m.BOTH, *m.FEEDBACK)
SEEDS = (0, 1, 2)
"""Flown once: INDI's and L1's cut-offs are of other vehicles and seeds (`benchmarks.paper.feedback`)."""


@dataclass(frozen=True)
class Unseen:
    """The two unseen flights of a seed, as records by name, and from when on they count [s]."""

    parts: dict[str, Record]

    def errors(self, known: Knowledge, method: Method | None) -> dict[str, Array]:
        """Mean and standard deviation (3,) of the absolute torque error on both; of the nominal model without one."""
        found = {}
        for name, record in self.parts.items():
            z = (record.measured - m.nominal(known, record))[:, 3:]
            left = z if method is None or method.predict is None else z - method.predict(known, record)
            size = np.abs(left[self.counts(record)])
            found |= {f"{name} mean": size.mean(axis=0), f"{name} std": size.std(axis=0)}
        return found

    def coverage(self, known: Knowledge, method: Method, calibrated: bool) -> dict[str, Array]:
        """Share (3,) of both flights' samples within 1.96 and within 3 sigma."""
        assert method.gp is not None
        gp = method.gp(known)
        gp = gp if calibrated else replace(gp, sigma_scale=np.ones(3))
        model = (known.physics if method.physics else known.model).wrench_model
        found = {}
        for name, record in self.parts.items():
            predictor = Predictor("", model, gp)
            error = (record.measured - predictor.predict(record, known.model.vehicle.body))[:, 3:]
            sigma = predictor.sigma(record)
            assert sigma is not None
            rows = self.counts(record)
            share = Coverage.of(error[rows], sigma[rows, 3:])
            found |= {f"{name} 95": share.within_95, f"{name} 3 sigma": share.within_3_sigma}
        return found

    def counts(self, record: Record) -> NDArray[np.bool_]:
        """Samples that count: the last 10 s, or all after the first 2."""
        return np.asarray(record.time >= (VALIDATION - 10.0 if record is self.parts["smooth"] else 2.0))


def knowledge(seed: int, number: int = 0, seconds: float = TRAINING, excitation: float = 1.0) -> Knowledge:
    """What is learnt from a pitch flight of vehicle `number`."""
    plant = vehicle(number)
    flown = fly(plant, named("pitch", seconds, excitation, seed), seed, name="training")
    return Knowledge(plant.believed, (as_log(flown, plant),), POINTS)


def unseen(seed: int) -> Unseen:
    """Flights that are not learnt from."""
    plant = vehicle()
    parts = {}
    for name, size in (("smooth", 0.0), ("excited", 1.0)):
        asked = named("pitch", VALIDATION, size, seed + 100)
        parts[name] = as_log(fly(plant, asked, seed + 100 + int(size), name="unseen"), plant).records[0]
    return Unseen(parts)


def one(seed: int, quick: bool) -> dict[str, Any]:
    """All methods on one seed."""
    known, flights = knowledge(seed, seconds=30.0 if quick else TRAINING), unseen(seed)
    rows = (m.CONSTANT, m.LINEAR, m.OBSERVER, m.GP) if quick else ROWS
    return {
        "errors": {"nominal": flights.errors(known, None)} | {r.name: flights.errors(known, r) for r in rows},
        "coverage": {
            r.name: {str(c): flights.coverage(known, r, c) for c in (False, True)} for r in rows if r.gp is not None
        },
        "named": [] if quick else list(known.explanation.effects),
        "figure": _traces(known, flights.parts["smooth"]) if seed == 0 else None,
    }


def missing(kept: dict[str, Any], report: Report, keep: Keep) -> None:
    """The rows without a band of their own that the results lack, each kept at once."""
    rows = [r for r in ROWS if r.name not in kept["errors"] and r.gp is None]
    flights = [(knowledge(seed), unseen(seed)) for seed in SEEDS] if rows else []
    for k, row in enumerate(rows):
        report(k / len(rows), row.name)
        kept["errors"][row.name] = median([flown.errors(known, row) for known, flown in flights])
        keep(kept)


def _traces(known: Knowledge, record: Record) -> dict[str, Array]:
    """What the figure shows: the last 10 s of the unexcited flight."""
    rows = record.time >= VALIDATION - 10.0
    predictor = Predictor("", known.model.wrench_model, known.gp())
    sigma = predictor.sigma(record)
    assert sigma is not None
    wrench = predictor.predict(record, known.model.vehicle.body)
    return {
        "time": record.time[rows],
        "commanded": record.commanded[rows, 3:],
        "measured": record.measured[rows, 3:],
        "predicted": wrench[rows, 3:],
        "sigma": sigma[rows, 3:],
    }


def run(quick: bool, out: Output, report: Report) -> dict[str, Any]:
    """The tables, and the figure of the first seed."""
    seeds = SEEDS[:1] if quick else SEEDS
    found = in_parallel(partial(one, quick=quick), seeds, report, "training, explaining, validating")
    prediction_figure(out.image("prediction"), found[0]["figure"])
    return {
        "seeds": len(seeds),
        "points": POINTS,
        "named_by_explain": found[0]["named"],
        **{part: median([f[part] for f in found]) for part in ("errors", "coverage")},
    }


def tables(body: dict[str, Any]) -> str:
    """Errors and coverage."""
    nominal = body["errors"]["nominal"]

    def cells(name: str, row: dict[str, Any]) -> list[str]:
        shares = ("-" if name == "nominal" else change(row[k], nominal[k]) for k in ("smooth mean", "excited mean"))
        return [name, triple(row["smooth mean"]), triple(row["smooth std"]), *shares]

    head = ["torque error x / y / z [Nm]", "mean", "std", "change [%]", "change, excited flight [%]"]
    paper = [
        ["paper, nominal", triple(PAPER["nominal"][0], 2), triple(PAPER["nominal"][1], 2), "-", "-"],
        ["paper, GP", triple(PAPER["learned"][0], 2), triple(PAPER["learned"][1], 2), "-62 / -70 / -74", "-"],
    ]
    parts = [table(head, [*paper, *(cells(n, r) for n, r in body["errors"].items())])]
    rows = [
        [name, *(triple(found[c][f"{f} 3 sigma"], 2) for f in ("smooth", "excited") for c in ("False", "True"))]
        for name, found in body["coverage"].items()
    ]
    head = ["share within 3 sigma", "as fitted", "calibrated", "excited, as fitted", "excited, calibrated"]
    parts.append(table(head, rows))
    return "\n\n".join(parts)


if __name__ == "__main__":
    main(("prediction",))
