"""Effects put into a model and taken out: fitted to flights, or set by hand."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.errors import FitError, ModelError, UsageError
from wrenchgap.flight.flight import AXES
from wrenchgap.learn.data.opening import OpenFlight
from wrenchgap.learn.identify.fit import Dataset, Fit, dataset, fit, held_out, with_fit
from wrenchgap.plant.effects import find
from wrenchgap.plant.history import Trial
from wrenchgap.plant.model import Model, make_effect
from wrenchgap.plant.model_file import tool_version
from wrenchgap.plant.wrench_model import ModelEffect, Provenance

Array = NDArray[np.float64]


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
    rms = [np.sqrt(np.mean(r**2, axis=0)) for r in (before, after)]
    return Trial(rms[0], rms[1], data.noise, change, t)


def trial_json(tried: Trial) -> dict[str, Any]:
    """Errors on time that was not fitted, six each."""
    return {
        "rms_before": tried.before,
        "rms_after": tried.after,
        "noise": tried.noise,
        "fall": tried.fall,
        "verdict": tried.verdict,
    }


def parse_value(text: str) -> tuple[str, dict[str, float] | list[float]]:
    """`com_offset=x:0.004,y:-0.007` by name or `com_offset=0.004,-0.007,0` in order; UsageError on anything else."""
    name, equals, rest = text.partition("=")
    parts = [part.strip() for part in rest.split(",") if part.strip()]
    if not (name and equals and parts):
        raise UsageError(f"{text!r}: expected EFFECT=PARAMETER:VALUE,... e.g. com_offset=x:0.004,y:-0.007")
    named = [re.split(r"[:=]", part, maxsplit=1) for part in parts]
    if all(len(pair) == 2 for pair in named):
        return name.strip(), {key.strip(): _number(value, text) for key, value in named}
    if any(len(pair) == 2 for pair in named):
        raise UsageError(f"{text!r}: give all parameters by name, or all in order")
    return name.strip(), [_number(part, text) for part in parts]


def _number(value: str, text: str) -> float:
    try:
        return float(value)
    except ValueError:
        raise UsageError(f"{text!r}: {value.strip()!r} is not a number") from None


def made(model: Model, text: str) -> ModelEffect:
    """The effect that a text like `servo_lag=tau:0.05` describes; parameters that are not named are zero.

    Raises ModelError for unknown names, with a list of the known ones.
    """
    name, values = parse_value(text)
    parameters = find(name).parameters(model.vehicle)
    if isinstance(values, dict) and set(values) <= {p.name for p in parameters}:
        values = {p.name: 0.0 for p in parameters} | values
    effect = make_effect(model.vehicle, name, values)
    for parameter, value in zip(parameters, effect.theta, strict=True):
        if value != 0.0 and not parameter.low <= value <= parameter.high:
            raise ModelError(
                f"effect {name}: {parameter.name} = {value:g} {parameter.unit} is not plausible for "
                f"{model.vehicle.name}; expected {parameter.low:.3g} to {parameter.high:.3g}"
            )
    return effect


def set_by_hand(model: Model, texts: Sequence[str]) -> Model:
    """The model with effects of given values, in place of its own of the same names."""
    source = Provenance(
        fitted=datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ"), version=tool_version(), method="set by hand"
    )
    new = [replace(made(model, text), provenance=source) for text in texts]
    names = {e.name for e in new}
    return model.with_effects((*(e for e in model.effects if e.name not in names), *new))


def with_hidden(model: Model, texts: Sequence[str]) -> Model:
    """The model with further effects; values add to those of an effect that it has already."""
    truth = replace(model, history=())
    for text in texts:
        new = made(model, text)
        old = truth.effect(new.name)
        if old is not None:
            new = replace(new, theta=old.theta + new.theta)
        truth = truth.with_effects((*(e for e in truth.effects if e.name != new.name), new))
    return truth


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
