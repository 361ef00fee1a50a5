"""Whether a flight can tell effects apart: how much of what one adds to the measured wrench another can imitate.

A flight on which the truth is the model with effect A would measure W_A = W(model + A). The best that a model with B
instead of A can do, with everything else that is fitted along (the model's own effects, an accelerometer's bias, and
`also`, by default the inertia, which is never known exactly), is

    left = W_A - min over theta_B, nuisance of W(model + B)                        through the filter, without noise

    cosine        between what A adds and its imitation: 1 means that B can do exactly what A does
    share         |left| / |what A adds|, newtons and newton metres on one scale (weights of
                  `learn.data.dataset.Dataset`)
    evidence      sum over the axes of log rms ratios, as in `learn.data.blocks`: whether the difference shows beyond
                  noise
    separation    that of `learn.data.blocks` between the two explanations, in paired-t units, expected

The expected separation follows from its definition. With residuals n (A, of variance s_l^2: noise, and on such flights
perhaps more than that) and n + left (B), each axis scaled by v_l = s_l sqrt(s_l^2 + <left_l^2>), the mean difference of
a block b is e_b = <sum_l left_l^2 / v_l>_b, plus noise of variance 4 <sum_l s_l^2 left_l^2 / v_l^2>_b / n_b with n_b
independent samples. So

    difference = mean_b e_b,    spread^2 = (var_b e_b + mean_b noise variance) / blocks,
    separation = difference / hypot(spread, discrepancy sum_l (s_l^2 - sensor noise_l^2) / v_l).

A direction "truth A, imitated by B" does not count where B has so many parameters more than A that
`explain` would not prefer it: both explain the flight, and the simpler one is named.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from wrenchgap.flight.errors import ModelError
from wrenchgap.flight.flight import Array
from wrenchgap.learn.data.blocks import SIGNIFICANCE, Contrast, by_block, contrast
from wrenchgap.learn.data.dataset import Dataset, dataset
from wrenchgap.learn.data.errors import rms, weighted
from wrenchgap.learn.data.measurement import Record
from wrenchgap.learn.identify.fit import Fit, fit, held_out
from wrenchgap.plant.effects import find
from wrenchgap.plant.model import Model
from wrenchgap.plant.wrench_model import ModelEffect

NUISANCE = ("inertia", "command_delay")
"""Effects that every vehicle has to a small extent; an imitator may use them as well."""
LAGS = ("command_delay", "servo_lag", "motor_lag", "asymmetric_motor_lag", "backlash")
"""Effects that a nuisance of their kind would hide: with one of them in the group, the others are no nuisance."""


@dataclass(frozen=True)
class SeparationThresholds:
    """From when on effects are separable."""

    least_share: float = 0.03
    """Share of an effect that must be left unimitated: no model is right to within 3 % of what it describes."""
    enough: float = 12.0
    """A separation beyond which more certainty is worth nothing; a larger share still is."""
    plain: float = 1.0
    """Evidence beyond which more is worth nothing."""
    aside: float = 0.5
    """Weight in a search of the directions that do not count."""
    invisible: float = 1e-3
    """Size, in standard deviations of the noise, below which something counts as zero."""
    fits: int = 6
    """Most fits in a row of an imitator whose prediction is not linear in its parameters (a force times its lever)."""


SEPARATION = SeparationThresholds()


@dataclass(frozen=True)
class Direction:
    """If `truth` is there and the model has `imitator` instead.

    `added` and `left` (6,) are rms of what the truth adds, and of what the imitator leaves of it, not a number on axes
    that were not measured; `traces` holds both as (K, 6), the second being the imitation. `counts` is false where the
    imitator is so much richer that the simpler explanation is named anyway.
    """

    truth: str
    imitator: str
    added: Array
    left: Array
    noise: Array
    cosine: float
    share: float
    evidence: float
    separation: float
    counts: bool
    traces: tuple[Array, Array]

    @property
    def told(self) -> bool:
        """Whether the two are told apart: beyond chance, beyond the noise, and beyond what any model gets wrong."""
        unlike = self.separation >= SIGNIFICANCE.indistinct and self.evidence >= SIGNIFICANCE.least_evidence
        return unlike and self.share >= SEPARATION.least_share

    @property
    def merit(self) -> float:
        """What a search maximises: separation times share times evidence, each up to where more is worth nothing."""
        return min(self.separation, SEPARATION.enough) * self.share * min(self.evidence / SEPARATION.plain, 1.0)

    @property
    def telling(self) -> int:
        """The axis on which the difference stands out most."""
        return int(np.nanargmax(self.left / self.noise))


@dataclass(frozen=True)
class Separability:
    """All ordered pairs of a group on one flight of `seconds`."""

    names: tuple[str, ...]
    seconds: float
    directions: tuple[Direction, ...]

    @property
    def counting(self) -> tuple[Direction, ...]:
        """The directions that matter; all where none does."""
        return tuple(d for d in self.directions if d.counts) or self.directions

    @property
    def worst(self) -> Direction:
        """The direction that is hardest to tell."""
        return min(self.counting, key=lambda d: d.merit)

    @property
    def separation(self) -> float:
        """Least expected separation."""
        return min(d.separation for d in self.counting)

    @property
    def share(self) -> float:
        """Least share that is left."""
        return min(d.share for d in self.counting)

    @property
    def separable(self) -> bool:
        """Whether every direction that counts is told apart."""
        return all(d.told for d in self.counting)

    @property
    def merit(self) -> float:
        """That of the hardest direction. Directions that do not count help to choose among flights otherwise alike."""
        return self.worst.merit + SEPARATION.aside * min(d.merit for d in self.directions)


def nuisances(also: Sequence[str] | None, names: Sequence[str], base: Model) -> tuple[str, ...]:
    """Effects that are fitted along with a group `names`: `also`, or `NUISANCE` but no lag beside a lag.

    What is in the group or in the model is none.
    """
    hidden = LAGS if set(names) & set(LAGS) else ()
    chosen = [a for a in NUISANCE if a not in hidden] if also is None else also
    return tuple(a for a in chosen if a not in names and base.effect(a) is None)


def separability(
    data: Record | Sequence[Record],
    model: Model,
    *effects: str | ModelEffect,
    also: Sequence[str] | None = None,
    floor: Array | None = None,
) -> Separability:
    """How well a flight tells `effects` apart, in all ordered pairs.

    Only commands and motion of `data` are used, and its measurement only to fit effects that are given by name and
    are not in the model. `floor` (6,) stands for the noise where more than sensor noise is left on such flights.
    Raises FitError where an effect cannot act on this data.
    """
    records = [data] if isinstance(data, Record) else data
    every = dataset(records, model)
    listed = tuple(e if isinstance(e, ModelEffect) else sized(e, model, every, also=also) for e in effects)
    sensor = every.noise
    if floor is not None:
        every = dataset([replace(r, noise=floor) for r in records], model)
    names = [e.name for e in listed]
    base = model.without([n for n in names if model.effect(n) is not None])
    along = nuisances(also, names, base)
    plain = every.predict(base.wrench_model)
    targets = {e.name: every.predict(base.with_effects([*base.effects, e]).wrench_model) for e in listed}

    def left(truth: str, other: ModelEffect) -> Array:
        return thorough(replace(every, measured=targets[truth]), base, other.name, along).residual

    return in_pairs(every, base, listed, sensor, {name: target - plain for name, target in targets.items()}, left)


def in_pairs(
    data: Dataset,
    base: Model,
    effects: Sequence[ModelEffect],
    sensor: Array,
    added: dict[str, Array],
    left: Callable[[str, ModelEffect], Array],
) -> Separability:
    """All ordered pairs, from what each truth adds (K, 6) and what each imitator leaves of it (truth, imitator)."""
    none = np.zeros_like(data.measured)
    found = []
    for truth, shown in added.items():
        visible = np.any(rms(shown) >= SEPARATION.invisible * data.noise)
        for other in (e for e in effects if e.name != truth):
            parts = (shown, left(truth, other), sensor) if visible else (none, none, sensor)
            made = direction(data, base, truth, other.name, *parts)
            found.append(made if visible else replace(made, cosine=float("nan")))
    seconds = len(data.measured) * data.records[0].dt_kept
    return Separability(tuple(e.name for e in effects), seconds, tuple(found))


def direction(
    data: Dataset, base: Model, truth: str, imitator: str, added: Array, left: Array, sensor: Array
) -> Direction:
    """A direction from what the truth adds and what the imitator leaves of it, (K, 6) each."""
    imitated = added - left
    few, many = (len(find(name).parameters(base.vehicle)) for name in (truth, imitator))
    a, b = (weighted(part, data.weights) for part in (added, imitated))
    size = max(float(np.linalg.norm(a)), 1e-30)
    return Direction(
        truth,
        imitator,
        np.where(data.measured_axes, rms(added), np.nan),
        np.where(data.measured_axes, rms(left), np.nan),
        data.noise,
        float(np.vdot(a, b)) / max(size * float(np.linalg.norm(b)), 1e-30),
        float(np.linalg.norm(weighted(left, data.weights))) / size,
        visibility(left, data.noise),
        expected_separation(data, left, sensor),
        comparable(few, many),
        (added, imitated),
    )


def comparable(size: int, other: int) -> bool:
    """Whether an effect of `other` parameters is simple enough to stand in the place of one of `size`."""
    return other <= size + 2 or other <= 1.5 * size


def thorough(data: Dataset, base: Model, name: str, also: Sequence[str] = ()) -> Fit:
    """A fit of one effect, with `also` where that helps, which does not end where one search ends.

    Three answers: the effect alone; then with the rest, which was absent; all from the start. Each is fitted again from
    where it ended until that brings nothing more (a lag, a width or a force times its lever is not found in one go),
    and the one that leaves least evidence counts. (A fit weights each axis by what it leaves there, so it may have
    given up an axis that another answer gets right.)
    """
    names = [*(e.name for e in base.effects), name]
    alone = _settled(data, base, names, fit(data, base, names))
    if not also or visibility(alone.residual, data.noise) < SEPARATION.invisible**2:
        return alone
    every = [*names[:-1], *also, name]
    absentees = tuple(absent(n, base) for n in also)
    answers = [alone]
    for start in (replace(alone, effects=(*alone.effects, *absentees)), None):
        with suppress(ModelError):  # an inertia that no body has: that way leads nowhere
            answers.append(_settled(data, base, every, fit(data, base, every, start=start)))
    return min(answers, key=lambda f: visibility(f.residual, data.noise))


def _settled(data: Dataset, base: Model, names: Sequence[str], start: Fit) -> Fit:
    """Fitted again and again from where the last fit ended."""
    best, left = start, visibility(start.residual, data.noise)
    for _ in range(SEPARATION.fits - 1):
        if left < SEPARATION.invisible**2:
            break
        again = fit(data, base, names, start=best)
        after = visibility(again.residual, data.noise)
        if after >= 0.99 * left:
            break
        best, left = again, after
    return best


def visibility(left: Array, noise: Array) -> float:
    """Evidence for `left` (K, 6) in `noise` (6,): sum of log sqrt(1 + <left^2> / noise^2) over axes with a noise."""
    return float(0.5 * np.nansum(np.log1p(np.mean(left**2, axis=0) / noise**2)))


def expected_separation(data: Dataset, left: Array, sensor: Array) -> float:
    """Expected separation for a difference `left` (K, 6) in what `data.noise` says; see the module's docstring.

    `sensor` (6,) is the part of it that is sensor noise.
    """
    known = data.measured_axes
    left, sensor, noise = left[:, known], sensor[known], data.noise[known] ** 2
    scale = np.sqrt(noise * (noise + np.mean(left**2, axis=0)))
    counts = np.bincount(data.block)
    excess = by_block(data.block, np.sum(left**2 / scale, axis=1))
    shaken = by_block(data.block, np.sum(4.0 * noise * left**2 / scale**2, axis=1))
    variance = float(np.var(excess, ddof=1)) if len(counts) > 1 else float(excess[0] ** 2)
    variance += float(np.mean(shaken / np.maximum(data.independence * counts, 1.0)))
    wrong = float(np.sum(np.maximum(noise - sensor**2, 0.0) / scale))
    return Contrast(float(np.mean(excess)), float(np.sqrt(variance / len(counts))), wrong).separation


def measured_separation(
    data: Dataset, base: Model, truth: str, imitator: str, also: Sequence[str] | None = None
) -> float:
    """The separation that a flight gave: both explanations fitted, and compared on blocks not fitted."""
    along = nuisances(also, (truth, imitator), base)
    residuals = []
    for name in (imitator, truth):
        found = thorough(data, base, name, along)
        residuals.append(held_out(data, base, [e.name for e in found.effects], found))
    return contrast(data, *residuals).separation


def sized(name: str, model: Model, data: Dataset | None = None, *, also: Sequence[str] | None = ()) -> ModelEffect:
    """An effect with values: the model's own; else fitted alone on `data`; else of typical size.

    A fit that leaves nothing of the effect (less than a tenth of its typical size) is not used.
    """
    if (known := model.effect(name)) is not None:
        return known
    if data is None:
        return typical(name, model)
    best = thorough(data, model, name, nuisances(also, (name,), model))
    found = next(e for e in best.effects if e.name == name)
    scale = np.array([p.scale for p in find(name).parameters(model.vehicle)])
    return found if np.any(np.abs(found.theta) > 0.1 * scale) else typical(name, model)


def absent(name: str, base: Model) -> ModelEffect:
    """An effect that is not there."""
    effect = find(name)
    return ModelEffect(effect, np.zeros(len(effect.parameters(base.vehicle))))


def typical(name: str, model: Model) -> ModelEffect:
    """An effect of typical size: `Parameter.scale`, signs in turn where both are plausible.

    One number that may have either sign is taken negative: rotors lose thrust more often than they gain it. Of an
    effect that is sparse (one weak rotor of twelve) only the first parameter, twice its scale.
    """
    effect = find(name)
    parameters = effect.parameters(model.vehicle)
    signs = [1.0 if p.low >= 0.0 or k % 2 == 0 else -1.0 for k, p in enumerate(parameters)]
    if len(parameters) == 1 and parameters[0].low == -parameters[0].high:
        signs = [-1.0]
    theta = np.array([s * p.scale for s, p in zip(signs, parameters, strict=True)])
    if effect.sparse:
        first = parameters[0]
        theta = np.zeros(len(parameters))
        theta[0] = 2.0 * first.scale * (-1.0 if abs(first.low) > abs(first.high) else 1.0)
    return ModelEffect(effect, np.clip(theta, [p.low for p in parameters], [p.high for p in parameters]))
