"""On which inputs what is left depends.

An additive Gaussian process: the residual is a sum of functions, each of one group of inputs (Duvenaud, Nickisch and
Rasmussen, "Additive Gaussian Processes", NeurIPS 2011). Each function has a linear and a squared-exponential kernel,

    k_g(x, x') = x . x' / D_g + exp(-|x - x'|^2 / (2 D_g))             x standardised, D_g inputs in the group

the latter as Nystroem features on a few representative samples (Williams and Seeger, NeurIPS 2001), so that a fit is a
ridge regression: all samples count, not some hundreds, and all of the inputs are tried in seconds. An ARD process over
thirty inputs at once would need more points than fit, and its lengthscales rank inputs poorly (a linear dependence
has a long one).

The shrinkage is chosen, per axis, on blocks of time held out within those that are fitted; everything that is reported
is on further blocks. Evidence would be cheaper, but what an incomplete set of inputs leaves is coloured, and evidence
takes the colour for signal.

Groups are found by forward selection, the one that takes off the most first, as long as the next does beyond chance
(paired t over blocks, scale-free over axes, as in `learn.posterior.explain`).

**The command is special.** A controller with feedback answers any disturbance, so the commanded wrench goes with
whatever is wrong: in hover the residual is minus the command. It is therefore tried last, and counts only for what the
other inputs do not explain.

**So is a vehicle that is blown about.** A gust moves it, and the controller leans it into the wind: attitude and
velocity then go with the residual, but behind it. What depends on the state is explained by the state of a moment ago
as well as by that of a moment later; what moves the state is explained better by the later one (Sims, "Money, Income,
and Causality", American Economic Review 62, 1972). `Relevance.driven` leaves that out.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from wrenchgap.flight.flight import Array
from wrenchgap.learn.data import feedback_regressors
from wrenchgap.learn.data.blocks import SIGNIFICANCE, by_block, evidence, paired_t, significant
from wrenchgap.learn.data.dataset import Dataset
from wrenchgap.learn.diagnose.quantities import InputGroup, input_groups
from wrenchgap.learn.process.subsample import Kernel, subsample


@dataclass(frozen=True)
class RelevanceSettings:
    """How the inputs are chosen on which an error depends."""

    folds: int = 4
    """Folds of blocks on which a choice is tried."""
    centres: int = 24
    """Most representative samples per group; a single input gets 8."""
    least: float = 0.02
    """Smallest share of the error, or of one axis ten times this, that is worth another group."""
    most: int = 4
    """Most groups chosen."""
    later: float = 0.3
    """How much earlier and later the inputs are taken to see which moves which [s]: what gusts of a few seconds do to a
    vehicle shows, and its state has not yet changed much."""


RELEVANCE = RelevanceSettings()


SHRINKAGE = np.logspace(-6, 3, 10)
"""Ridge penalties tried, relative to the mean eigenvalue of the features."""
LAST = "command"


@dataclass(frozen=True)
class GroupRelevance:
    """What one group of inputs explains, as shares of the variance of the residual on held-out blocks of time.

    `alone` with these inputs only; `lost` when they are left out of the chosen ones, the command not among them (for a
    group that was not chosen: what it would add to those). `alone_axes`, `lost_axes` (6,) per axis. `step` is the place
    in the selection, from 1; 0 if not chosen. `significance` is the paired t over blocks of `lost`. Shares below zero
    are zero.
    """

    name: str
    label: str
    columns: tuple[str, ...]
    alone: float
    lost: float
    alone_axes: Array
    lost_axes: Array
    significance: float
    step: int

    @property
    def chosen(self) -> bool:
        """Whether the residual depends on these inputs beyond chance and beyond the others chosen."""
        return self.step > 0


@dataclass(frozen=True)
class Relevance:
    """Groups of inputs, those chosen first in the order of choice, then the others by what they explain alone.

    `explained` is the share that the chosen groups explain together, `explained_axes` (6,) per axis; `driven` that of
    the chosen groups but the command, less what they explain better by their values a moment later than earlier.
    """

    groups: tuple[GroupRelevance, ...]
    explained: float
    explained_axes: Array
    driven: float
    lacking: dict[str, str]

    @property
    def chosen(self) -> tuple[GroupRelevance, ...]:
        """The inputs on which the residual depends."""
        return tuple(g for g in self.groups if g.chosen)


def relevance(data: Dataset, residual: Array, *, progress: Callable[[int, int], None] | None = None) -> Relevance:
    """Rank `learn.diagnose.quantities.input_groups` by what they explain of a residual (K, 6) of `data`; deterministic.

    `progress` is told (fits done, about of how many).
    """
    found, lacking = input_groups(data)
    moving = [g for g in found if np.ptp(g.values, axis=0).any()]
    with threadpool_limits(1, user_api="blas"):
        return _Search(data, residual, moving, progress).result(lacking)


def features(values: Array, seed: int = 0) -> Array:
    """Features (K, D + M) of one group of inputs (K, D): their products are k_g, but for a constant."""
    spread = values.std(axis=0)
    x = (values - values.mean(axis=0)) / np.where(spread > 1e-12, spread, 1.0)
    dims = x.shape[1]
    centres = x[subsample(x, 8 if dims == 1 else min(RELEVANCE.centres, 8 + 8 * dims), pre_thin=1000, seed=seed)]
    kernel = Kernel(np.full(dims, np.sqrt(dims)), 1.0, 0.0)
    gram = kernel(centres, centres) + 1e-6 * np.eye(len(centres))
    smooth = np.linalg.solve(np.linalg.cholesky(gram), kernel(centres, x)).T
    return np.column_stack((x / np.sqrt(dims), smooth))


class _Search:
    def __init__(
        self, data: Dataset, residual: Array, groups: Sequence[InputGroup], progress: Callable[[int, int], None] | None
    ) -> None:
        self.data, self.groups, known = data, groups, data.measured_axes
        self.residual = np.where(known, residual, 0.0)  # with weight zero; their shares are not a number in the end
        self.absent = np.where(known, 1.0, np.nan)
        parts = [features(g.values) for g in groups]
        whole = np.column_stack((*parts, np.ones(len(residual)), self.residual))
        self.phi = whole[:, :-7]
        ends = np.cumsum([p.shape[1] for p in parts])
        self.columns = [np.arange(end - p.shape[1], end) for end, p in zip(ends, parts, strict=True)]
        self.fold = data.block % RELEVANCE.folds
        self.used = [f for f in range(RELEVANCE.folds) if (self.fold == f).any()]
        self.products = {f: (own := whole[self.fold == f]).T @ own for f in self.used}
        self.base = self.left([])
        self.variance = np.maximum(np.mean(self.base**2, axis=0), 1e-300)
        self.progress = progress
        self.done = 0

    def left(self, chosen: Sequence[int]) -> Array:
        """What these groups leave (K, 6) of the residual, every block predicted without it."""
        out = np.empty_like(self.residual)
        columns = np.concatenate([np.empty(0, dtype=np.intp), *(self.columns[i] for i in chosen)])
        kept = np.concatenate((columns, self.phi.shape[1] + np.arange(7)))
        products = {f: own[np.ix_(kept, kept)] for f, own in self.products.items()}
        for f in self.used:
            rows, inner = self.fold == f, [products[g] for g in self.used if g != f]
            train = np.sum(inner or [products[f]], axis=0)
            mean = train[-7] / train[-7, -7]
            out[rows] = self.residual[rows] - mean[-6:]
            if chosen:
                values, vectors, turned = _spectrum(train)
                penalty = np.maximum(_shrinkage(train, inner) * values.mean(), 1e-12)
                weights = vectors @ (turned / (values[:, None] + penalty))
                out[rows] -= (self.phi[np.ix_(rows, columns)] - mean[:-7]) @ weights
        return out

    def share(self, before: Array, after: Array) -> tuple[float, Array]:
        """Share of the residual's variance that the second leaves less than the first: of the whole, per axis."""
        lost = np.mean(before**2, axis=0) - np.mean(after**2, axis=0)
        scale = self.data.weights**2
        return float(lost @ scale / (self.variance @ scale)), np.asarray(lost / self.variance)

    def t_value(self, before: Array, after: Array) -> float:
        """Paired t over blocks, every axis counting by its own size."""
        size = np.sqrt(np.mean(before**2, axis=0) * np.mean(after**2, axis=0)) + 1e-300
        return float(paired_t(by_block(self.data.block, np.sum((before**2 - after**2) / size, axis=1))))

    def select(self) -> tuple[list[int], Array]:
        """The groups chosen, in order, and what they leave."""
        order: list[int] = []
        current = self.base
        while len(order) < RELEVANCE.most:
            waiting = [i for i in range(len(self.groups)) if i not in order]
            last = [i for i in waiting if self.groups[i].name == LAST]
            best = self._best(order, current, [i for i in waiting if i not in last]) or self._best(order, current, last)
            if best is None:
                break
            order.append(best[0])
            current = best[1]
        return order, current

    def _best(self, order: Sequence[int], current: Array, waiting: Sequence[int]) -> tuple[int, Array] | None:
        """The group that takes off the most, if it does beyond chance and enough to be worth it."""
        worthy = []
        for i in waiting:
            left = self.left([*order, i])
            self.tick()
            whole, axes = self.share(current, left)
            t, large = self.t_value(current, left), evidence(current, left) > SIGNIFICANCE.large_evidence
            worth = whole > RELEVANCE.least or axes.max() > 10 * RELEVANCE.least
            if worth and significant(t, large=large):  # held-out blocks are predicted better than luck would have it
                worthy.append((whole, i, left))
        return max(worthy, key=lambda item: item[0])[1:] if worthy else None

    def tick(self) -> None:
        self.done += 1
        if self.progress is not None:
            self.progress(self.done, 6 * len(self.groups))

    def result(self, lacking: dict[str, str]) -> Relevance:
        order, current = self.select()
        others = [i for i in order if self.groups[i].name != LAST]
        found = []
        for i, group in enumerate(self.groups):
            alone, alone_axes = self.share(self.base, self.left([i]))
            against = order if group.name == LAST else others
            rest = [j for j in against if j != i]
            before, after = self.left(rest), self.left([*rest, i])
            self.tick()
            lost, lost_axes = self.share(before, after)
            found.append(
                GroupRelevance(
                    group.name,
                    group.label,
                    group.columns,
                    max(alone, 0.0),
                    max(lost, 0.0),
                    np.maximum(alone_axes, 0.0) * self.absent,
                    np.maximum(lost_axes, 0.0) * self.absent,
                    self.t_value(before, after),
                    order.index(i) + 1 if i in order else 0,
                )
            )
        found.sort(key=lambda g: (g.step or len(self.groups) + 1, -g.alone))
        whole, axes = self.share(self.base, current)
        del self.phi  # the searches of `driven` have as much again
        driven = self.driven([self.groups[i] for i in others])
        return Relevance(tuple(found), max(whole, 0.0), np.maximum(axes, 0.0) * self.absent, driven, lacking)

    def driven(self, chosen: Sequence[InputGroup]) -> float:
        """What these groups explain, less what they do better `RELEVANCE.later` than earlier."""
        shares = []
        for seconds in (-RELEVANCE.later, 0.0, RELEVANCE.later):
            moved = [replace(g, values=shifted(self.data, g.values, seconds)) for g in chosen]
            other = _Search(self.data, self.residual, moved, None)
            shares.append(other.share(other.base, other.left(range(len(moved))))[0])
        earlier, now, later = shares
        return max(now - max(later - earlier, 0.0), 0.0)


def shifted(data: Dataset, values: Array, seconds: float) -> Array:
    """Values (K, D) of that many seconds later; at the ends of records the last that there are."""
    steps = round(seconds / data.records[0].dt_kept)
    return np.concatenate([feedback_regressors.shifted(own, -steps) for own in data.by_record(values)])


def _about_means(products: Array, of: Array) -> tuple[Array, Array]:
    """Products of features (P, P), and with outputs (P, 6), about the means that the samples `of` have.

    Both are sums of products (P + 7, P + 7) over samples, of features, one, and outputs.
    """
    mean = of[-7] / of[-7, -7]
    centred = products - np.outer(mean, products[-7])
    centred -= np.outer(centred[:, -7], mean)
    return centred[:-7, :-7], centred[:-7, -6:]


def _spectrum(products: Array) -> tuple[Array, Array, Array]:
    """Eigenvalues (P,) and vectors of the centred features' products, and their products with outputs, turned."""
    gram, cross = _about_means(products, products)
    values, vectors = np.linalg.eigh(gram)
    return np.maximum(values, 0.0), vectors, vectors.T @ cross


def _shrinkage(train: Array, inner: Sequence[Array]) -> Array:
    """The penalty (6,) that predicts folds within the training blocks best."""
    if len(inner) < 2:
        return np.full(6, SHRINKAGE[len(SHRINKAGE) // 2])
    errors = np.zeros((len(SHRINKAGE), 6))
    for test in inner:
        rest = train - test
        values, vectors, turned = _spectrum(rest)
        gram, cross = _about_means(test, rest)
        cross, gram = vectors.T @ cross, vectors.T @ gram @ vectors
        for k, factor in enumerate(SHRINKAGE):
            weights = turned / (values[:, None] + max(factor * values.mean(), 1e-12))
            errors[k] += np.sum(weights * (gram @ weights), axis=0) - 2.0 * np.sum(weights * cross, axis=0)
    return np.asarray(SHRINKAGE[np.argmin(errors, axis=0)])
