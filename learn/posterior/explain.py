"""Which physical effect is missing: candidates of the catalogue, ranked by the error they leave on held-out blocks.

`explain` is the one way from opened flights to a verdict: timing, effects to try (`learn.data.candidates`), each by
itself (`learn.posterior.single_effects`), weights of sets of them (`learn.posterior.posterior`), the likeliest set
fitted and its members (`learn.posterior.members`), what it leaves, and the verdict (`learn.posterior.verdict`). Two
measures, both on held-out blocks:

    energy    sum_l (w_l r_l)^2, newtons and newton metres on one scale (w of `learn.data.dataset.Dataset`): what a user
              sees; orders candidates and members. score = 1 - energy left / energy of the model as given
    evidence  sum_l log(rms_l before / rms_l after): scale-free, so that a small axis counts too; what is named
              has some, beyond chance in a paired test over blocks (docs/decisions/0006-blocks.md)
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.repeats import refuse_seen
from wrenchgap.flight.result import Result
from wrenchgap.learn.data.blocks import SIGNIFICANCE
from wrenchgap.learn.data.candidates import Candidates, Lack, Untried, candidates
from wrenchgap.learn.data.comparison import Validation, validate
from wrenchgap.learn.data.dataset import Dataset, dataset, spread_out
from wrenchgap.learn.data.errors import reduction, rms
from wrenchgap.learn.data.opening import OpenFlight
from wrenchgap.learn.diagnose.relevance import Relevance, relevance
from wrenchgap.learn.diagnose.residual_patterns import OneRotor, Oscillation, one_rotor, oscillation
from wrenchgap.learn.diagnose.timing import FlightTiming, answering_axes, timing_of
from wrenchgap.learn.identify.air import AirVelocity, air_velocity
from wrenchgap.learn.identify.fit import Fit, with_fit
from wrenchgap.learn.parallel import cores, one_thread
from wrenchgap.learn.posterior.detection_limits import DetectionLimit, detection_limits
from wrenchgap.learn.posterior.disturbance_free import disturbance_free, may_be_disturbance_free, without_feedback
from wrenchgap.learn.posterior.equivalence_classes import EquivalenceClass
from wrenchgap.learn.posterior.injection import Injection, Recovery, recoveries
from wrenchgap.learn.posterior.late_clock import LateClock, late_clock, with_clock
from wrenchgap.learn.posterior.members import Fitted, Member, fitted, needed_members
from wrenchgap.learn.posterior.posterior import Posterior, posterior
from wrenchgap.learn.posterior.scored_sets import parts_of
from wrenchgap.learn.posterior.settings import DEFAULT, SearchSettings
from wrenchgap.learn.posterior.single_effects import (
    Candidate,
    ModelResidual,
    SingleEffects,
    model_residual,
    single_effects,
)
from wrenchgap.learn.posterior.unexplained_bands import OpenBand, unexplained_bands
from wrenchgap.learn.posterior.verdict import Verdict, concentrated, decide, open_axes, over_noise
from wrenchgap.plant.effects import catalogue, family
from wrenchgap.plant.model import Model
from wrenchgap.plant.vehicle import Vehicle

Array = NDArray[np.float64]
Progress = Callable[[float, str], None]


SEARCH_SECONDS = 200.0
"""Most flight time that candidates are tried on [s]; of longer logs, pieces spread over all of it. What is chosen is
then fitted to everything."""

FEWEST = 5
"""Blocks of time below which nothing is said about what the rest depends on."""


@dataclass(frozen=True, repr=False)
class Explanation(Result):
    """What is missing, according to the logs. `rms_*` are (6,) held-out; `noise` (6,) is the sensor noise.

    `effects` are the members' names, that with the largest share of the error first; `ranking` has every candidate by
    itself. `posterior` weighs the sets, `open` are axes (6,) on which structure is left, `bands` the frequencies at
    which what is named leaves some. `oscillation` is one found in the residual, `one_rotor` the rotor in whose
    direction it pushes; `depends` says on what it depends, where axes are open; `concentrated` is the share of the
    residual that sits in the worst tenth of the time; `left` is its rms over that of the noise, the worse of force
    and torque. `timing` is that of each of `flights`; `validation` the test on flights that were not fitted, where
    some were given; `answering` are the axes on which commands answered a disturbance. `named_there` says that what
    is named pushes where `one_rotor` pushes: the mean of what comes and goes, whose name is open.
    `limits` say what these flights could have shown beside what is named, `recoveries` what was found again of it.
    """

    verdict: Verdict
    members: tuple[Member, ...]
    ranking: tuple[Candidate, ...]
    posterior: Posterior
    fit: Fit
    model: Model
    rms_before: Array
    rms_after: Array
    noise: Array
    untried: tuple[Untried, ...]
    open: NDArray[np.bool_]
    oscillation: Oscillation | None
    one_rotor: OneRotor | None
    depends: Relevance | None
    concentrated: float
    left: float
    flights: tuple[OpenFlight, ...] = ()
    timing: tuple[FlightTiming, ...] = ()
    validation: Validation | None = None
    answering: tuple[int, ...] = ()
    bands: tuple[OpenBand, ...] = ()
    named_there: bool = False
    limits: tuple[DetectionLimit, ...] = ()
    recoveries: tuple[Recovery, ...] = ()

    @property
    def reduction(self) -> Array:
        """Fraction (6,) of the rms on held-out time that is gone."""
        return reduction(self.rms_before, self.rms_after)

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the members."""
        return tuple(m.name for m in self.members)

    def confidence(self, member: Member) -> float:
        """Probability that the member, or one of its group, is there (`Posterior.probability`)."""
        return member.probability

    @property
    def firm(self) -> tuple[str, ...]:
        """Names in nine tenths of the weight of all sets, of an effect with several forms that of its family; none that
        another stands in the place of (`Member.alike`), that is at the limit of what is plausible, that one rotor makes
        which comes and goes, or whose evidence is all on axes that are open: what is left there may have made it.
        """  # noqa: D205
        if self.named_there:
            return ()
        shown = ~self.open if self.verdict is Verdict.UNKNOWN else np.ones(6, dtype=bool)
        sure = [m for m in self.members if not m.alike and m.name not in self.fit.stuck]
        named = {family(m.name) for m in sure if m.by_axis[shown].sum() > SIGNIFICANCE.least_evidence}
        return tuple(n for n in self.posterior.firm if n in named)

    @property
    def classes(self) -> tuple[EquivalenceClass, ...]:
        """Sets of effects that these logs cannot tell apart, by class, heaviest first."""
        return self.posterior.classes

    @property
    def air(self) -> AirVelocity | None:
        """How the air moved, where the fit has it; one velocity for all flights."""
        return air_velocity(self.fit.values("wind"))

    @property
    def groups(self) -> tuple[tuple[str, ...], ...]:
        """For each member that has one: its name, and what these logs cannot tell from it."""
        return tuple((m.name, *(r.name for r in m.alike)) for m in self.members if m.alike)

    @property
    def separable(self) -> tuple[tuple[str, ...], ...]:
        """Groups of single effects, for which a flight can be designed."""
        known = catalogue()
        singles = [(m.name, *(r.name for r in m.alike if len(r.names) == 1 and r.name in known)) for m in self.members]
        return tuple(names for names in singles if len(names) > 1)


def explain(
    flights: Sequence[OpenFlight],
    model: Model,
    *,
    names: Sequence[str] = (),
    validation: Sequence[OpenFlight] = (),
    injections: int = 0,
    settings: SearchSettings = DEFAULT,
    jobs: int | None = None,
    progress: Progress | None = None,
) -> Explanation:
    """Find the effects that `model` is missing on flights that were opened for it.

    Among `names`, by default the catalogue; what is not tried and why is in the result. `validation` flights are not
    fitted, the result is tested on them. So many `injections` check the limits of what would have been firm, each a
    search of its own. `settings` are those of the search; `jobs` processes, by default one for each core. Raises
    ModelError for unknown names, FitError where the flights are too short, LogError where a flight is fitted and tested
    on.
    """
    report = progress or (lambda fraction, words: None)
    refuse_seen([f.flight for f in flights], [f.flight for f in validation])
    report(0.0, "timing of the topics")
    timing = tuple(timing_of(f, model) for f in flights)
    data = dataset([r for f in flights for r in f.records], model, answering_axes(timing))
    chosen = candidates(data.records, model, names)
    jobs = cores() if jobs is None else jobs
    clock, part, done = late_clock(timing), 1.0 / (1 + injections), iter(range(1 + injections))

    def search(data: Dataset) -> Explanation:
        first = part * next(done)
        told = lambda fraction, words: report(first + part * fraction, words)  # noqa: E731
        return search_dataset(data, model, chosen, clock=clock, settings=settings, jobs=jobs, progress=told)

    def firm_with(one: Injection) -> Sequence[str]:
        return search(dataset(one.into(data.records, model), model, data.answering)).firm

    found = search(data)
    again = recoveries(found.limits, found.firm, model, injections, len(data.measured), firm_with)
    tested = validate(validation, flights, model, found.model) if validation else None
    return replace(found, flights=tuple(flights), timing=timing, validation=tested, recoveries=again)


@one_thread
def search_dataset(
    data: Dataset,
    model: Model,
    chosen: Candidates,
    *,
    clock: LateClock | None = None,
    settings: SearchSettings = DEFAULT,
    jobs: int = 1,
    progress: Progress | None = None,
) -> Explanation:
    """The part of `explain` that needs no flights: search, what is left, verdict; `clock` is a late IMU's."""
    tell = progress or (lambda fraction, words: None)
    some = spread_out(data.records, SEARCH_SECONDS)
    on = model_residual(data if some is data.records else dataset(some, model, data.answering), model, settings)
    on, tried, found = _searched(on, chosen, jobs, tell)
    data = data if on.data.answering else replace(data, answering=())
    found = with_clock(found, clock, model.vehicle)
    tell(0.8, "fitting what was named")
    best, named, found = needed_members(on, found, jobs)
    every, whole = (on, best) if some is data.records else _whole(data, model, [m.name for m in named], best)
    own = {e.name: e.theta for e in model.effects}
    found = found.at({e.name: e.theta - own.get(e.name, 0.0) for e in whole.fit.effects}, model.vehicle)
    swinging = oscillation(on.data, best.left)
    bands = unexplained_bands(on, found, best.left) if named else ()
    loud = open_axes(on, best.left) | np.isin(np.arange(6), [b.axis for b in bands])
    pushing = one_rotor(on.data, model.vehicle, best.left) if loud.any() else None
    mean = one_rotor(on.data, model.vehicle, on.given - best.left) if pushing and named else None
    depends = relevance(on.data, best.left) if loud.any() and len(np.unique(on.data.block)) >= FEWEST else None
    verdict = decide(on, named, loud, swinging or pushing, depends, at_limit=best.fit.stuck)
    limits = _limits(found, named, model.vehicle, loud & (verdict is Verdict.UNKNOWN))
    failed = tuple(Untried(name, Lack.FIT, words) for name, words in tried.failed.items())
    return Explanation(
        verdict,
        named,
        tried.candidates,
        replace(found, scorer=None),
        whole.fit,
        with_fit(model, whole.fit),
        rms(every.given),
        rms(whole.left),
        data.noise,
        (*chosen.untried, *failed),
        loud,
        swinging,
        pushing,
        depends,
        concentrated(on.data, best.left),
        over_noise(on.data, best.left),
        answering=data.answering,
        bands=bands,
        named_there=bool(pushing and mean and set(pushing.rotors) & set(mean.rotors)),
        limits=limits,
    )


def _limits(
    found: Posterior, named: Sequence[Member], vehicle: Vehicle, silent: NDArray[np.bool_]
) -> tuple[DetectionLimit, ...]:
    """What would have been firm beside the members that were named, by evidence on axes that are not `silent` (6,)."""
    if found.scorer is None:
        return ()
    members, columns = {m.name for m in named}, found.scorer.spectrum.columns
    keys = tuple(k for k in found.best.scored_set.keys if set(columns[k].names) & members)
    return detection_limits(found.scorer, keys, vehicle, lambda by, some: parts_of(by, by(some), {}), silent)


def _searched(
    on: ModelResidual, chosen: Candidates, jobs: int, tell: Progress
) -> tuple[ModelResidual, SingleEffects, Posterior]:
    """Candidates by themselves and sets of them. Where commands answer the motion, on the wrench as it is too: that
    counts where a set leaves no disturbance which they could have answered.
    """  # noqa: D205
    twice = bool(on.data.answering)
    tried = single_effects(on, chosen.tried, jobs=jobs, progress=lambda f, words: tell(0.3 * f, words), twice=twice)
    if twice:
        free = without_feedback(on)
        if may_be_disturbance_free(on, free, tried.columns):
            again = single_effects(
                free, chosen.tried, jobs=jobs, progress=lambda f, words: tell(0.3 + 0.2 * f, words), twice=True
            )
            other = posterior(free, again.columns, jobs=jobs, progress=lambda f, words: tell(0.5 + 0.2 * f, words))
            if disturbance_free(on, free, other):
                return free, again, other
        on.data.starts.clear()
    found = posterior(on, tried.columns, jobs=jobs, progress=lambda f, words: tell(0.7 + 0.1 * f, words))
    return on, tried, found


def _whole(data: Dataset, model: Model, names: Sequence[str], best: Fitted) -> tuple[ModelResidual, Fitted]:
    """What was named on a part of long logs, fitted to all of them."""
    on = model_residual(data, model)
    return on, fitted(on, names, best.fit)
