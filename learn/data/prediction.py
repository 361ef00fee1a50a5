"""What predicts the measured wrench of a record: a model, with a process on top where there is one.

A process looks at the command, and at what it was told to look at besides (`process_inputs`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from wrenchgap.flight.errors import FitError
from wrenchgap.flight.flight import Array
from wrenchgap.learn.data.candidates import Untried, inapplicable
from wrenchgap.learn.data.measurement import Record, low_pass, predict
from wrenchgap.plant.mismatch import MismatchModel, output_indices
from wrenchgap.plant.mismatch_inputs import POSED, extra_inputs
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


def require_pose(names: Sequence[str], record: Record) -> None:
    """Raise FitError for a group that needs a pose where the log has none."""
    missing = [name for name in names if name in POSED]
    if missing and not record.has_pose:
        raise FitError(
            f"{record.flight}: input {', '.join(missing)} needs odometry, which the log lacks; map it with "
            "--topic odometry=/your/topic, or learn a GP without this input (--inputs)"
        )


def process_inputs(names: Sequence[str], record: Record) -> Array:
    """Commands (K, 6) and the columns of the groups `names` behind them, filtered as the measurement is.

    Raises FitError for a group that needs a pose where the log has none.
    """
    if not names:
        return record.commanded
    require_pose(names, record)
    wrench = record.commands.wrench_B
    sent = np.concatenate((wrench[:1], wrench[:-1]))
    extra, _ = extra_inputs(names, sent, record.state, record.dt)
    return np.hstack((record.commanded, low_pass(extra, record.dt, record.cutoff_hz)[record.keep]))


def pooled_inputs(names: Sequence[str], records: Sequence[Record]) -> Array:
    """Of all records, one after the other."""
    return np.concatenate([process_inputs(names, record) for record in records])
