"""`wrenchgap add`: put effects into a model."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from replay.options import (
    Between,
    Cutoff,
    Force,
    JsonFile,
    ModelOption,
    ModelOut,
    Quiet,
    Topics,
    complete_effects,
    many,
    parse_between,
    parse_topics,
)

if TYPE_CHECKING:
    from plant.model import Model


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("add", cls=many("--from", "--value"))(add)


def add(
    model: ModelOption,
    output: ModelOut,
    effects: Annotated[
        list[str] | None,
        typer.Argument(metavar="EFFECT...", help="Effects to fit.", autocompletion=complete_effects),
    ] = None,
    logs: Annotated[
        list[Path] | None, typer.Option("--from", metavar="LOG...", help="Logs to fit to.", show_default=False)
    ] = None,
    value: Annotated[
        list[str] | None,
        typer.Option("--value", metavar="EFFECT=P:V,...", help="Set values by hand instead, e.g. servo_lag=tau:0.05."),
    ] = None,
    topic: Topics = None,
    cutoff: Cutoff = 8.0,
    between: Between = None,
    json: JsonFile = None,
    force: Force = False,
    quiet: Quiet = False,
) -> None:
    """Fit effects to logs and write the model that has them; the model file's comments stay.

    All effects of the new model are fitted together, those that MODEL had already too. Logs, hashes, date and version
    are written beside the values.

    Example: `wrenchgap add com_offset servo_lag -m tilt_hexarotor --from train.mcap -o fitted.toml`
    """
    from flight.errors import UsageError
    from plant import model_file
    from replay.results import claim

    claim({"--output": output, "--json": json}, force=force, inputs=logs or ())
    base = model_file.load(model)
    if value and (effects or logs):
        raise UsageError("add: --value sets values by hand; leave out EFFECT and --from, or fit in a second step")
    if value:
        _set(base, value, output, json, force, quiet)
        return
    if not effects:
        raise UsageError("add: no effect named, e.g. com_offset; find one with wrenchgap explain")
    if not logs:
        raise UsageError("add: nothing to fit to; give logs with --from LOG..., or values with --value EFFECT=P:V")
    _fit(base, list(effects), logs, output, topic, cutoff, between, json, force, quiet)


def _fit(
    base: Model,
    effects: list[str],
    logs: list[Path],
    output: Path,
    topic: list[str] | None,
    cutoff: float,
    between: str | None,
    json: Path | None,
    force: bool,
    quiet: bool,
) -> None:
    from plant import model_file
    from plant.effects import find
    from replay import comparison, editing, tables
    from replay.console import Printer, progress
    from replay.flights import open_flights
    from replay.results import document, log_input, model_input, write_json

    for name in effects:
        find(name)
    printer = Printer(quiet)
    hz = comparison.cutoff_checked(cutoff)
    with progress("fitting", quiet) as report:
        report(0.0, "reading logs")
        flights = open_flights(logs, base, topics=parse_topics(topic), cutoff_hz=hz, between=parse_between(between))
        edited = editing.add_fitted(base, effects, flights, cutoff_hz=hz, progress=report)
    source = model_input(base)  # before the output may replace it
    saved = model_file.save(edited.model, output, force=force)
    together = [e.name for e in base.effects if e.name not in effects]
    if edited.refitted:
        printer.line(f"already in {base.name}, fitted anew: {', '.join(edited.refitted)}")
    if together:
        printer.line(f"fitted together with what {base.name} has: {', '.join(together)}")
    printer.show(tables.parameters(edited.rows, f"effects of {saved.name}"))
    rows = [("rms before", edited.rms_before), ("rms after", edited.rms_after)]
    fall = 1.0 - edited.rms_after / edited.rms_before
    printer.show(tables.before_after("on the fitted logs", rows, fall))
    limits = [f"{name} ended at the limit of what is plausible; see docs/effects" for name in edited.fit.at_bound]
    printer.notes(limits, "warning")
    notes = [note for f in flights for note in f.notes]
    printer.notes(notes)
    if json is not None:
        inputs = [*(log_input(f.flight) for f in flights), source]
        body = {**edited.to_json(), "model": str(output), "cutoff_hz": cutoff, "notes": [*limits, *notes]}
        write_json(json, document("add", body, inputs), force=force)
    printer.wrote(model=output, result=json)


def _set(base: Model, values: list[str], output: Path, json: Path | None, force: bool, quiet: bool) -> None:
    from plant import model_file
    from replay import editing, tables
    from replay.console import Printer
    from replay.results import document, model_input, write_json

    source = model_input(base)  # before the output may replace it
    saved = model_file.save(editing.set_by_hand(base, values), output, force=force)
    printer = Printer(quiet)
    printer.show(tables.parameters(editing.rows_of(saved), f"effects of {saved.name}"))
    if json is not None:
        body = {"effects": editing.effects_json(saved), "refitted": [], "model": str(output)}
        write_json(json, document("add", body, [source]), force=force)
    printer.wrote(model=output, result=json)
