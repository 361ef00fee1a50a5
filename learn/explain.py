"""Which physical effect is missing: candidates of the catalogue, ranked by the error they leave on held-out blocks.

Forward selection. At every step each remaining effect is fitted *together with* those already chosen (and those of
the model), and the residual of blocks of time that its fit did not see is compared, block by block, with what the
present model leaves there. An effect is taken if that improves beyond chance; among those, the one that takes off the
most error. A backward pass then drops whatever no longer helps.

Two measures, both on held-out blocks:

    energy    sum_l (w_l r_l)^2, newtons and newton metres on one scale (w of `learn.fit.Dataset`): what a user sees;
              orders the candidates. score = 1 - energy left / energy of the model as given
    evidence  sum_l log(rms_l before / rms_l after): scale-free, so that a small axis counts too; decides whether an
              effect is there at all, with a paired test over blocks (blocks, because filtered samples are not
              independent; docs/decisions/0006-blocks.md)

Effects whose held-out residuals do not differ beyond chance from the chosen one's, and which change the prediction in
the same direction, form a group with it: this log cannot tell them apart.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from learn.fit import Dataset, Fit, dataset, fit, held_out, inapplicable, spread_out, unexcited, with_fit
from plant.effects import catalogue
from plant.model import Model

Array = NDArray[np.float64]
Verdict = Literal["effect", "group", "unknown", "nothing"]
Progress = Callable[[str, int, int], None]

SIGNIFICANT = 3.0
"""Paired t over blocks beyond which an improvement is not chance."""
PLAIN = (0.5, 2.0)
"""Evidence beyond which a smaller paired t is enough. An effect that acts in few blocks only (near the ground, at
speed) makes blocks differ and so its own t small; chance does not take 40 % off an axis in blocks not fitted."""
INDISTINCT = 2.5
"""Paired t over blocks below which two explanations cannot be told apart."""
LEAST_EVIDENCE = 0.2
"""Smallest evidence (sum of log rms ratios over the axes) worth a name: e.g. 7 % of the rms of three axes."""
LIKE = 0.8
"""Least cosine between the changes that two explanations make to the prediction for them to be called alike."""
SEARCH_SECONDS = 200.0
"""Most flight time that candidates are tried on [s]; of longer logs, pieces spread over all of it. What is chosen is
then fitted to everything."""
MATERIAL = 0.2
"""Smallest parameter worth a name, in typical sizes (`Parameter.scale`): e.g. 1 % of thrust, 6 ms of lag."""


def _beyond_chance(significance: float, evidence: float) -> bool:
    """Whether an improvement with this paired t and this evidence is none of luck's."""
    certain = significance > SIGNIFICANT and evidence > LEAST_EVIDENCE
    return certain or (evidence > PLAIN[0] and significance > PLAIN[1])


def _evidence(worse: Array, better: Array) -> float:
    """Sum over axes of log rms ratios of two residuals (K, 6)."""
    before, after = (np.maximum(np.sqrt(np.mean(r**2, axis=0)), 1e-30) for r in (worse, better))
    return float(np.sum(np.log(before / after)))


@dataclass(frozen=True)
class Candidate:
    """One effect tried on top of a model. `residual` (K, 6) is held out; `falls` (6,) are fractions of rms taken off
    relative to the model that it was tried on; `score` is the share of the given model's energy that is gone in all.
    """  # noqa: D205

    name: str
    fit: Fit
    residual: Array
    falls: Array
    score: float
    evidence: float
    significance: float
    implausible: tuple[str, ...]

    @property
    def size(self) -> int:
        """Number of parameters of this effect."""
        return sum(name == self.name for name, _ in self.fit.parameters)

    @property
    def material(self) -> bool:
        """Whether the effect is large enough to be worth a name."""
        rows = zip(self.fit.parameters, self.fit.theta, strict=True)
        return any(abs(v) >= MATERIAL * p.scale for (name, p), v in rows if name == self.name)

    @property
    def beyond_chance(self) -> bool:
        """Whether held-out blocks are predicted better than luck would have it."""
        return _beyond_chance(self.significance, self.evidence)

    def values(self) -> list[tuple[str, float, float, str]]:
        """(parameter, value, standard deviation, unit) of this effect."""
        rows = zip(self.fit.parameters, self.fit.theta, self.fit.std, strict=True)
        return [(p.name, float(v), float(s), p.unit) for (name, p), v, s in rows if name == self.name]


@dataclass(frozen=True)
class Step:
    """One step of the forward selection: all candidates, best first; the one chosen, and those like it."""

    candidates: tuple[Candidate, ...]
    chosen: str | None
    alike: tuple[tuple[str, float], ...]  # (name, cosine of the predicted changes)


@dataclass(frozen=True)
class Explanation:
    """What is missing, according to the logs. `rms_*` are (6,) held-out; `noise` (6,) is the sensor noise."""

    verdict: Verdict
    effects: tuple[str, ...]
    groups: tuple[tuple[str, ...], ...]
    steps: tuple[Step, ...]
    fit: Fit
    model: Model
    rms_before: Array
    rms_after: Array
    noise: Array
    inapplicable: dict[str, str]
    dropped: tuple[str, ...]

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
    progress: Progress | None = None,
) -> Explanation:
    """Find the missing effects, at most `most` of them, among `names` (default: the catalogue)."""
    present = [e.name for e in model.effects]
    tried = [n for n in (names or catalogue()) if n not in present]
    reasons = {
        n: r
        for n in tried
        if (r := inapplicable(n, model, data.records) or unexcited(n, model, data.records)) is not None
    }
    tried = [n for n in tried if n not in reasons]
    some = spread_out(data.records, SEARCH_SECONDS)
    search = _Search(data if some is data.records else dataset(some, model), model, present, progress)
    steps: list[Step] = []
    chosen: list[str] = []
    while len(chosen) < most:
        step = search.step(chosen, [n for n in tried if n not in chosen])
        steps.append(step)
        if step.chosen is None:
            break
        chosen.append(step.chosen)
        search.accept(chosen, next(c for c in step.candidates if c.name == step.chosen))
    dropped = search.prune(chosen)
    chosen = [n for n in chosen if n not in dropped]
    groups = tuple(
        (s.chosen, *(name for name, _ in s.alike)) for s in steps if s.chosen in chosen and s.alike and s.chosen
    )
    if search.data is not data:
        whole = _Search(data, model, present, progress)
        whole.refit(chosen, search.fit)
        search = whole
    before = np.sqrt(np.mean(search.given**2, axis=0))
    after = np.sqrt(np.mean(search.current**2, axis=0))
    return Explanation(
        _verdict(chosen, groups, before, after, data),
        tuple(chosen),
        groups,
        tuple(steps),
        search.fit,
        with_fit(model, search.fit),
        before,
        after,
        data.noise,
        reasons,
        tuple(dropped),
    )


def _verdict(
    chosen: Sequence[str], groups: Sequence[Sequence[str]], before: Array, after: Array, data: Dataset
) -> Verdict:
    """Structure is left where all axes together, or one alone, stay far above noise and half of what they were."""
    energy_before, energy_after = (float(np.sum((data.weights * rms) ** 2)) for rms in (before, after))
    floor = float(np.sum((data.weights * data.noise) ** 2))
    together = energy_after > 4.0 * floor and energy_after > 0.5 * energy_before
    alone = (after > 5.0 * data.noise) & (after > 0.5 * before)
    if together or alone.any():
        return "unknown"
    if not chosen:
        return "nothing"
    return "group" if any(chosen[0] in g for g in groups) else "effect"


class _Search:
    """State of the selection: the present model's held-out residual and fit."""

    def __init__(self, data: Dataset, model: Model, present: list[str], progress: Progress | None) -> None:
        self.data = data
        self.model = model
        self.present = present
        self.progress = progress
        self.fit = fit(data, model, present)
        self.given: Array = held_out(data, model, present, self.fit)
        self.current = self.given
        self.counts = np.bincount(data.block)

    def accept(self, names: Sequence[str], candidate: Candidate) -> None:
        """Take a candidate into the model, with all parameters fitted anew."""
        self.refit(names, candidate.fit)

    def refit(self, names: Sequence[str], start: Fit) -> None:
        """All parameters of the model and of these effects fitted anew, from where another fit ended."""
        self.fit = fit(self.data, self.model, [*self.present, *names], start=start)
        self.current = held_out(self.data, self.model, [*self.present, *names], self.fit)

    def blocks(self, residual: Array, variance: Array) -> Array:
        """Mean over each block of sum_l r_l^2 / variance_l, (B,)."""
        loss = np.sum(residual**2 / variance, axis=1)
        return np.asarray(np.bincount(self.data.block, weights=loss) / self.counts)

    def t_value(self, worse: Array, better: Array) -> float:
        """Paired t over blocks for `worse` having the larger residual (K, 6)."""
        variance = np.sqrt(np.mean(worse**2, axis=0) * np.mean(better**2, axis=0)) + 1e-30
        difference = self.blocks(worse, variance) - self.blocks(better, variance)
        if len(difference) < 3:
            return 0.0
        spread = float(np.std(difference, ddof=1) / np.sqrt(len(difference)))
        return float(np.mean(difference)) / max(spread, 1e-30)

    def energy(self, residual: Array) -> float:
        weighted = residual * self.data.weights
        return float(np.vdot(weighted, weighted))

    def candidate(self, chosen: Sequence[str], name: str) -> Candidate:
        """Fit `name` together with what is there, and see what it leaves on held-out blocks."""
        names = [*self.present, *chosen, name]
        fitted = fit(self.data, self.model, names, base=self.fit)
        residual = held_out(self.data, self.model, names, fitted)
        rms_old, rms_new = (np.sqrt(np.mean(r**2, axis=0)) for r in (self.current, residual))
        bound = tuple(b for b in fitted.at_bound if b.startswith(f"{name}."))
        return Candidate(
            name,
            fitted,
            residual,
            1.0 - rms_new / np.maximum(rms_old, 1e-30),
            1.0 - self.energy(residual) / max(self.energy(self.given), 1e-30),
            _evidence(self.current, residual),
            self.t_value(self.current, residual),
            bound,
        )

    def step(self, chosen: Sequence[str], names: Sequence[str]) -> Step:
        """Try every candidate; choose the one that takes off the most, or a smaller one that does as well."""
        found: list[Candidate] = []
        for k, name in enumerate(names):
            if self.progress is not None:
                self.progress(f"step {len(chosen) + 1}: {name}", k, len(names))
            found.append(self.candidate(chosen, name))
        found.sort(key=lambda c: (bool(c.implausible), -c.score))
        worthy = [c for c in found if not c.implausible and c.material and c.beyond_chance]
        if not worthy:
            return Step(tuple(found), None, ())
        best = worthy[0]
        alike = [
            c
            for c in worthy[1:]
            if self.t_value(c.residual, best.residual) < INDISTINCT and self.cosine(c.residual, best.residual) > LIKE
        ]
        simplest = min([best, *alike], key=lambda c: (c.size, -c.score))
        rivals = [c for c in [best, *alike] if c is not simplest and c.size <= simplest.size + 2]
        similar = tuple((c.name, self.cosine(c.residual, simplest.residual)) for c in rivals)
        order = [simplest, *(c for c in found if c is not simplest)]
        return Step(tuple(order), simplest.name, similar)

    def cosine(self, first: Array, second: Array) -> float:
        """Cosine between the changes that two candidates make to the present prediction."""
        a = ((self.current - first) * self.data.weights).ravel()
        b = ((self.current - second) * self.data.weights).ravel()
        return float(a @ b / max(float(np.linalg.norm(a) * np.linalg.norm(b)), 1e-30))

    def prune(self, chosen: Sequence[str]) -> list[str]:
        """Drop effects, one by one, without which held-out blocks are predicted no worse."""
        dropped: list[str] = []
        for name in list(chosen)[:-1]:
            rest = [n for n in chosen if n != name and n not in dropped]
            names = [*self.present, *rest]
            fitted = fit(self.data, self.model, names, start=self.fit)
            residual = held_out(self.data, self.model, names, fitted)
            if not _beyond_chance(self.t_value(residual, self.current), _evidence(residual, self.current)):
                dropped.append(name)
                self.fit, self.current = fitted, residual
        return dropped
