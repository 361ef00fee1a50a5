"""A model and what to know of it before it is used."""

from __future__ import annotations

from dataclasses import dataclass

from wrenchgap.flight.result import Result
from wrenchgap.plant.model import Model


@dataclass(frozen=True, repr=False)
class Sheet(Result):
    """A model to look at: `assumed` is what nobody said, in words, `notes` what its source said besides."""

    model: Model
    assumed: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
