"""Tracking, pitch 0-60-0 deg ten times: the box plot of |e_R| with and without compensation, integral on in both.

What the paper explains its z failure with, servos and motors that its GP does not see, is put to the test: rows that
know of the past (as GP input) or of the lags (physics that leads them).
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from benchmarks.paper import methods as m
from benchmarks.paper.figures import box_figure
from benchmarks.paper.flying import fly
from benchmarks.paper.methods import Knowledge, Method
from benchmarks.paper.plants import vehicle
from benchmarks.paper.prediction import TRAINING, knowledge
from benchmarks.paper.running import Keep, Output, Report, change, in_parallel, main, mrad, table
from wrenchgap.flight.flight import Array
from wrenchgap.plant.trajectory import named

LENGTH = 100.0
PAPER = {"without": ((0.07, 0.087, 0.051), (0.114, 0.100, 0.066)), "with": ((0.04, 0.03, 0.058), (0.050, 0.040, 0.054))}
ROWS = (
    *m.EVERYWHERE,
    m.ON_A_LINE,
    m.SPARSE,
    m.PAST,
    m.LEADING,
    m.LEADING_BOTH,
    m.JUDGED,
    m.TOGETHER,
    m.ALL_TOGETHER,
    *m.FEEDBACK,
)
QUICK = (m.PD, m.INTEGRAL, m.LINEAR, m.GP)
SHOWN = (m.INTEGRAL, m.CONSTANT, m.LINEAR, m.OBSERVER, m.PHYSICS, m.GP, m.PAST, m.BOTH, m.LEADING_BOTH)


def one(method: Method, known: Knowledge, length: float) -> Array:
    """|e_R| (N, 3) of ten pitches; integral on unless the method says otherwise."""
    plant = vehicle()
    compensator = None if method.build is None else method.build(known)
    flown = fly(plant, named("pitch", length), 50, compensator=compensator, integral=method.integral is not False)
    return np.abs(flown.error)


def run(quick: bool, out: Output, report: Report) -> dict[str, Any]:
    """Medians and boxes of every method, and the box plot."""
    rows, length = (QUICK, 10.0) if quick else (ROWS, LENGTH)
    report(0.0, "training")
    known = knowledge(0, seconds=30.0 if quick else TRAINING)
    if not quick:
        report(0.0, "explaining")
        _ = known.physics
    found = in_parallel(partial(one, known=known, length=length), rows, report, "flying")
    errors = {r.name: e for r, e in zip(rows, found, strict=True)}
    box_figure(out.image("pitch"), {r.name: errors[r.name] for r in SHOWN if r.name in errors})
    return {
        "points": known.points,
        "seconds": length,
        "named_by_explain": [] if quick else list(known.explanation.effects),
        "rows": {name: summary(e) for name, e in errors.items()},
    }


def missing(kept: dict[str, Any], report: Report, keep: Keep) -> None:
    """The rows that the results lack, one after the other, each kept at once."""
    rows = [r for r in ROWS if r.name not in kept["rows"]]
    if not rows:
        return
    report(0.0, "training")
    known = knowledge(0, seconds=TRAINING)
    for k, row in enumerate(rows):
        report(k / len(rows), row.name)
        kept["rows"][row.name] = summary(one(row, known, LENGTH))
        keep(kept)


def summary(error: Array) -> dict[str, Array]:
    """Median, box (75th less 25th percentile) and 95th percentile (3,) of |e_R| [rad]."""
    low, middle, high, most = np.percentile(error, (25, 50, 75, 95), axis=0)
    return {"median": middle, "box": high - low, "percentile_95": most, "mean": error.mean(axis=0)}


def tables(body: dict[str, Any]) -> str:
    """Medians and boxes."""
    base = body["rows"][m.INTEGRAL.name]["median"]
    head = ["abs(e_R) x / y / z [mrad]", "median", "change of the median [%]", "box", "95th percentile"]
    rows = []
    for name, (median, box) in PAPER.items():
        share = "-" if name == "without" else change(median, PAPER["without"][0])
        rows.append([f"paper, {name}", mrad(median), share, mrad(box), "-"])
    for name, row in body["rows"].items():
        share = "-" if name == m.INTEGRAL.name else change(row["median"], base)
        rows.append([name, mrad(row["median"]), share, mrad(row["box"]), mrad(row["percentile_95"])])
    return table(head, rows)


if __name__ == "__main__":
    main(("pitch",))
