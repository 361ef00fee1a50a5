"""The search for the set of effects that leaves least on held-out time: forward, then every choice put to the test.

Forward: at every step each candidate is fitted together with what was chosen; the one that takes off the most energy
is taken, or a smaller one that does as well. What was chosen early was chosen while much was still unexplained, so
afterwards each member of the set is taken out again: if held-out blocks are predicted no worse it goes, and if another
effect in its place does better, or as well with fewer parameters, that one comes in. Members that a single effect of
the catalogue stands for together (`Effect.parts`: mass and centre of mass of a payload) are put to the same test.
The effects that do as well in a member's place form its group.
"""

# Long because the forward search and the exchange change one set, step by step, and are read together.

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.errors import ModelError
from wrenchgap.learn.data.blocks import INDISTINCT, LARGE_EVIDENCE, Contrast, contrast, cosine, evidence, significant
from wrenchgap.learn.data.dataset import Dataset
from wrenchgap.learn.data.errors import energy, reduction, rms
from wrenchgap.learn.identify.air import companions
from wrenchgap.learn.identify.fit import Fit, fit, held_out
from wrenchgap.learn.parallel import each
from wrenchgap.plant.air import that_act
from wrenchgap.plant.effects import family, find
from wrenchgap.plant.history import Value
from wrenchgap.plant.model import Model
from wrenchgap.plant.wrench_model import ModelEffect

Array = NDArray[np.float64]
Progress = Callable[[float, str], None]

LEAST_EVIDENCE = 0.2
"""Smallest evidence (sum of log rms ratios over the axes) worth a name: e.g. 7 % of the rms of three axes."""
LIKE = 0.8
"""Least cosine between the changes that two explanations make to the prediction for them to be called alike."""
MATERIAL = 0.2
"""Smallest parameter worth a name, in typical sizes (`Parameter.scale`): e.g. 1 % of thrust, 6 ms of lag."""
OVERSHADOWS = 0.5
"""Least cosine for an effect too small for a name to take another's place (2 ms of lag that look like backlash)."""
MAJOR = 0.3
"""Share of the error from which on a member that others push to the limit of what is plausible stays all the same."""
RIVAL = 0.3
"""Least share of the energy that a member takes off for another effect to be tried in its place."""
MOST_RIVALS = 6
"""How many other effects are tried in a member's place."""


def beyond_chance(t: float, gained: float) -> bool:
    """Whether an improvement with this paired t and this evidence is significant and worth a name."""
    return gained > LEAST_EVIDENCE and significant(t, large=gained > LARGE_EVIDENCE)


@dataclass(frozen=True)
class Candidate:
    """One effect tried on top of a model. `residual` (K, 6) is held out; `reduction` (6,) are fractions of rms that
    are gone relative to the model that it was tried on; `score` is the share of the given model's energy that is gone
    in all. `companions` are tried with it as one (`learn.identify.air`).
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
    def size(self) -> int:
        """Number of parameters of all of them."""
        return sum(name in self.names for name, _ in self.fit.parameters)

    @property
    def material(self) -> bool:
        """Whether the effect is large enough to be worth a name."""
        return material(self.fit, self.name)

    @property
    def beyond_chance(self) -> bool:
        """Whether held-out blocks are predicted better than luck would have it."""
        return beyond_chance(self.significance, self.evidence)

    @property
    def worthy(self) -> bool:
        """Whether it may be named at all."""
        return not self.implausible and self.material and self.beyond_chance

    @property
    def values(self) -> tuple[Value, ...]:
        """Parameters of this effect as fitted."""
        return self.fit.values(self.name)


@dataclass(frozen=True)
class Rival:
    """Another effect in a member's place: how much worse it does, and how alike the two are.

    `separation` is the difference in paired-t units, the models' inadequacy included; `cosine` that of the changes
    which the two make to the prediction.
    """

    name: str
    separation: float
    cosine: float
    candidate: Candidate

    @property
    def alike(self) -> bool:
        """Whether this log cannot tell the two apart."""
        there = self.candidate.beyond_chance and not self.candidate.implausible
        return there and self.separation < INDISTINCT and self.cosine > LIKE

    @property
    def overshadows(self) -> bool:
        """Whether this one, too small for a name, does clearly better than the member that it is compared with."""
        c = self.candidate
        small = c.beyond_chance and not c.material and not c.implausible
        return small and self.separation < -INDISTINCT and self.cosine > OVERSHADOWS


@dataclass(frozen=True)
class Member:
    """An effect of the final set: what it alone takes off, and what else might stand in its place.

    `share` of the given model's energy is lost without it; `significance` and `evidence` are those of the set with it
    against the set without it.
    """

    name: str
    share: float
    significance: float
    evidence: float
    rivals: tuple[Rival, ...]

    @property
    def alike(self) -> tuple[Rival, ...]:
        """The rest of its group; another form of the same effect is the same name, and no news."""
        return tuple(r for r in self.rivals if r.alike and family(r.name) != family(self.name))


@dataclass(frozen=True)
class Step:
    """One step of the forward selection, on top of the effects `on`: all candidates, best first; the one chosen, and
    those like it.
    """  # noqa: D205

    on: tuple[str, ...]
    candidates: tuple[Candidate, ...]
    chosen: str | None
    alike: tuple[tuple[str, float], ...]  # (name, cosine of the predicted changes)


def material(fitted: Fit, name: str) -> bool:
    """Whether any parameter of the effect is worth a name."""
    rows = zip(fitted.parameters, fitted.theta, strict=True)
    return any(abs(v) >= MATERIAL * p.scale for (owner, p), v in rows if owner == name)


def comparable(size: int, other: int) -> bool:
    """Whether an effect of `other` parameters is simple enough to stand in the place of one of `size`."""
    return other <= size + 2 or other <= 1.5 * size


class Search:
    """The present set, its fit and what it leaves on held-out blocks."""

    def __init__(
        self, data: Dataset, model: Model, names: Sequence[str], progress: Progress | None, jobs: int = 1
    ) -> None:
        self.data = data
        self.model = model
        self.names = tuple(names)
        self.present = [e.name for e in model.effects]
        self.progress = progress
        self.jobs = jobs
        self.chosen: list[str] = []
        self.steps: list[Step] = []
        self.failed: dict[str, str] = {}
        self.fit = fit(data, model, self.present)
        self.given: Array = held_out(data, model, self.present, self.fit)
        self.current = self.given

    def __getstate__(self) -> dict[str, object]:
        """What a worker needs to fit a candidate (`learn.parallel`)."""
        return {**vars(self), "progress": None, "steps": []}

    def run(self, most: int, rounds: int = 3) -> tuple[Member, ...]:
        """Forward and refine in turn, until a refinement changes nothing that the next step could build on."""
        for _ in range(rounds):
            self.forward(most)
            before = set(self.chosen)
            members = self.refine()
            if set(self.chosen) == before or len(self.chosen) >= most:
                break
        return members

    # ------------------------------------------------------------ forward

    def forward(self, most: int) -> None:
        """Take effects as long as one improves held-out blocks beyond chance, at most `most` in all."""
        while len(self.chosen) < most:
            step = self.step()
            self.steps.append(step)
            if step.chosen is None:
                break
            chosen = next(c for c in step.candidates if c.name == step.chosen)
            self.take([*self.chosen, *chosen.names], chosen.fit)

    def take(self, names: Sequence[str], start: Fit) -> None:
        """Make `names` the set, all parameters fitted anew."""
        self.chosen = list(names)
        self.fit, self.current = self.fitted(names, start)

    def fitted(self, names: Sequence[str], start: Fit) -> tuple[Fit, Array]:
        """Fit of a set together with the model's own effects, and its held-out residual."""
        every = [*self.present, *names]
        found = fit(self.data, self.model, every, start=start)
        return found, held_out(self.data, self.model, every, found)

    def step(self) -> Step:
        """Try every candidate; choose the one that takes off the most, or a smaller one that does as well."""
        names = [n for n in self.names if family(n) not in {family(c) for c in self.chosen}]
        found = self.attempts(self.chosen, names, self.fit, self.current, f"step {len(self.chosen) + 1}")
        found.sort(key=lambda c: (bool(c.implausible), -c.score))
        worthy = [c for c in found if c.worthy and not self.overshadowed(c, found)]
        if not worthy:
            return Step(tuple(self.chosen), tuple(found), None, ())
        best = worthy[0]
        alike = [c for c in worthy[1:] if self.as_good(c, best)]
        simplest = min([best, *alike], key=lambda c: (c.size, -c.score))
        rivals = [c for c in [best, *alike] if c is not simplest and comparable(simplest.size, c.size)]
        similar = tuple((c.name, cosine(self.data, self.current, c.residual, simplest.residual)) for c in rivals)
        order = [simplest, *(c for c in found if c is not simplest)]
        return Step(tuple(self.chosen), tuple(order), simplest.name, similar)

    def overshadowed(self, candidate: Candidate, others: Sequence[Candidate]) -> bool:
        """Whether a simple effect too small for a name explains the same, and clearly better: then neither is named."""
        small = [c for c in others if c.beyond_chance and not c.material and not c.implausible]
        return any(
            contrast(self.data, candidate.residual, c.residual).t > INDISTINCT
            and cosine(self.data, self.current, c.residual, candidate.residual) > OVERSHADOWS
            for c in small
            if c.size <= candidate.size
        )

    def as_good(self, candidate: Candidate, best: Candidate) -> bool:
        """Whether blocks do not tell the two apart; what is still unexplained is no excuse yet."""
        even = contrast(self.data, candidate.residual, best.residual).t < INDISTINCT
        return even and cosine(self.data, self.current, candidate.residual, best.residual) > LIKE

    def attempts(
        self, others: Sequence[str], names: Sequence[str], base: Fit, residual: Array, words: str
    ) -> list[Candidate]:
        """Candidates with these names, without those whose fit leaves what is physically possible."""
        names = [n for n in names if n in that_act([n], (*self.present, *others))]

        def attempt(name: str) -> Candidate | str:
            try:
                found = self.candidate(others, name, base, residual)
            except (ModelError, np.linalg.LinAlgError) as error:  # an inertia that no body has, say
                return str(error).removeprefix(f"effect {name}: ")
            return replace(found, fit=replace(found.fit, effects=()))  # which may not survive pickling

        out: list[Candidate] = []
        for k, (name, found) in enumerate(
            zip(names, each(attempt, names, self.jobs, (self.data, self.model)), strict=True)
        ):
            self.tell(f"{words}: {name}", k, len(names))
            if isinstance(found, str):
                self.failed[name] = found
            else:
                out.append(replace(found, fit=self.with_effects(found.fit, [*self.present, *others, *found.names])))
        return out

    def with_effects(self, fitted: Fit, names: Sequence[str]) -> Fit:
        """The fit of these names with its effects, made anew from its values."""
        effects, at = [], 0
        for name in names:
            size = len(find(name).parameters(self.model.vehicle))
            part = slice(at, at + size)
            effects.append(ModelEffect(find(name), fitted.theta[part], fitted.std[part]))
            at += size
        return replace(fitted, effects=tuple(effects))

    def candidate(self, others: Sequence[str], name: str, base: Fit, residual: Array) -> Candidate:
        """`name` on top of `others`; with a companion where that is better by the rule for any further effect."""
        best = self.candidate_set(others, (name,), base, residual)
        for other in companions(name, (*self.present, *others), self.names):
            both = self.candidate_set(others, (name, other), base, residual)
            gained = contrast(self.data, best.residual, both.residual).t, evidence(best.residual, both.residual)
            if beyond_chance(*gained) and material(both.fit, other) and not both.implausible:
                best = both
        return best

    def candidate_set(self, others: Sequence[str], added: Sequence[str], base: Fit, residual: Array) -> Candidate:
        """Fit `added` together with `others` (whose fit and held-out residual are given); what they leave."""
        names = [*self.present, *others, *added]
        found = fit(self.data, self.model, names, base=base)
        left = held_out(self.data, self.model, names, found, exact=False)
        weights = self.data.weights
        before, after = rms(residual), rms(left)
        return Candidate(
            added[0],
            replace(found, jacobian=np.empty((0, 6, 0))),
            left,
            reduction(before, after),
            1.0 - energy(left, weights) / max(energy(self.given, weights), 1e-30),
            evidence(residual, left),
            contrast(self.data, residual, left).t,
            tuple(b for b in found.at_bound if b.split(".")[0] in added),
            tuple(added[1:]),
        )

    def rival(self, candidate: Candidate, best: Array, without: Array) -> Rival:
        """A candidate against what leaves `best`; both on top of what leaves `without`."""
        compared: Contrast = contrast(self.data, candidate.residual, best)
        alike = cosine(self.data, without, candidate.residual, best)
        return Rival(candidate.name, compared.separation, alike, candidate)

    # ------------------------------------------------------------ afterwards

    def refine(self, rounds: int = 8) -> tuple[Member, ...]:
        """Put every member to the test until none is dropped or replaced; the members, largest first."""
        for _ in range(rounds):
            if self.merge():
                continue
            members: list[Member] = []
            for k, name in enumerate(list(self.chosen)):
                self.tell(f"testing {name}", k, len(self.chosen))
                member = self.test(name)
                if member is None:
                    break
                members.append(member)
            else:
                return tuple(sorted(members, key=lambda m: -m.share))
        needed = [m for m in map(self.examine, list(self.chosen)) if m is not None]
        if len(needed) < len(self.chosen):
            self.take(that_act((m.name for m in needed), self.present), self.fit)
            needed = [m for m in needed if m.name in self.chosen]
        return tuple(sorted(needed, key=lambda m: -m.share))

    def merge(self) -> bool:
        """Replace members by the one effect that stands for them together, where that does as well."""
        for name in self.names:
            parts = [p for p in find(name).parts if p in self.chosen]
            if len(parts) < 2 or name in self.chosen:
                continue
            rest = [n for n in self.chosen if n not in parts]
            base, without = self.fitted(rest, self.fit)
            attempted = self.attempts(rest, [name], base, without, "together")
            if not attempted:
                continue
            whole = attempted[0]
            if whole.worthy and self.rival(whole, self.current, without).separation < INDISTINCT:
                self.take([*rest, name], whole.fit)
                return True
        return False

    def test(self, name: str) -> Member | None:
        """The member, or None where the set was changed: dropped, or another effect in its place."""
        member = self.examine(name)
        if member is None:
            self.take(self.without(name), self.fit)
            return None
        size = self.size(name)
        if any(r.overshadows and r.candidate.size <= size for r in member.rivals):
            self.take(self.without(name), self.fit)
            return None
        better = [r for r in member.rivals if r.candidate.worthy and self.preferred(r, size)]
        if better:
            winner = min(better, key=lambda r: (r.candidate.size, r.separation))
            kept = {n: [n] for n in self.without(name)} | {name: list(winner.candidate.names)}
            self.take([one for n in self.chosen for one in kept.get(n, ())], winner.candidate.fit)
            return None
        return member

    def without(self, name: str) -> list[str]:
        """The set without this member, and without what cannot act without it."""
        return that_act((n for n in self.chosen if n != name), self.present)

    def size(self, name: str) -> int:
        """Number of parameters that go with this member."""
        gone = set(self.chosen) - set(self.without(name))
        return sum(len(find(n).parameters(self.model.vehicle)) for n in gone)

    def preferred(self, rival: Rival, size: int) -> bool:
        """Whether the rival belongs in the member's place: better, or as good with fewer parameters."""
        if rival.candidate.size < size:
            return rival.separation < INDISTINCT
        return rival.separation < -INDISTINCT if rival.candidate.size > size else rival.separation < -1.0

    def examine(self, name: str) -> Member | None:
        """What the set is without this member, and what else might stand there; None if not needed or implausible."""
        rest = self.without(name)
        base, without = self.fitted(rest, self.fit)
        needed = contrast(self.data, without, self.current).t
        gained = evidence(without, self.current)
        weights = self.data.weights
        lost = energy(without, weights) - energy(self.current, weights)
        share = lost / max(energy(self.given, weights), 1e-30)
        stuck = any(b.startswith(f"{name}.") for b in self.fit.at_bound) and share < MAJOR
        if stuck or not beyond_chance(needed, gained) or not material(self.fit, name):
            return None
        tried = self.attempts(rest, self.rivals_of(name), base, without, f"in place of {name}")
        size = self.size(name)
        rivals = [self.rival(c, self.current, without) for c in tried if comparable(size, c.size)]
        return Member(name, share, needed, gained, tuple(sorted(rivals, key=lambda r: r.separation)))

    def rivals_of(self, name: str) -> list[str]:
        """Effects outside the set that did a good part of what this one did, or are known to look like it.

        The one that did most comes first, known or not: a table's best candidate must be tried in a member's place.
        """
        known = {n for n in self.names if name in find(n).confused_with} | set(find(name).confused_with)
        others = {family(n) for n in self.chosen if n != name}
        close: dict[str, float] = {}
        for step in self.steps:
            own = next((c for c in step.candidates if name in c.names), None)
            if own is None:
                continue
            for c in step.candidates:
                if known & set(c.names) or (own.evidence > 0 and c.evidence > RIVAL * own.evidence):
                    for n in c.names:
                        close[n] = max(close.get(n, -np.inf), c.evidence / max(own.evidence, 1e-9))
        free = [n for n in close if n != name and family(n) not in others and n in self.names]
        most = max((close[n] for n in free), default=0.0)
        return sorted(free, key=lambda n: (close[n] < most, n not in known, -close[n]))[:MOST_RIVALS]

    def tell(self, words: str, k: int, count: int) -> None:
        """Progress."""
        if self.progress is not None:
            self.progress(min(1.0, k / max(count, 1)), words)
