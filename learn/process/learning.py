"""A Gaussian process learnt from flights, and how well it predicts.

Inputs are the filtered commanded wrenches, outputs what the model leaves of the measured wrench. Samples are thinned to
1 / (2 f_c) or more, because the filter has made closer ones dependent (docs/decisions/0006-blocks.md).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.errors import UsageError
from wrenchgap.flight.flight import AXES
from wrenchgap.learn.data.comparison import Comparison, Predictor, compare
from wrenchgap.learn.data.inputs import process_inputs
from wrenchgap.learn.data.measurement import Record
from wrenchgap.learn.data.opening import OpenFlight, check_effects
from wrenchgap.learn.identify.absorption import Absorbed, Absorption, absorbed
from wrenchgap.learn.identify.fit import dataset
from wrenchgap.learn.process.alternatives import Choices, choose
from wrenchgap.learn.process.calibration import Coverage
from wrenchgap.learn.process.gp import FitSettings, GaussianProcess, LogSource, MeanKind, Provenance
from wrenchgap.learn.process.train import fit, fit_linear
from wrenchgap.plant.mismatch import conditioning, output_indices
from wrenchgap.plant.model import Model
from wrenchgap.plant.model_file import content_hash, tool_version

Array = NDArray[np.float64]

TORQUE = AXES[3:]
NEARLY_SINGULAR = 0.2
"""Smallest real part of the eigenvalues of I + dmu/dW below which the correction is ill-conditioned."""


WORSE = 1.2
"""Ratio of rms on unseen flights above which a GP does harm."""


WORTH_IT = 0.95
"""Ratio of rms on unseen flights, to the best of the simpler alternatives, above which a GP is not worth it."""
NOMINAL, CONSTANT, LINEAR = "nominal", "constant offset", "linear in the command"


@dataclass(frozen=True)
class Samples:
    """What is learnt from: `inputs` (M, D), the command first, and mismatch `outputs` (M, 6), `spacing` [s] apart."""

    inputs: Array
    outputs: Array
    spacing: float


@dataclass(frozen=True)
class Learnt:
    """A GP and what it does on the training flights and, where given, on others."""

    gp: GaussianProcess
    samples: int
    spacing: float
    training: Comparison
    validation: Comparison | None
    real_min: Array  # (3,) 1st percentile, median, maximum of the smallest real part along the training commands

    @property
    def warnings(self) -> list[str]:
        """What a user should know before trusting the correction."""
        found = []
        if self.real_min[0] < NEARLY_SINGULAR:
            found.append(
                f"I + dmu/dW is nearly singular on the training flights (smallest eigenvalue {self.real_min[0]:.2f}): "
                "where little is accelerated the mismatch is minus the command, and the GP has learnt just that; train "
                "on a flight with excitation on all axes, or add effects first."
            )
        if self.validation is not None:
            axes = [str(AXES[k]) for k in output_indices(self.gp.outputs)]
            given, simple, learnt = self._rms(-2), np.min([self._rms(1), self._rms(2)], axis=0), self._rms(-1)
            given = given if self.gp.settings.mean == "physics" else self._rms(0)
            worse = learnt > WORSE * given
            idle = ~worse & (learnt > WORTH_IT * np.minimum(given, simple))
            listed = [
                f"{a} (rms {b:.2g} to {c:.2g})" for a, b, c, w in zip(axes, given, learnt, worse, strict=True) if w
            ]
            if listed:
                found.append(
                    f"on unseen flights the GP makes it worse: {', '.join(listed)}; leave these out with --outputs."
                )
            if idle.any():
                names = ", ".join(a for a, i in zip(axes, idle, strict=True) if i)
                found.append(
                    f"on unseen flights the GP is not worth it for {names}: the model without it, a constant or a "
                    "straight line does as well."
                )
        return found

    def _rms(self, place: int) -> Array:
        """On the validation flights, of the predictor at this place (L,)."""
        assert self.validation is not None
        return np.asarray(self.validation.evaluations[place].pooled.rms[output_indices(self.gp.outputs)])

    @property
    def coverage(self) -> dict[str, tuple[Coverage, Coverage]]:
        """How often sigma is right, before and after calibration, on the training flights and unseen ones."""
        flights = {"training": self.training, "unseen": self.validation}
        return {name: _coverage(self.gp, one) for name, one in flights.items() if one is not None}

    def to_json(self) -> dict[str, Any]:
        """The body of the `learn` schema."""
        gp = self.gp
        low, middle, high = self.real_min
        return {
            "axes": list(AXES),
            "outputs": list(gp.outputs),
            "settings": dict(gp.settings.__dict__),
            "samples": self.samples,
            "points": len(gp.inputs),
            "spacing_s": self.spacing,
            "cutoff_hz": gp.provenance.cutoff_hz,
            "physics": gp.provenance.physics,
            "sigma_prior": gp.sigma_prior,
            "sigma_training": gp.sigma_training,
            "sigma_scale": gp.sigma_scale,
            "coverage": {
                name: {"before": before.to_json(), "after": after.to_json()}
                for name, (before, after) in self.coverage.items()
            },
            "conditioning": {"percentile_1": low, "median": middle, "maximum": high},
            "training": self.training.to_json(),
            "validation": None if self.validation is None else self.validation.to_json(),
            "warnings": self.warnings,
        }


def _coverage(gp: GaussianProcess, flights: Comparison) -> tuple[Coverage, Coverage]:
    """Without and with the factor of calibration."""
    rows, last = output_indices(gp.outputs), flights.evaluations[-1]
    error = np.concatenate([r.measured - p for r, p in zip(flights.records, last.predictions, strict=True)])[:, rows]
    assert last.sigma is not None
    sigma = np.concatenate(last.sigma)[:, rows]
    return Coverage.of(error, sigma / gp.sigma_scale), Coverage.of(error, sigma)


def guard(
    flights: Sequence[OpenFlight],
    model: Model,
    gp: GaussianProcess,
    *,
    progress: Callable[[float, str], None] | None = None,
) -> Absorption:
    """Which effect of the catalogue the GP, learnt on `model` from `flights`, is absorbing."""
    report = progress or (lambda fraction, words: None)
    data = dataset([r for f in flights for r in f.records], model)
    return absorbed(data, model, gp, progress=lambda words, k, n: report(k / max(n, 1), words))


def absorption_words(found: Absorption) -> str:
    """What the GP absorbs and what to do about it, in one sentence; empty where it absorbs nothing that has a name."""
    first = found.first
    if first is None:
        return ""
    shares = {a.name: a.share for a in found.tried}
    rest = "and learning what is left"
    if len(found.effects) == 1:
        values = f"; {_values(first)}" if len(first.values()) <= 3 else ""
        what = f"{first.name} ({100 * first.share:.0f} % of its correction{values})"
        return f"the GP absorbs {what}: consider `wrenchgap add {first.name}` {rest}."
    listed = ", ".join(f"{name} ({100 * shares[name]:.0f} %)" for name in found.effects)
    return (
        f"the GP absorbs one of {listed}: these reproduce its correction equally well; see `wrenchgap explain`, then "
        f"consider `wrenchgap add` {rest}."
    )


def _values(found: Absorbed) -> str:
    return ", ".join(
        f"{name} {value:.3g}{'' if unit == '1' else f' {unit}'}" for name, value, _, unit in found.values()
    )


def absorption_json(found: Absorption) -> dict[str, Any]:
    """The key `absorbs` of the `learn` schema."""
    return {
        "effects": list(found.effects),
        "summary": absorption_words(found),
        "tried": [
            {
                "effect": a.name,
                "cosine": a.cosine,
                "share": a.share,
                "significance": a.t,
                "named": a.named,
                "parameters": [{"name": n, "value": v, "std": s, "unit": u} for n, v, s, u in a.values()],
            }
            for a in found.tried
        ],
    }


def parse_outputs(text: str) -> tuple[str, ...]:
    """`torque`, `wrench`, or names of axes separated by commas."""
    if text == "torque":
        return TORQUE
    if text == "wrench":
        return AXES
    names = tuple(part.strip() for part in text.split(",") if part.strip())
    wrong = [n for n in names if n not in AXES]
    if wrong or not names or len(set(names)) < len(names):
        raise UsageError(f"--outputs {text}: expected torque, wrench, or different names out of {', '.join(AXES)}")
    return names


def samples(records: Sequence[Record], model: Model, groups: Sequence[str] = ()) -> Samples:
    """Inputs and mismatches of all records, thinned to at least 1 / (2 f_c).

    Raises FitError where an effect of the model, or a group of inputs, needs what a log lacks.
    """
    check_effects(model.effects, model, records)
    physics = Predictor("physics", model.wrench_model)
    inputs, outputs = [], []
    spacing = 0.0
    for record in records:
        kept = record.dt * (record.keep.step or 1)
        step = max(1, math.ceil(1.0 / (2.0 * record.cutoff_hz * kept) - 1e-9))
        residual = record.measured - physics.predict(record, model.vehicle.body)
        inputs.append(process_inputs(groups, record)[::step])
        outputs.append(residual[::step])
        spacing = kept * step
    return Samples(np.concatenate(inputs), np.concatenate(outputs), spacing)


def learn(
    flights: Sequence[OpenFlight],
    model: Model,
    outputs: tuple[str, ...],
    settings: FitSettings,
    *,
    validation: Sequence[OpenFlight] = (),
    progress: Callable[[float, str], None] | None = None,
) -> Learnt:
    """Learn what `model` leaves on `flights`, and see what the GP does there and on `validation`.

    With a mean other than physics, the nominal vehicle is what leaves it. Raises UsageError for physics without any.
    """
    records = [r for f in flights for r in f.records]
    base = physics_of(model, settings)
    data = samples(records, base, settings.inputs)
    targets = data.outputs[:, output_indices(outputs)]
    gp = fit(
        data.inputs,
        targets,
        outputs,
        settings,
        provenance=Provenance(
            vehicle=model.vehicle.name,
            model_hash=content_hash(base),
            physics=", ".join(e.name for e in base.effects) or "nominal",
            cutoff_hz=records[0].cutoff_hz,
            logs=tuple(LogSource(f.flight.path.name, f.flight.content_hash) for f in flights),
            version=tool_version(),
            date=datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
        ),
        progress=progress,
    )
    found = [Predictor(NOMINAL, model.nominal.wrench_model), *_lines(records, model, outputs)]
    found += [Predictor(model.name, base.wrench_model)] if base.effects else []
    found.append(Predictor(f"{model.name if base.effects else NOMINAL}+GP", base.wrench_model, gp))
    real = conditioning(gp, data.inputs).real_min
    learnt = Learnt(
        gp,
        len(data.inputs),
        data.spacing,
        compare(flights, model, found),
        compare(validation, model, found) if validation else None,
        np.array([np.percentile(real, 1), np.median(real), real.max()]),
    )
    provenance = replace(gp.provenance, warnings=tuple(learnt.warnings))
    return replace(learnt, gp=replace(gp, provenance=provenance))


def alternatives(
    flights: Sequence[OpenFlight],
    model: Model,
    outputs: tuple[str, ...],
    settings: FitSettings,
    *,
    progress: Callable[[float, str], None] | None = None,
) -> Choices:
    """How other inputs and the other inference would predict time of these flights that is left out."""
    records = [r for f in flights for r in f.records]
    base = physics_of(model, settings)
    targets = samples(records, base).outputs[:, output_indices(outputs)]
    return choose(lambda groups: samples(records, base, groups).inputs, targets, outputs, settings, progress)


def choice_words(found: Choices) -> str:
    """What would be better, in one sentence; empty where nothing is."""
    better = found.better
    if better is None:
        return ""
    asked = found.tried[0].settings
    options = []
    if better.settings.inputs != asked.inputs:
        options.append(f"--inputs {','.join(better.settings.inputs)}")
    if better.settings.inference != asked.inference:
        options.append(f"--inference {better.settings.inference}")
    return f"with {' '.join(options)} the error on left-out time would be {100 * better.gain:.0f} % smaller."


def choices_json(found: Choices) -> list[dict[str, Any]]:
    """The key `alternatives` of the `learn` schema: the first is what was asked for."""
    return [
        {
            "inputs": list(c.settings.inputs),
            "inference": c.settings.inference,
            "rms": c.rms,
            "gain": c.gain,
            "significance": c.t,
            "best": c.settings == found.best,
        }
        for c in found.tried
    ]


def default_mean(model: Model) -> MeanKind:
    """Physics where the model has effects, else the paper's zero."""
    return "physics" if model.effects else "zero"


def physics_of(model: Model, settings: FitSettings) -> Model:
    """On top of what a process with these settings is learnt."""
    if settings.mean != "physics":
        return model.nominal
    if not model.effects:
        raise UsageError(
            f"--mean physics: {model.name} has no effects; name some with `wrenchgap explain` and put them into it "
            "with `wrenchgap add`, or say --mean zero"
        )
    return model


def _lines(records: Sequence[Record], model: Model, outputs: tuple[str, ...]) -> list[Predictor]:
    """The simplest alternatives: a constant offset, and a straight line in the command, on the nominal vehicle."""
    nominal = model.nominal
    every = samples(records, nominal)
    rows = output_indices(outputs)
    return [
        Predictor(name, nominal.wrench_model, fit_linear(every.inputs, every.outputs[:, rows], outputs, slope=slope))
        for name, slope in ((CONSTANT, False), (LINEAR, True))
    ]
