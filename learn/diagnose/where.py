"""Where a model fails: error budget, failure maps, whiteness, the inputs that matter, and the worst stretches.

`examine` puts together what the other modules of this folder say about one model (with a Gaussian process on top where
one is given) on some flights.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from wrenchgap.flight.flight import Array
from wrenchgap.flight.result import Result
from wrenchgap.learn.data.comparison import Stretch, compare
from wrenchgap.learn.data.dataset import dataset
from wrenchgap.learn.data.opening import OpenFlight
from wrenchgap.learn.diagnose.budget import Budget, Source, budget, held_out_process
from wrenchgap.learn.diagnose.failure_map import FailureMap, failure_map
from wrenchgap.learn.diagnose.relevance import Relevance, relevance
from wrenchgap.learn.diagnose.whiteness import Whiteness, whiteness
from wrenchgap.learn.process.gp import GaussianProcess
from wrenchgap.learn.process.predictors import predictors
from wrenchgap.plant.model import Model

if TYPE_CHECKING:
    from wrenchgap.learn.process.train import Progress


@dataclass(frozen=True)
class FittedHere:
    """The effects of a model, or the process (None), were fitted on these very flights: their part is not held out."""

    model: str | None
    flights: tuple[str, ...]


@dataclass(frozen=True)
class NoProcess:
    """Too little data to hold anything out for a Gaussian process: its part of the budget is zero."""


@dataclass(frozen=True, repr=False)
class Where(Result):
    """Where the model `name` fails on `flights`.

    `rms`, `noise` (6,) [N, Nm] of its residual and of the sensors; `failure_map`, `whiteness`, `relevance` and `worst`
    are about the residual of the model, with the given Gaussian process where there is one. `seconds` of flight were
    looked at, behind a filter of `cutoff_hz`.
    """

    name: str
    flights: tuple[str, ...]
    seconds: float
    samples: int
    cutoff_hz: float
    rms: Array
    noise: Array
    budget: Budget
    failure_map: FailureMap
    whiteness: Whiteness
    relevance: Relevance
    worst: tuple[Stretch, ...]
    notes: tuple[object, ...]


def examine(
    flights: Sequence[OpenFlight], model: Model, gp: GaussianProcess | None = None, progress: Progress | None = None
) -> Where:
    """Where `model` (and `gp` on top of it) fails on flights that were opened for it; deterministic."""
    report = progress or (lambda fraction, words: None)
    cutoff = flights[0].records[0].cutoff_hz
    found, notes = predictors(model, (), gp, cutoff)
    remarks: list[object] = [*notes]
    compared = compare(flights, model, found)
    data = dataset(compared.records, model)
    residuals = [data.measured - np.concatenate(e.predictions) for e in compared.evaluations]
    nominal, last = residuals[0], residuals[-1]
    left = residuals[1] if model.effects else nominal
    if gp is not None:
        made = budget(data, nominal, left, left - last, Source.GIVEN)
    else:
        report(0.05, "a Gaussian process on the residual")
        process = held_out_process(data, left, progress=lambda k, n: report(0.05 + 0.5 * k / n, "Gaussian process"))
        made = budget(data, nominal, left, process, Source.FITTED)
        if process is None:
            remarks.append(NoProcess())
    report(0.55, "failure maps")
    mapped = failure_map(data, last)
    report(0.65, "whiteness")
    judged = whiteness(data, last)
    report(0.75, "inputs that matter")
    relevant = relevance(data, last, progress=lambda k, n: report(0.75 + 0.25 * min(1.0, k / n), "inputs that matter"))
    return Where(
        compared.evaluations[-1].name,
        compared.flights,
        sum(len(r) * r.dt_kept for r in compared.records),
        len(data.measured),
        cutoff,
        compared.evaluations[-1].pooled.rms,
        data.noise,
        made,
        mapped,
        judged,
        relevant,
        compared.evaluations[-1].worst,
        tuple(dict.fromkeys([*remarks, *_fitted_here(flights, model, gp), *compared.notes])),
    )


def _fitted_here(flights: Sequence[OpenFlight], model: Model, gp: GaussianProcess | None) -> list[FittedHere]:
    """A note where effects or process were fitted on one of these very flights."""
    here = {f.flight.content_hash: f.records[0].flight for f in flights}
    of_effects = {sha for e in model.effects for _, sha in e.provenance.logs}
    of_process = {log.sha256 for log in gp.provenance.logs} if gp is not None else set()
    found = [
        FittedHere(name, tuple(sorted(here[sha] for sha in used if sha in here)))
        for name, used in ((model.name, of_effects), (None, of_process))
    ]
    return [note for note in found if note.flights]
