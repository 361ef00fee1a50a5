"""The keys of a model file and the model that they describe. docs/model-file.md explains them."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from wrenchgap._escaping import file_word
from wrenchgap.flight.compared_signals import SHIFTABLE
from wrenchgap.flight.errors import ModelError
from wrenchgap.plant import reader
from wrenchgap.plant.controller import ControllerGains, default_gains
from wrenchgap.plant.effects import Source, catalogue
from wrenchgap.plant.effects.effect import Parameter
from wrenchgap.plant.history import Snapshot, Trial, Value, Version
from wrenchgap.plant.model import Model, make_effect
from wrenchgap.plant.model_file.command import CommandTable, bench_table, with_bench_table
from wrenchgap.plant.model_file.vehicle_table import VehicleTable
from wrenchgap.plant.reader import (
    Axes,
    NotNegative,
    Number,
    Positive,
    SixMeasured,
    Table,
    Text,
    expected,
    quoted,
    rule_error,
)
from wrenchgap.plant.sensors import SensorNoise
from wrenchgap.plant.vehicle import Tolerances, Vehicle
from wrenchgap.plant.wrench_model import ModelEffect, Provenance

SCHEMA = 1
PAGE = "docs/model-file.md"

SENTENCE = re.compile(r"(?:better|worse|no clear change): error energy ([+-]?\d+) %, t (-?[\d.]+)")
"""What files of earlier versions have as `verdict` in place of `change` and `t`."""


class FileTable(Table):
    """A source file with its hash."""

    file: Text = ""
    sha256: Text = ""


class ParameterTable(Table):
    """One parameter; a bare number is its value."""

    value: Number
    std: NotNegative | None = None
    unit: Text = ""


class HeldOutTable(Table):
    """The error on held-out time."""

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
            raise rule_error(
                f"verdict: got {values['verdict']!r}, expected words like 'better: error energy -65 %, t 12.3'"
            )
        numbers = {"change": float(said[1]) / 100.0, "t": float(said[2])}
        return numbers | {key: value for key, value in values.items() if key != "verdict"}


class ValueTable(ParameterTable):
    """One parameter of an effect in a version."""

    name: Text


class SnapshotTable(Table):
    """One effect in a version."""

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

    def to_version(self) -> Version:
        """The version."""
        trial = None
        if (found := self.held_out) is not None:
            before, after, noise = np.array((found.before, found.after, found.noise))
            trial = Trial(before, after, noise, found.change, found.t)
        effects = ((e.name, tuple(Value(v.name, v.value, v.std, v.unit) for v in e.parameters)) for e in self.effects)
        return Version(
            int(self.version),
            *(self.command, self.content, self.file, self.parent, self.date, self.wrenchgap),
            tuple((flight.file, flight.sha256) for flight in self.flights),
            trial,
            tuple(Snapshot(*effect) for effect in effects),
        )


class ProvenanceTable(Table):
    """Provenance of the values of an effect."""

    fitted: Text = ""
    version: Text = ""
    method: Text = ""
    logs: tuple[FileTable, ...] = ()


Given = Annotated[ParameterTable, BeforeValidator(lambda v: v if isinstance(v, dict) else {"value": v})]


class EffectTable(Table):
    """One effect with its values."""

    name: Text
    parameters: dict[str, Given]
    source: FileTable = FileTable()
    provenance: ProvenanceTable = ProvenanceTable()

    def model_effect(self, vehicle: Vehicle, where: str) -> ModelEffect:
        """The effect on this vehicle. `where` is the key of the table, for errors."""
        own = self._user_source()
        effect = make_effect(vehicle, self.name, {key: p.value for key, p in self.parameters.items()})
        known = effect.effect.parameters(replace(vehicle, tolerances=Tolerances()))
        names = [p.name for p in known]
        missing = [n for n in names if n not in self.parameters]
        if missing:
            raise ModelError(f"effect {self.name}: parameter {missing[0]!r} is missing; expected {', '.join(names)}")
        for parameter in known:
            _check(self.parameters[parameter.name], parameter, f"{where}.parameters.{parameter.name}", self.name)
        stds = [self.parameters[n].std for n in names]
        std = None if None in stds else np.array(stds, dtype=float)
        p = self.provenance
        logs = tuple((log.file, log.sha256) for log in p.logs)
        return replace(effect, std=std, provenance=Provenance(logs, p.fitted, p.version, p.method, own))

    def _user_source(self) -> Source | None:
        """The file of a user effect as it was; ModelError where none is loaded."""
        file, name = self.source.file, self.name
        if not file:
            return None
        if name not in catalogue():
            own = Path(Path(file).name)  # of the user's folder: where a file of code lies is nothing for a model to say
            words = f"a program, which runs: if you trust it, pass that file with --effects {file_word(own)}"
            raise ModelError(f"effect {name!r} is a user's own, from {own}; {words}")
        return Source(file, self.source.sha256)


def _check(
    given: ParameterTable, known: Parameter, where: str, effect: str, beyond: float = 10.0, rounded: float = 1e-6
) -> None:
    """Raise ModelError for another unit than the parameter has, and for a value that no vehicle has.

    A value may be `beyond` times what is plausible (`Parameter.low`, `high`): fits stay within the range, which goes
    with the vehicle's numbers; beyond this a unit or a digit is wrong, and a delay would take all memory. One that was
    written with nine digits may be outside of it by a share `rounded` of that range.
    """
    if given.unit not in ("", known.unit):
        raise ModelError(f"{where}.unit: got {quoted(repr(given.unit))}, expected {known.unit!r} ({effect})")
    low, high = beyond * min(known.low, 0.0), beyond * max(known.high, 0.0)
    if not low - rounded * (high - low) <= given.value <= high + rounded * (high - low):
        limits = f"{low:.3g} to {high:.3g} {known.unit}"
        raise ModelError(f"{where}.value: got {given.value:g}, expected {limits} ({effect} on this vehicle)")


SizeVector = Annotated[tuple[NotNegative, NotNegative, NotNegative], expected("three numbers that are not negative")]


class BetweenFlightsTable(Table):
    """Standard deviation of the wrench between flights [N, Nm]."""

    force: SizeVector
    torque: SizeVector


ShiftedRole = Annotated[str, Field(pattern=f"^({'|'.join(SHIFTABLE)})$"), expected(f"a role: {', '.join(SHIFTABLE)}")]
Shift = Annotated[Number, Field(ge=-10.0, le=10.0), expected("seconds, at most 10 either way")]


class ModelTable(Table):
    """The whole file. The tables [controller] and [sensors] have the fields of their dataclasses as keys."""

    version: Number = Field(alias="schema")
    vehicle: VehicleTable
    controller: dict[str, Any] = Field({})
    sensors: dict[str, Any] = Field({})
    topics: dict[str, Text] = Field({})
    shifts: dict[ShiftedRole, Shift] = Field({})
    command: CommandTable | None = None
    unmeasured: Axes = ()
    cutoff_hz: Positive | None = None
    between_flights: BetweenFlightsTable | None = None
    effects: tuple[EffectTable, ...] = ()
    history: tuple[VersionTable, ...] = ()


def loads(text: str, folder: Path | None = None) -> Model:
    """A model from the text of a model file; a bench table that it names lies in `folder`. Raises ModelError."""
    document = reader.toml(text)
    reader.check_schema(document, SCHEMA)
    bench = bench_table(document.get("command"), folder)
    beside = () if bench is None or folder is None else (folder / document["command"]["table"],)
    document |= {} if bench is None else {"command": bench}
    table = reader.read(ModelTable, document, page=PAGE)
    vehicle = table.vehicle.vehicle()
    gains = reader.values_of(ControllerGains, table.controller, where="controller", page=PAGE)
    noise = reader.values_of(SensorNoise, table.sensors, where="sensors", page=PAGE)
    effects = [effect.model_effect(vehicle, f"effects[{k}]") for k, effect in enumerate(table.effects)]
    scatter = table.between_flights
    model = Model(
        vehicle,
        controller=default_gains(vehicle, gains),
        sensors=SensorNoise(**noise),
        topics=table.topics,
        shifts=table.shifts,
        command=None if table.command is None else table.command.curve(),
        unmeasured=table.unmeasured,
        cutoff_hz=table.cutoff_hz,
        between_flights=None if scatter is None else (*scatter.force, *scatter.torque),
        beside=beside,
        text=text if bench is None else with_bench_table(text, bench),
        history=tuple(version.to_version() for version in table.history),
        notes=tuple(note for note in (table.vehicle.inertia_note, *(e.changed_source for e in effects)) if note),
    )
    return model.with_effects(effects)
