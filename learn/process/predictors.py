"""What to compare on some flights: the nominal vehicle, models, a Gaussian process on what it was learnt on."""

from collections.abc import Sequence
from dataclasses import dataclass

from wrenchgap.flight.errors import FitError, ModelError
from wrenchgap.learn.data.prediction import Predictor
from wrenchgap.learn.process.gp import GaussianProcess
from wrenchgap.plant.model import Model
from wrenchgap.plant.model_file import content_hash

NOMINAL = "nominal"
"""Name of the vehicle without effects."""


@dataclass(frozen=True)
class WithoutEffects:
    """A model that has no effects: it differs from nominal only where its vehicle does."""

    model: str


@dataclass(frozen=True)
class OtherFilter:
    """The process was learnt behind another filter [Hz] than the one in use."""

    learnt_hz: float
    used_hz: float


@dataclass(frozen=True)
class OtherPhysics:
    """The process was learnt on another version of the model, which had the effects `physics`."""

    physics: str


def cutoff_of(gp: GaussianProcess | None) -> float | None:
    """Cut-off [Hz] of the data that a process was learnt on; None where there is none."""
    return None if gp is None else gp.provenance.cutoff_hz


def check_effects(gp: GaussianProcess, *models: Model) -> None:
    """Raise FitError unless one of the models has the effects that a process was learnt on, whatever their values.

    A process is what those effects left of the measured wrench: with others it corrects what they do, or do not do.
    """
    if any(_has_effects_of(gp, model) for model in models):
        return
    have = ", ".join(e.name for e in models[0].effects) or "none"
    learnt = "the nominal vehicle" if gp.provenance.physics == NOMINAL else f"the effects {gp.provenance.physics}"
    raise FitError(
        f"GP: learnt on top of {learnt}, and the effects of {models[0].name} are {have}; give the model that it was "
        "learnt on (-m), or learn one on this model with `wrenchgap learn`"
    )


def _has_effects_of(gp: GaussianProcess, model: Model) -> bool:
    return sorted(gp.provenance.physics.split(", ")) == sorted([e.name for e in model.effects] or [NOMINAL])


ProcessNote = WithoutEffects | OtherFilter | OtherPhysics


def predictors(
    model: Model,
    against: Sequence[Model] = (),
    gp: GaussianProcess | None = None,
    cutoff_hz: float | None = None,
    labels: Sequence[str] = (),
) -> tuple[list[Predictor], list[ProcessNote]]:
    """What to compare, and notes: the nominal vehicle, the model if it has effects, others, the GP on its model.

    The Gaussian process is added to what it was learnt on: the model itself, or the nominal vehicle. `labels` name the
    model and the others. Raises ModelError for models of different vehicles, FitError for a process of another one,
    or one on top of effects that none of them has.
    """
    found = [Predictor(NOMINAL, model.nominal.wrench_model)]
    notes: list[ProcessNote] = []
    name, *names = labels or [m.name for m in (model, *against)]
    others = list(zip(against, names, strict=True))
    if model.effects:
        found.append(Predictor(_fresh(name, found), model.wrench_model))
    for other, label in others:
        _check_geometry(model, other)
        found.append(Predictor(_fresh(label, found), other.wrench_model))
        if not other.effects:
            notes.append(WithoutEffects(label))
    if gp is not None:
        gp.check_vehicle(model.vehicle.name)
        candidates = [(model.nominal, NOMINAL), (model, name), *others]
        below = next((c for c in candidates if content_hash(c[0]) == gp.provenance.model_hash), None)
        if below is None:
            check_effects(gp, model, *(candidate for candidate, _ in candidates))
            below = next(c for c in candidates if _has_effects_of(gp, c[0]))
            notes.append(OtherPhysics(gp.provenance.physics))
        learnt = gp.provenance.cutoff_hz
        if learnt is not None and cutoff_hz is not None and learnt != cutoff_hz:
            notes.append(OtherFilter(learnt, cutoff_hz))
        found.append(Predictor(f"{below[1]}+GP", below[0].wrench_model, gp))
    return found, notes


def _fresh(name: str, taken: Sequence[Predictor]) -> str:
    names = {p.name for p in taken}
    return next(new for new in (name, *(f"{name} ({n})" for n in range(2, len(names) + 3))) if new not in names)


def _check_geometry(model: Model, other: Model) -> None:
    if other.vehicle.name != model.vehicle.name:
        raise ModelError(
            f"{other.name}: is a model of {other.vehicle.name}, {model.name} is one of {model.vehicle.name}; only "
            "models of one vehicle can be compared (the name is vehicle.name)"
        )
    (arms, rotors), (others, spun) = (
        [0 if part is None else len(part) for part in (v.arms, v.rotors)] for v in (model.vehicle, other.vehicle)
    )
    if (arms, rotors) != (others, spun):
        raise ModelError(
            f"{other.name}: {others} arms and {spun} rotors, {model.name} has {arms} and {rotors}; only models of one "
            "vehicle can be compared"
        )
