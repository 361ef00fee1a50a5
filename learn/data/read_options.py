"""How logs are read: one form of it, from the command line to `learn.data.opening.open_flights`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

from wrenchgap.flight.budget import Budget
from wrenchgap.learn.data.intervals import Between
from wrenchgap.learn.data.measurement import CUTOFF_HZ


@dataclass(frozen=True)
class ReadOptions:
    """How logs are read.

    Parameters
    ----------
    topics
        Which topic plays a role, by role, in place of the model file's: `{"imu": "/my/imu"}`.
    shifts
        What is added to the stamps of a role [s], by role.
    cutoff_hz
        Cut-off of the low-pass [Hz] that commanded and measured wrench both pass.
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
    cutoff_hz: float = CUTOFF_HZ
    between: Between = None
    unmeasured: Sequence[str] = ()
    accept: Sequence[str] = ()
    keep: Sequence[str] = ()
    budget: Budget | str | None = None

    def changed(self, **options: Any) -> ReadOptions:
        """The same with other `options`, by name. Raises TypeError, with all names, for one that there is not."""
        names = [one.name for one in fields(self)]
        if unknown := sorted(options.keys() - set(names)):
            raise TypeError(f"{', '.join(unknown)}: no option of reading logs; there are {', '.join(names)}")
        return replace(self, **options)

    def to_json(self) -> dict[str, Any]:
        """The options by name; the budget where there is one."""
        every = {one.name: getattr(self, one.name) for one in fields(self)}
        return {name: value for name, value in every.items() if name != "budget" or value is not None}
