"""The flights of a working session and its current model: effects go in, come out, are undone and done again.

A model is never changed, it is replaced: what was there before comes back with the very same numbers. Everything that
is computed from the present model is kept until the model changes.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeVar

import numpy as np

from wrenchgap.flight.errors import ModelError, UsageError
from wrenchgap.flight.flight import Array
from wrenchgap.learn import GaussianProcess, OpenFlight
from wrenchgap.learn.data.candidates import Untried, inapplicable
from wrenchgap.learn.data.dataset import Dataset
from wrenchgap.learn.data.prediction import Predictor
from wrenchgap.learn.diagnose.timing import dataset_of
from wrenchgap.learn.process.predictors import predictors
from wrenchgap.plant.history import Trial
from wrenchgap.plant.model import Model
from wrenchgap.plant.wrench_model import ModelEffect, WrenchModel

T = TypeVar("T")
Question = Literal["explain", "changed"]


@dataclass(frozen=True)
class Revision:
    """The model at one moment: by which change, fitted to which flights (file, SHA-256), what that did on other time.

    `order` are its effects in the order in which they came in.
    """

    model: Model
    words: str
    order: tuple[str, ...]
    flights: tuple[tuple[str, str], ...] = ()
    trial: Trial | None = None


@dataclass(frozen=True)
class Found:
    """What was found on a flight, on top of which model, and what that was called."""

    result: Any
    model: Model
    name: str


class WorkingModel:
    """Open flights by name, a model that changes, and where given a GP that was learnt on the model as opened.

    `saved` says whether a file has the model as it is opened.
    """

    def __init__(
        self, flights: Sequence[OpenFlight], model: Model, gp: GaussianProcess | None, *, saved: bool = True
    ) -> None:
        self.flights, self.gp = {one.records[0].flight: one for one in flights}, gp
        self.lock = threading.RLock()
        self.revisions = [Revision(model, "", tuple(e.name for e in model.effects))]
        """The model as it was opened, and after every change since."""
        self.found: dict[tuple[Question, str], Found] = {}
        """What was found, by question and flight; it stays when the model changes."""
        self._undone: list[Revision] = []
        self._saved = model if saved else None
        found, self.notes = predictors(model, (), gp, flights[0].records[0].cutoff_hz)
        self.opened_model, self._opened_predictor = model, found[-1]
        self._data: dict[tuple[str, ...], Dataset] = {}
        self._cached: dict[tuple[str, ...], object] = {}

    @property
    def model(self) -> Model:
        """The current model."""
        return self.revisions[-1].model

    @property
    def order(self) -> tuple[str, ...]:
        """Names of its effects in the order in which they came in."""
        return self.revisions[-1].order

    @property
    def undoable(self) -> str:
        """What would be undone, in words."""
        return self.revisions[-1].words if len(self.revisions) > 1 else ""

    @property
    def redoable(self) -> str:
        """What would be done again, in words."""
        return self._undone[-1].words if self._undone else ""

    @property
    def saved(self) -> bool:
        """Whether a file says the same as the model."""
        return self.model is self._saved

    def keep_found(self, before: WorkingModel) -> None:
        """Take over what was found `before` with this very model, on flights that are here as they were there."""
        if before.model is not self.opened_model:
            return
        hashes = {name: one.flight.content_hash for name, one in before.flights.items()}
        same = {name for name, one in self.flights.items() if hashes.get(name) == one.flight.content_hash}
        for (question, flight), one in before.found.items():
            if {flight, *(one.result.healthy if question == "changed" else ())} <= same:
                if question == "explain":  # the flight as it is open now, not as it was then
                    one = replace(one, result=replace(one.result, flights=(self.flights[flight],)))
                self.found[question, flight] = one

    def change(self, revision: Revision, *, instead: bool = False, depth: int = 200) -> None:
        """Make another model the current one; `instead` of the last change where that was a part of this one.

        So many changes as `depth` can be undone.
        """
        with self.lock:
            if instead and len(self.revisions) > 1:
                self.revisions.pop()
            self.revisions.append(revision)
            if len(self.revisions) > depth:
                del self.revisions[1]
            self._undone.clear()
            self._cached.clear()

    def undo(self) -> None:
        """Take the last change back. Raises UsageError where there is none."""
        with self.lock:
            if len(self.revisions) < 2:
                raise UsageError("there is nothing to undo: the model is as it was opened")
            self._undone.append(self.revisions.pop())
            self._cached.clear()

    def redo(self) -> None:
        """Do again what was taken back last. Raises UsageError where there is nothing."""
        with self.lock:
            if not self._undone:
                raise UsageError("there is nothing to redo")
            self.revisions.append(self._undone.pop())
            self._cached.clear()

    def was_saved(self, model: Model) -> None:
        """The current model is in a file now: `model`, with its path and history."""
        with self.lock:
            self.revisions[-1] = replace(self.revisions[-1], model=model)
            self._saved = model
            self._cached.clear()

    def flight(self, name: str) -> OpenFlight:
        """The open flight of this name."""
        return self.flights[name]

    def data(self, *flights: str) -> Dataset:
        """The records of flights, stacked; evaluators of it remember what models have in common."""
        with self.lock:
            if flights not in self._data:
                self._data[flights] = dataset_of([self.flights[f] for f in flights], self.opened_model)
            return self._data[flights]

    def cached(self, key: tuple[str, ...], make: Callable[[], T]) -> T:
        """The value under `key`, made if it is not there since the model changed."""
        with self.lock:
            if key not in self._cached:
                self._cached[key] = make()
            return self._cached[key]  # type: ignore[return-value]

    def applicable_model(self, model: Model, flight: str) -> WrenchModel:
        """The model without effects that need what the flight's log lacks."""
        lacking = {one.effect for one in self.inapplicable_effects(model, flight)}
        return WrenchModel(model.vehicle, tuple(e for e in model.effects if e.name not in lacking))

    def inapplicable_effects(self, model: Model, flight: str) -> tuple[Untried, ...]:
        """Effects of a model that cannot be evaluated on a flight."""
        reasons = (inapplicable(e.name, model, self.flights[flight].records) for e in model.effects)
        return tuple(reason for reason in reasons if reason is not None)

    def model_residual(self, model: Model, flight: str) -> Array:
        """Measured wrench minus the model's prediction (K, 6), without any GP."""
        with self.lock:
            data = self.data(flight)
            return data.measured - data.predict(self.applicable_model(model, flight))

    def residual(self, flight: str) -> Array:
        """What the current model leaves of the measured wrench (K, 6), with its GP where it has one."""

        def make() -> Array:
            predictor = self.predictor
            if predictor.gp is None:
                return self.model_residual(self.model, flight)
            data, body = self.data(flight), self.model.vehicle.body
            base = self.applicable_model(replace(self.model, effects=predictor.model.effects), flight)
            usable = replace(predictor, model=base)
            return np.asarray(data.measured - np.concatenate([usable.predict(r, body) for r in data.records]))

        return self.cached(("residual", flight), make)

    @property
    def name(self) -> str:
        """The current model's name: that of the opened one, or what is in it now."""
        if [e.name for e in self.model.effects] == [e.name for e in self.opened_model.effects]:
            return self.opened_model.name if self.saved else f"{self.opened_model.name} (changed)"
        return " + ".join([self.model.vehicle.name, *self.order])

    @property
    def predictor(self) -> Predictor:
        """What predicts: the current model. A GP sits on the model as it was opened, and counts only there."""
        if self.model is self.opened_model:
            return self._opened_predictor
        return Predictor(self.name, self.model.wrench_model)

    def effect(self, name: str) -> ModelEffect:
        """The effect of this name. Raises ModelError where the model has none."""
        if (found := self.model.effect(name)) is None:
            have = ", ".join(e.name for e in self.model.effects) or "none"
            raise ModelError(f"{self.name}: has no effect {name!r}; its effects: {have}")
        return found
