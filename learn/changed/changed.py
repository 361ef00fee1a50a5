"""What changed between healthy flights and suspect ones: the one way from opened flights to that answer.

All flights are one linear problem (`learn.changed.pooled_flights`), about what the healthy ones show in common
(`learn.changed.healthy_model`). What the model is wrong by in all of them is there and free within typical sizes, every
flight has a trim of its own as large as healthy flights differ by, and candidates are changes: what effects add on the
suspect flights only. Sets of changes are weighed as sets of effects are (`learn.posterior`). So a thrust scale, a trim,
an unmodelled drag that is in all flights drops out, and a difference that healthy flights show among themselves is no
change.

    changed   nothing having changed has less than `CHANCE` of the weight, and the heaviest set has a name
    unknown   so too, but the heaviest set only says that there is a wrench; or the suspect flights leave far more
    nothing   else
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any

import numpy as np
from scipy.special import stdtrit
from threadpoolctl import threadpool_limits

from wrenchgap.flight.arguments import Progress, silent
from wrenchgap.flight.flight import AXES, Array
from wrenchgap.flight.result import Result
from wrenchgap.learn.changed.by_flight import FlightRow, NotCompared, not_compared, rows_by_flight, values_by_flight
from wrenchgap.learn.changed.healthy_model import HealthyModel, OutlierFlight, healthy_model, outlier_flights
from wrenchgap.learn.changed.linearised_effects import over_both_sides
from wrenchgap.learn.changed.places import Place, places, where_of
from wrenchgap.learn.changed.pooled_flights import PooledFlights, calibrated, comparable_flights
from wrenchgap.learn.changed.priors import NAMELESS, ROTOR_THRUST
from wrenchgap.learn.changed.search import ODDS, Weighed, weigh
from wrenchgap.learn.changed.sizes import Alone, Size, candidate_changes, deviations, louder, sizes
from wrenchgap.learn.changed.spectrum import answered
from wrenchgap.learn.data.candidates import Candidates, Untried, candidates
from wrenchgap.learn.data.dataset import dataset, spread_out
from wrenchgap.learn.data.errors import means_by
from wrenchgap.learn.data.opening import OpenFlight
from wrenchgap.learn.diagnose.timing import FlightTiming, timing_of, unfollowed_axes
from wrenchgap.learn.identify.bias_and_trim import WORTH, scatter_between, typical_trim
from wrenchgap.learn.identify.least_squares import left_by
from wrenchgap.learn.parallel import cores, one_thread
from wrenchgap.learn.posterior.detection_limits import DetectionLimit, detection_limits
from wrenchgap.learn.posterior.discriminating_tests import Check
from wrenchgap.learn.posterior.injection import Injection, Recovery, recoveries
from wrenchgap.learn.posterior.posterior import EquivalenceClass
from wrenchgap.learn.posterior.sensor_causes import made_by_another_filter
from wrenchgap.learn.posterior.settings import CHANGES
from wrenchgap.learn.posterior.sparse_commands import made_by_sparse_commands
from wrenchgap.plant.effects import family, find
from wrenchgap.plant.model import Model

Kind = tuple[tuple[str, ...], tuple[int, ...], tuple[bool, ...]]
"""What healthy flights are compared in: laws, axes on which commands answer the motion, axes that were measured."""
SECONDS = 120.0
"""Most flight time of either side [s]; of longer logs, pieces spread over all of it."""
AT_ONCE = 2
"""Effects of a set up to which its names can be firm: three unrelated changes between two flights are less likely than
one that is far from straight, and that several others make up for.
"""
CHANCE = 0.1
"""Weight of nothing having changed below which something has."""


class Verdict(StrEnum):
    """Whether something changed; see the module."""

    CHANGED = "changed"
    NOTHING = "nothing"
    UNKNOWN = "unknown"


@dataclass(frozen=True, repr=False)
class Changed(Result):
    """What changed on the `suspect` flights against the `healthy` ones (names; without those that are `odd`).

    `firm` are effects that changed in nine tenths of the weight of all sets. `classes` are sets of changes that these
    flights cannot tell apart, heaviest first, `nothing` the weight of none. `parameters` are those of the likeliest
    set, `places` where on the vehicle its sparse effects may be, `alone` each change by itself. `scatter` (6,) [N, Nm]
    is what healthy flights differ by; with `scatter_known` off, one healthy flight, it is typical values. `rows` are
    the flights; `by_means` says that nothing was excited, so that only their means were compared. `louder` are
    axes on which suspect flights leave far more than healthy ones; where there are none, `limits` say which changes
    these flights could have shown, `recoveries` what was found again of some of it.
    """

    verdict: Verdict
    names: tuple[str, ...]
    firm: tuple[str, ...]
    nothing: float
    classes: tuple[EquivalenceClass, ...]
    settle: tuple[Check, ...]
    parameters: tuple[Size, ...]
    places: tuple[Place, ...]
    alone: tuple[Alone, ...]
    odd: tuple[OutlierFlight, ...]
    not_compared: tuple[NotCompared, ...]
    rows: tuple[FlightRow, ...]
    scatter: Array
    scatter_known: bool
    answering: tuple[int, ...]
    by_means: bool
    louder: tuple[str, ...]
    untried: tuple[Untried, ...]
    model: Model
    limits: tuple[DetectionLimit, ...] = ()
    recoveries: tuple[Recovery, ...] = ()
    flights: tuple[OpenFlight, ...] = ()
    timing: tuple[FlightTiming, ...] = ()

    def differing(self, sigmas: float = 3.0) -> tuple[str, ...]:
        """Effects of which the suspect flights have values that differ by more than healthy ones do, by so many
        standard deviations: no one change is that of all of them.
        """  # noqa: D205
        rows = [r.values for r in self.rows if r.role == "suspect"]
        apart = []
        for one in self.parameters:
            values = [row[one.effect, one.name] for row in rows if (one.effect, one.name) in row]
            usual = float(np.hypot(one.scatter, one.std * len(rows) ** 0.5))
            if len(values) > 1 and np.ptp(values) > sigmas * 2.0**0.5 * usual:
                apart.append(one.effect)
        return tuple(dict.fromkeys(apart))

    @property
    def suspect(self) -> tuple[str, ...]:
        """Names of the suspect flights."""
        return tuple(r.flight for r in self.rows if r.role == "suspect")

    @property
    def healthy(self) -> tuple[str, ...]:
        """Names of the healthy flights that were compared with."""
        return tuple(r.flight for r in self.rows if r.role == "healthy")

    @property
    def clear(self) -> float:
        """Standard deviations of a change from which on its sign is known to 95 %: by Student's t, as few healthy
        flights say little of what flights differ by.
        """  # noqa: D205
        return float(stdtrit(len(self.healthy) - 1 + WORTH, 0.95))

    @property
    def is_clear(self) -> bool:
        """Whether any change is beyond what so few healthy flights leave open."""
        return not self.parameters or any(p.significance > self.clear for p in self.parameters)

    @property
    def established(self) -> bool:
        """Whether something surely changed: a firm effect, or one of several that these flights cannot tell apart."""
        sets = self.classes[0].sets if self.classes else ()
        several = any(s.weight >= CHANGES.otherwise for s in sets[1:]) and bool(sets[0].names)
        together = several and sum(s.weight for s in sets) >= CHANGES.firm
        return bool(self.firm) or (together and self.is_clear)

    def confidence(self, name: str) -> float:
        """Weight of the sets that name the effect, or another form of it; never above `SearchSettings.certain`."""
        named = [s.weight for c in self.classes for s in c.sets if family(name) in {family(n) for n in s.names}]
        return min(CHANGES.certain, sum(named))


def changed(
    suspects: Sequence[OpenFlight],
    healthy: Sequence[OpenFlight],
    model: Model,
    *,
    names: Sequence[str] = (),
    injections: int = 0,
    jobs: int | None = None,
    progress: Progress | None = None,
) -> Changed:
    """Find what changed between flights that were opened for `model`, among `names`, by default the catalogue.

    So many `injections` into the suspect flights check the limits of what would have been firm. `jobs` processes, by
    default one for each core. Raises UsageError where a side has no flight, LogError for the same flight on both sides
    or one of another vehicle, ModelError for unknown names.
    """
    return Baseline(healthy, model, names=names, jobs=jobs).against(suspects, progress, injections)


class Baseline:
    """Healthy flights of one vehicle, with what of them does not depend on the suspects: many can be compared with them
    at the cost of one. `healthy` are flights that were opened for `model`; the rest is as for `changed`.
    """  # noqa: D205

    def __init__(
        self, healthy: Sequence[OpenFlight], model: Model, *, names: Sequence[str] = (), jobs: int | None = None
    ) -> None:
        self.healthy, self.model, self.names = tuple(healthy), model, tuple(names)
        self.jobs = cores() if jobs is None else jobs
        self._timing: dict[str, FlightTiming] = {}
        self._standing: dict[Kind, HealthyModel] = {}
        self._odd: dict[Kind, tuple[tuple[int, OutlierFlight], ...]] = {}
        self._usual: dict[Kind, dict[str, Any]] = {}

    def against(self, suspects: Sequence[OpenFlight], progress: Progress | None = None, injections: int = 0) -> Changed:
        """What changed on these flights; options and errors as for `changed`."""
        tell = progress or silent

        def firm_with(one: Injection) -> Sequence[str]:
            tell(0.9, f"with {one.effect} injected")
            flights = [  # what is injected may be as large as what tells vehicles apart
                replace(f, records=one.into(f.records, self.model), accept=(*f.accept, "vehicles")) for f in suspects
            ]
            return self._against(flights, silent, limits_of=()).firm

        with threadpool_limits(1, user_api="blas"):  # so that digits do not depend on how many there are
            found = self._against(suspects, tell)
            seed = sum(len(r) for f in suspects for r in f.records)
            again = recoveries(found.limits, found.firm, self.model, injections, seed, firm_with)
            return replace(found, recoveries=again)

    @one_thread
    def _against(
        self, suspects: Sequence[OpenFlight], tell: Progress, limits_of: Sequence[str] | None = None
    ) -> Changed:
        flights = comparable_flights(suspects, self.healthy, self.model)
        tell(0.0, "timing of the topics")
        timing = tuple(self._timed(f) for f in flights)
        pool, untried = self._pooled(flights, unfollowed_axes(timing), tell)
        tell(0.5, "comparing healthy flights")
        count = len(self.healthy)
        kind = (tuple(one.name for one in pool.laws), pool.data.answering, tuple(pool.data.measured_axes.tolist()))
        if kind not in self._odd:
            self._odd[kind] = outlier_flights(pool, range(count))
        odd = self._odd[kind]
        gone = {number for number, _ in odd}
        good = [f for f in range(count) if f not in gone]
        tell(0.6, "what healthy flights differ by")
        kept = pool.only([f for f in range(len(flights)) if f not in gone])
        if kind not in self._usual:
            usual = calibrated(kept, range(len(good)))
            self._usual[kind] = {k: getattr(usual, k) for k in ("scatter", "sizes", "deviations")}
        kept = replace(kept, **self._usual[kind])
        tell(0.7, "weighing sets of changes")
        mine = range(len(good), len(flights) - len(gone))
        found = compared(kept, range(len(good)), mine, self.jobs, limits_of)
        rows = (*(rows_by_flight(pool.only([number]), ["odd"], [{}])[0] for number, _ in odd), *found.rows)
        changes = {n: {one.name: one.change for one in found.parameters if one.effect == n} for n in found.names}
        of_imu = made_by_another_filter(changes, timing[:count], timing[count:])
        of_log = made_by_sparse_commands(changes, *([f.flight for f in s] for s in (flights[:count], flights[count:])))
        doubtful = {family(one) for one in (*of_imu, *of_log, *found.differing())}
        doubtful |= {p.effect for p in found.parameters if p.effect == ROTOR_THRUST and p.change > 0.0}  # by how much?
        clear = {family(p.effect) for p in found.parameters if p.significance > found.clear}
        firm = tuple(n for n in found.firm if n in clear - doubtful)
        found = replace(found, odd=tuple(one for _, one in odd), rows=rows, untried=untried, model=self.model)
        return replace(found, firm=firm, flights=flights, timing=timing)

    def _timed(self, flight: OpenFlight) -> FlightTiming:
        key = f"{flight.flight.name} {flight.flight.content_hash}"
        if key not in self._timing:
            self._timing[key] = timing_of(flight, self.model)
        return self._timing[key]

    def _pooled(
        self, flights: Sequence[OpenFlight], answering: tuple[int, ...], tell: Progress
    ) -> tuple[PooledFlights, tuple[Untried, ...]]:
        """All flights as one problem, the healthy ones first; effects that cannot be tried."""
        count = len(self.healthy)
        sides = (flights[:count], flights[count:])
        calm, odd = (spread_out(tuple(r for f in side for r in f.records), SECONDS) for side in sides)
        data = dataset([*calm, *odd], self.model, answering)
        chosen: Candidates = candidates(data.records, self.model, self.names)
        tell(0.1, "effects one by one")
        kind = (tuple(chosen.tried), data.answering, tuple(data.measured_axes.tolist()))
        if kind not in self._standing:
            self._standing[kind] = healthy_model(
                dataset(calm, self.model, answering), self.model, chosen.tried, self.jobs
            )
        usual = self._standing[kind]
        suspect = dataset(odd, self.model, answering)
        found = over_both_sides(usual.laws, chosen.tried, suspect, usual.model, data.measured_axes, self.jobs)
        untried = (*chosen.untried, *usual.failed)
        given = left_by(data, self.model)
        left = left_by(data, usual.model)
        return PooledFlights(data, usual.model, left, found, typical_trim(self.model), {}, {}, given), untried


def compared(
    pool: PooledFlights,
    good: Sequence[int],
    mine: Sequence[int],
    jobs: int = 1,
    limits_of: Sequence[str] | None = None,
) -> Changed:
    """The answer on a calibrated pool of healthy flights `good` and suspect ones `mine`, with limits of `limits_of`."""
    found = weigh(pool, mine, jobs)
    pool = found.pool
    best = next((c.sets[0] for c in found.posterior.classes if c.sets[0].names), None)
    loud = louder(found, mine)
    verdict = _verdict(found, () if best is None else best.names, loud)
    names = () if verdict is Verdict.NOTHING or best is None else best.names
    named, vehicle = tuple(sorted(names)), pool.model.vehicle
    limits = () if loud else detection_limits(found.scorer, named, vehicle, ODDS, of=limits_of)
    limits = tuple(one for one in limits if one.effect not in NAMELESS)
    certain = verdict is Verdict.CHANGED and len(names) <= AT_ONCE and found.settled
    firm = tuple(n for n in found.posterior.firm if n not in NAMELESS) if certain else ()
    values: list[dict[tuple[str, str], float]] = [{} for _ in pool.names]
    if names:
        *_, prior = deviations(found, found.scorer(tuple(sorted(names))), names)
        keys = [(n, p.name) for n in names for p in find(n).parameters(pool.model.vehicle)]
        values = [dict(zip(keys, v.tolist(), strict=True)) for v in values_by_flight(found, names, prior)]
    scatter = pool.scatter
    if pool.deviations:  # all that the means differ by, also where parameters say it
        scatter = scatter_between(means_by(pool.data.flight, pool.given)[list(good)], typical_trim(pool.model))
    roles = ["suspect" if f in mine else "healthy" for f in range(len(pool.names))]
    return Changed(
        verdict,
        names,
        firm,
        found.nothing,
        found.posterior.classes,
        found.posterior.settle,
        sizes(found, names, good),
        tuple(p for n in names for p in places(found, names, n)),
        candidate_changes(found),
        (),
        not_compared(pool, mine),
        tuple(rows_by_flight(pool, roles, values)),
        np.where(pool.data.measured_axes, scatter, np.nan),
        len(good) > 1,
        pool.data.answering,
        bool(answered(pool.data)),
        tuple(AXES[a] for a in loud),
        (),
        pool.model,
        limits,
    )


def _verdict(found: Weighed, best: Sequence[str], loud: Sequence[int]) -> Verdict:
    if loud:
        return Verdict.UNKNOWN
    if found.nothing >= CHANCE or not best:
        return Verdict.NOTHING
    return Verdict.UNKNOWN if set(best) <= set(NAMELESS) else Verdict.CHANGED


__all__ = ["Changed", "Verdict", "changed", "where_of"]
