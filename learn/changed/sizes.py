"""How large changes are: in SI, in units of the scatter between flights, and where on the vehicle.

std          of the change, from what wanders within the flights: the trims held fixed; with what forms and stamps
             that are nearly right may be off by (`learn.identify.least_squares.Problem.covariance`)
scatter      what flights differ by, in this parameter: the trims free, sqrt(std_free^2 - std^2)
significance |change| / hypot(scatter, std)
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag

from wrenchgap.flight.flight import Array
from wrenchgap.learn.changed.by_flight import shared, values_by_flight
from wrenchgap.learn.changed.places import where_of
from wrenchgap.learn.changed.priors import read
from wrenchgap.learn.changed.search import Weighed, worth_a_name
from wrenchgap.learn.changed.spectrum import answered
from wrenchgap.learn.data.errors import means_by
from wrenchgap.learn.identify.fit import MATERIAL
from wrenchgap.learn.identify.least_squares import MISFIT
from wrenchgap.learn.posterior.kernels import bounded, relevant
from wrenchgap.learn.posterior.score import Scored
from wrenchgap.plant.effects import find

WIDE = 4.0
"""Prior of a value on one flight, in sizes of the prior of its change: wide enough not to pull."""


@dataclass(frozen=True)
class Size:
    """One parameter: its value on healthy flights and on the suspect ones, what healthy flights differ by, the standard
    deviation of the change.
    """  # noqa: D205

    effect: str
    name: str
    healthy: float
    scatter: float
    suspect: float
    std: float
    unit: str
    where: str

    @property
    def change(self) -> float:
        """Suspect less healthy."""
        return self.suspect - self.healthy

    @property
    def change_std(self) -> float:
        """What the change is uncertain by: what flights differ by, and its standard deviation within them."""
        return float(np.hypot(self.scatter, self.std))

    @property
    def significance(self) -> float:
        """The change in units of what it is uncertain by."""
        return abs(self.change) / max(self.change_std, 1e-30)


@dataclass(frozen=True)
class Alone:
    """A change by itself: its parameters, and the log odds of it against none, its prior included. Of one that is not
    `large`, the odds, however good, are no news (`learn.changed.search.worth_a_name`).
    """  # noqa: D205

    effect: str
    odds: float
    sizes: tuple[Size, ...]
    large: bool = True

    @property
    def largest(self) -> Size:
        """The parameter that is most significant."""
        return max(self.sizes, key=lambda s: s.significance)


def sizes(found: Weighed, names: Sequence[str], healthy: Sequence[int] = ()) -> tuple[Size, ...]:
    """Parameters of a set of changes that are worth a line; `healthy` are flights of which the values are a mean, where
    there are none they are what all flights share.
    """  # noqa: D205
    if not names:
        return ()
    space = found.scorer.spectrum
    scored = found.scorer(tuple(sorted(names)))
    values, std, free, prior = deviations(found, scored, names)
    usual = values_by_flight(found, names, prior)[list(healthy)].mean(axis=0) if healthy else shared(found, names)
    out, at = [], 0
    vehicle = found.pool.model.vehicle
    for name in names:
        for k, p in enumerate(find(name).parameters(vehicle)):
            scatter = float(np.sqrt(max(free[at] ** 2 - std[at] ** 2, 0.0)))
            base, change = float(usual[at]), float(values[at])
            timing = max(r.timing_error for r in found.pool.data.records) if p.unit == "s" else 0.0
            inexact = np.hypot(MISFIT * change, timing)
            if abs(change) >= MATERIAL * space.columns[name].scale[k] or not find(name).sparse:
                where = where_of(vehicle, name, p.name)
                size = Size(
                    name, p.name, base, scatter, base + change, float(np.hypot(std[at], inexact)), p.unit, where
                )
                out.append(size)
            at += 1
    return tuple(out)


def deviations(found: Weighed, scored: Scored, names: Sequence[str]) -> tuple[Array, Array, Array, Array]:
    """The changes (P,), given that they are changes: with a prior that is too wide to pull; their standard deviations
    (P,) with every trim held fixed, and with all that is always there free; the sizes (P,) of that prior on one flight.

    What a flight differs by as any other does, and a change of the same kind, are one sum: the prior of a change, which
    weighs sets, would leave a share of it to the former.
    """  # noqa: D205
    space = found.scorer.spectrum
    unknown = np.concatenate([space.parameters[n] for n in names])
    whole, always = found.scorer.weighed(scored.variance), space.always
    fixed = whole[np.ix_(unknown, unknown)]
    free = found.scorer.eliminated(scored.variance)[np.ix_(unknown, unknown)]
    theta = np.concatenate([scored.theta[n] for n in names])
    low, high, usual, sparse = (x[unknown] for x in (space.low, space.high, space.scale, space.sparse))
    size = relevant(free, free @ theta, low, high, usual, sparse, usual)
    wide = np.where(sparse, size, WIDE * usual)
    vehicle = found.pool.model.vehicle
    reads = block_diag(*(read(vehicle, n, len(space.parameters[n])) for n in names))
    std, loose = (np.sqrt(np.diag(reads @ covariance(part, wide) @ reads.T)) for part in (fixed, free))
    own = np.concatenate(([0], [space.offset[n] for n in names])).astype(int)
    left = np.concatenate(([1.0], -np.ones(len(names))))
    both = np.concatenate((unknown, always))
    values = bounded(
        whole[np.ix_(both, both)],
        whole[np.ix_(both, own)] @ left,
        space.low[both],
        space.high[both],
        np.concatenate((wide, space.scale[always])),
    )
    alone = np.where(sparse, relevant(fixed, fixed @ theta, low, high, usual, sparse, usual), WIDE * usual)
    return reads @ values[: len(unknown)], std, loose, np.max(reads * alone, axis=1)


def covariance(A: Array, scale: Array) -> Array:
    """Of parameters (P, P) with the curvature A of the data (P, P) and priors of these sizes (P,).

    No data make a parameter less certain than its prior: a curvature that rounding leaves negative says nothing.
    """
    size, turn = np.linalg.eigh(0.5 * (A + A.T) * np.outer(scale, scale))
    turned = scale[:, None] * turn
    return np.asarray((turned / (1.0 + np.maximum(size, 0.0))) @ turned.T)


def candidate_changes(found: Weighed) -> tuple[Alone, ...]:
    """Every change by itself, the likeliest first; of those likelier than none, ones too small for a name come last."""
    scorer = found.scorer
    odds = {k: scorer((k,)).log_probability - scorer(()).log_probability for k in scorer.spectrum.columns}
    listed = [Alone(k, odds[k], sizes(found, (k,)), worth_a_name(scorer, k)) for k in odds]
    return tuple(
        sorted((one for one in listed if one.sizes), key=lambda one: (one.odds < 0.0, not one.large, -one.odds))
    )


def louder(found: Weighed, suspects: Sequence[int]) -> tuple[int, ...]:
    """Axes on which every suspect flight leaves, within itself, far more than the loudest healthy one; of axes on which
    commands answer the motion nothing is said: those leave what the air was like.
    """  # noqa: D205
    space = found.scorer.spectrum
    best = found.posterior.classes[0].sets[0].scored_set.scored
    weights = best.weights if best.keys in found.scorer.known else found.scorer(()).weights
    left = space.combined(weights)
    flight = found.pool.data.flight[space.starts][space.block]
    rms = np.sqrt(means_by(flight[space.within], left[space.within] ** 2))
    mine = np.isin(np.arange(len(rms)), list(suspects))
    loud = rms[mine].min(axis=0) > space.settings.structure * rms[~mine].max(axis=0)
    quiet = {*answered(found.pool.data), *found.pool.data.answering}
    return tuple(int(axis) for k, axis in enumerate(space.axes) if loud[k] and axis not in quiet)
