"""`wrenchgap add`: put effects into a model."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from wrenchgap.replay.cli import options as o
from wrenchgap.replay.cli.requests import Reading, show_result, write_result

if TYPE_CHECKING:
    from wrenchgap.plant.model import Model


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("add", cls=o.many("--from", "--value"))(add)


def add(
    ctx: typer.Context,
    model: o.ModelOption,
    output: o.ModelOut,
    effects: Annotated[
        list[str] | None,
        typer.Argument(metavar="EFFECT...", help="Effects to fit.", autocompletion=o.complete_effects),
    ] = None,
    logs: o.FromLogs = None,
    value: Annotated[
        list[str] | None,
        typer.Option("--value", metavar="EFFECT=P:V,...", help="Set values by hand instead, e.g. servo_lag=tau:0.05."),
    ] = None,
    topic: o.Topics = None,
    shift: o.Shift = None,
    cutoff: o.Cutoff = 8.0,
    between: o.Between = None,
    own: o.OwnEffects = None,
    json: o.JsonFile = None,
    force: o.Force = False,
    quiet: o.Quiet = False,
) -> None:
    """Fit effects to logs and write the model that has them; the model file's comments stay.

    All effects of the new model are fitted together, those that MODEL had already too. Logs, hashes, date and version
    are written beside the values, and the new file carries the history of all its versions (`wrenchgap history`).

    Example: `wrenchgap add com_offset servo_lag -m tilt_hexarotor --from train.mcap -o fitted.toml`
    """
    from wrenchgap.flight.errors import UsageError
    from wrenchgap.replay import api
    from wrenchgap.replay.present.documents import claim

    claim({"--output": output, "--json": json}, force=force, inputs=logs or ())
    base, command = api.load_model(model), o.command_line(ctx)
    if value and (effects or logs):
        raise UsageError("add: --value sets values by hand; leave out EFFECT and --from, or fit in a second step")
    if value:
        _set(base, value, output, command, json, force, quiet)
        return
    if not effects:
        raise UsageError("add: no effect named, e.g. com_offset; find one with wrenchgap explain")
    if not logs:
        raise UsageError("add: nothing to fit to; give logs with --from LOG..., or values with --value EFFECT=P:V")
    _fit(base, effects, logs, Reading.of(topic, shift, cutoff, between), output, command, json, force, quiet)


def _fit(
    base: Model,
    effects: list[str],
    logs: list[Path],
    reading: Reading,
    output: Path,
    command: str,
    json: Path | None,
    force: bool,
    quiet: bool,
) -> None:
    from wrenchgap.replay import api
    from wrenchgap.replay.cli.console import Printer, progress
    from wrenchgap.replay.present.documents import model_input

    o.parse_effects(",".join(effects))
    with progress("fitting", quiet) as report:
        report(0.0, "reading logs")
        flights = reading.open(logs, base)
        added = api.add(base, effects, flights, progress=report)
    source = model_input(base)  # before the output may replace it
    saved = api.save_model(added, output, command=command, force=force)
    printer = Printer(quiet)
    show_result(printer, added)
    number = saved.history[-1].number
    body = {**added.to_json(), "model": str(output), "model_version": number}
    write_result(json, "add", body, force=force, flights=flights, inputs=[source])
    printer.wrote(**{f"model (version {number})": output, "result": json})


def _set(
    base: Model, values: list[str], output: Path, command: str, json: Path | None, force: bool, quiet: bool
) -> None:
    from wrenchgap.plant.effect_values import set_by_hand
    from wrenchgap.replay import api
    from wrenchgap.replay.cli.console import Printer
    from wrenchgap.replay.present.addition import effects_json, model_table
    from wrenchgap.replay.present.documents import model_input

    source = model_input(base)  # before the output may replace it
    saved = api.save_model(set_by_hand(base, values), output, before=base, command=command, force=force)
    printer = Printer(quiet)
    printer.show(model_table(saved))
    number = saved.history[-1].number
    body = {
        "effects": effects_json(saved.snapshot), "refitted": [], "model": str(output), "model_version": number
    }  # fmt: skip
    write_result(json, "add", body, force=force, inputs=[source])
    printer.wrote(model=output, result=json)
