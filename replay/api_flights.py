"""Public functions that ask what differs between flights; the others are in `replay.api`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from wrenchgap.flight.arguments import check_arguments
from wrenchgap.learn.changed import changed as changing
from wrenchgap.learn.changed.changed import Changed
from wrenchgap.learn.data.opening import Flights, listed
from wrenchgap.learn.identify import trend as trending
from wrenchgap.learn.identify.add import Addition, model_of
from wrenchgap.learn.identify.trend import Trend
from wrenchgap.plant.model import Model


@check_arguments
def changed(
    suspects: Flights,
    healthy: Flights,
    model: Model | Addition,
    *,
    names: Sequence[str] = (),
    injections: int = 0,
    jobs: int | None = None,
    progress: Callable[[float, str], None] | None = None,
) -> Changed:
    """What changed on suspect flights against healthy ones of the same vehicle, where on it, and what to inspect.

    What the model is wrong by in all of them drops out. Among `names`, by default the whole catalogue; so many
    `injections` of changes at the limits of what would have been shown check these; `jobs` processes, by default one
    for each core.
    """
    asked: Any = {"names": names, "injections": injections, "jobs": jobs, "progress": progress}
    return changing.changed(listed(suspects), listed(healthy), model_of(model).without_tolerances, **asked)


@check_arguments
def trend(
    flights: Flights,
    model: Model | Addition,
    effects: Sequence[str] = (),
    *,
    progress: Callable[[float, str], None] | None = None,
) -> Trend:
    """Each flight fitted by itself, in the order given, and which parameters stepped or drifted over the flights.

    `effects` are fitted, by default those of the model, else `thrust_scale` and `com_offset`.
    """
    return trending.trend(listed(flights), model_of(model).without_tolerances, effects, progress=progress)
