"""A working session for the viewer: logs opened for a model, on the clock of their gap-free stretches."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flight import so3
from flight.flight import ReferenceSeries, Samples
from learn.gp import GaussianProcess
from learn.measurement import CUTOFF_HZ
from plant.model import Model
from plant.vehicle import Vehicle
from replay.comparison import compare, predictors
from replay.flights import OpenFlight, open_flights
from viewer.session import Scene, Stretch

Array = NDArray[np.float64]

RATE = 50.0
"""Instants per second that the viewer gets [Hz], about."""


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

    def _made(self, name: str) -> Scene:
        one = self._opened[name]
        parts = [_thinned(s) for s in one.samples]
        time = np.concatenate([one.samples[i].time[part] for i, part in enumerate(parts)])
        result = compare([one], self.model, [self._predictor])
        evaluation = result.evaluations[0]
        known = [r.time for r in one.records]
        reference = one.flight.reference
        position, quat = (None, None) if reference is None else _reference(reference, time)
        wrenches = {
            "commanded": _at(time, known, [r.commanded for r in one.records]),
            "measured": _at(time, known, [r.measured for r in one.records]),
            "predicted": _at(time, known, list(evaluation.predictions)),
        }
        if not self.model.effects and self._predictor.gp is None:
            del wrenches["predicted"]  # the nominal model predicts the command
        return Scene(
            name=name,
            time=time,
            position_E=_joined(one, parts, "position_E", (0.0, 0.0, 0.0)),
            quat_EB=_joined(one, parts, "quat_EB", (1.0, 0.0, 0.0, 0.0)),
            reference_position_E=position,
            quat_ED=quat,
            tilt=_tilt(one, parts, self.vehicle),
            wrenches=wrenches,
            worst=tuple(Stretch(s.start, s.stop, f"worst {s.axis.replace('_', ' ')}") for s in evaluation.worst),
            notes=tuple(dict.fromkeys((*self.notes, *one.notes, *result.notes))),
        )


def _thinned(samples: Samples) -> slice:
    return slice(0, None, max(1, round(1.0 / (RATE * samples.dt))))


def _joined(one: OpenFlight, parts: Sequence[slice], name: str, unknown: Sequence[float]) -> Array:
    """A quantity of all stretches; `unknown` where a stretch lacks it."""
    values = []
    for samples, part in zip(one.samples, parts, strict=True):
        given = getattr(samples, name)
        values.append(np.tile(unknown, (len(samples), 1))[part] if given is None else given[part])
    return np.concatenate(values)


def _tilt(one: OpenFlight, parts: Sequence[slice], vehicle: Vehicle) -> Array | None:
    """Angles of all arms as commanded (logged or allocated), None where the model has no arms."""
    if vehicle.arms is None:
        return None
    times = np.concatenate([s.time[part] for s, part in zip(one.samples, parts, strict=True)])
    tilts = [(r.state.time, r.commands.tilt) for r in one.records if r.commands.tilt is not None]
    return _at(times, [t for t, _ in tilts], [v for _, v in tilts], len(vehicle.arms))


def _at(time: Array, knots: Sequence[Array], values: Sequence[Array], columns: int = 6) -> Array:
    """Pieces, linear between their samples, at `time` (K,); nan outside all of them."""
    out = np.full((len(time), columns), np.nan)
    for knot, value in zip(knots, values, strict=True):
        inside = (time >= knot[0]) & (time <= knot[-1])
        out[inside] = np.stack([np.interp(time[inside], knot, column) for column in value.T], axis=1)
    return out


def _reference(reference: ReferenceSeries, time: Array) -> tuple[Array, Array]:
    """Position (K, 3) and attitude (K, 4) of the reference at `time`; nan where it is not logged."""
    knots = reference.time
    position = np.stack([np.interp(time, knots, column) for column in reference.position_E.T], axis=1)
    quat = so3.interpolate(time, knots, reference.quat_ED)
    missing = (time < knots[0]) | (time > knots[-1])
    for gap in reference.gaps:
        missing |= (time > gap.start) & (time < gap.stop)
    position[missing], quat[missing] = np.nan, np.nan
    return position, quat
