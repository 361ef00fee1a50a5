"""Which physical effect is missing: candidates of the catalogue, ranked by the error they leave on held-out blocks.

From opened flights to a verdict, in the order of the steps (docs/theory/posterior.md):

    timing, dataset         offsets of the topics; records cut into blocks         `learn.diagnose`, `learn.data`
    candidates              effects to try on these flights                        `learn.data.candidates`
    model_residual          what the model leaves                                  `learn.posterior.single_effects`
    single_effects          each candidate fitted alone, and as a straight line    the same, `columns`
    joint_search            sets of candidates, searched, linearised, weighed      `joint_search`, `subset_search`
    with_sensor_causes      a delay or a mass may be a sensor of the IMU           `sensor_causes`
    needed_members          the likeliest set fitted; those that are not needed go `members`
    residual_structure      what the named set leaves                              `verdict`
    decide                  the verdict                                            the same
    posterior               probabilities, classes, bench checks                   `posterior`
    detection_limits        what these flights could have shown beside it          `detection_limits`

Two measures, both on held-out blocks:

    energy    sum_l (w_l r_l)^2, newtons and newton metres on one scale (w of `learn.data.dataset.Dataset`): what a user
              sees; orders candidates and members. score = 1 - energy left / energy of the model as given
    evidence  sum_l log(rms_l before / rms_l after): scale-free, so that a small axis counts too; what is named
              has some, beyond chance in a paired test over blocks (docs/decisions/0006-blocks.md)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from wrenchgap.flight.arguments import Progress, part_of, silent
from wrenchgap.flight.flight import Array
from wrenchgap.flight.repeats import refuse_seen
from wrenchgap.flight.result import Result
from wrenchgap.learn.data.blocks import SIGNIFICANCE
from wrenchgap.learn.data.candidates import Candidates, Lack, Untried, candidates
from wrenchgap.learn.data.comparison import Validation, validate
from wrenchgap.learn.data.dataset import Dataset, dataset, spread_out
from wrenchgap.learn.data.errors import reduction, rms
from wrenchgap.learn.data.opening import OpenFlight
from wrenchgap.learn.diagnose.timing import FlightTiming, answering_axes, timing_of
from wrenchgap.learn.identify.air import AirVelocity, air_velocity
from wrenchgap.learn.identify.bias_and_trim import (
    FlightsApart,
    GrantedTrim,
    flights_apart,
    granted_trims,
    unclear_constant,
)
from wrenchgap.learn.identify.fit import Fit, with_fit
from wrenchgap.learn.identify.least_squares import left_by
from wrenchgap.learn.parallel import cores, one_thread
from wrenchgap.learn.posterior.detection_limits import DetectionLimit, detection_limits
from wrenchgap.learn.posterior.disturbance_free import disturbance_free, may_be_disturbance_free, without_feedback
from wrenchgap.learn.posterior.injection import Injection, Recovery, recoveries, with_injection
from wrenchgap.learn.posterior.joint_search import FEW, joint_search
from wrenchgap.learn.posterior.members import Member, fitted, needed_members
from wrenchgap.learn.posterior.posterior import EquivalenceClass, Posterior, WeighedSets, posterior
from wrenchgap.learn.posterior.relinearisation import spectrum_of
from wrenchgap.learn.posterior.sensor_causes import SensorCause, sensor_causes, with_sensor_causes
from wrenchgap.learn.posterior.settings import DEFAULT, SearchSettings
from wrenchgap.learn.posterior.single_effects import (
    Candidate,
    ModelResidual,
    SingleEffects,
    model_residual,
    single_effects,
)
from wrenchgap.learn.posterior.subset_search import ordered, searched
from wrenchgap.learn.posterior.verdict import ResidualStructure, Verdict, decide, residual_structure
from wrenchgap.plant.effects import catalogue, family
from wrenchgap.plant.model import Model

SEARCH_SECONDS = 200.0
"""Most flight time that candidates are tried on [s]; of longer logs, pieces spread over all of it. What is chosen is
then fitted to everything."""


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
    report = progress or silent
    refuse_seen([f.flight for f in flights], [f.flight for f in validation])
    report(0.0, "timing of the topics")
    timing = tuple(timing_of(f, model) for f in flights)
    data = dataset([r for f in flights for r in f.records], model, answering_axes(timing))
    chosen = candidates(data.records, model, names)
    jobs = cores() if jobs is None else jobs
    causes, part = sensor_causes([f.flight for f in flights], timing), 1.0 / (1 + injections)
    done = iter(range(1 + injections))

    def search(data: Dataset, limits_of: Sequence[str] | None = None) -> Explanation:
        first = part * next(done)
        told = part_of(report, first, first + part)
        return search_dataset(
            data, model, chosen, causes=causes, settings=settings, jobs=jobs, progress=told, limits_of=limits_of
        )

    def firm_with(one: Injection) -> Sequence[str]:
        return search(dataset(one.into(data.records, model), model, data.answering), limits_of=()).firm

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
    causes: Sequence[SensorCause] = (),
    settings: SearchSettings = DEFAULT,
    jobs: int = 1,
    progress: Progress | None = None,
    limits_of: Sequence[str] | None = None,
) -> Explanation:
    """The steps of `explain` that need no flights; `causes` is what their sensors may do that looks like effects.

    `limits_of` are the effects whose detection limits are wanted, by default all: they take most of the time.
    """
    tell = progress or silent
    some = spread_out(data.records, SEARCH_SECONDS)
    part = data if some is data.records else dataset(some, model, data.answering)
    on, tried, found = weighed_sets(model_residual(part, model, settings), chosen.tried, jobs, tell)
    found = with_sensor_causes(found, causes, model.vehicle)
    tell(0.8, "fitting what was named")
    best, members, found = needed_members(on, found, jobs)
    rest = residual_structure(on, found, members, best.left)
    verdict = decide(on, members, rest, at_limit=best.fit.stuck)
    data = data if on.data.answering else replace(data, answering=())
    every = on if some is data.records else model_residual(data, model)
    whole = best if every is on else fitted(every, [m.name for m in members], best.fit)
    found = found.at({e.name: e.theta - model.theta(e.name) for e in whole.fit.effects})
    named = {m.name for m in members}
    keys = tuple(k for k in found.best.scored_set.keys if set(found.scorer.spectrum.columns[k].names) & named)
    left, unsure = left_by(data, with_fit(model, whole.fit)), rest.open & (verdict is Verdict.UNKNOWN)
    constant = whole.fit.values("constant_wrench")
    flown = with_injection(on, found.scorer) if on.data.answering else None
    limits = detection_limits(found.scorer, keys, model.vehicle, silent=unsure, of=limits_of, flown=flown)
    return Explanation(
        verdict=verdict,
        members=members,
        ranking=tried.candidates,
        posterior=posterior(found.sets, found.classes, model.vehicle, settings, [c.check for c in causes]),
        fit=whole.fit,
        model=with_fit(model, whole.fit),
        rms_before=rms(every.given),
        rms_after=rms(whole.left),
        noise=data.noise,
        untried=(*chosen.untried, *(Untried(name, Lack.FIT, words) for name, words in tried.failed.items())),
        answering=data.answering,
        apart=flights_apart(data, left, model),
        granted=granted_trims(data, left + unclear_constant(constant), left_by(data, model), model),
        given={e.name: e.theta for e in model.effects},
        limits=limits,
        **vars(rest),
    )


def weighed_sets(
    on: ModelResidual, names: Sequence[str], jobs: int, tell: Progress
) -> tuple[ModelResidual, SingleEffects, WeighedSets]:
    """Candidates by themselves and sets of them. Where commands answer the motion, on the wrench as it is too: that
    counts where a set leaves no disturbance which they could have answered.
    """  # noqa: D205
    twice = bool(on.data.answering)
    tried = single_effects(on, names, jobs=jobs, progress=part_of(tell, 0.0, 0.3), twice=twice)
    if twice:
        free = without_feedback(on)
        if may_be_disturbance_free(on, free, tried.columns):
            again = single_effects(free, names, jobs=jobs, progress=part_of(tell, 0.3, 0.5), twice=True)
            lines = searched(spectrum_of(free, again.columns), jobs)
            if disturbance_free(on, free, ordered(lines)[:FEW], nearly=True):
                other = joint_search(free, lines, jobs=jobs, tell=part_of(tell, 0.5, 0.7))
                # at its limit a law is another one, and may hide what commands answered
                within = [one.scored for one in other.wholes if not any(p.stuck for p in one.parts)]
                if disturbance_free(on, free, within):
                    return free, again, other
        on.data.starts.clear()
    lines = searched(spectrum_of(on, tried.columns), jobs)
    return on, tried, joint_search(on, lines, jobs=jobs, tell=part_of(tell, 0.7, 0.8))


@dataclass(frozen=True, repr=False)
class Explanation(ResidualStructure, Result):
    """What is missing, according to the logs. `rms_*` are (6,) held-out; `noise` (6,) is the sensor noise.

    `effects` are the members' names, that with the largest share of the error first; `ranking` has every candidate by
    itself. `posterior` weighs the sets. `timing` is that of each of `flights`; `validation` the test on flights that
    were not fitted, where some were given; `answering` are the axes on which commands answered a disturbance.
    `limits` say what these flights could have shown beside what is named, `recoveries` what was found again of it.
    `apart` are axes on which the flights do not agree on a constant, the farthest first; `granted` those on which they
    share one that the model's scatter between flights allows. `given` are the effects that the model had, (P,) by name.
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
    flights: tuple[OpenFlight, ...] = ()
    timing: tuple[FlightTiming, ...] = ()
    validation: Validation | None = None
    answering: tuple[int, ...] = ()
    limits: tuple[DetectionLimit, ...] = ()
    recoveries: tuple[Recovery, ...] = ()
    apart: tuple[FlightsApart, ...] = ()
    granted: tuple[GrantedTrim, ...] = ()
    given: Mapping[str, Array] = field(default_factory=dict)

    @property
    def reduction(self) -> Array:
        """Fraction (6,) of the rms on held-out time that is gone."""
        return reduction(self.rms_before, self.rms_after)

    def changes(self, name: str) -> dict[str, float]:
        """By parameter, a fitted value less that of the given model, which is zero where it lacks the effect."""
        values = self.fit.values(name)
        own = self.given.get(name, np.zeros(len(values)))
        return {v.name: float(v.value - before) for v, before in zip(values, own, strict=True)}

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
        which comes and goes, that takes nothing off the error, or whose evidence is all on axes that are open: what is
        left there may have made it. None at all where what explains most is at its limit: the others were fitted beside
        a law that is another one.
        """  # noqa: D205
        if self.named_there or not self.fit.stuck.isdisjoint(self.effects[:1]):
            return ()
        shown = ~self.open if self.verdict is Verdict.UNKNOWN else np.ones(6, dtype=bool)
        sure = [m for m in self.members if not m.alike and m.name not in self.fit.stuck and m.share > 0.0]
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
        """For each member, or several that go together: its name, and what these logs cannot tell from it."""
        alike = dict.fromkeys((r.place, r.name) for m in self.members for r in m.alike)
        return tuple((own, *(r for o, r in alike if o == own)) for own in dict.fromkeys(o for o, _ in alike))

    @property
    def separable(self) -> tuple[tuple[str, ...], ...]:
        """Groups of single effects, for which a flight can be designed."""
        known = catalogue()
        singles = [tuple(n for n in group if n in known) for group in self.groups if group[0] in known]
        return tuple(names for names in singles if len(names) > 1)
