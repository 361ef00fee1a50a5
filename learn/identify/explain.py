"""Which physical effect is missing: candidates of the catalogue, ranked by the error they leave on held-out blocks.

`learn.identify.search` finds the set of effects; this module says what that means. Two measures, both on held-out blocks:

    energy    sum_l (w_l r_l)^2, newtons and newton metres on one scale (w of `learn.identify.fit.Dataset`): what a user sees;
              orders the candidates. score = 1 - energy left / energy of the model as given
    evidence  sum_l log(rms_l before / rms_l after): scale-free, so that a small axis counts too; decides whether an
              effect is there at all, with a paired test over blocks (blocks, because filtered samples are not
              independent; docs/decisions/0006-blocks.md)

The verdict is "effect" where the set explains the residual and nothing else would do in the place of its largest
member, "group" where something else would, "unknown" where structure is left, "nothing" where there is none.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from wrenchgap.learn.diagnose.relevance import Relevance, relevance
from wrenchgap.learn.diagnose.resonance import Swing, swing
from wrenchgap.learn.identify.confidence import probability
from wrenchgap.learn.identify.fit import Dataset, Fit, dataset, inapplicable, spread_out, unexcited, with_fit
from wrenchgap.learn.identify.search import (
    INDISTINCT,
    MATERIAL,
    SIGNIFICANT,
    Candidate,
    Member,
    Progress,
    Search,
    Step,
)
from wrenchgap.plant.effects import catalogue
from wrenchgap.plant.model import Model

__all__ = [
    "INDISTINCT",
    "MATERIAL",
    "SIGNIFICANT",
    "Candidate",
    "Explanation",
    "Member",
    "Step",
    "Verdict",
    "explain",
]

Array = NDArray[np.float64]
Verdict = Literal["effect", "group", "unknown", "nothing"]

SEARCH_SECONDS = 200.0
"""Most flight time that candidates are tried on [s]; of longer logs, pieces spread over all of it. What is chosen is
then fitted to everything."""

LOUD, UNEXPLAINED = 2.5, 0.25
"""Structure is left where the rms of force or torque stays above this many times the noise and this share of what it
was."""
QUIET = 1.5
"""Rms over the noise below which nothing is looked for in what is left."""
UNUSUAL = 0.1
"""Share of the time, the worst, that a verdict disregards."""
FEWEST = 5
"""Blocks of time below which nothing is said about what the rest depends on."""


@dataclass(frozen=True)
class Explanation:
    """What is missing, according to the logs. `rms_*` are (6,) held-out; `noise` (6,) is the sensor noise.

    `effects` are the members' names, that with the largest share of the error first; `steps` the trace of the forward
    search. `swing` is an oscillation found in what is left; `depends` says on what that depends, where the verdict is
    "unknown"; `concentrated` is the share of what is left that sits in the worst tenth of the time; `left` is the rms
    that is left over that of the noise, the worse of force and torque.
    """

    verdict: Verdict
    members: tuple[Member, ...]
    steps: tuple[Step, ...]
    fit: Fit
    model: Model
    rms_before: Array
    rms_after: Array
    noise: Array
    inapplicable: dict[str, str]
    dropped: tuple[str, ...]
    swing: Swing | None
    depends: Relevance | None
    concentrated: float
    left: float

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the members."""
        return tuple(m.name for m in self.members)

    def probability(self, member: Member) -> float:
        """How often a name with this much behind it is right (`learn.identify.confidence`)."""
        return probability(member, self.left, self.verdict == "unknown")

    @property
    def groups(self) -> tuple[tuple[str, ...], ...]:
        """For each member that has one: its name, and what these logs cannot tell from it."""
        return tuple((m.name, *(r.name for r in m.alike)) for m in self.members if m.alike)

    @property
    def full(self) -> bool:
        """Whether the search took as many effects as it may, and more might be there."""
        return bool(self.steps) and self.steps[-1].chosen is not None

    @property
    def ranking(self) -> tuple[Candidate, ...]:
        """All candidates of the first step, best first."""
        return self.steps[0].candidates if self.steps else ()


def explain(
    data: Dataset,
    model: Model,
    *,
    names: Sequence[str] | None = None,
    most: int = 4,
    barred: Mapping[str, str] | None = None,
    jobs: int = 1,
    progress: Progress | None = None,
) -> Explanation:
    """Find the missing effects, at most `most` of them, among `names` (default: the catalogue), by `jobs` processes.

    `barred` are effects not to be tried, by name, with the reason.
    """
    present = [e.name for e in model.effects]
    tried = [n for n in (names or catalogue()) if n not in present]
    reasons = {n: r for n, r in (barred or {}).items() if n in tried}
    reasons |= {
        n: r
        for n in tried
        if n not in reasons
        and (r := inapplicable(n, model, data.records) or unexcited(n, model, data.records)) is not None
    }
    tried = [n for n in tried if n not in reasons]
    some = spread_out(data.records, SEARCH_SECONDS)
    part = data if some is data.records else dataset(some, model)
    search = Search(part, model, tried, progress, jobs)
    members = search.run(most)
    whole = search if part is data else Search(data, model, tried, progress)
    if whole is not search:
        whole.take([m.name for m in members], search.fit)
    before = np.sqrt(np.mean(whole.given**2, axis=0))
    after = np.sqrt(np.mean(whole.current**2, axis=0))
    named = {m.name for m in members}
    left = part, search.current
    swinging = swing(*left) if _left_over(*left) > QUIET else None
    verdict = _verdict(members, part, search.given, search.current, swinging)
    return Explanation(
        verdict,
        members,
        tuple(search.steps),
        whole.fit,
        with_fit(model, whole.fit),
        before,
        after,
        data.noise,
        {**reasons, **search.failed},
        tuple(dict.fromkeys(s.chosen for s in search.steps if s.chosen and s.chosen not in named)),
        swinging,
        relevance(*left) if verdict == "unknown" and len(np.unique(part.block)) >= FEWEST else None,
        _concentrated(*left),
        _left_over(*left),
    )


def _concentrated(data: Dataset, residual: Array) -> float:
    """Share of the energy that sits in the worst tenth of the time."""
    loud = np.sum((residual * data.weights) ** 2, axis=1)
    return float(1.0 - np.sum(loud[_usual(data, residual)]) / max(float(np.sum(loud)), 1e-30))


def _usual(data: Dataset, residual: Array) -> NDArray[np.bool_]:
    """Samples (K,) outside the tenth of the blocks with the largest residual: one gust or touch is no verdict."""
    loud = np.bincount(data.block, weights=np.sum((residual * data.weights) ** 2, axis=1)) / np.bincount(data.block)
    return np.asarray(loud[data.block] <= np.quantile(loud, 1.0 - UNUSUAL, method="lower"))


def _norms(data: Dataset, residual: Array) -> Array:
    """Root mean square norm of force and torque, (2,)."""
    squares = np.mean(residual**2, axis=0)
    return np.asarray(np.sqrt([squares[:3].sum(), squares[3:].sum()]))


def _left_over(data: Dataset, residual: Array) -> float:
    """What is left over the noise, the worse of force and torque."""
    noise = np.sqrt(np.array([np.sum(data.noise[:3] ** 2), np.sum(data.noise[3:] ** 2)]))
    return float(np.max(_norms(data, residual) / noise))


def _verdict(members: Sequence[Member], data: Dataset, given: Array, current: Array, swinging: Swing | None) -> Verdict:
    """Unknown where force or torque stay well above the noise and above a quarter of what they were, or swing."""
    usual = _usual(data, current)
    before, after = _norms(data, given[usual]), _norms(data, current[usual])
    noise = np.sqrt(np.array([np.sum(data.noise[:3] ** 2), np.sum(data.noise[3:] ** 2)]))
    if swinging is not None or np.any((after > LOUD * noise) & (after > UNEXPLAINED * before)):
        return "unknown"
    if not members:
        return "nothing"
    return "group" if members[0].alike else "effect"
