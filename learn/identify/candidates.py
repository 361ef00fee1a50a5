"""Which effects are tried: the one place that decides it.

Of the catalogue, or of the names that a user gave, an effect is tried unless

    the model has another form of it
    it needs what model or logs lack                `learn.data.applicable.inapplicable`
    the flights cannot show it                      `learn.data.applicable.unexcited`: never that fast, that low ...
    the model file knows what it is about           `plant.effects.effect.Effect.known`: a mass that was weighed
    it is air that moves, and no effect through         alone it has no force (`plant.air`)
    which the air acts is tried or in the model
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from wrenchgap.learn.data.applicable import Lack, Untried, inapplicable, unexcited
from wrenchgap.learn.data.measurement import Record
from wrenchgap.plant.air import that_act
from wrenchgap.plant.effects import catalogue, family, find
from wrenchgap.plant.model import Model


@dataclass(frozen=True)
class Candidates:
    """Names to try, and what is not tried with the reason."""

    tried: tuple[str, ...]
    untried: tuple[Untried, ...]


def candidates(records: Sequence[Record], model: Model, names: Sequence[str] = ()) -> Candidates:
    """The effects to try on these records, among `names` where there are any.

    What the model has already is tried as a change of its values. Raises ModelError for unknown names.
    """
    present = {e.name for e in model.effects}
    taken = {n for n in catalogue() if family(n) in {family(p) for p in present}} - present
    wanted = [n for n in (names or catalogue()) if n not in taken]
    reasons = {n: inapplicable(n, model, records) or unexcited(n, model, records) for n in wanted}
    reasons |= {n: _known(n, model) for n in wanted if reasons[n] is None and n not in present}
    tried = [n for n in wanted if reasons[n] is None]
    acting = that_act(tried, [e.name for e in model.effects])
    reasons |= {n: Untried(n, Lack.AIR) for n in tried if n not in acting}
    untried = tuple(u for n in wanted if (u := reasons[n]) is not None)
    return Candidates(tuple(acting), untried)


def _known(name: str, model: Model) -> Untried | None:
    why = find(name).known(model.vehicle)
    return None if why is None else Untried(name, Lack.KNOWN, why)
