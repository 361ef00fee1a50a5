"""Sets that are worth a look, each with all that is said of it, and their weights.

Weights are pseudo-BMA with the Bayesian bootstrap over blocks of time: how often each set would win on flights like
these. Source: Yao, Vehtari, Simpson and Gelman, Bayesian Analysis 13, 2018, sec. 3.4.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from wrenchgap.flight.flight import Array
from wrenchgap.learn.data.blocks import SIGNIFICANCE
from wrenchgap.learn.identify.fit import MATERIAL
from wrenchgap.learn.posterior.columns import Column
from wrenchgap.learn.posterior.linear_problem import quadratic
from wrenchgap.learn.posterior.score import Keys, Scored, Scorer
from wrenchgap.learn.posterior.settings import SearchSettings
from wrenchgap.learn.posterior.spectrum import Spectrum


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
    stuck = at_limit(theta, column.low, column.high)
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
    it does not need is taken out, with their shares of it: of two effects that do the same, one or the other. `bends`
    (L,) are by how much more the set leaves without a member than straight lines have it, factors by axis.
    """  # noqa: D205

    scored: Scored
    parts: tuple[Part, ...]
    by_block: Array
    predicted: Array
    left: Array
    leaves: tuple[tuple[ScoredSet, float], ...] = ()
    bends: Mapping[str, Array] = field(default_factory=dict)

    @property
    def keys(self) -> Keys:
        """Its candidates."""
        return self.scored.keys

    @property
    def names(self) -> tuple[str, ...]:
        """Effects of those that are named, that with the most evidence first."""
        parts = sorted((p for p in self.parts if p.named), key=lambda p: -p.evidence)
        return tuple(n for p in parts for n in p.names)


def scored_set(
    scorer: Scorer,
    keys: Keys,
    rests: Mapping[Keys, Array] | None = None,
    bends: Mapping[str, Array] | None = None,
) -> ScoredSet:
    """All that is said of a set, and of what remains of it. `rests` are mean squares (L,) by axis that sets without one
    of its members leave, where they are known better than by the straight lines of the whole set; `bends` those of
    other sets, for members of which no rest is known.
    """  # noqa: D205
    known = dict(bends or {})
    for key in keys:
        rest = tuple(k for k in sorted(keys) if k != key)
        if rests and rest in rests:
            known[key] = rests[rest] / by_axis(scorer, scorer(rest).left)

    def describe(some: Keys) -> ScoredSet:
        return described(scorer, some, parts_of(scorer, scorer(some), known))

    leaves = tuple((describe(leaf), share) for leaf, share in without_idle(scorer, keys, known).items())
    return replace(describe(keys), leaves=leaves, bends=known)


def described(scorer: Scorer, keys: Keys, parts: tuple[Part, ...]) -> ScoredSet:
    """A set, whatever remains of it, with what is said of its members."""
    scored = scorer(keys)
    left = by_axis(scorer, scored.left)
    return ScoredSet(scored, parts, scorer.by_block(scored), adds(scorer.spectrum, scored), left)


def without_idle(scorer: Scorer, keys: Keys, bends: Mapping[str, Array], many: int = 12) -> dict[Keys, float]:
    """What remains of a set when all that it does not need is taken out, with shares of it (`ScoredSet.leaves`).
    `bends` are those of a scored set; once `many` sets were seen, the likeliest way is followed alone.
    """  # noqa: D205

    def idle(some: Keys) -> list[Keys]:
        """Without each member that hardly shows, the likeliest first."""
        left = by_axis(scorer, scorer(some).left)
        rests = {gone: tuple(k for k in some if k != gone) for gone in some}
        least = SIGNIFICANCE.least_evidence
        found = [r for g, r in rests.items() if _evidence(left, _without(scorer, r, g, bends)) <= least]
        return sorted(found, key=lambda rest: -scorer(rest).log_probability)

    leaves = pruned(scorer(keys).keys, idle, many)
    return dict(zip(leaves, shares(scorer, leaves), strict=True))


def pruned(keys: Keys, idle: Callable[[Keys], list[Keys]], many: float) -> list[Keys]:
    """The sets that remain of one when what `idle` takes out of each, one member after the other, is gone; where
    `many` were seen, along the first way only.
    """  # noqa: D205
    seen: set[Keys] = set()
    leaves: dict[Keys, None] = {}

    def follow(some: Keys) -> bool:
        """Whether a set was reached in which nothing is idle."""
        if some in seen:
            return False
        seen.add(some)
        rests = idle(some)
        if not rests:
            leaves[some] = None
            return True
        reached = False
        for rest in rests:
            if not reached or len(seen) < many:
                reached = follow(rest) or reached
        return reached

    follow(keys)
    return list(leaves)


def shares(scorer: Scorer, sets: Sequence[Keys]) -> list[float]:
    """Of these sets, by their probabilities."""
    log = np.array([scorer(keys).log_probability for keys in sets])
    share = np.exp(log - log.max())
    return [float(x) for x in share / share.sum()]


def _without(scorer: Scorer, rest: Keys, gone: str, bends: Mapping[str, Array]) -> Array:
    """Mean squares (L,) by axis that remain without a member."""
    return np.asarray(by_axis(scorer, scorer(rest).left) * bends.get(gone, 1.0))


def _evidence(left: Array, without: Array) -> float:
    """Sum over axes of the log of how much the rms grows, from mean squares."""
    return 0.5 * float(np.sum(np.log(without) - np.log(left)))


def adds(space: Spectrum, scored: Scored) -> Array:
    """Coefficients (K, L) of what the candidates of a set add to the prediction."""
    used = [k for key in scored.keys for k in (*space.parameters[key], space.offset[key])]
    weights = np.zeros(len(scored.weights))
    weights[used] = -scored.weights[used]
    return space.combined(weights)


def parts_of(scorer: Scorer, scored: Scored, bends: Mapping[str, Array]) -> tuple[Part, ...]:
    """What is said of each candidate of a set; `bends` are those of a scored set."""
    space, settings = scorer.spectrum, scorer.spectrum.settings
    sensor = by_axis(scorer, space.sensor)
    left = by_axis(scorer, scored.left)
    parts = []
    sizes = {k: _size(scorer, scored, k) for k in scored.keys}
    for key in scored.keys:
        c, theta = space.columns[key], scored.theta[key]
        without = _without(scorer, tuple(k for k in scored.keys if k != key), key, bends)
        returns = np.maximum(without / left - 1.0, 0.0)
        above = np.maximum(1.0 - settings.structure**2 * sensor / left, 0.0) * returns / (returns + 1.0)
        rough = [k for k in scored.keys if k != key and space.columns[k].accuracy > settings.rough]
        law = sum((settings.off * space.columns[k].accuracy) ** 2 * sizes[k] for k in rough)
        own = returns * sizes[key] / np.maximum(sizes[key] + law, 1e-30)
        trust = float(own.sum() / max(float(np.sum(returns + above)), 1e-30))
        parts.append(part(c, theta, _evidence(left, without), trust, settings))
    return tuple(parts)


def _size(scorer: Scorer, scored: Scored, key: str) -> Array:
    """Mean squares (L,) by axis of what a member adds."""
    space = scorer.spectrum
    rows = np.append(space.parameters[key], space.offset[key])
    return by_axis(scorer, quadratic(space.products[:, :, rows[:, None], rows], scored.weights[rows]))


def at_limit(theta: Array, low: Array, high: Array) -> bool:
    """Whether a parameter is at a plausible limit other than zero, or within half a per cent of the range of it."""
    margin = 5e-3 * (high - low)
    return bool(np.any(((theta - low < margin) & (low != 0.0)) | ((high - theta < margin) & (high != 0.0))))


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
