"""Every candidate by itself on top of the model: the table that a user reads, and the columns that sets are made of."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from wrenchgap.flight.arguments import Progress, silent
from wrenchgap.flight.errors import ModelError
from wrenchgap.flight.flight import Array
from wrenchgap.flight.memory import empty_on_disk, let_go
from wrenchgap.learn.data.blocks import beyond_chance, contrast, evidence
from wrenchgap.learn.data.dataset import Dataset
from wrenchgap.learn.data.errors import energy, reduction, rms
from wrenchgap.learn.identify.air import companions
from wrenchgap.learn.identify.bias_and_trim import unsure_thrust
from wrenchgap.learn.identify.fit import MANY, Fit, Starts, fit, held_out
from wrenchgap.learn.identify.least_squares import Problem, left_by
from wrenchgap.learn.parallel import each
from wrenchgap.learn.posterior.columns import Column, by_effect, column
from wrenchgap.learn.posterior.settings import DEFAULT, SearchSettings
from wrenchgap.plant.effects import acting_effects, find
from wrenchgap.plant.history import Value
from wrenchgap.plant.model import Model, make_effect
from wrenchgap.plant.wrench_model import ModelEffect


@dataclass(frozen=True)
class Candidate:
    """One effect tried on top of a model. `residual` (K, 6) is held out; `reduction` (6,) are fractions of rms that
    are gone relative to the model that it was tried on; `score` is the share of the given model's energy that is gone
    in all. `companions` are tried with it as one (`learn.identify.air`). `fit` is without residual and derivatives.
    """  # noqa: D205

    name: str
    fit: Fit
    residual: Array
    reduction: Array
    score: float
    evidence: float
    significance: float
    implausible: tuple[str, ...]
    companions: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """The effect and its companions."""
        return (self.name, *self.companions)

    @property
    def values(self) -> tuple[Value, ...]:
        """Parameters of this effect as fitted."""
        return self.fit.values(self.name)


@dataclass(frozen=True)
class ModelResidual:
    """What effects are tried on: flights and a model; what it leaves (K, 6), and on held-out time but for the
    accelerometers' biases; the model's own effects that are uncertain, with their standard deviations as sizes.
    `settings` are those of the search.
    """  # noqa: D205

    data: Dataset
    model: Model
    left: Array
    given: Array
    known: tuple[Column, ...] = ()
    settings: SearchSettings = DEFAULT

    @property
    def own(self) -> tuple[str, ...]:
        """Names of the model's own effects, which stay as they are unless they are named."""
        return tuple(e.name for e in self.model.effects)


def model_residual(data: Dataset, model: Model, settings: SearchSettings = DEFAULT) -> ModelResidual:
    """What the model leaves on these flights, for a search with these settings."""
    left = left_by(data, model)
    known = uncertain_effects(data, model)
    return ModelResidual(data, model, left, held_out(data, model, (), fit(data, model, ())), known, settings)


def uncertain_effects(data: Dataset, model: Model) -> tuple[Column, ...]:
    """What the model's own effects may be off by, and the thrust of a model that is not sure of it."""
    own = [e for e in model.effects if e.std is not None and np.any(e.std > 0.0)]
    if thrust := unsure_thrust(model):
        own.append(replace(make_effect(model.vehicle, "thrust_scale", [0.0]), std=np.array([thrust])))
    return tuple(uncertain(data, model, e) for e in own)


def uncertain(data: Dataset, model: Model, effect: ModelEffect) -> Column:
    """What an effect of the model may be off by: its derivatives, and its standard deviations in place of sizes."""
    problem = Problem(data, model, (effect.name,))
    size = problem.size
    std = np.zeros(size) if effect.std is None else np.nan_to_num(effect.std)
    spread = np.maximum(std, 1e-3 * problem.scale[:size])
    return Column.straight((effect.name,), problem.jacobian(problem.start(None))[:, :, :size], spread, 1e3)


@dataclass(frozen=True)
class SingleEffects:
    """Candidates, best first; their columns; effects that could not be fitted, with the reason."""

    candidates: tuple[Candidate, ...]
    columns: tuple[Column, ...]
    failed: dict[str, str] = field(default_factory=dict)


def single_effects(
    on: ModelResidual, names: Sequence[str], *, jobs: int = 1, progress: Progress = silent, twice: bool = False
) -> SingleEffects:
    """Try every effect of `names` by itself, air that moves together with each drag that it acts through. `twice` says
    that the same is asked of these data and of those `unanswering`: fits begin where the other's did.
    """  # noqa: D205
    wanted, vehicle = [n for n in names if n in acting_effects([n], on.own)], on.model.vehicle

    def attempt(name: str) -> str | tuple[Candidate, list[Column]]:
        """By itself and with what comes with it: the better of them by held-out time, and the columns of all."""
        try:
            starts = on.data.root.starts if twice else None
            best, line = _candidate(on, (name,), starts)
            columns = [line]
            for other in companions(name, on.own, names):
                both, line = _candidate(on, (name, other), starts)
                columns.append(line)
                t = contrast(on.data, best.residual, both.residual).t
                if beyond_chance(t, evidence(best.residual, both.residual)) and not both.implausible:
                    best = both
            return replace(best, fit=replace(best.fit, effects=())), columns  # effects may not survive pickling
        except (ModelError, np.linalg.LinAlgError) as error:  # an inertia that no body has, say
            return str(error).removeprefix(f"effect {name}: ")

    candidates: list[Candidate] = []
    columns: list[Column] = []
    failed: dict[str, str] = {}
    shared = (on.data.root, on.model)
    for k, (name, found) in enumerate(zip(wanted, each(attempt, wanted, jobs, shared), strict=True)):
        progress(k / max(len(wanted), 1), f"trying {name}")
        if isinstance(found, str):
            failed[name] = found
            continue
        one, lines = found
        theta, std = (by_effect(values, one.names, vehicle) for values in (one.fit.theta, one.fit.std))
        effects = tuple(ModelEffect(find(n), theta[n], std[n]) for n in one.names)
        candidates.append(replace(one, fit=replace(one.fit, effects=effects)))
        columns += [c.spilled() for c in lines if np.any(c.jacobian)]
    on.data.forget()
    candidates.sort(key=lambda c: (bool(c.implausible), -c.score))
    return SingleEffects(_put_away(candidates), tuple(columns), failed)


def _put_away(candidates: Sequence[Candidate]) -> tuple[Candidate, ...]:
    """The same with their residuals in one array, which waits on disk where there are `MANY` samples."""
    if not candidates or len(candidates[0].residual) < MANY:
        return tuple(candidates)
    kept = empty_on_disk((len(candidates), *candidates[0].residual.shape), least=1)
    for c, own in zip(candidates, kept, strict=True):
        own[:] = c.residual
    let_go(kept)
    return tuple(replace(c, residual=own) for c, own in zip(candidates, kept, strict=True))


def _candidate(on: ModelResidual, added: tuple[str, ...], starts: Starts | None) -> tuple[Candidate, Column]:
    found = fit(on.data, on.model, added, starts=starts)
    left = held_out(on.data, on.model, added, found, exact=False)
    weights = on.data.weights
    line = column(on.data, on.model, on.left, found, added)
    return (
        Candidate(
            added[0],
            replace(found, residual=np.empty((0, 6)), jacobian=np.empty((0, 6, 0))),
            left,
            reduction(rms(on.given), rms(left)),
            1.0 - energy(left, weights) / max(energy(on.given, weights), 1e-30),
            evidence(on.given, left),
            contrast(on.data, on.given, left).t,
            tuple(b for b in found.at_bound if b.split(".")[0] in added),
            tuple(added[1:]),
        ),
        line,
    )
