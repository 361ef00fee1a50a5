"""`wrenchgap add`: put effects into a model."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from wrenchgap.replay.cli.options import (
    Between,
    Cutoff,
    Force,
    JsonFile,
    ModelOption,
    ModelOut,
    OwnEffects,
    Quiet,
    Shift,
    Topics,
    command_line,
    complete_effects,
    many,
    parse_between,
    parse_shifts,
    parse_topics,
)

if TYPE_CHECKING:
    from wrenchgap.plant.model import Model


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("add", cls=many("--from", "--value"))(add)


def add(
    ctx: typer.Context,
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
    shift: Shift = None,
    cutoff: Cutoff = 8.0,
    between: Between = None,
    own: OwnEffects = None,
    json: JsonFile = None,
    force: Force = False,
    quiet: Quiet = False,
) -> None:
    """Fit effects to logs and write the model that has them; the model file's comments stay.

    All effects of the new model are fitted together, those that MODEL had already too. Logs, hashes, date and version
    are written beside the values, and the new file carries the history of all its versions (`wrenchgap history`).

    Example: `wrenchgap add com_offset servo_lag -m tilt_hexarotor --from train.mcap -o fitted.toml`
    """
    from wrenchgap.flight.errors import UsageError
    from wrenchgap.plant import model_file
    from wrenchgap.replay.present.documents import claim

    claim({"--output": output, "--json": json}, force=force, inputs=logs or ())
    base = model_file.load(model)
    if value and (effects or logs):
        raise UsageError("add: --value sets values by hand; leave out EFFECT and --from, or fit in a second step")
    if value:
        _set(ctx, base, value, output, json, force, quiet)
        return
    if not effects:
        raise UsageError("add: no effect named, e.g. com_offset; find one with wrenchgap explain")
    if not logs:
        raise UsageError("add: nothing to fit to; give logs with --from LOG..., or values with --value EFFECT=P:V")
    _fit(ctx, base, list(effects), logs, output, topic, shift, cutoff, between, json, force, quiet)


def _fit(
    ctx: typer.Context,
    base: Model,
    effects: list[str],
    logs: list[Path],
    output: Path,
    topic: list[str] | None,
    shift: list[str] | None,
    cutoff: float,
    between: str | None,
    json: Path | None,
    force: bool,
    quiet: bool,
) -> None:
    from wrenchgap.learn.data import comparison
    from wrenchgap.learn.data.opening import open_flights
    from wrenchgap.learn.identify import add as editing
    from wrenchgap.plant import model_file
    from wrenchgap.plant.effects import find
    from wrenchgap.replay.cli.console import Printer, progress
    from wrenchgap.replay.present import tables
    from wrenchgap.replay.present.documents import document, log_input, model_input, write_json

    for name in effects:
        find(name)
    printer = Printer(quiet)
    hz = comparison.cutoff_checked(cutoff)
    with progress("fitting", quiet) as report:
        report(0.0, "reading logs")
        topics, shifts = parse_topics(topic), parse_shifts(shift)
        flights = open_flights(logs, base, topics=topics, cutoff_hz=hz, between=parse_between(between), shifts=shifts)
        edited = editing.add_fitted(base, effects, flights, cutoff_hz=hz, progress=report)
    source = model_input(base)  # before the output may replace it
    versioned = model_file.next_version(
        base, edited.model, command=command_line(ctx), path=output, flights=edited.flights, trial=edited.trial
    )
    saved = model_file.save(versioned, output, force=force)
    together = [e.name for e in base.effects if e.name not in effects]
    if edited.refitted:
        printer.line(f"already in {base.name}, fitted anew: {', '.join(edited.refitted)}")
    if together:
        printer.line(f"fitted together with what {base.name} has: {', '.join(together)}")
    printer.show(tables.parameters(edited.rows, f"effects of {saved.name}"))
    rows = [("rms before", edited.rms_before), ("rms after", edited.rms_after)]
    fall = 1.0 - edited.rms_after / edited.rms_before
    if edited.trial is None:
        printer.show(tables.before_after("on the fitted logs", rows, fall))
    else:
        tried = [("rms before", edited.trial.before), ("rms after", edited.trial.after)]
        tried.append(("sensor noise", edited.trial.noise))
        printer.show(tables.before_after("on time of these logs that was not fitted", tried, edited.trial.fall))
        printer.line(edited.trial.verdict, style="yellow" if edited.trial.verdict.startswith("worse") else "")
    limits = [f"{name} ended at the limit of what is plausible; see docs/effects" for name in edited.fit.at_bound]
    printer.notes(limits, "warning")
    notes = [*base.notes, *(note for f in flights for note in f.notes)]
    printer.notes(notes)
    if json is not None:
        inputs = [*(log_input(f.flight) for f in flights), source]
        head = {"model": str(output), "model_version": saved.history[-1].number}
        body = {**edited.to_json(), **head, "cutoff_hz": cutoff, "notes": [*limits, *notes]}
        write_json(json, document("add", body, inputs), force=force)
    printer.wrote(**{f"model (version {saved.history[-1].number})": output, "result": json})


def _set(
    ctx: typer.Context, base: Model, values: list[str], output: Path, json: Path | None, force: bool, quiet: bool
) -> None:
    from wrenchgap.learn.identify import add as editing
    from wrenchgap.plant import model_file
    from wrenchgap.plant.effect_values import set_by_hand
    from wrenchgap.replay.cli.console import Printer
    from wrenchgap.replay.present import tables
    from wrenchgap.replay.present.documents import document, model_input, write_json

    source = model_input(base)  # before the output may replace it
    changed = set_by_hand(base, values)
    versioned = model_file.next_version(base, changed, command=command_line(ctx), path=output)
    saved = model_file.save(versioned, output, force=force)
    printer = Printer(quiet)
    printer.show(tables.parameters(editing.rows_of(saved), f"effects of {saved.name}"))
    if json is not None:
        head = {"model": str(output), "model_version": saved.history[-1].number}
        body = {"effects": editing.effects_json(saved), "refitted": [], **head}
        write_json(json, document("add", body, [source]), force=force)
    printer.wrote(model=output, result=json)
