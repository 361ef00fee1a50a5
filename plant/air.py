"""Which effects say how the air moves, and through which of the others that exerts a force."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from wrenchgap.flight.errors import ModelError
from wrenchgap.plant.effects import AirEffect, catalogue, find


def is_air(name: str) -> bool:
    """Whether an effect says how the air moves."""
    return isinstance(find(name), AirEffect)


def is_drag(name: str) -> bool:
    """Whether air that moves exerts a force through this effect even on a vehicle that stands."""
    effect = find(name)
    return effect.aerodynamic and effect.place == "wrench"


def that_act(names: Iterable[str], among: Iterable[str] = ()) -> list[str]:
    """`names` without air that moves where no effect of them, or of `among`, sees it."""
    listed = list(names)
    seen = any(find(n).aerodynamic for n in (*listed, *among))
    return [n for n in listed if seen or not is_air(n)]


def require_force(names: Sequence[str]) -> None:
    """Raise ModelError for a set in which nothing sees that the air moves."""
    for name in names:
        if name not in that_act(names):
            through = ", ".join(n for n in catalogue() if is_drag(n))
            raise ModelError(
                f"effect {name}: has no force of its own; add it together with an effect through which the air acts: "
                f"{through}"
            )
