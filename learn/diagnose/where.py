"""Where a model fails: error budget, failure maps, whiteness, the inputs that matter, and the worst stretches.

`examine` puts together what `learn.diagnose.budget`, `learn.diagnose.failure_map`, `learn.diagnose.whiteness` and `learn.diagnose.relevance` say about one
model (with a Gaussian process on top where one is given) on some flights; `replay.present.where_figures` draws it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.flight import AXES
from wrenchgap.learn.data.comparison import Stretch, compare, predictors
from wrenchgap.learn.data.opening import OpenFlight
from wrenchgap.learn.diagnose.budget import Budget, budget, held_out_process
from wrenchgap.learn.diagnose.failure_map import Dependence, FailureMap, failure_map
from wrenchgap.learn.diagnose.relevance import GroupRelevance, Relevance, relevance
from wrenchgap.learn.diagnose.whiteness import WORTH, Autocorrelation, CrossCorrelation, Whiteness, whiteness
from wrenchgap.learn.identify.fit import dataset
from wrenchgap.learn.process.gp import GaussianProcess
from wrenchgap.plant.model import Model

Array = NDArray[np.float64]
Report = Callable[[float, str], None]
"""Called with the fraction done (0 to 1) and what is being done."""


@dataclass(frozen=True)
class Where:
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
    notes: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """The body of the `where` schema."""
        return {
            "axes": list(AXES),
            "model": self.name,
            "flights": list(self.flights),
            "seconds": self.seconds,
            "samples": self.samples,
            "cutoff_hz": self.cutoff_hz,
            "rms": self.rms.tolist(),
            "noise": self.noise.tolist(),
            "budget": self.budget.to_json(),
            "failure_map": self.failure_map.to_json(),
            "whiteness": self.whiteness.to_json(),
            "relevance": self.relevance.to_json(),
            "worst": [s.to_json() for s in self.worst],
            "summary": list(summary(self)),
            "notes": list(self.notes),
        }


def examine(
    flights: Sequence[OpenFlight],
    model: Model,
    gp: GaussianProcess | None = None,
    progress: Report | None = None,
) -> Where:
    """Where `model` (and `gp` on top of it) fails on flights that were opened for it; deterministic."""
    report = progress or (lambda fraction, words: None)
    cutoff = flights[0].records[0].cutoff_hz
    found, notes = predictors(model, (), gp, cutoff)
    compared = compare(flights, model, found)
    data = dataset(compared.records, model)
    residuals = [data.measured - np.concatenate(e.predictions) for e in compared.evaluations]
    nominal, last = residuals[0], residuals[-1]
    left = residuals[1] if model.effects else nominal
    if gp is not None:
        made = budget(data, nominal, left, left - last, "given")
    else:
        report(0.05, "a Gaussian process on what is left")
        process = held_out_process(data, left, progress=lambda k, n: report(0.05 + 0.5 * k / n, "Gaussian process"))
        made = budget(data, nominal, left, process, "fitted")
        if process is None:
            notes.append("too little data to hold anything out for a Gaussian process; its part of the budget is zero.")
    report(0.55, "failure maps")
    mapped = failure_map(data, last)
    report(0.65, "whiteness")
    judged = whiteness(data, last)
    report(0.75, "inputs that matter")
    relevant = relevance(data, last, progress=lambda k, n: report(0.75 + 0.25 * min(1.0, k / n), "inputs that matter"))
    return Where(
        compared.evaluations[-1].name,
        compared.flights,
        sum(len(r) * r.dt * (r.keep.step or 1) for r in compared.records),
        len(data.measured),
        cutoff,
        compared.evaluations[-1].pooled.rms,
        data.noise,
        made,
        mapped,
        judged,
        relevant,
        compared.evaluations[-1].worst,
        tuple(dict.fromkeys([*notes, *_fitted_here(flights, model, gp), *compared.notes])),
    )


def _fitted_here(flights: Sequence[OpenFlight], model: Model, gp: GaussianProcess | None) -> list[str]:
    """A note where effects or process were fitted on one of these very flights."""
    here = {f.flight.content_hash: f.records[0].flight for f in flights}
    notes = []
    used = {here[sha] for e in model.effects for _, sha in e.provenance.logs if sha in here}
    if used:
        notes.append(
            f"the effects of {model.name} were fitted on {', '.join(sorted(used))}: their part is not held out."
        )
    used = {here[log.sha256] for log in (gp.provenance.logs if gp is not None else ()) if log.sha256 in here}
    if used:
        notes.append(f"the GP was learnt on {', '.join(sorted(used))}: its part is not held out.")
    return notes


def summary(where: Where) -> tuple[str, ...]:
    """The result in a few sentences, most important first."""
    shares = where.budget.whole()
    process = {"fitted": "a Gaussian process would explain", "given": "the GP explains"}.get(where.budget.source)
    parts = [f"{_percent(shares['noise'])} is sensor noise"]
    if shares["physics"] != 0.0:
        parts.append(f"the effects of {where.name.removesuffix('+GP')} explain {_percent(shares['physics'])}")
    if process is not None:
        parts.append(f"{process} {_percent(shares['process'])}")
    parts.append(f"{_percent(shares['unexplained'])} stays unexplained")
    out = [f"Of the nominal model's error energy {', '.join(parts)}."]
    out.append(goes_with(where.failure_map))
    out.append(_depends_on(where.relevance))
    colours = [a.axis for a in where.whiteness.autocorrelation if not a.white]
    if not colours:
        out.append("The residual is as white as filtered sensor noise on all axes.")
    else:
        named = "any axis" if len(colours) == len(AXES) else ", ".join(colours)
        out.append(f"The residual is not white on {named}: structure is left there.")
    return tuple(out)


def goes_with(mapped: FailureMap) -> str:
    """With what the error goes most beyond chance, in a sentence."""
    sure = [d for d in mapped.significant if d.score >= 0.05][:3]
    if not sure:
        return "The error goes with none of the quantities beyond chance."
    return f"What the error goes with: {'; '.join(dependence_words(d) for d in sure)}."


def dependence_words(dependence: Dependence) -> str:
    """In what way, and on which axes, the error goes with a quantity: half a sentence."""
    if dependence.of_mean < dependence.of_size:
        return f"{dependence.label} ({_percent(dependence.of_size)} of how large it is)"
    axes = [AXES[k] for k in np.argsort(-dependence.axes_mean) if dependence.axes_mean[k] > 0.2][:3]
    on = f", mostly {', '.join(axes)}" if axes else ""
    return f"{dependence.label} ({_percent(dependence.of_mean)} of its mean{on})"


def _depends_on(relevant: Relevance) -> str:
    if not relevant.chosen:
        return "No input predicts the residual on held-out time."
    listed = ", then ".join(relevance_words(g) for g in relevant.chosen)
    return f"On held-out time {_percent(relevant.explained)} of the residual follows {listed}."


def relevance_words(group: GroupRelevance) -> str:
    """What a group of inputs explains, and on which axes it is missed: half a sentence."""
    axes = [AXES[k] for k in np.argsort(-group.lost_axes) if group.lost_axes[k] > 0.2][:3]
    on = f", on {', '.join(axes)}" if axes else ""
    return f"{group.label} ({_percent(group.alone)} alone, {_percent(group.lost)} lost without{on})"


def autocorrelation_words(auto: Autocorrelation) -> str:
    """Whether one axis is white, and at which lag it is least."""
    if auto.white:
        return "as white as filtered noise"
    k = int(np.argmin(np.abs(auto.lags - auto.worst)))
    return f"not white: {auto.value[k]:+.2f} at {auto.worst:.2f} s, noise {auto.expected[k]:+.2f} +- {auto.band[k]:.2f}"


def crosscorrelation_words(cross: CrossCorrelation | None) -> str:
    """What one axis follows most, and how late."""
    if cross is None:
        return "no input that moves enough"
    if not cross.outside or abs(cross.peak) < WORTH:
        return "follows no input beyond chance"
    late = "at once" if cross.lag == 0 else f"{abs(cross.lag):.2f} s {'after' if cross.lag > 0 else 'before'}"
    return f"{cross.peak:+.2f} with {cross.input} {late} (chance {cross.band:.2f})"


def _percent(value: float) -> str:
    return f"{100 * value:.0f} %" if abs(value) >= 0.095 or value == 0 else f"{100 * value:.1f} %"
