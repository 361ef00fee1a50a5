"""What predicts the measured wrench of a record: a model, with a process on top where there is one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from wrenchgap.flight.flight import Array
from wrenchgap.learn.data.applicable import Untried, inapplicable
from wrenchgap.learn.data.inputs import process_inputs
from wrenchgap.learn.data.measurement import Record, predict
from wrenchgap.plant.mismatch import MismatchModel, output_indices
from wrenchgap.plant.model import Model
from wrenchgap.plant.vehicle import Body
from wrenchgap.plant.wrench_model import WrenchModel


class Process(MismatchModel, Protocol):
    """A mismatch model that may look at more than the command."""

    @property
    def input_groups(self) -> tuple[str, ...]:
        """Groups of inputs besides the command (`plant.mismatch_inputs`)."""


@dataclass(frozen=True)
class Predictor:
    """A model, with a process on top where there is one, under its name in tables."""

    name: str
    model: WrenchModel
    gp: Process | None = None

    def predict(self, record: Record, body: Body) -> Array:
        """Measured wrench (K, 6) that the model expects, as processed with the mass and inertia of `body`."""
        predicted = predict(record, self.model, body)
        if self.gp is not None:
            predicted[:, output_indices(self.gp.outputs)] += self.gp.mean(process_inputs(self.gp.input_groups, record))
        return predicted

    def sigma(self, record: Record) -> Array | None:
        """Standard deviation (K, 6) where a process knows one; not a number on the other axes."""
        if self.gp is None:
            return None
        sigma = np.full((len(record), 6), np.nan)
        sigma[:, output_indices(self.gp.outputs)] = self.gp.std(process_inputs(self.gp.input_groups, record))
        return sigma

    def usable(self, model: Model, records: Sequence[Record]) -> tuple[Predictor, tuple[Untried, ...]]:
        """The same without effects that need what these records of `model`'s vehicle lack, and which those are."""
        reasons = {e.name: inapplicable(e.name, model, records) for e in self.model.effects}
        lacking = tuple(reason for reason in reasons.values() if reason is not None)
        if not lacking:
            return self, ()
        kept = tuple(e for e in self.model.effects if reasons[e.name] is None)
        return replace(self, model=WrenchModel(self.model.vehicle, kept)), lacking
