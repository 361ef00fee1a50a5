"""Which effects are tried: the one place that decides it.

Of the catalogue, or of the names that a user gave, an effect is tried unless

    the model has it already, in one of its forms   it is then fitted together with every candidate
    it needs what model or logs lack                `learn.data.applicable.inapplicable`
    the flights cannot show it                      `learn.data.applicable.unexcited`: never that fast, that low ...
    it is air that moves, and no effect through         alone it has no force (`plant.air`)
    which the air acts is tried or in the model
    it is one of time, and on most axes of every    a lag found there would be the controller's own phase
    flight the commands answer the motion           (`learn.diagnose.response`); not where a user asked for it by name
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from wrenchgap.flight.offsets import Problem
from wrenchgap.learn.data.applicable import Lack, Untried, inapplicable, unexcited
from wrenchgap.learn.data.measurement import Record
from wrenchgap.learn.diagnose.timing import FlightTiming
from wrenchgap.plant.air import that_act
from wrenchgap.plant.effects import catalogue, family
from wrenchgap.plant.model import Model

LAGS = ("servo_lag", "motor_lag", "asymmetric_motor_lag", "command_delay", "backlash")
"""Effects that show in when, not in how much: where commands answer the motion they are not identifiable."""
FEEDBACK_AXES = 3
"""Axes on which the commands answer the motion, from which on a flight says nothing about lags and delays; all of them
where fewer were measured."""


@dataclass(frozen=True)
class Candidates:
    """Names to try, and what is not tried with the reason."""

    tried: tuple[str, ...]
    untried: tuple[Untried, ...]


def candidates(
    records: Sequence[Record], model: Model, names: Sequence[str] = (), timing: Sequence[FlightTiming] = ()
) -> Candidates:
    """The effects to try on these records, among `names` where there are any. Raises ModelError for unknown names."""
    present = {e.name for e in model.effects}
    taken = present if names else {n for n in catalogue() if family(n) in {family(p) for p in present}}
    wanted = [n for n in (names or catalogue()) if n not in taken]
    barred = {} if names else {u.effect: u for u in feedback_dominated(timing)}
    reasons = {n: barred.get(n) or inapplicable(n, model, records) or unexcited(n, model, records) for n in wanted}
    order = [*(n for n in barred if n in reasons), *(n for n in wanted if n not in barred)]
    tried = [n for n in wanted if reasons[n] is None]
    acting = that_act(tried, [e.name for e in model.effects])
    reasons |= {n: Untried(n, Lack.AIR) for n in tried if n not in acting}
    untried = tuple(u for n in order if (u := reasons[n]) is not None)
    return Candidates(tuple(acting), untried)


def feedback_dominated(timing: Sequence[FlightTiming]) -> tuple[Untried, ...]:
    """Effects of time that these flights cannot identify; none where one flight can."""
    details = []
    for flight in timing:
        axes = [r.axis for r in flight.responses if r.offset.problem is Problem.FEEDBACK]
        if len(axes) < max(1, min(FEEDBACK_AXES, len(flight.responses))):
            return ()
        details.append(f"{flight.flight}: on {', '.join(axes)}")
    return tuple(Untried(name, Lack.FEEDBACK, details[0]) for name in LAGS) if details else ()
