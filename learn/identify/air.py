"""Air that moves: identified together with the effects through which it acts, never alone.

Wind has no force of its own. It enters every aerodynamic effect as v - v_w, a product with that effect's coefficients:
where those are zero the derivative with respect to v_w is zero, and where v_w is wrongly zero the coefficients are
wrong. Trying one effect at a time finds neither, so

    in a search    a drag is tried in still air and in moving air, and the air's motion is part of that candidate where
                   it predicts held-out time better by the rule that any further effect must meet (`companions`)
    in a set       air that moves stays only as long as an effect that sees it does (`plant.effects.acting_effects`)
    in a fit       where every coefficient is zero, they start at their typical sizes (`awake`)
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from wrenchgap.flight.flight import Array
from wrenchgap.plant.effects import find, is_air, is_drag
from wrenchgap.plant.history import Value
from wrenchgap.plant.vehicle import Vehicle
from wrenchgap.plant.wrench_model import ModelEffect


def companions(name: str, others: Iterable[str], names: Iterable[str]) -> tuple[str, ...]:
    """What of `names` to try together with `name` on top of `others`, each by itself.

    Air that moves, for the first drag of a set; beside a drag it is a candidate like any other.
    """
    present = tuple(others)
    if not is_drag(name) or any(is_drag(n) or is_air(n) for n in present):
        return ()
    return tuple(n for n in names if is_air(n))


def awake(values: Mapping[str, Array], fixed: Sequence[ModelEffect], vehicle: Vehicle) -> dict[str, Array]:
    """Start values by effect; typical coefficients where air that moves would see nothing but zeros.

    `fixed` are effects that are in the model and not fitted. Coefficients that may be negative (places, angles) stay.
    """
    seen = [*values.items(), *((e.name, e.theta) for e in fixed)]
    zero = not any(np.any(theta != 0.0) for name, theta in seen if find(name).aerodynamic)
    if not (zero and any(is_air(n) for n in values)):
        return dict(values)

    def start(name: str, theta: Array) -> Array:
        if not find(name).aerodynamic:
            return theta
        parameters = find(name).parameters(vehicle)
        return np.array([p.scale if p.low >= 0.0 else float(v) for p, v in zip(parameters, theta, strict=True)])

    return {name: start(name, theta) for name, theta in values.items()}


@dataclass(frozen=True)
class AirVelocity:
    """How the air moved on the flights: `wind_E` (3,) and `std` (3,) [m/s]; its vertical part is taken to be zero."""

    wind_E: Array
    std: Array


def air_velocity(wind: Sequence[Value]) -> AirVelocity | None:
    """From the fitted values of `wind`; None where there are none."""
    if not wind:
        return None
    at = {v.name: v for v in wind}
    horizontal = [at[f"velocity_{axis}"] for axis in "xy"]
    spread = [0.0 if v.std is None else v.std for v in horizontal]
    return AirVelocity(np.array([*(v.value for v in horizontal), 0.0]), np.array([*spread, 0.0]))
