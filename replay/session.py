"""A working session for the viewer: logs opened for a model, on the clock of their gap-free stretches."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from flight.channels import Channel, channels
from learn.gp import GaussianProcess
from learn.measurement import CUTOFF_HZ
from plant.model import Model
from plant.vehicle import Vehicle
from replay.comparison import compare, predictors
from replay.flights import open_flights
from replay.scene import Prediction, predicted, recorded
from viewer.session import Scene, Stretch


class LogSession:
    """Implements `viewer.session.Session` for logs, a model and, where given, a GP."""

    def __init__(
        self,
        logs: Sequence[str | Path],
        model: Model,
        gp: GaussianProcess | None = None,
        *,
        topics: Mapping[str, str] | None = None,
    ) -> None:
        self.model = model
        cutoff = CUTOFF_HZ if gp is None else gp.provenance.cutoff_hz or CUTOFF_HZ
        candidates, self.notes = predictors(model, (), gp, cutoff)
        self._predictor = candidates[-1]
        opened = open_flights(logs, model, topics=topics, cutoff_hz=cutoff)
        self._opened = {one.records[0].flight: one for one in opened}
        self._scenes: dict[str, Scene] = {}

    @property
    def vehicle(self) -> Vehicle:
        """The vehicle of the model."""
        return self.model.vehicle

    @property
    def flights(self) -> tuple[str, ...]:
        """Names of the flights."""
        return tuple(self._opened)

    def scene(self, flight: str) -> Scene:
        """The flight of this name."""
        if flight not in self._scenes:
            self._scenes[flight] = self._made(flight)
        return self._scenes[flight]

    def channels(self, flight: str) -> Mapping[str, Channel]:
        """Everything in the log of a flight, by name."""
        found = self._opened[flight].flight
        return channels(found.path, found)

    def _made(self, name: str) -> Scene:
        one = self._opened[name]
        result = compare([one], self.model, [self._predictor])
        evaluation = result.evaluations[0]
        scene = recorded(one, self.vehicle)
        trivial = not self.model.effects and self._predictor.gp is None  # the nominal model predicts the command
        return predicted(
            scene,
            one,
            {} if trivial else {"predicted": Prediction.of(evaluation)},
            residual_of="commanded" if trivial else "predicted",
            worst=[Stretch(s.start, s.stop, f"worst {s.axis.replace('_', ' ')}") for s in evaluation.worst],
            notes=(*self.notes, *result.notes),
        )
