"""Which physical effect is missing: candidates of the catalogue, ranked by the error they leave on held-out blocks.

`explain` is the one way from opened flights to a verdict: timing, the effects to try (`learn.identify.candidates`), the
search for the set (`learn.identify.search`), what that set leaves, and the verdict. Two measures, both on held-out
blocks:

    energy    sum_l (w_l r_l)^2, newtons and newton metres on one scale (w of `learn.data.dataset.Dataset`): what a user
              sees; orders the candidates. score = 1 - energy left / energy of the model as given
    evidence  sum_l log(rms_l before / rms_l after): scale-free, so that a small axis counts too; decides whether an
              effect is there at all, with a paired test over blocks (docs/decisions/0006-blocks.md)

What a verdict needs (`_verdict`):

    unknown   force or torque stay above `LOUD` times the noise and above the share `UNEXPLAINED` of what they were, the
              worst `UNUSUAL` of the time left aside; or an oscillation is found in what is left
    nothing   no effect was named
    group     another effect would do as well in the place of the largest member
    effect    else
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.result import Result
from wrenchgap.learn.data.applicable import Lack, Untried
from wrenchgap.learn.data.blocks import by_block
from wrenchgap.learn.data.dataset import Dataset, dataset, spread_out
from wrenchgap.learn.data.errors import energy, force_and_torque, reduction, rms, weighted
from wrenchgap.learn.data.opening import OpenFlight
from wrenchgap.learn.diagnose.relevance import Relevance, relevance
from wrenchgap.learn.diagnose.resonance import Oscillation, oscillation
from wrenchgap.learn.diagnose.timing import FlightTiming, timing_of
from wrenchgap.learn.identify.air import AirVelocity, air_velocity
from wrenchgap.learn.identify.candidates import Candidates, candidates
from wrenchgap.learn.identify.confidence import confidence
from wrenchgap.learn.identify.fit import Fit, with_fit
from wrenchgap.learn.identify.search import Candidate, Member, Search, Step
from wrenchgap.learn.identify.validation import Validation, validate
from wrenchgap.learn.parallel import cores
from wrenchgap.plant.model import Model

Array = NDArray[np.float64]
Progress = Callable[[float, str], None]


class Verdict(StrEnum):
    """What the flights show to be missing; see the module."""

    EFFECT = "effect"
    GROUP = "group"
    UNKNOWN = "unknown"
    NOTHING = "nothing"


SEARCH_SECONDS = 200.0
"""Most flight time that candidates are tried on [s]; of longer logs, pieces spread over all of it. What is chosen is
then fitted to everything."""

LOUD, UNEXPLAINED = 2.5, 0.25
"""Structure is left where the rms of force or torque stays above this many times the noise and this share of what it
was."""
QUIET = 1.5
"""Rms over the noise below which nothing is looked for in what is left."""
UNUSUAL = 0.1
"""Share of the time, the worst, that a verdict disregards."""
FEWEST = 5
"""Blocks of time below which nothing is said about what the rest depends on."""


@dataclass(frozen=True, repr=False)
class Explanation(Result):
    """What is missing, according to the logs. `rms_*` are (6,) held-out; `noise` (6,) is the sensor noise.

    `effects` are the members' names, that with the largest share of the error first; `steps` the trace of the forward
    search. `oscillation` is one found in the residual; `depends` says on what that depends, where the verdict is
    "unknown"; `concentrated` is the share of the residual that sits in the worst tenth of the time; `left` is its rms
    over that of the noise, the worse of force and torque. `timing` is that of each of `flights`; `validation` the test
    on flights that were not fitted, where some were given.
    """

    verdict: Verdict
    members: tuple[Member, ...]
    steps: tuple[Step, ...]
    fit: Fit
    model: Model
    rms_before: Array
    rms_after: Array
    noise: Array
    untried: tuple[Untried, ...]
    dropped: tuple[str, ...]
    oscillation: Oscillation | None
    depends: Relevance | None
    concentrated: float
    left: float
    flights: tuple[OpenFlight, ...] = ()
    timing: tuple[FlightTiming, ...] = ()
    validation: Validation | None = None

    @property
    def reduction(self) -> Array:
        """Fraction (6,) of the rms on held-out time that is gone."""
        return reduction(self.rms_before, self.rms_after)

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the members."""
        return tuple(m.name for m in self.members)

    def confidence(self, member: Member) -> float:
        """How often a name with this much evidence is right (`learn.identify.confidence`)."""
        return confidence(member, self.left, self.verdict is Verdict.UNKNOWN)

    @property
    def air(self) -> AirVelocity | None:
        """How the air moved, where the fit has it; one velocity for all flights."""
        return air_velocity(self.fit.values("wind"))

    @property
    def groups(self) -> tuple[tuple[str, ...], ...]:
        """For each member that has one: its name, and what these logs cannot tell from it."""
        return tuple((m.name, *(r.name for r in m.alike)) for m in self.members if m.alike)

    @property
    def full(self) -> bool:
        """Whether the search took as many effects as it may, and more might be there."""
        return bool(self.steps) and self.steps[-1].chosen is not None

    @property
    def ranking(self) -> tuple[Candidate, ...]:
        """All candidates of the first step, best first."""
        return self.steps[0].candidates if self.steps else ()


def explain(
    flights: Sequence[OpenFlight],
    model: Model,
    *,
    names: Sequence[str] = (),
    validation: Sequence[OpenFlight] = (),
    most: int = 4,
    jobs: int | None = None,
    progress: Progress | None = None,
) -> Explanation:
    """Find the effects that `model` is missing on flights that were opened for it, at most `most` of them.

    Among `names`, by default the catalogue; what is not tried and why is in the result. `validation` flights are not
    fitted, the result is tested on them. `jobs` processes, by default one for each core. Raises ModelError for unknown
    names, FitError where the flights are too short.
    """
    report = progress or (lambda fraction, words: None)
    report(0.0, "timing of the topics")
    timing = tuple(timing_of(f, model) for f in flights)
    data = dataset([r for f in flights for r in f.records], model)
    chosen = candidates(data.records, model, names, timing)
    found = search_dataset(data, model, chosen, most=most, jobs=cores() if jobs is None else jobs, progress=report)
    tested = validate(validation, flights, model, found.model) if validation else None
    return replace(found, flights=tuple(flights), timing=timing, validation=tested)


def search_dataset(
    data: Dataset,
    model: Model,
    chosen: Candidates,
    *,
    most: int = 4,
    jobs: int = 1,
    progress: Progress | None = None,
) -> Explanation:
    """The part of `explain` that needs no flights: search, what is left, verdict."""
    some = spread_out(data.records, SEARCH_SECONDS)
    part = data if some is data.records else dataset(some, model)
    search = Search(part, model, chosen.tried, progress, jobs)
    members = search.run(most)
    whole = search if part is data else Search(data, model, chosen.tried, progress)
    if whole is not search:
        whole.take([m.name for m in members], search.fit)
    named = {m.name for m in members}
    left = part, search.current
    swinging = oscillation(*left) if _over_noise(*left) > QUIET else None
    verdict = _verdict(members, part, search.given, search.current, swinging)
    failed = tuple(Untried(name, Lack.FIT, words) for name, words in search.failed.items())
    return Explanation(
        verdict,
        members,
        tuple(search.steps),
        whole.fit,
        with_fit(model, whole.fit),
        rms(whole.given),
        rms(whole.current),
        data.noise,
        (*chosen.untried, *failed),
        tuple(dict.fromkeys(s.chosen for s in search.steps if s.chosen and s.chosen not in named)),
        swinging,
        relevance(*left) if verdict is Verdict.UNKNOWN and len(np.unique(part.block)) >= FEWEST else None,
        _concentrated(*left),
        _over_noise(*left),
    )


def _concentrated(data: Dataset, residual: Array) -> float:
    """Share of the energy that sits in the worst tenth of the time."""
    usual = residual[_usual(data, residual)]
    return 1.0 - energy(usual, data.weights) / max(energy(residual, data.weights), 1e-30)


def _usual(data: Dataset, residual: Array) -> NDArray[np.bool_]:
    """Samples (K,) outside the tenth of the blocks with the largest residual: one gust or touch is no verdict."""
    loud = by_block(data.block, np.sum(weighted(residual, data.weights) ** 2, axis=1))
    return np.asarray(loud[data.block] <= np.quantile(loud, 1.0 - UNUSUAL, method="lower"))


def _over_noise(data: Dataset, residual: Array) -> float:
    """The residual over the noise, the worse of force and torque."""
    return float(np.nanmax(force_and_torque(rms(residual)) / force_and_torque(data.noise)))


def _verdict(
    members: Sequence[Member], data: Dataset, given: Array, current: Array, swinging: Oscillation | None
) -> Verdict:
    """Unknown where force or torque stay well above the noise and above a quarter of what they were, or swing."""
    usual = _usual(data, current)
    before, after = force_and_torque(rms(given[usual])), force_and_torque(rms(current[usual]))
    noise = force_and_torque(data.noise)
    if swinging is not None or np.any((after > LOUD * noise) & (after > UNEXPLAINED * before)):
        return Verdict.UNKNOWN
    if not members:
        return Verdict.NOTHING
    return Verdict.GROUP if members[0].alike else Verdict.EFFECT
