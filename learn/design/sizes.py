"""How large an effect is taken to be when a flight is designed: as in the model, as fitted, or typical."""

from __future__ import annotations

import numpy as np

from wrenchgap.plant.effects import find
from wrenchgap.plant.model import Model
from wrenchgap.plant.wrench_model import ModelEffect


def absent(name: str, base: Model) -> ModelEffect:
    """An effect that is not there."""
    effect = find(name)
    return ModelEffect(effect, np.zeros(len(effect.parameters(base.vehicle))))


def typical(name: str, model: Model) -> ModelEffect:
    """An effect of typical size: `Parameter.scale`, signs in turn where both are plausible.

    One number that may have either sign is taken negative: rotors lose thrust more often than they gain it. Of an
    effect that is sparse (one weak rotor of twelve) only the first parameter, twice its scale.
    """
    effect = find(name)
    parameters = effect.parameters(model.vehicle)
    signs = [1.0 if p.low >= 0.0 or k % 2 == 0 else -1.0 for k, p in enumerate(parameters)]
    if len(parameters) == 1 and parameters[0].low == -parameters[0].high:
        signs = [-1.0]
    theta = np.array([s * p.scale for s, p in zip(signs, parameters, strict=True)])
    if effect.sparse:
        first = parameters[0]
        theta = np.zeros(len(parameters))
        theta[0] = 2.0 * first.scale * (-1.0 if abs(first.low) > abs(first.high) else 1.0)
    return ModelEffect(effect, np.clip(theta, [p.low for p in parameters], [p.high for p in parameters]))
