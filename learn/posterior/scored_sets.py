"""Sets that are worth a look, each with all that is said of it, and their weights.

Weights are pseudo-BMA with the Bayesian bootstrap over blocks of time: how often each set would win on flights like
these. Source: Yao, Vehtari, Simpson and Gelman, Bayesian Analysis 13, 2018, sec. 3.4.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from wrenchgap.flight.flight import Array
from wrenchgap.learn.data.blocks import SIGNIFICANCE
from wrenchgap.learn.identify.fit import MATERIAL
from wrenchgap.learn.identify.least_squares import at_limit
from wrenchgap.learn.posterior.columns import Column
from wrenchgap.learn.posterior.linear_problem import quadratic
from wrenchgap.learn.posterior.score import Keys, Scored, Scorer
from wrenchgap.learn.posterior.settings import SearchSettings


@dataclass(frozen=True)
class Part:
    """One candidate of a set: `names` of its effects, `size` of its largest parameter in typical sizes.

    `stuck` says that one is at a limit of what is plausible. `evidence` is the sum over axes of the log of how much the
    rms grows without it; `trust` the share of that which what neither the set leaves unexplained (above the sensors'
    noise) nor the rough laws of its other members could have made as well. `named` says whether it is large enough for
    a name, matters enough, and is likelier there than a fluke of the rest.
    """

    names: tuple[str, ...]
    theta: Array
    size: float
    stuck: bool
    evidence: float
    trust: float
    named: bool


def part(column: Column, theta: Array, evidence: float, trust: float, settings: SearchSettings) -> Part:
    """What is said of a candidate at these parameters (P,), with this evidence and trust."""
    stuck = bool(at_limit(theta, column.low, column.high).any())
    size = float(np.max(np.abs(theta) / column.scale))
    enough, least = SIGNIFICANCE.least_evidence, 0.5
    if stuck:
        trust, enough, least = trust * settings.at_limit, settings.evident, 0.5 * settings.at_limit
    named = size >= MATERIAL and evidence > enough and trust > least
    return Part(column.names, theta, size, stuck, evidence, trust, named)


@dataclass(frozen=True)
class ScoredSet:
    """A set as scored. `by_block` (blocks,) is its log likelihood; `predicted` (K, L) the cosine coefficients of what
    it adds to the prediction; `left` (L,) mean squares by axis. `leaves` are the sets that remain of it when all that
    it does not need is taken out, with their shares of it (`without_idle`).
    """  # noqa: D205

    scored: Scored
    parts: tuple[Part, ...]
    by_block: Array
    predicted: Array
    left: Array
    leaves: tuple[tuple[ScoredSet, float], ...] = ()

    @property
    def keys(self) -> Keys:
        """Its candidates."""
        return self.scored.keys

    @property
    def names(self) -> tuple[str, ...]:
        """Effects of those that are named, that with the most evidence first."""
        return names_of(self.parts)


def names_of(parts: Iterable[Part]) -> tuple[str, ...]:
    """Effects of the members that are named, that with the most evidence first."""
    return tuple(n for p in sorted(parts, key=lambda p: -p.evidence) if p.named for n in p.names)


class Rule(NamedTuple):
    """How the members of a set are judged: their `evidence` and `trust` (`Part`) by key, and the `least` evidence
    of one that is not idle. Once `many` sets without idle members were seen, the likeliest way is followed alone.
    """  # noqa: D205

    evidence: Callable[[Scorer, Keys], dict[str, float]]
    trust: Callable[[Scorer, Keys], dict[str, float]]
    least: float
    many: float


def growth(scorer: Scorer, keys: Keys) -> dict[str, float]:
    """Sum over axes of the log of how much the rms grows without each member."""
    left = by_axis(scorer, scorer(keys).left)
    return {k: 0.5 * float(np.sum(np.log(_without(scorer, keys, k)) - np.log(left))) for k in keys}


def own_share(scorer: Scorer, keys: Keys) -> dict[str, float]:
    """Share of each member's growth that neither what the set leaves nor its rough laws could have made."""
    space, scored, settings = scorer.spectrum, scorer(keys), scorer.spectrum.settings
    left = by_axis(scorer, scored.left)
    beyond_noise = np.maximum(1.0 - settings.structure**2 * by_axis(scorer, space.sensor) / left, 0.0)
    sizes = {}
    for key in keys:
        rows = space.rows(key)
        sizes[key] = by_axis(scorer, quadratic(space.products[:, :, rows[:, None], rows], scored.weights[rows]))
    out = {}
    for key in keys:
        returns = np.maximum(_without(scorer, keys, key) / left - 1.0, 0.0)
        above = beyond_noise * returns / (returns + 1.0)
        rough = [k for k in keys if k != key and space.columns[k].accuracy > settings.rough]
        law = sum((settings.off * space.columns[k].accuracy) ** 2 * sizes[k] for k in rough)
        own = returns * sizes[key] / np.maximum(sizes[key] + law, 1e-30)
        out[key] = float(own.sum() / max(float(np.sum(returns + above)), 1e-30))
    return out


GROWTH = Rule(growth, own_share, SIGNIFICANCE.least_evidence, 12)
"""Of sets of effects: by what is left on each axis."""


def _without(scorer: Scorer, keys: Keys, gone: str) -> Array:
    """Mean squares (L,) by axis that remain without a member."""
    rest = scorer(tuple(k for k in keys if k != gone))
    return by_axis(scorer, rest.left)


def scored_set(scorer: Scorer, keys: Keys, rule: Rule = GROWTH) -> ScoredSet:
    """All that is said of a set, and of what remains of it."""
    space = scorer.spectrum

    def described(some: Keys) -> ScoredSet:
        scored = scorer(some)
        used, adds = space.rows(*scored.keys), np.zeros(len(scored.weights))
        adds[used] = -scored.weights[used]
        parts, left = parts_of(scorer, scored.keys, rule), by_axis(scorer, scored.left)
        return ScoredSet(scored, parts, scorer.by_block(scored), space.combined(adds), left)

    leaves = tuple((described(leaf), share) for leaf, share in without_idle(scorer, keys, rule).items())
    return replace(described(keys), leaves=leaves)


def parts_of(scorer: Scorer, keys: Keys, rule: Rule = GROWTH) -> tuple[Part, ...]:
    """What is said of each candidate of a set."""
    scored, space = scorer(keys), scorer.spectrum
    evidence, trust = (judge(scorer, scored.keys) for judge in (rule.evidence, rule.trust))
    return tuple(part(space.columns[k], scored.theta[k], evidence[k], trust[k], space.settings) for k in scored.keys)


def without_idle(scorer: Scorer, keys: Keys, rule: Rule = GROWTH) -> dict[Keys, float]:
    """The sets that remain of one when what is idle, one member after the other, is gone, with their shares of it by
    probability: of two effects that do the same, one or the other (`ScoredSet.leaves`).
    """  # noqa: D205
    seen: set[Keys] = set()
    leaves: list[Keys] = []

    def follow(some: Keys) -> bool:
        """Whether a set was reached in which nothing is idle."""
        if some in seen:
            return False
        seen.add(some)
        idle = [k for k, evidence in rule.evidence(scorer, some).items() if evidence <= rule.least]
        rests = [tuple(k for k in some if k != gone) for gone in idle]
        if not rests:
            leaves.append(some)
            return True
        reached = False
        for rest in sorted(rests, key=lambda rest: -scorer(rest).log_probability):
            if not reached or len(seen) < rule.many:
                reached = follow(rest) or reached
        return reached

    follow(scorer(keys).keys)
    return dict(zip(leaves, shares(scorer, leaves), strict=True))


def shares(scorer: Scorer, sets: Sequence[Keys]) -> list[float]:
    """Of these sets, by their probabilities."""
    return shares_of([scorer(keys).log_probability for keys in sets])


def shares_of(log_probabilities: Sequence[float], root: float = 1.0) -> list[float]:
    """By probabilities whose odds count to the power 1 / `root`."""
    log = np.array(log_probabilities)
    share = np.exp((log - log.max()) / root)
    return [float(x) for x in share / share.sum()]


def by_axis(scorer: Scorer, squares: Array) -> Array:
    """Mean squares (L,) over all coefficients of those by band and axis."""
    count = scorer.spectrum.count
    least = np.finfo(float).tiny
    return np.asarray(np.maximum(np.sum(count * squares, axis=0) / np.sum(count, axis=0), least))


def weights(sets: Sequence[ScoredSet]) -> Array:
    """Weights (S,) of sets by their blocks of time."""
    return bootstrapped(np.array([c.by_block for c in sets]), np.array([c.scored.prior for c in sets]))


def bootstrapped(likelihood: Array, prior: Array, draws: int = 1000, seed: int = 0) -> Array:
    """Weights (S,): Dirichlet weights of the blocks (or flights), the share of every set, and the mean of so many
    draws. `likelihood` (S, B) and `prior` (S,) are logarithms.
    """  # noqa: D205
    blocks = likelihood.shape[1]
    drawn = np.random.default_rng(seed).dirichlet(np.ones(blocks), draws) * blocks
    log = drawn @ likelihood.T + prior
    share = np.exp(log - log.max(axis=1, keepdims=True))
    return np.asarray((share / share.sum(axis=1, keepdims=True)).mean(axis=0))
