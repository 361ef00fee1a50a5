"""An effect added to flights as measured: whether a search finds it again at the size that its limit states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from wrenchgap.flight.flight import Array
from wrenchgap.learn.data.dataset import Dataset, dataset
from wrenchgap.learn.posterior.detection_limits import DetectionLimit
from wrenchgap.plant.effects import find
from wrenchgap.plant.model import Model
from wrenchgap.plant.vehicle import Vehicle
from wrenchgap.plant.wrench_model import ModelEffect

SHARES = (1.0, 0.5)
"""Of its limit at which an effect is injected, in turn: there it should be firm; at half of it, no other should be."""


@dataclass(frozen=True)
class Recovery:
    """What the search said of flights with an effect injected at `share` of its limit: whether it was `firm`, and other
    names that were, and are not without it.
    """  # noqa: D205

    effect: str
    parameter: str
    unit: str
    size: float
    share: float
    firm: bool
    others: tuple[str, ...]

    @property
    def as_stated(self) -> bool:
        """Whether it was firm where it should be, and no other name was."""
        return not self.others and (self.firm or self.share < 1.0)


def injected_limits(limits: Sequence[DetectionLimit], number: int, seed: int) -> list[tuple[DetectionLimit, float]]:
    """Limits and shares of them to inject: every limit at all `SHARES`, in an order drawn by lot."""
    order = np.random.default_rng(seed).permutation([k for k, limit in enumerate(limits) if limit.shown])
    return [(limits[k], share) for k in order for share in SHARES][:number]


def change_at(limit: DetectionLimit, share: float, vehicle: Vehicle) -> Array:
    """Parameters (P,) of the effect at a share of a limit; of those that do nothing by themselves where fits begin."""
    parameters = find(limit.effect).parameters(vehicle)
    change = np.array([0.0 if p.alone else p.start for p in parameters])
    change[[p.name for p in parameters].index(limit.parameter)] = share * limit.size
    return change


def added_by(data: Dataset, model: Model, name: str, change: Array) -> Array:
    """Measured wrench (K, 6) that the effect adds to what `model` predicts, when its parameters change by (P,)."""
    own = next((e.theta for e in model.effects if e.name == name), np.zeros(len(change)))
    others = tuple(e for e in model.effects if e.name != name)
    changed = model.with_effects((*others, ModelEffect(find(name), own + change)))
    return data.predict(changed.wrench_model) - data.predict(model.wrench_model)


def injected(data: Dataset, model: Model, name: str, change: Array) -> Dataset:
    """The same flights with that in what they measured; commands and motion are as they were."""
    added = np.split(added_by(data, model, name, change), np.cumsum([len(r) for r in data.records])[:-1])
    records = [replace(r, measured=r.measured + own) for r, own in zip(data.records, added, strict=True)]
    return dataset(records, model, data.answering)
