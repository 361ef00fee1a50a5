"""Flights of both sides as one linear problem: what the model leaves, laws of effects, what all flights share."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from wrenchgap.flight.errors import UsageError
from wrenchgap.flight.flight import Array, Mask
from wrenchgap.flight.repeats import Repeats
from wrenchgap.learn.changed.linearised_effects import ABSOLUTE, LinearisedEffect
from wrenchgap.learn.changed.spectrum import ChangeSpectrum, answered
from wrenchgap.learn.changed.varying import (
    LEFT,
    Varying,
    columns,
    renewed,
    seeming,
    share_of_day,
    varying,
)
from wrenchgap.learn.data.dataset import Dataset, dataset
from wrenchgap.learn.data.errors import means_by
from wrenchgap.learn.data.one_vehicle import refuse_other_vehicle
from wrenchgap.learn.data.opening import OpenFlight, distinct
from wrenchgap.learn.identify.bias_and_trim import means_of_flights, scatter_between, trim_of, typical_trim
from wrenchgap.learn.posterior.columns import Column
from wrenchgap.learn.posterior.kernels import bounded
from wrenchgap.learn.posterior.linear_problem import quadratic
from wrenchgap.learn.posterior.settings import CHANGES, SearchSettings
from wrenchgap.learn.posterior.spectrum import Spectrum
from wrenchgap.plant.effects import family
from wrenchgap.plant.model import Model

ROUNDS = 4
"""In which the sizes of what is common are found."""
WIDE = 10.0
"""Scatter, in typical ones, that flights are granted while the sizes of what is common are found: whatever is wrong
with a command is also an explanation of why two flights are commanded differently, and would take their scatter."""


@dataclass(frozen=True)
class PooledFlights:
    """Flights with what a model leaves, `left` (K, 6), and the `laws` of effects over all of them, about that model.

    It is the model that was given with what healthy flights show in common (`learn.changed.healthy_model`); what the
    given one leaves is `given` (K, 6). `scatter` (6,) [N, Nm] is what flights differ by, one standard deviation;
    `sizes` are those of the laws' common parts, where the healthy flights say more than nothing. `deviations` are the
    scatters of what differs between flights as parameters (`learn.changed.varying`), empty where only means are
    compared. `settings` are those of the search.
    """

    data: Dataset
    model: Model
    left: Array
    laws: tuple[LinearisedEffect, ...]
    scatter: Array
    sizes: dict[str, Array]
    deviations: dict[str, Array]
    given: Array
    settings: SearchSettings = CHANGES

    @property
    def names(self) -> tuple[str, ...]:
        """Flights by their number."""
        return tuple(dict.fromkeys(r.flight for r in self.data.records))

    def rows(self, flights: Collection[int]) -> Mask:
        """Samples (K,) of some flights."""
        return np.isin(self.data.flight, list(flights))

    def only(self, flights: Collection[int]) -> PooledFlights:
        """The same with some of the flights, in their order."""
        kept, names = self.rows(flights), self.names
        records = [r for r in self.data.records if names.index(r.flight) in flights]
        data = dataset(records, self.model, self.data.answering)
        kept_laws = tuple(one.rows(kept) for one in self.laws)
        return replace(self, data=data, left=self.left[kept], given=self.given[kept], laws=kept_laws)

    @property
    def shared_laws(self) -> tuple[LinearisedEffect, ...]:
        """Of effects with several forms the first: one is enough to be in all flights."""
        first: dict[str, LinearisedEffect] = {}
        for one in self.laws:
            first.setdefault(family(one.name), one)
        return tuple(first.values())

    @cached_property
    def common(self) -> tuple[Column, ...]:
        """What is in all flights alike, with the sizes that healthy flights make likely."""
        out = []
        for one in self.shared_laws:
            column = one.common
            if one.name in self.sizes and len(self.sizes[one.name]) == len(column.scale):
                column = replace(column, scale=self.sizes[one.name])
            out.append(column)
        return tuple(out)

    @cached_property
    def varying(self) -> tuple[Varying, ...]:
        """What differs between flights as parameters."""
        if not self.deviations:
            return ()
        return varying(self.data, self.model, self.shared_laws, self.deviations)

    def spectrum(self, changes: tuple[Column, ...] = (), suspects: Collection[int] = ()) -> Spectrum:
        """Of these changes, beside what all flights share and what every flight may differ by.

        Several suspect flights have a trim in common besides: they may have been flown on one day, and then tell no
        more about it than one does. Each law seems to change from one trajectory to the next (`seeming`). A law that
        says what flights differ by says what changed as exactly: what it is off by weighs on both alike.
        """
        same = {v.name for v in self.varying}
        changes = tuple(replace(c, accuracy=0.0) if c.key in same else c for c in changes)
        trim = trim_of(replace(self.model, between_flights=tuple(self.scatter.tolist())))
        rows = self.rows(suspects)
        day = []
        if len(suspects) > 1:
            common = rows[:, None] & self.data.measured_axes
            day = [Varying("day", common[:, :, None] * np.eye(6), self.scatter).column(rows, share_of_day(suspects))]
        slack: list[Column] = []
        if self.deviations and suspects:  # where means alone are compared there is no trajectory
            whole = [one for one in self.shared_laws if one.name not in same]  # of the others that is known already
            slack = [seeming(one.name, one.bent.jacobian, one.bent.scale).column(rows) for one in whole]
        known = (*day, *columns(self.varying, self.data.flight, suspects), *slack, *self.common)
        return ChangeSpectrum(self.data, self.left, changes, trim, known, self.settings)

    def common_values(self, theta: Array) -> list[Array]:
        """Of each of `common`, `theta` being the always-there unknowns of a spectrum: they are the last."""
        return split(theta[len(theta) - self.common_size :], self.common)

    @property
    def common_size(self) -> int:
        """Unknowns of `common`."""
        return sum(len(c.scale) for c in self.common)

    def unexplained(self, theta: Array) -> Array:
        """What is left (K, 6) without what all flights share and each differs by, trims aside; there is no suspect."""
        known = (*columns(self.varying, self.data.flight, ()), *self.common)
        return self.left - added(known, split(theta[-sum(len(c.scale) for c in known) :], known))

    def shared(self, theta: Array) -> Array:
        """What all flights share (K, 6) of what the model leaves, of the same unknowns."""
        return added(self.common, self.common_values(theta)) + np.zeros_like(self.left)

    def shared_values(self, theta: Array, name: str) -> Array:
        """Parameters (P,) of an effect that all flights share, of those unknowns; zero of another form of an effect."""
        size = len(next(one for one in self.laws if one.name == name).reference)
        named = (v for c, v in zip(self.common, self.common_values(theta), strict=True) if c.key == name)
        return next(named, np.zeros(size))[:size]


def split(theta: Array, some: Sequence[Column]) -> list[Array]:
    """Unknowns of columns one after the other, by column."""
    return np.split(theta, np.cumsum([len(c.scale) for c in some])[:-1]) if some else []


def added(some: Sequence[Column], values: Sequence[Array]) -> Array:
    """What columns add (K, 6) at these values, their offsets aside."""
    return np.asarray(sum(c.jacobian @ v for c, v in zip(some, values, strict=True)))


def calibrated(pool: PooledFlights, healthy: Collection[int]) -> PooledFlights:
    """The pool with the scatters of its healthy flights and the sizes of what is common to them.

    Sizes by automatic relevance (`learn.identify.fit`) from what happens within the flights, from `ABSOLUTE` of the
    typical ones up to these: what healthy flights show may be as large as they show it.
    """
    alone = pool.only(healthy)
    flights = len(alone.names)
    excited = flights > 1 and not answered(alone.data)  # one flight shows no deviations: trims, and the answer says so
    sizes = {one.name: one.common.scale for one in pool.laws}
    scales: dict[str, Array] = {}
    if excited:
        scales = {v.name: v.scale for v in varying(alone.data, pool.model, alone.shared_laws, {})}
    usual = (LEFT if excited else 1.0) * typical_trim(pool.model)
    alone = replace(alone, scatter=(1.0 if excited else WIDE) * usual)
    for _ in range(ROUNDS):
        alone = replace(alone, sizes=sizes, deviations=scales)
        theta, covariance, _ = within_bounds(alone.spectrum())
        for one, shown in zip(alone.shared_laws, alone.common_values(theta), strict=True):
            least = one.common.scale
            sizes = sizes | {one.name: np.clip(np.abs(shown), least, least / ABSOLUTE)}
        if excited:
            at = len(theta) - alone.common_size
            own = slice(at - flights * sum(len(v.scale) for v in alone.varying), at)
            scales = renewed(alone.varying, theta[own], np.diag(covariance)[own], flights, pool.model)
    left = alone.unexplained(theta)
    scatter = scatter_between(means_by(alone.data.flight, left), usual, means_of_flights(alone.data, left)[1])
    return replace(pool, scatter=scatter, sizes=sizes, deviations=scales)


def within_bounds(
    spectrum: Spectrum, low: Array | None = None, high: Array | None = None, rounds: int = 3
) -> tuple[Array, Array, Array]:
    """The always-there unknowns (Q,) within bounds, their covariance without any, and the mean squares (bands, axes)
    that are left, axes and bands weighed by what they leave.
    """  # noqa: D205
    always, left = spectrum.always, spectrum.products[:, :, 0, 0]
    weights = np.zeros(spectrum.low.size)
    weights[0] = 1.0
    scale = spectrum.scale[always]
    for _ in range(rounds):
        whole = np.tensordot(spectrum.count / np.maximum(left, spectrum.sensor), spectrum.products, ([0, 1], [0, 1]))
        A, b = whole[np.ix_(always, always)], whole[always, 0]
        covariance = np.linalg.inv(A + np.diag(scale**-2.0))
        theta = covariance @ b
        if low is not None and high is not None and (np.any(theta < low) or np.any(theta > high)):
            theta = bounded(A, b, low, high, scale)
        weights[always] = -theta
        left = np.maximum(quadratic(spectrum.products, weights), 0.0)
    return theta, np.asarray(covariance, dtype=float), left


def comparable_flights(
    suspects: Sequence[OpenFlight], healthy: Sequence[OpenFlight], model: Model
) -> tuple[OpenFlight, ...]:
    """All flights, healthy ones first, with names that differ; a one-line error for those that cannot be compared."""
    for side, word in ((suspects, "suspect"), (healthy, "healthy")):
        if not side:
            raise UsageError(f"changed: no {word} flight; give suspect flights, and healthy ones with --healthy")
    repeats = Repeats()
    for one in (*healthy, *suspects):
        repeats.refuse(one.flight, remedy="name each flight once, as healthy or as suspect")
    for one in healthy if len(healthy) > 2 else ():
        refuse_other_vehicle(one, [f for f in healthy if f is not one], "the other healthy flights", model)
    for one in suspects:
        refuse_other_vehicle(one, healthy, "the healthy flights", model)
    return tuple(distinct([*healthy, *suspects]))
