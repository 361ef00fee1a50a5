"""What a user may call to ask what differs between flights; the rest of what may be called is in `replay.api`."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from wrenchgap.learn.data.opening import Flights, listed
from wrenchgap.learn.identify import trend as trending
from wrenchgap.learn.identify.add import Addition, model_of
from wrenchgap.learn.identify.trend import Trend
from wrenchgap.plant.model import Model


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
    return trending.trend(listed(flights), model_of(model), effects, progress=progress)
