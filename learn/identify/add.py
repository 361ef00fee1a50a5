"""Effects put into a model and taken out: fitted to flights, or set by hand."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.errors import FitError
from wrenchgap.flight.flight import AXES
from wrenchgap.learn.data.opening import OpenFlight
from wrenchgap.learn.identify.fit import Dataset, Fit, dataset, fit, held_out, with_fit
from wrenchgap.plant.effects import find
from wrenchgap.plant.history import Trial
from wrenchgap.plant.model import Model
from wrenchgap.plant.model_file import tool_version
from wrenchgap.plant.wrench_model import Provenance

Array = NDArray[np.float64]


CLEAR = 3.0
"""Paired t over blocks of time beyond which a change of the error is not chance."""


@dataclass(frozen=True)
class Edited:
    """A model with effects fitted: rms (6,) on the fitted flights before and after; `refitted` were in it already.

    `trial` tells the same of time that was not fitted, None where the logs are too short to hold any out.
    """

    model: Model
    fit: Fit
    rms_before: Array
    rms_after: Array
    refitted: tuple[str, ...]
    trial: Trial | None
    flights: tuple[tuple[str, str], ...]

    @property
    def rows(self) -> list[tuple[str, str, float, float | None, str]]:
        """(effect, parameter, value, std, unit)."""
        values = zip(self.fit.parameters, self.fit.theta, self.fit.std, strict=True)
        return [(name, p.name, float(v), float(s), p.unit) for (name, p), v, s in values]

    def to_json(self) -> dict[str, Any]:
        """The body of the `add` schema."""
        return {
            "axes": list(AXES),
            "effects": effects_json(self.model),
            "refitted": list(self.refitted),
            "rms_before": self.rms_before,
            "rms_after": self.rms_after,
            "at_bound": list(self.fit.at_bound),
            "held_out": None if self.trial is None else trial_json(self.trial),
        }


def add_fitted(
    model: Model,
    names: Sequence[str],
    flights: Sequence[OpenFlight],
    *,
    cutoff_hz: float,
    progress: Callable[[float, str], None] | None = None,
) -> Edited:
    """Fit the named effects together with those that the model has. Raises FitError where the logs cannot say."""
    for name in names:
        find(name)
    present = [e.name for e in model.effects]
    every = [*present, *(n for n in dict.fromkeys(names) if n not in present)]
    data = dataset([r for f in flights for r in f.records], model)
    report = progress or (lambda fraction, words: None)
    count = 0

    def tick() -> None:
        nonlocal count
        count += 1
        report(1.0 - 0.97**count, f"fitting {', '.join(every)}")

    fitted = fit(data, model, every, tick=tick)
    logs = tuple((f.flight.path.name, f.flight.content_hash) for f in flights)
    source = Provenance(
        logs=logs,
        fitted=datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
        version=tool_version(),
        method=f"wrenchgap add: {', '.join(every)} together, six axes below {cutoff_hz:g} Hz",
    )
    fitted = replace(fitted, effects=tuple(replace(e, provenance=source) for e in fitted.effects))
    after = with_fit(model, fitted)
    residuals = [data.measured - data.predict(m.wrench_model) for m in (model, after)]
    before_rms, after_rms = (np.sqrt(np.mean(r**2, axis=0)) for r in residuals)
    refitted = tuple(n for n in names if n in present)
    return Edited(after, fitted, before_rms, after_rms, refitted, trial(data, model, every, fitted), logs)


def trial(data: Dataset, model: Model, names: Sequence[str], fitted: Fit) -> Trial | None:
    """`model` as it stands against the same with `names` fitted, on blocks of time that the fit did not see.

    The accelerometer's bias is estimated on both sides. The verdict is that of a paired t over the blocks' weighted
    squared errors (docs/decisions/0006-blocks.md).
    """
    try:
        before = held_out(data, model, (), fit(data, model, ()))
        after = held_out(data, model, names, fitted)
    except FitError:  # too short to hold anything out
        return None
    counts = np.bincount(data.block)
    losses = [np.bincount(data.block, weights=((r * data.weights) ** 2).sum(axis=1)) / counts for r in (before, after)]
    gain = losses[0] - losses[1]
    spread = float(np.std(gain, ddof=1)) / np.sqrt(len(gain)) if len(gain) > 2 else np.inf
    t = float(np.mean(gain)) / max(spread, 1e-30)
    change = float((losses[1] * counts).sum() / max((losses[0] * counts).sum(), 1e-30)) - 1.0
    words = "better" if t > CLEAR else "worse" if t < -CLEAR else "no clear change"
    rms = [np.sqrt(np.mean(r**2, axis=0)) for r in (before, after)]
    return Trial(rms[0], rms[1], data.noise, f"{words}: error energy {100 * change:+.0f} %, t {t:.1f}")


def trial_json(tried: Trial) -> dict[str, Any]:
    """Errors on time that was not fitted, six each."""
    return {
        "rms_before": tried.before,
        "rms_after": tried.after,
        "noise": tried.noise,
        "fall": tried.fall,
        "verdict": tried.verdict,
    }


def effects_json(model: Model) -> list[dict[str, Any]]:
    """Effects of a model with their values."""
    return [
        {
            "effect": e.name,
            "parameters": [
                {"name": p.name, "value": float(e.theta[k]), "std": None if e.std is None else e.std[k], "unit": p.unit}
                for k, p in enumerate(e.effect.parameters(model.vehicle))
            ],
        }
        for e in model.effects
    ]


def rows_of(model: Model) -> list[tuple[str, str, float, float | None, str]]:
    """(effect, parameter, value, std, unit) of a model's effects."""
    return [
        (e["effect"], p["name"], p["value"], None if p["std"] is None else float(p["std"]), p["unit"])
        for e in effects_json(model)
        for p in e["parameters"]
    ]
