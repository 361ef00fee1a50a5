"""Effects with their parameters, as sentences name them."""

from __future__ import annotations

from collections.abc import Sequence

from wrenchgap.learn.identify.fit import Fit
from wrenchgap.learn.posterior.explain import Explanation
from wrenchgap.plant.history import Value
from wrenchgap.plant.model import Model
from wrenchgap.replay.present.numbers import called, quantity, share

PROMINENT = 0.3
"""Parameters of this share of the largest, in typical sizes, are named."""
WORTH_A_WORD, UNLIKELY = 0.1, 1.5
"""Share of the error energy and t above which the best single effect is told where nothing is established."""
ALIKE, MOST_ALIKE = 0.9, 3
"""Others of that share of its score are told with it, so many in all."""


def nearest(found: Explanation, *, at_all: bool = False) -> str:
    """What would take off a good part of the error, and is not established; nothing in turbulence, which fits much, and
    nothing unlikely, except `at_all`.
    """  # noqa: D205
    fair = [c for c in found.ranking if at_all or (c.significance > UNLIKELY and not c.implausible)]
    near = [] if found.open.any() and not at_all else sorted(fair, key=lambda c: -c.score)
    if not near or near[0].score < WORTH_A_WORD:
        return ""
    best = near[0]
    alike = [c.name for c in near[1:MOST_ALIKE] if c.score > ALIKE * best.score]
    first = with_values(best.fit, found.model, best.name)
    names = " or ".join([first, *alike])
    return f"Nearest, and not established: {names}, which would take off {share(best.score)} of the error energy."


def with_values(fit: Fit, model: Model, name: str) -> str:
    """The effect with its parameters, or of many the three largest, as far as they are comparable with the largest."""
    shown: Sequence[Value] = fit.values(name)
    if len(shown) > 3:
        typical = {p.name: p.scale for owner, p in fit.parameters if owner == name}
        by_size = sorted(shown, key=lambda v: -abs(v.value) / typical[v.name])
        largest = abs(by_size[0].value) / typical[by_size[0].name]
        shown = [v for v in by_size[:3] if abs(v.value) / typical[v.name] > PROMINENT * largest]
    if not shown:
        return name
    return f"{name} ({', '.join(f'{called(v.name, model.vehicle)} {quantity(v.value, v.unit)}' for v in shown)})"
