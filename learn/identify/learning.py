"""A Gaussian process learnt from flights, how well it predicts, and what to know before it is used.

Inputs are the filtered commanded wrenches, outputs what the model leaves of the measured wrench
(`learn.identify.samples`). How much of it is believed is decided in `learn.identify.guard`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from wrenchgap.flight.arguments import Progress, silent
from wrenchgap.flight.errors import FitError, UsageError
from wrenchgap.flight.flight import AXES, Array
from wrenchgap.flight.repeats import refuse_seen
from wrenchgap.flight.result import Result
from wrenchgap.learn.data.comparison import Comparison, compare
from wrenchgap.learn.data.dataset import dataset
from wrenchgap.learn.data.input_errors import untrusted
from wrenchgap.learn.data.opening import OpenFlight
from wrenchgap.learn.data.prediction import Predictor
from wrenchgap.learn.diagnose.flown_controller import attitude_gains, gains_source
from wrenchgap.learn.identify.absorption import Absorption, absorbed
from wrenchgap.learn.identify.guard import guarded_process
from wrenchgap.learn.identify.samples import sampled_inputs, samples
from wrenchgap.learn.parallel import one_thread
from wrenchgap.learn.process.alternatives import Alternatives, compare_alternatives
from wrenchgap.learn.process.gp import (
    Caution,
    CautionKind,
    FitSettings,
    GaussianProcess,
    LogSource,
    MeanKind,
    Provenance,
)
from wrenchgap.learn.process.held_out_time import Coverage, Decision, Reason, Verdict
from wrenchgap.learn.process.predictors import NOMINAL
from wrenchgap.learn.process.train import fit_linear
from wrenchgap.plant.mismatch import conditioning, output_indices
from wrenchgap.plant.model import Model
from wrenchgap.plant.model_file import content_hash, tool_version, utc_now
from wrenchgap.plant.stability import Margin

TORQUE = AXES[3:]
CONSTANT, LINEAR = "constant offset", "linear in the command"


@dataclass(frozen=True)
class CautionThresholds:
    """From when on a process is not to be trusted."""

    nearly_singular: float = 0.2
    """Smallest real part of the eigenvalues of I + dmu/dW below which the correction is ill-conditioned."""
    worse: float = 1.2
    """Ratio of rms on unseen flights above which a GP does harm."""
    worth_it: float = 0.95
    """Ratio of rms on unseen flights, to the best of the simpler alternatives, above which a GP is not worth it."""


CAUTION = CautionThresholds()


@dataclass(frozen=True, repr=False)
class Learnt(Result):
    """A GP and what it does on the training flights and, where given, on others.

    `real_min` (3,): 1st percentile, median and maximum, along the training commands, of the smallest real part of the
    eigenvalues of I + dmu/dW; `margin`: the stability margin there. `alternatives` are other inputs and the other
    inference on held-out time; `absorption` is which effect of the catalogue the process reproduces. Both None where
    nobody asked. `wrench_computed`: a log has no commanded wrench in newtons: it is what the model makes of its
    actuators.
    """

    gp: GaussianProcess
    samples: int
    spacing: float
    training: Comparison
    validation: Comparison | None
    real_min: Array
    margin: Margin
    alternatives: Alternatives | None = None
    absorption: Absorption | None = None
    wrench_computed: bool = False

    @property
    def cautions(self) -> tuple[Caution, ...]:
        """What a user should know before trusting the correction."""
        found = []
        if self.wrench_computed:
            found.append(Caution(CautionKind.ALLOCATED))
        if self.real_min[0] < CAUTION.nearly_singular:
            found.append(Caution(CautionKind.NEARLY_SINGULAR, eigenvalue=float(self.real_min[0])))
        if self.validation is not None:
            given, simple, learnt = self._rms(-2), np.min([self._rms(1), self._rms(2)], axis=0), self._rms(-1)
            given = given if self.gp.settings.mean == "physics" else self._rms(0)
            worse = learnt > CAUTION.worse * given
            idle = ~worse & (learnt > CAUTION.worth_it * np.minimum(given, simple))
            for kind, rows in ((CautionKind.WORSE, worse), (CautionKind.NOT_WORTH_IT, idle)):
                if rows.any():
                    axes = tuple(name for name, row in zip(self.gp.outputs, rows, strict=True) if row)
                    found.append(Caution(kind, axes, tuple(given[rows].tolist()), tuple(learnt[rows].tolist())))
        return tuple(found)

    def _rms(self, place: int) -> Array:
        """On the validation flights, of the predictor at this place (L,)."""
        assert self.validation is not None
        return np.asarray(self.validation.evaluations[place].pooled.rms[output_indices(self.gp.outputs)])

    @property
    def coverage(self) -> dict[str, tuple[Coverage, Coverage]]:
        """How often sigma is right, before and after calibration, on the training flights and unseen ones."""
        out, rows = {}, output_indices(self.gp.outputs)
        for name, flights in (("training", self.training), ("unseen", self.validation)):
            if flights is not None:
                last = flights.evaluations[-1]
                error = np.concatenate([r.measured for r in flights.records]) - np.concatenate(last.predictions)
                assert last.sigma is not None
                error, sigma = error[:, rows], np.concatenate(last.sigma)[:, rows]
                out[name] = Coverage.of(error, sigma / self.gp.sigma_scale), Coverage.of(error, sigma)
        return out


def absorption(
    flights: Sequence[OpenFlight], model: Model, gp: GaussianProcess, *, progress: Progress | None = None
) -> Absorption:
    """Which effect of the catalogue the GP, learnt on `model` from `flights`, is absorbing."""
    return absorbed(dataset([r for f in flights for r in f.records], model), model, gp, progress=progress)


@one_thread
def learn(
    flights: Sequence[OpenFlight],
    model: Model,
    outputs: tuple[str, ...] = TORQUE,
    settings: FitSettings | None = None,
    *,
    validation: Sequence[OpenFlight] = (),
    best_inputs: bool = False,
    guard: bool = True,
    progress: Progress | None = None,
) -> Learnt:
    """Learn what `model` leaves on `flights`, and see what the GP does there and on `validation`.

    With a mean other than physics, the nominal vehicle is what leaves it (`settings` by default as the paper's, with
    physics where the model has effects). With `best_inputs` the process looks at what predicts held-out time best,
    with `guard` it is compared with other inputs and with every effect of the catalogue. Raises UsageError for physics
    without any, LogError where a flight is learnt from and tested on.
    """
    refuse_seen([f.flight for f in flights], [f.flight for f in validation])
    settings = settings or FitSettings(mean=default_mean(model))
    outputs = learnable_outputs(flights, outputs)
    others = None
    if best_inputs or guard:
        others = alternatives(flights, model, outputs, settings, progress=progress)
        settings = others.best if best_inputs else settings
    found = learn_process(flights, model, outputs, settings, validation=validation, progress=progress)
    reproduced = absorption(flights, physics_of(model, settings), found.gp, progress=progress) if guard else None
    return replace(found, alternatives=others, absorption=reproduced)


def learnable_outputs(flights: Sequence[OpenFlight], outputs: Sequence[str]) -> tuple[str, ...]:
    """Those of the axes that these flights measured and of whose commands they say more than the mean.

    On others there is nothing to learn. FitError where none is left, UsageError for what is no axis.
    """
    if wrong := [axis for axis in outputs if axis not in AXES]:
        raise UsageError(f"--outputs: {wrong[0]!r} is no axis; expected names out of {', '.join(AXES)}")
    records = [r for f in flights for r in f.records]
    known = np.all([r.measured_axes for r in records], axis=0)
    listed = ", ".join(dict.fromkeys(f.flight.name for f in flights))
    measured = tuple(axis for axis in outputs if known[AXES.index(axis)])
    if not measured:
        raise FitError(
            f"{listed}: {', '.join(outputs)} {'was' if len(outputs) == 1 else 'were'} not measured, and there is "
            f"nothing to learn; choose --outputs among {', '.join(np.array(AXES)[known]) or 'none'}"
        )
    unsaid = untrusted(records)[0]
    found = tuple(axis for axis in measured if not unsaid[AXES.index(axis)])
    if not found:
        raise FitError(
            f"{listed}: but for the mean nothing of {', '.join(measured)} follows the logged commands, as where they "
            "are snapshots of faster ones: there is nothing to learn; if they are, log commands at the rate of the loop"
        )
    return found


def learn_process(
    flights: Sequence[OpenFlight],
    model: Model,
    outputs: tuple[str, ...],
    settings: FitSettings,
    *,
    validation: Sequence[OpenFlight] = (),
    progress: Progress | None = None,
) -> Learnt:
    """`learn` with settings as they are, compared with nothing but the simplest alternatives."""
    records = [r for f in flights for r in f.records]
    base = physics_of(model, settings)
    provenance = Provenance(
        vehicle=model.vehicle.name,
        model_hash=content_hash(base),
        physics=", ".join(e.name for e in base.effects) or NOMINAL,
        cutoff_hz=records[0].cutoff_hz,
        logs=tuple(LogSource(f.flight.path.name, f.flight.content_hash) for f in flights),
        version=tool_version(),
        date=utc_now(),
    )
    flown = attitude_gains(flights, model)
    provenance = replace(provenance, gains=gains_source(model) if flown is None else "log")
    looped = base if flown is None else replace(base, controller=flown.into(base.controller))
    made = guarded_process(records, looped, outputs, settings, provenance, progress or silent)
    gp, data = made.gp, made.data
    nominal = model.nominal
    every, rows = samples(records, nominal), output_indices(outputs)
    found = [Predictor(NOMINAL, nominal.wrench_model)]
    for name, slope in ((CONSTANT, False), (LINEAR, True)):  # the simplest alternatives
        line = fit_linear(every.inputs, every.outputs[:, rows], outputs, slope=slope)
        found.append(Predictor(name, nominal.wrench_model, line))
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
        made.margin,
        wrench_computed=any(f.flight.commanded is None or f.flight.commanded.unit != "N" for f in flights),
    )
    return replace(learnt, gp=_judged(learnt))


def _judged(learnt: Learnt) -> GaussianProcess:
    """The process with what `learn` says of it; outputs that increase the error on unseen flights are not believed."""
    gp, cautions = learnt.gp, learnt.cautions
    worse = {axis for c in cautions if c.kind is CautionKind.WORSE for axis in c.axes} if gp.settings.guarded else set()

    def judged(one: Verdict) -> Verdict:
        refused = {"decision": Decision.DO_NOT, "reason": Reason.WORSE, "gain": 0.0}
        return replace(one, **refused) if one.output in worse and one.gain else one  # type: ignore[arg-type]

    said = replace(gp.provenance, warnings=cautions, verdicts=tuple(map(judged, gp.provenance.verdicts)))
    gain = np.array([0.0 if axis in worse else g for axis, g in zip(gp.outputs, gp.gain, strict=True)])
    return replace(gp, gain=gain, provenance=said)


def alternatives(
    flights: Sequence[OpenFlight],
    model: Model,
    outputs: tuple[str, ...],
    settings: FitSettings,
    *,
    progress: Progress | None = None,
) -> Alternatives:
    """How other inputs and the other inference would predict held-out time of these flights."""
    records = [r for f in flights for r in f.records]
    base = physics_of(model, settings)
    plain = samples(records, base)

    @cache
    def columns(group: str) -> Array:
        return sampled_inputs(records, (group,))[:, len(AXES) :]

    def inputs(groups: tuple[str, ...]) -> Array:
        return np.hstack((plain.inputs, *map(columns, groups)))

    return compare_alternatives(inputs, plain.outputs[:, output_indices(outputs)], outputs, settings, progress)


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
