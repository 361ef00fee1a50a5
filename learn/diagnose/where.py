"""Where a model fails: error budget, failure maps, whiteness, the inputs that matter, and the worst stretches.

`examine` puts together what the other modules of this folder say about one model (with a Gaussian process on top where
one is given) on some flights. The error budget is what the nominal model's mean square error is made of, per axis:

    E_nominal = noise + physics + process + unexplained

    physics      E_nominal - E_model             what the effects in the model take off; negative where they do harm
    process      E_model - E_model+GP            what a Gaussian process of the commanded wrench takes off what is left
    noise        min(sigma_noise^2, E_left)      sensor noise that passes the filter (`learn.data.measurement`)
    unexplained  E_left - noise                  the rest, E_left being what model and process leave

The process is fitted on other blocks of time than those on which it is judged: blocks go to four folds in turn. On
an axis where it does not take anything off beyond chance (paired t over blocks, docs/decisions/0006-blocks.md) it is
not used and its part is zero: there it has learnt noise, and would do harm. It is a small process, made to see how
much structure there is, not to fly with; `wrenchgap learn` makes better ones.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from wrenchgap.flight.arguments import Progress, silent
from wrenchgap.flight.flight import AXES, Array
from wrenchgap.flight.result import Result
from wrenchgap.learn.data.blocks import SIGNIFICANCE, paired_t
from wrenchgap.learn.data.comparison import Stretch, compare
from wrenchgap.learn.data.dataset import Dataset, dataset
from wrenchgap.learn.data.errors import means_by, weighted
from wrenchgap.learn.data.opening import OpenFlight
from wrenchgap.learn.diagnose.failure_map import FailureMap, failure_map
from wrenchgap.learn.diagnose.relevance import Relevance, relevance
from wrenchgap.learn.diagnose.whiteness import Whiteness, whiteness
from wrenchgap.learn.process.gp import FitSettings, GaussianProcess
from wrenchgap.learn.process.predictors import predictors
from wrenchgap.plant.model import Model

PARTS = ("noise", "physics", "process", "unexplained")


class Source(StrEnum):
    """Which process is meant: fitted for the budget and judged on blocks that it had not seen, given, or none."""

    FITTED = "fitted"
    GIVEN = "given"
    NONE = "none"


@dataclass(frozen=True)
class Budget:
    """Mean squares (6,) [N^2, Nm^2] that add up to `nominal`; `weights` (6,) put them on one scale."""

    nominal: Array
    noise: Array
    physics: Array
    process: Array
    unexplained: Array
    weights: Array
    source: Source

    @property
    def has_physics(self) -> bool:
        """Whether the effects of the model take anything off."""
        return bool(np.nan_to_num(self.physics).any())

    def shares(self) -> dict[str, Array]:
        """Parts as fractions of the nominal error (6,), by name."""
        return {name: getattr(self, name) / np.maximum(self.nominal, 1e-300) for name in PARTS}

    def whole(self) -> dict[str, float]:
        """The same for all axes together, newtons and newton metres on one scale."""
        scale = self.weights**2
        total = max(float(weighted(self.nominal, scale).sum()), 1e-300)
        return {name: float(weighted(getattr(self, name), scale).sum()) / total for name in PARTS}


def budget(data: Dataset, nominal: Array, left: Array, process: Array | None, source: Source) -> Budget:
    """Budget of residuals (K, 6): of the nominal model, of the model, and the process's prediction of the latter.

    `process` (K, 6) is None where there is none; a given one counts wherever it helps at all.
    """
    before, model = (np.mean(r**2, axis=0) for r in (nominal, left))
    after = model
    if process is not None:
        better = np.mean((left - process) ** 2, axis=0)
        least = 0.0 if source is Source.GIVEN else SIGNIFICANCE.large
        t = paired_t(means_by(data.block, left**2 - (left - process) ** 2))
        believed = (better < after) & (t > least)
        after = np.where(believed, better, after)
    else:
        source = Source.NONE
    noise = np.minimum(data.noise**2, after)
    return Budget(before, noise, before - model, model - after, after - noise, data.weights, source)


def held_out_process(
    data: Dataset,
    residual: Array,
    *,
    points: int = 150,
    folds: int = 4,
    progress: Callable[[int, int], None] | None = None,
) -> Array | None:
    """Prediction (K, 6) of a residual (K, 6) from the command, by processes that did not see its block of time.

    Not a number on axes that were not measured.

    None where the log is too short to hold anything out, or the command never moves.
    """
    from wrenchgap.learn.process.train import fit  # here: others need not wait for it

    xi = data.commanded
    fold = data.block % folds
    every = max(1, int(1.0 / data.independence))  # closer samples say the same
    settings = FitSettings(points=points, restarts=0, mean="constant", pre_thin=1500)
    known = data.measured_axes
    outputs = tuple(axis for axis, measured in zip(AXES, known, strict=True) if measured)
    out = np.where(known, 0.0, np.full_like(residual, np.nan))
    for f in range(folds):
        test, train = fold == f, np.flatnonzero(fold != f)[::every]
        if progress is not None:
            progress(f, folds)
        if not test.any():
            continue
        if len(train) < 4 * xi.shape[1] or not (np.ptp(xi[train], axis=0) > 0).any():
            return None
        out[np.ix_(test, known)] = fit(xi[train], residual[np.ix_(train, known)], outputs, settings).mean(xi[test])
    return out


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
    flights: Sequence[OpenFlight],
    model: Model,
    gp: GaussianProcess | None = None,
    progress: Progress | None = None,
) -> Where:
    """Where `model` (and `gp` on top of it) fails on flights that were opened for it; deterministic."""
    report = progress or silent
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
