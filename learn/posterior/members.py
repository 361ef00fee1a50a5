"""Members of the likeliest set: what each of them takes off, and what may stand in its place."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from wrenchgap.flight.flight import Array
from wrenchgap.learn.data.blocks import SIGNIFICANCE, contrast, evidence, needed
from wrenchgap.learn.data.errors import energy
from wrenchgap.learn.identify.fit import MATERIAL, Fit, fit, held_out
from wrenchgap.learn.parallel import each
from wrenchgap.learn.posterior.posterior import NamedSet, WeighedSets, trusted_weight
from wrenchgap.learn.posterior.settings import SearchSettings
from wrenchgap.learn.posterior.single_effects import ModelResidual
from wrenchgap.plant.effects import acting_effects, family
from wrenchgap.plant.model import Model

MAJOR_SHARE = 0.3
"""Share of the error from which on an effect at the limit of what is plausible is named all the same."""
MOST_RIVALS = 6
"""Alternatives in a member's place that are listed."""


@dataclass(frozen=True)
class Rival:
    """What stands in a member's place in another set: one effect, or several together.

    It stands in the place of `members`: of the member, or of it and others that go with it.
    `separation` is by how many standard errors that set fits worse, the square root of twice the log of the odds;
    `weight` its share of all; `cosine` that of the changes that the two make to the prediction.
    """

    names: tuple[str, ...]
    members: tuple[str, ...]
    separation: float
    weight: float
    cosine: float

    @property
    def name(self) -> str:
        """All of them."""
        return " + ".join(self.names)

    @property
    def place(self) -> str:
        """In whose place they stand."""
        return " + ".join(self.members)

    @property
    def alike(self) -> bool:
        """Whether these logs cannot tell the two apart."""
        return self.separation < SIGNIFICANCE.indistinct


@dataclass(frozen=True)
class Member:
    """An effect of the likeliest set: what it alone takes off, and what else might stand in its place.

    `share` of the given model's energy is lost without it; `significance` and `evidence` are those of the set with it
    against the set without it, on held-out time, without what commands that answer the motion could explain
    (`learn.data.feedback_regressors`), `by_axis` (6,) the evidence of each; `probability` is that of the effect
    or one of its group.
    """

    name: str
    share: float
    significance: float
    evidence: float
    probability: float
    rivals: tuple[Rival, ...]
    by_axis: Array = field(default_factory=lambda: np.zeros(6))

    @property
    def needed(self) -> bool:
        """Whether held-out time is predicted worse without it, beyond chance and by enough to matter."""
        return needed(self.significance, self.evidence)

    @property
    def alike(self) -> tuple[Rival, ...]:
        """The rest of its group; another form of the same effect is the same name, and no news."""
        return tuple(
            r for r in self.rivals if r.alike and {family(n) for n in r.names} != {family(n) for n in r.members}
        )


@dataclass(frozen=True)
class Fitted:
    """A set fitted together, the model's other effects as they are, and its residual (K, 6) on held-out time."""

    fit: Fit
    left: Array


def fitted(
    on: ModelResidual, names: Sequence[str], start: Fit | None = None, near: Mapping[str, Array] | None = None
) -> Fitted:
    """Fit the named effects, all parameters anew, from a fit or values to start at (`learn.identify.fit.fit`)."""
    found = fit(on.data, on.model, names, start=start, near=near)
    return Fitted(found, held_out(on.data, on.model, names, found))


def needed_members(
    on: ModelResidual, found: WeighedSets, jobs: int = 1
) -> tuple[Fitted, tuple[Member, ...], WeighedSets]:
    """The likeliest set without those of its effects that are too small for a name when all are fitted together, at
    the limit of what is plausible, or not needed on held-out time: those go, the least needed first. The fit; the
    members, that which takes off most first; the sets without what went.
    """  # noqa: D205
    names = found.best.names
    best = fitted(on, names, near=found.best.theta(on.model))
    while True:
        listed = members(on, names, best, jobs)
        idle = [
            m
            for m in listed
            if not (material(best.fit, on.model, m.name) and m.needed)
            or (m.name in best.fit.stuck and m.share < MAJOR_SHARE)
        ]
        if not idle:
            on.data.forget()
            return best, with_rivals(listed, found, on.settings), found
        gone = min(idle, key=lambda m: m.evidence).name
        kept = tuple(acting_effects([n for n in names if n != gone], on.own))
        for name in names:
            found = found if name in kept else found.without(name)
        names, best = kept, fitted(on, kept, best.fit)


def material(fitted: Fit, model: Model, name: str) -> bool:
    """Whether any parameter of the effect, or its change from what the model has, is worth a name."""
    rows = [(v, p) for (owner, p), v in zip(fitted.parameters, fitted.theta, strict=True) if owner == name]
    pairs = zip(rows, model.theta(name), strict=True)
    return any(abs(v - o) >= MATERIAL * p.scale for (v, p), o in pairs)


def members(on: ModelResidual, names: Sequence[str], best: Fitted, jobs: int = 1) -> tuple[Member, ...]:
    """What each of these effects takes off, which leave `best`; that which takes off most first."""

    def without(name: str) -> Array:
        return fitted(on, acting_effects([n for n in names if n != name], on.own), best.fit).left

    weights = on.data.weights
    after = on.data.remaining(best.left)
    out = []
    for name, left in zip(names, each(without, names, jobs, (on.data.root, on.model)), strict=True):
        share = (energy(left, weights) - energy(best.left, weights)) / max(energy(on.given, weights), 1e-30)
        before = on.data.remaining(left)
        by_axis = np.array([evidence(before[:, [k]], after[:, [k]]) for k in range(6)])
        t = contrast(on.data, before, after).t
        out.append(Member(name, share, t, evidence(before, after), np.nan, (), by_axis))
    return tuple(sorted(out, key=lambda m: -m.share))


def with_rivals(listed: Sequence[Member], found: WeighedSets, settings: SearchSettings) -> tuple[Member, ...]:
    """Members with what other sets have in the place of each, the nearest first; and with the probability that the
    effect or one of its group is there. All else is named alike in those sets, or they are of the likeliest class.
    """  # noqa: D205
    best, mates = found.best, found.classes[0].sets
    least = settings.otherwise * sum(s.weight for s in mates)
    likely = [set(s.names) for s in mates if s.weight >= least]
    out = []
    for member in listed:
        rivals: dict[tuple[str, ...], Rival] = {}
        for other in found.sets:
            instead = tuple(n for n in other.names if n not in best.names)
            gone = tuple(n for n in best.names if n not in other.names)
            if member.name not in gone or not instead or instead in rivals:
                continue
            if len(gone) == 1 or set(other.names) in likely:
                rivals[instead] = _rival(best, other, instead, gone)
        nearest = tuple(sorted(rivals.values(), key=lambda r: r.separation))[:MOST_RIVALS]
        alike = [r.names for r in nearest if r.alike]
        probability = min(settings.certain, trusted_weight(found.sets, [(member.name,), *alike]))
        out.append(replace(member, probability=probability, rivals=nearest))
    return tuple(out)


def _rival(best: NamedSet, other: NamedSet, instead: tuple[str, ...], gone: tuple[str, ...]) -> Rival:
    odds = np.log(max(best.weight, 1e-300) / max(other.weight, 1e-300))
    a, b = best.scored_set.predicted.ravel(), other.scored_set.predicted.ravel()
    alike = float(a @ b / max(float(np.linalg.norm(a) * np.linalg.norm(b)), 1e-30))
    return Rival(instead, gone, float(np.sign(odds) * np.sqrt(2.0 * abs(odds))), other.weight, alike)
