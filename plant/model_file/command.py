"""The table [command] of a model file: unit of the rotor commands in logs, and the curve to thrust or speed."""

import csv
import itertools
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
import tomlkit
from annotated_types import Interval, Len
from pydantic import BeforeValidator, model_validator

from wrenchgap.flight.errors import ModelError
from wrenchgap.flight.flight import GRAVITY, RPM
from wrenchgap.plant import reader
from wrenchgap.plant.command_curve import Bench, CommandCurve, CommandUnit, Gives, Polynomial
from wrenchgap.plant.reader import Number, Positive, Table, Text, expected, rule_error

COLUMNS: dict[str, tuple[Gives, float]] = {
    "thrust": ("thrust", 1.0),
    "thrust_g": ("thrust", GRAVITY / 1000.0),
    "speed": ("speed", 1.0),
    "rpm": ("speed", RPM),
}
"""Columns of a bench table with what was measured: what it is, and one of its units in N or rad/s."""
LAWS = ("thrust_max", "thrust", "speed", "table")


Numbers = Annotated[tuple[Number, ...], expected("a list of numbers")]
Coefficients = Annotated[
    tuple[Number, ...],
    Len(1, 8),  # thrust has three
    expected("a list of 1 to 8 coefficients, that of u^0 first"),
]
Unit = Annotated[CommandUnit, expected('"normalised" (0 to 1) or "pwm" (pulse widths in us)')]
Ends = Annotated[tuple[Number, Number], expected("two numbers: the commands at no and at full throttle")]


class BenchTable(Table):
    """A bench table by columns, all of one length."""

    command: Numbers
    thrust: Numbers | None = None
    thrust_g: Numbers | None = None
    speed: Numbers | None = None
    rpm: Numbers | None = None
    voltage: Numbers | None = None

    @model_validator(mode="after")
    def _columns(self) -> Self:
        measured = [name for name in COLUMNS if getattr(self, name) is not None]
        if len(measured) != 1:
            raise rule_error(f"got {' and '.join(measured) or 'neither'}, expected one column of {', '.join(COLUMNS)}")
        given = {name: getattr(self, name) for name in ("command", *measured, "voltage")}
        lengths = {name: len(values) for name, values in given.items() if values is not None}
        if len(set(lengths.values())) != 1 or lengths["command"] < 2:
            said = ", ".join(f"{n} of {name}" for name, n in lengths.items())
            raise rule_error(f"got {said}; expected as many of each, two or more")
        return self

    def bench(self) -> tuple[Gives, Bench]:
        """The measured quantity, and the points."""
        name = next(name for name in COLUMNS if getattr(self, name) is not None)
        gives, factor = COLUMNS[name]
        voltage = None if self.voltage is None else np.array(self.voltage)
        return gives, Bench(np.array(self.command), factor * np.array(getattr(self, name)), voltage)


class VoltageTable(Table):
    """Effect of the battery: thrust (or speed) is proportional to (V / nominal)^exponent."""

    nominal: Positive
    exponent: Annotated[Number, Interval(ge=-10.0, le=10.0), expected("-10 to 10")]  # physics has one or two


def _bench(value: Any) -> Any:
    if isinstance(value, str):
        raise rule_error(f"{value}: a bench table is found beside the model file; load the model by its path")
    return value


class CommandTable(Table):
    """The whole table: a unit and one law."""

    unit: Unit
    range: Ends | None = None
    thrust_max: Positive | None = None
    factor: Number | None = None
    thrust: Coefficients | None = None
    speed: Coefficients | None = None
    table: Annotated[BenchTable, BeforeValidator(_bench)] | None = None
    voltage: VoltageTable | None = None
    source: Text = ""

    @model_validator(mode="after")
    def _one_law(self) -> Self:
        given = [name for name in LAWS if getattr(self, name) is not None]
        if len(given) != 1:
            raise rule_error(f"got {' and '.join(given) or 'no curve'}, expected one of {', '.join(LAWS)}")
        if self.factor is not None and (self.thrust_max is None or not 0.0 <= self.factor <= 1.0):
            raise rule_error(f"factor: got {self.factor:g}, expected 0 to 1, beside thrust_max")
        if self.unit == "pwm" and self.range is None and self.table is None:
            raise rule_error(
                "range: is missing; expected the pulse widths at no and at full throttle, e.g. [1000, 2000]"
            )
        low, high = self.range or (0.0, 1.0)
        if abs(high - low) <= 1e-6 * max(1.0, abs(low), abs(high)):
            raise rule_error(f"range: got {[low, high]}, expected two different commands")
        return self

    def curve(self) -> CommandCurve:
        """The curve."""
        gives: Gives = "thrust" if self.speed is None else "speed"
        law: Polynomial | Bench
        if self.table is not None:
            gives, law = self.table.bench()
        elif self.thrust_max is not None:
            f = self.factor or 0.0
            law = Polynomial(self.thrust_max * np.array([0.0, 1.0 - f, f]))
        else:
            law = Polynomial(np.array(getattr(self, gives), dtype=float))
        voltage = None if self.voltage is None else (self.voltage.nominal, self.voltage.exponent)
        return CommandCurve(self.unit, gives, law, self.range or (0.0, 1.0), voltage, self.source)


def table_of(curve: CommandCurve) -> dict[str, Any]:
    """The table of a curve."""
    out: dict[str, Any] = {"unit": curve.unit, "range": list(curve.ends)}
    if isinstance(curve.law, Bench):
        rows = {"command": curve.law.command.tolist(), curve.gives: curve.law.value.tolist()}
        out["table"] = rows | ({} if curve.law.voltage is None else {"voltage": curve.law.voltage.tolist()})
    else:
        out[curve.gives] = curve.law.coefficients.tolist()
    if curve.voltage is not None:
        out["voltage"] = dict(zip(("nominal", "exponent"), curve.voltage, strict=True))
    return out | ({"source": curve.source} if curve.source else {})


def bench_table(command: Any, folder: Path | None) -> dict[str, Any] | None:
    """The table [command] with the bench table in `folder` that it names inserted; None where it names none."""
    if folder is None or not isinstance(command, dict) or not isinstance(command.get("table"), str):
        return None
    path = reader.sibling_file(folder, command["table"], ".csv", "command.table")
    return {"source": f"bench table {path.name}"} | command | {"table": read_bench(path)}


def with_bench_table(text: str, command: Mapping[str, Any]) -> str:
    """The text of a model file with what `bench_table` gave.

    So a model that is written elsewhere still has it, and a bench table that was changed is noticed.
    """
    document = reader.toml_document(text)
    columns = ", ".join(f"{head} = {values}" for head, values in command["table"].items())
    document["command"]["table"] = tomlkit.value("{" + columns + "}")
    document["command"].setdefault("source", command["source"])
    return tomlkit.dumps(document)


def read_bench(path: Path, max_rows: int = 2000) -> dict[str, list[float]]:
    """Columns of a bench table (.csv): `command`, one of `COLUMNS`, and perhaps `voltage`. Thrust stands give some 100.

    Raises ModelError, which repeats nothing of the file: it may be another one.
    """
    text = reader.text_of(path, "as a bench table")
    rows = csv.reader(text.splitlines(), skipinitialspace=True)
    try:
        heads = [head.strip() for head in next(rows, [])]
        wanted = ("command", *COLUMNS, "voltage")
        if "command" not in heads or not set(heads) <= set(wanted) or len(set(heads)) < len(heads):
            raise ModelError(
                f"{path}: its first line does not have the columns command, one of {', '.join(COLUMNS)}, perhaps "
                "voltage, each once and no others"
            )
        out: dict[str, list[float]] = {head: [] for head in heads}
        for row in rows:
            if len(out["command"]) == max_rows:
                raise ModelError(f"{path}: has more than {max_rows} rows; expected a curve, not the log of a stand")
            for head, value in zip(heads, _numbers(path, rows.line_num, heads, row), strict=True):
                out[head].append(value)
    except csv.Error:
        raise ModelError(f"{path}, line {rows.line_num}: expected {len(heads)} numbers, got no table") from None
    return out


def _numbers(path: Path, line: int, heads: list[str], row: list[str]) -> list[float]:
    """The cells of a row, one for each column."""
    if len(row) > len(heads):
        raise ModelError(f"{path}, line {line}: expected {len(heads)} numbers, got {len(row)} cells")
    for head, value in itertools.zip_longest(heads, row):
        try:
            float(value)
        except (TypeError, ValueError):
            raise ModelError(f"{path}, line {line}: expected a number as {head}") from None
    return [float(value) for value in row]
