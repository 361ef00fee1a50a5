"""How logs are read: one form of it, from the command line to `learn.data.opening.open_flights`.

The times of a flight that are asked for are one interval, or several that add up (`Between`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from wrenchgap.flight.arguments import check_types
from wrenchgap.flight.budget import Budget
from wrenchgap.flight.compared_signals import shifted
from wrenchgap.flight.errors import LogError
from wrenchgap.flight.flight import Flight, Gap, Samples
from wrenchgap.flight.unmeasured import axis_names
from wrenchgap.learn.data.measurement import CUTOFF_HZ
from wrenchgap.plant.model import Model
from wrenchgap.plant.model_file import with_reading
from wrenchgap.plant.state import rows

Interval = tuple[float, float]
Between = Interval | Sequence[Interval] | None
"""Times [s] of the flight's own clock; None is all of it."""
MINIMUM_FLIGHT = 2.0
"""Shortest stretch that is worth keeping [s]."""


def intervals(between: Between) -> tuple[Interval, ...]:
    """Intervals in order of time, those that touch as one; none where all of the flight is asked for."""
    if between is None or len(between) == 0:
        return ()
    single = isinstance(between[0], int | float | np.number)
    every: list[Interval] = [tuple(between)] if single else list(between)  # type: ignore[list-item,arg-type]
    joined: list[Interval] = []
    for start, stop in sorted((float(a), float(b)) for a, b in every):
        if joined and start <= joined[-1][1]:
            joined[-1] = (joined[-1][0], max(joined[-1][1], stop))
        else:
            joined.append((start, stop))
    return tuple(joined)


def times_outside(between: Between) -> tuple[Gap, ...]:
    """The times that are not asked for."""
    asked = intervals(between)
    if not asked:
        return ()
    edges = [-np.inf, *(t for interval in asked for t in interval), np.inf]
    return tuple(Gap(float(a), float(b)) for a, b in zip(edges[::2], edges[1::2], strict=True) if b > a)


def kept_within(stretches: Sequence[Samples], between: Between, found: Flight) -> list[Samples]:
    """The parts of the stretches that are asked for; a LogError where nothing of the flight lies there."""
    asked = intervals(between)
    if not asked:
        return list(stretches)
    kept = []
    for samples in stretches:
        for interval in asked:
            first, last = np.searchsorted(samples.time, interval)
            if (last - first) * samples.dt >= MINIMUM_FLIGHT:
                kept.append(rows(samples, slice(int(first), int(last))))
    if not kept:
        begin, end = stretches[0].time[0], stretches[-1].time[-1]
        listed = " and ".join(f"{a:g} and {b:g} s" for a, b in asked)
        raise LogError(
            f"{found.path.name}: less than {MINIMUM_FLIGHT:g} s of flight between {listed}; the flight lasts from "
            f"{begin:.1f} to {end:.1f} s"
        )
    return kept


@dataclass(frozen=True)
class ReadOptions:
    """How logs are read.

    Parameters
    ----------
    topics
        Which topic plays a role, by role, in place of the model file's: `{"imu": "/my/imu"}`.
    shifts
        What is added to the stamps of a role [s], by role, in place of the model file's.
    cutoff_hz
        Cut-off of the low-pass [Hz] that commanded and measured wrench both pass; by default the model file's, else 8.
    between
        Time [s] that is kept, `(start, stop)`, or several such intervals; by default all of it.
    unmeasured
        Axes that the sensors did not measure, besides those of the model file: `("force_x",)` (`flight.unmeasured`).
    accept
        Names of checks that may be bad (docs/checks.md).
    keep
        Names of phases that are not left out: `("saturation",)` (`learn.data.phases`).
    budget
        Memory and processor time that reading one log may take: `"8GB,120s"` (`flight.budget`).

    Examples
    --------
    >>> ReadOptions(cutoff_hz=5.0).changed(between=(3.0, 9.0)).cutoff_hz
    5.0
    """

    topics: Mapping[str, str] | None = None
    shifts: Mapping[str, float] | None = None
    cutoff_hz: float | None = None
    between: Between = None
    unmeasured: Sequence[str] = ()
    accept: Sequence[str] = ()
    keep: Sequence[str] = ()
    budget: Budget | str | None = None

    def __post_init__(self) -> None:
        check_types(type(self), vars(self))

    def changed(self, **options: Any) -> ReadOptions:
        """The same with other `options`, by name. Raises TypeError, with all names, for one that there is not."""
        names = [one.name for one in fields(self)]
        if unknown := sorted(options.keys() - set(names)):
            raise TypeError(f"{', '.join(unknown)}: no option of reading logs; there are {', '.join(names)}")
        return replace(self, **options)

    def low_pass_hz(self, model: Model | None = None) -> float:
        """The cut-off [Hz] that holds for a model."""
        of_model = None if model is None else model.cutoff_hz
        return next(hz for hz in (self.cutoff_hz, of_model, CUTOFF_HZ) if hz is not None)

    def unmeasured_axes(self, model: Model | None = None) -> tuple[str, ...]:
        """The axes that the options and a model say were not measured. Raises UsageError for what is no axis."""
        return axis_names([*axis_names(self.unmeasured), *(() if model is None else model.unmeasured)])

    def shifted(self, flight: Flight, model: Model | None = None) -> Flight:
        """The flight with its stamps moved as the options and a model say; the model's only where none moved them."""
        asked, default = self.shifts or {}, {} if model is None else model.shifts
        said = {role for role, series in flight.series().items() if {role, series.topic} & asked.keys()}
        still = flight.series().keys() - said - flight.shifts.keys()
        return shifted(flight, {**{role: by for role, by in default.items() if role in still}, **asked})

    def recorded_in(self, model: Model) -> Model:
        """The model with these topics, shifts, cut-off and unmeasured axes, so that they need not be said again."""
        return with_reading(model, self.topics or {}, self.shifts or {}, self.cutoff_hz, self.unmeasured)

    def to_json(self) -> dict[str, Any]:
        """The options by name; the budget where there is one."""
        every = {one.name: getattr(self, one.name) for one in fields(self)}
        return {name: value for name, value in every.items() if name != "budget" or value is not None}
