"""Sets that are worth a look, each with all that is said of it, and their weights.

Weights are pseudo-BMA with the Bayesian bootstrap over blocks of time: how often each set would win on flights like
these. Source: Yao, Vehtari, Simpson and Gelman, Bayesian Analysis 13, 2018, sec. 3.4.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from wrenchgap.flight.flight import Array
from wrenchgap.learn.data.blocks import LEAST_EVIDENCE
from wrenchgap.learn.identify.fit import MATERIAL
from wrenchgap.learn.posterior.hunt import Hunt
from wrenchgap.learn.posterior.score import Keys, Scored, Scorer, quadratic, saturated
from wrenchgap.learn.posterior.spectrum import Spectrum

TOP = 30
"""Best sets of a hunt that are scored with the spectrum unknown."""
PLAIN = 4
"""Plainest sets that are."""
DRAWS = 1000
SEED = 0
MANY = 12
"""Sets from which on what remains of a set is followed along the likeliest way only."""
IMPLAUSIBLE = 0.6
"""Trust in an effect that others push to the limit of what is plausible: something else is pushing."""
LOUD = 2.5
"""Rms over that of the sensors from which on what a set leaves is structure: something else may be making it, and with
it the difference that one of the members makes."""
ROUGH, FAR_OFF = 0.05, 3.0
"""Accuracy beyond which a law's shape is an assumption: several times its accuracy, it may have made the difference
that another member makes."""
MAJOR = 1.5
"""Evidence from which on an effect that others push to the limit of what is plausible is named all the same."""


@dataclass(frozen=True)
class Part:
    """One candidate of a set: `names` of its effects, `size` of its largest parameter in typical sizes.

    `stuck` says that one is at a limit of what is plausible. `evidence` is the sum over axes of the log of how much the
    rms grows without it; `trust` the share of that which what neither the set leaves unexplained (`LOUD`) nor the
    rough laws of its other members (`ROUGH`) could have made as well.
    """

    names: tuple[str, ...]
    theta: Array
    size: float
    stuck: bool
    evidence: float
    trust: float

    @property
    def named(self) -> bool:
        """Whether it is large enough for a name, matters enough, and is likelier there than a fluke of the rest."""
        enough, least = (MAJOR, 0.5 * IMPLAUSIBLE) if self.stuck else (LEAST_EVIDENCE, 0.5)
        return self.size >= MATERIAL and self.evidence > enough and self.trust > least


@dataclass(frozen=True)
class Contender:
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
    leaves: tuple[tuple[Contender, float], ...] = ()
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


def contender(
    scorer: Scorer,
    keys: Keys,
    rests: Mapping[Keys, Array] | None = None,
    bends: Mapping[str, Array] | None = None,
) -> Contender:
    """All that is said of a set, and of what remains of it. `rests` are mean squares (L,) by axis that sets without one
    of its members leave, where they are known better than by the straight lines of the whole set; `bends` those of
    other sets, for members of which no rest is known.
    """  # noqa: D205
    known = dict(bends or {})
    for key in keys:
        rest = tuple(k for k in sorted(keys) if k != key)
        if rests and rest in rests:
            known[key] = rests[rest] / by_axis(scorer, scorer(rest).left)
    leaves = tuple((_bare(scorer, leaf, known), share) for leaf, share in leaves_of(scorer, keys, known).items())
    return replace(_bare(scorer, keys, known), leaves=leaves, bends=known)


def leaves_of(scorer: Scorer, keys: Keys, bends: Mapping[str, Array]) -> dict[Keys, float]:
    """What remains of a set when all that it does not need is taken out, with shares of it (`Contender.leaves`).
    `bends` are those of a contender.
    """  # noqa: D205
    leaves = list(dict.fromkeys(_leaves(scorer, scorer(keys).keys, bends, set())))
    log = np.array([scorer(leaf).log_probability for leaf in leaves])
    share = np.exp(log - log.max())
    return dict(zip(leaves, (share / share.sum()).tolist(), strict=True))


def _leaves(scorer: Scorer, keys: Keys, bends: Mapping[str, Array], seen: set[Keys]) -> list[Keys]:
    """Sets without anything idle that can be reached by taking out one idle part after the other, the likeliest ways
    first; once `MANY` sets were seen, only the likeliest way further.
    """  # noqa: D205
    if keys in seen:
        return []
    seen.add(keys)
    left = by_axis(scorer, scorer(keys).left)
    idle = []
    for gone in keys:
        rest = tuple(k for k in keys if k != gone)
        if _evidence(left, _without(scorer, rest, gone, bends)) <= LEAST_EVIDENCE:
            idle.append(rest)
    if not idle:
        return [keys]
    idle.sort(key=lambda rest: -scorer(rest).log_probability)
    out: list[Keys] = []
    for rest in idle:
        if not out or len(seen) < MANY:
            out += _leaves(scorer, rest, bends, seen)
    return out


def _without(scorer: Scorer, rest: Keys, gone: str, bends: Mapping[str, Array]) -> Array:
    """Mean squares (L,) by axis that remain without a member."""
    return np.asarray(by_axis(scorer, scorer(rest).left) * bends.get(gone, 1.0))


def _evidence(left: Array, without: Array) -> float:
    """Sum over axes of the log of how much the rms grows, from mean squares."""
    return 0.5 * float(np.sum(np.log(without) - np.log(left)))


def _bare(scorer: Scorer, keys: Keys, bends: Mapping[str, Array]) -> Contender:
    space, scored = scorer.spectrum, scorer(keys)
    predicted = adds(space, scored)
    left = by_axis(scorer, scored.left)
    return Contender(scored, parts_of(scorer, scored, bends), scorer.by_block(scored), predicted, left)


def adds(space: Spectrum, scored: Scored) -> Array:
    """Coefficients (K, L) of what the candidates of a set add to the prediction."""
    used = [k for key in scored.keys for k in (*space.parameters[key], space.offset[key])]
    weights = np.zeros(len(scored.weights))
    weights[used] = -scored.weights[used]
    return space.combined(weights)


def parts_of(scorer: Scorer, scored: Scored, bends: Mapping[str, Array]) -> tuple[Part, ...]:
    """What is said of each candidate of a set; `bends` are those of a contender."""
    space = scorer.spectrum
    sensor = by_axis(scorer, space.sensor)
    left = by_axis(scorer, scored.left)
    parts = []
    sizes = {k: _size(scorer, scored, k) for k in scored.keys}
    for key in scored.keys:
        c, theta = space.columns[key], scored.theta[key]
        without = _without(scorer, tuple(k for k in scored.keys if k != key), key, bends)
        returns = np.maximum(without / left - 1.0, 0.0)
        above = np.maximum(1.0 - LOUD**2 * sensor / left, 0.0) * returns / (returns + 1.0)
        rough = [k for k in scored.keys if k != key and space.columns[k].accuracy > ROUGH]
        law = sum((FAR_OFF * space.columns[k].accuracy) ** 2 * sizes[k] for k in rough)
        own = returns * sizes[key] / np.maximum(sizes[key] + law, 1e-30)
        trust = float(own.sum() / max(float(np.sum(returns + above)), 1e-30))
        evidence = _evidence(left, without)
        stuck = at_limit(theta, c.low, c.high)
        size = float(np.max(np.abs(theta) / c.scale))
        parts.append(Part(c.names, theta, size, stuck, evidence, trust * (IMPLAUSIBLE if stuck else 1.0)))
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


def searched(spectrum: Spectrum, rounds: int = 2, jobs: int = 1) -> Scorer:
    """A scorer that has scored the sets which flights make likely, at the noise that the likeliest leaves."""
    reference, weights_left = saturated(spectrum)
    spectrum.calm(spectrum.loud(spectrum.combined(weights_left)))
    for _ in range(rounds):
        scorer = Scorer(spectrum, reference)
        search(scorer, jobs=jobs)
        reference = ordered(scorer)[0].left
    return scorer


def search(scorer: Scorer, rounds: int = 4, jobs: int = 1) -> None:
    """Score what hunts find, with the spectrum that the best leaves, until the best stays the best."""
    scorer(())
    variance, last = scorer.variance, None
    for _ in range(rounds):
        hunt = Hunt(scorer, variance)
        scorer.many((*hunt.run()[:TOP], *hunt.plain()[:PLAIN]), jobs)
        best = ordered(scorer)[0]
        if best.keys == last:
            break
        last, variance = best.keys, best.variance


def ordered(scorer: Scorer) -> list[Scored]:
    """Scored sets, the likeliest first."""
    return sorted(scorer.known.values(), key=lambda s: -s.log_probability)


def weights(sets: Sequence[Contender]) -> Array:
    """Weights (S,) of sets by their blocks of time."""
    return bootstrapped(np.array([c.by_block for c in sets]), np.array([c.scored.prior for c in sets]))


def bootstrapped(likelihood: Array, prior: Array) -> Array:
    """Weights (S,): Dirichlet weights of the blocks (or flights), the share of every set, and the mean of many such
    draws. `likelihood` (S, B) and `prior` (S,) are logarithms.
    """  # noqa: D205
    blocks = likelihood.shape[1]
    drawn = np.random.default_rng(SEED).dirichlet(np.ones(blocks), DRAWS) * blocks
    log = drawn @ likelihood.T + prior
    share = np.exp(log - log.max(axis=1, keepdims=True))
    return np.asarray((share / share.sum(axis=1, keepdims=True)).mean(axis=0))
