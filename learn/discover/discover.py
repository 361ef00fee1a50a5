"""From what the catalogue leaves to a law: searched, held against chance, held out, and told with what is like it.

explain      what the catalogue says; where it leaves nothing, there is no law to look for
evidence     what atoms would make on these flights, named effects projected out       `evidence`
steps        the atom that gains most, if that is more than chance gains; again on what it leaves      `search`
laws         of each: what is like it, whether halves of the time find it again, whether parts agree
fitted       the laws as effects of their own, with what was named, as `add` fits them; held out by time or flight
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

from wrenchgap.flight.arguments import Progress, part_of, silent
from wrenchgap.flight.flight import Array
from wrenchgap.flight.result import Result
from wrenchgap.learn.data.dataset import Dataset, dataset, spread_out
from wrenchgap.learn.data.opening import OpenFlight
from wrenchgap.learn.discover.residual import Fitted, FoundAtom, HeldOut, Law, Residual
from wrenchgap.learn.discover.settings import SETTINGS
from wrenchgap.learn.parallel import one_thread
from wrenchgap.learn.posterior.explain import SEARCH_SECONDS, Explanation, explain
from wrenchgap.learn.posterior.verdict import Verdict
from wrenchgap.plant.model import Model


class Outcome(StrEnum):
    """What was found."""

    LAW = "law"
    DEPENDS = "depends"
    NOTHING = "nothing"


@dataclass(frozen=True, repr=False)
class Discovery(Result):
    """What is said of what the catalogue leaves.

    `rms_before`, `rms_after` (6,) are of what the named effects leave, and of what the laws leave, on time or flights
    that the laws were not fitted to, `held_out` says which; `noise` (6,) is the sensors'. `energy_reduction` is the
    share of the energy above that noise which the laws take off, `regression_reduction`
    that of the residual's variance which regressions on all logged quantities take off. `rejected` are formulas that
    were found and did not hold, `depends` the quantities on which what is left depends (`learn.diagnose.relevance`), of
    `tried` laws. `source` is the effect file of the laws, and of those that predict the same.
    """

    outcome: Outcome
    explanation: Explanation
    laws: tuple[Law, ...]
    rejected: tuple[str, ...]
    depends: tuple[str, ...]
    rms_before: Array
    rms_after: Array
    noise: Array
    energy_reduction: float
    regression_reduction: float
    held_out: str
    tried: int
    source: str


@one_thread
def discover(
    flights: Sequence[OpenFlight],
    model: Model,
    *,
    validation: Sequence[OpenFlight] = (),
    explanation: Explanation | None = None,
    jobs: int | None = None,
    progress: Progress | None = None,
) -> Discovery:
    """Look for the law of what the catalogue cannot name on these flights.

    `validation` flights are not fitted; the laws are tested on them, else on quarters of the time in turn.
    `explanation` is that of these flights, where it is known. Raises as `explain` does.
    """
    tell = progress or silent
    if explanation is None:
        part = part_of(tell, 0.0, 0.6)
        explanation = explain(flights, model, validation=validation, jobs=jobs, progress=part)
    records = spread_out(tuple(r for f in flights for r in f.records), SEARCH_SECONDS)
    data = dataset(records, model, explanation.answering)
    if explanation.verdict is not Verdict.UNKNOWN and not explanation.open.any():
        left = explanation.rms_after
        return Discovery(Outcome.NOTHING, explanation, (), (), (), left, left, data.noise, 0.0, 0.0, "", 0, "")
    tell(0.6, "laws on the wrench as it is")
    if not data.answering:
        return _laws(data, model, explanation, validation)
    free = _laws(data.unanswering(), model, explanation, validation)
    if free.outcome is Outcome.LAW:
        return free
    tell(0.8, "laws on what commands did not answer")
    found = _laws(data, model, explanation, validation)
    return found if found.laws else replace(found, rejected=tuple(dict.fromkeys((*free.rejected, *found.rejected))))


def _laws(data: Dataset, model: Model, explanation: Explanation, validation: Sequence[OpenFlight]) -> Discovery:
    """Search, fit and test laws on these data."""
    on = Residual(data, model, explanation)
    steps = on.steps()
    fitted = Fitted(on, [s for s in steps if s.holds])
    while unsure := {s.name for s in fitted.steps if fitted.fit.from_nothing(s.name) < SETTINGS.sure}:
        fitted = Fitted(on, [s for s in fitted.steps if s.name not in unsure])
    return _result(on, steps, fitted, fitted.on_flights(validation) if validation else fitted.on_time())


def _result(on: Residual, steps: Sequence[FoundAtom], fitted: Fitted, tested: HeldOut) -> Discovery:
    """The verdict: a law that was found and holds, and takes off much of what is left."""
    depends = on.explanation.depends
    chosen = tuple(g.label for g in depends.chosen) if depends is not None else ()
    good = fitted.steps if tested.energy_reduction >= SETTINGS.energy_reduction else ()
    return Discovery(
        outcome=Outcome.LAW if good else Outcome.DEPENDS if chosen or steps else Outcome.NOTHING,
        explanation=on.explanation,
        laws=tuple(fitted.law(s) for s in good),
        rejected=tuple(s.formula for s in steps if s not in good),
        depends=chosen,
        rms_before=tested.before,
        rms_after=tested.after,
        noise=on.data.noise,
        energy_reduction=tested.energy_reduction,
        regression_reduction=float(depends.explained) if depends is not None else 0.0,
        held_out=tested.where,
        tried=len(on.first.atoms),
        source=fitted.source if good else "",
    )
