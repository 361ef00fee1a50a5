"""The keys of a model file that say where it came from: its files and its history."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
from pydantic import model_validator

from wrenchgap.plant.history import Snapshot, Trial, Value, Version
from wrenchgap.plant.reader import Number, SixMeasured, Table, Text, broken

SENTENCE = re.compile(r"(?:better|worse|no clear change): error energy ([+-]?\d+) %, t (-?[\d.]+)")
"""What files of earlier versions have as `verdict` in place of `change` and `t`."""


class FileTable(Table):
    """A file that something came from."""

    file: Text = ""
    sha256: Text = ""


class ParameterTable(Table):
    """One parameter; a bare number is its value."""

    value: Number
    std: Number | None = None
    unit: Text = ""


class HeldOutTable(Table):
    """The error on time that was not fitted."""

    before: SixMeasured
    after: SixMeasured
    noise: SixMeasured
    change: Number
    t: Number

    @model_validator(mode="before")
    @classmethod
    def _numbers_from_sentence(cls, values: Any) -> Any:
        """Files of earlier versions have a sentence in place of `change` and `t`."""
        if not isinstance(values, dict) or "verdict" not in values:
            return values
        said = SENTENCE.fullmatch(str(values["verdict"]))
        if said is None:
            raise broken(
                f"verdict: got {values['verdict']!r}, expected words like 'better: error energy -65 %, t 12.3'"
            )
        numbers = {"change": float(said[1]) / 100.0, "t": float(said[2])}
        return numbers | {key: value for key, value in values.items() if key != "verdict"}

    def made(self) -> Trial:
        """The trial."""
        return Trial(np.array(self.before), np.array(self.after), np.array(self.noise), self.change, self.t)


class ValueTable(ParameterTable):
    """One parameter of an effect as it stood."""

    name: Text


class SnapshotTable(Table):
    """One effect as it stood."""

    name: Text
    parameters: tuple[ValueTable, ...] = ()


class VersionTable(Table):
    """One version of the model."""

    version: Number
    command: Text = ""
    content: Text
    file: Text = ""
    parent: Text = ""
    date: Text = ""
    wrenchgap: Text = ""
    flights: tuple[FileTable, ...] = ()
    held_out: HeldOutTable | None = None
    effects: tuple[SnapshotTable, ...] = ()

    def made(self) -> Version:
        """The version."""
        return Version(
            int(self.version),
            *(self.command, self.content, self.file, self.parent, self.date, self.wrenchgap),
            tuple((flight.file, flight.sha256) for flight in self.flights),
            None if self.held_out is None else self.held_out.made(),
            tuple(
                Snapshot(e.name, tuple(Value(v.name, v.value, v.std, v.unit) for v in e.parameters))
                for e in self.effects
            ),
        )
