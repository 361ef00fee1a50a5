"""A working session for the viewer: logs opened for a model, on the clock of their gap-free stretches.

What is recorded stays; the working model changes, and every scene is made anew from it. Beside it, one class each does
the analysis: where the model fails, effects, compensation.
"""

from __future__ import annotations

import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from wrenchgap.flight.budget import Budget
from wrenchgap.flight.inspection import Channel, channels_of
from wrenchgap.learn.data.comparison import compare
from wrenchgap.learn.data.opening import Flights, listed
from wrenchgap.learn.process.gp import GaussianProcess
from wrenchgap.learn.process.predictors import predictors
from wrenchgap.plant.model import Model
from wrenchgap.replay.present.notes import sentences
from wrenchgap.replay.session.compensation import SessionCompensation
from wrenchgap.replay.session.effects import SessionEffects
from wrenchgap.replay.session.failure import SessionFailures
from wrenchgap.replay.session.panels.compensation import CompensationPanel
from wrenchgap.replay.session.panels.effects import EffectsPanel
from wrenchgap.replay.session.panels.failure import FailurePanel
from wrenchgap.replay.session.saving import SaveFolder
from wrenchgap.replay.session.scene import predicted, recorded
from wrenchgap.replay.session.working_model import WorkingModel
from wrenchgap.viewer.scene import Scene, Stretch
from wrenchgap.viewer.session import Capabilities, MakePanel

if TYPE_CHECKING:
    from wrenchgap.replay.session.comparisons import SessionComparisons

PREDICTED = "predicted"
"""The wrench of the current model, in a scene."""
UNSAVED = "MODEL"
"""What a model is called in the commands of a report while no file says the same."""


class LogSession:
    """Implements `viewer.session.Session` for flights that were opened for a model, and where given a GP.

    `gp_name` is what the GP is called on the page; `against` are other models whose predictions are shown beside;
    models and trajectories that are saved on the page go into `folder`, without one the page offers them as downloads.
    `budget` is that of reading a log again for its channels (`flight.budget`).
    """

    def __init__(
        self,
        flights: Flights,
        model: Model,
        gp: GaussianProcess | None = None,
        *,
        gp_name: str = "GP",
        against: Sequence[Model] = (),
        folder: SaveFolder | None = None,
        budget: Budget | str | None = None,
    ) -> None:
        self.working = WorkingModel(listed(flights), model, gp)
        self._budget = budget
        self.vehicle, self.flights = model.vehicle, tuple(self.working.flights)
        found, notes = predictors(model, against)
        self._against = found[len(found) - len(against) :]
        self._notes = (*self.working.notes, *notes)
        self.failures = SessionFailures(self.working)
        self.effects = SessionEffects(self.working, folder)
        self.compensations = SessionCompensation(self.working, gp_name)
        self.comparisons: SessionComparisons | None = None
        panels: list[MakePanel] = [
            partial(FailurePanel, failures=self.failures),
            partial(EffectsPanel, effects=self.effects),
            partial(CompensationPanel, compensations=self.compensations),
        ]
        if len(self.flights) > 1:
            from wrenchgap.replay.session.comparisons import SessionComparisons  # here: one flight need not wait for it
            from wrenchgap.replay.session.panels.changed import ChangedPanel

            self.comparisons = SessionComparisons(self.working)
            panels.insert(2, partial(ChangedPanel, comparisons=self.comparisons))
        self.capabilities = Capabilities(panels, self.channels, self.report)
        self._recorded: dict[str, Scene] = {}

    @property
    def model(self) -> Model:
        """The current model."""
        return self.working.model

    def scene(self, flight: str) -> Scene:
        """The flight of this name, with what the current model says of it, and the last replay on it."""
        with self.working.lock:
            made = self.working.cached(("scene", flight), lambda: self._made(flight))
            return replace(made, series=(*made.series, *self.compensations.series(flight)))

    def channels(self, flight: str) -> Mapping[str, Channel]:
        """Everything in the log of a flight, by name."""
        found = self.working.flight(flight).flight
        return channels_of(found.path, found, self._budget)

    def report(self, flight: str, progress: Callable[[float, str], None]) -> str:
        """The HTML report: the current model fitted on the flight, tested on all others. Takes minutes.

        A GP belongs to the model that it was learnt on, and is left out once that has changed.
        """
        from wrenchgap.replay import api  # here: the page stands before they are there
        from wrenchgap.replay.present.report import Repetition, Request, page

        working, model, one = self.working, self.model, self.working.flight(flight)
        others = [opened for name, opened in working.flights.items() if name != flight]
        name = str(model.path) if working.saved and model.path is not None else UNSAVED
        words = ["wrenchgap", "report", str(one.flight.path), "-m", name]
        words += ["--validate", *(str(o.flight.path) for o in others)] if others else []
        gp = working.gp if model is working.opened_model else None
        made = api.report(one, model, validate=others, gp=gp, progress=progress)
        return page(made, Repetition.of(made, Request(name, shlex.join([*words, "-o", "report.html"]))))

    def _made(self, name: str) -> Scene:
        one, predictor = self.working.flight(name), self.working.predictor
        if name not in self._recorded:
            self._recorded[name] = recorded(one, self.vehicle)
        result = compare([one], self.model, [predictor, *self._against])
        evaluation, *others = result.evaluations
        models = {other.name: other for other in others}
        trivial = not predictor.model.effects and predictor.gp is None  # the nominal model predicts the command
        if not trivial:
            models = {PREDICTED: evaluation, **models}
        return predicted(
            self._recorded[name],
            one,
            models,
            residual_of="commanded" if trivial else PREDICTED,
            worst=[Stretch(s.start, s.stop, f"worst {s.axis.replace('_', ' ')}") for s in evaluation.worst],
            notes=sentences((*self._notes, *result.notes)),
        )
