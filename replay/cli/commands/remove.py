"""`wrenchgap remove`: take effects out of a model."""

from __future__ import annotations

import typer

from wrenchgap.replay.cli.options import (
    Effects,
    Force,
    JsonFile,
    ModelOption,
    ModelOut,
    OwnEffects,
    Quiet,
    command_line,
)


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("remove")(remove)


def remove(
    ctx: typer.Context,
    effects: Effects,
    model: ModelOption,
    output: ModelOut,
    own: OwnEffects = None,
    json: JsonFile = None,
    force: Force = False,
    quiet: Quiet = False,
) -> None:
    """Take effects out of a model; the others keep their values (fit them anew with `wrenchgap add`).

    Example: `wrenchgap remove servo_lag -m fitted.toml -o without.toml`
    """
    from wrenchgap.learn.identify import add as editing
    from wrenchgap.plant import model_file
    from wrenchgap.replay.cli.console import Printer
    from wrenchgap.replay.present import tables
    from wrenchgap.replay.present.documents import claim, document, model_input, write_json

    claim({"--output": output, "--json": json}, force=force)
    base = model_file.load(model)
    source = model_input(base)  # before the output may replace it
    less = model_file.next_version(base, base.without(effects), command=command_line(ctx), path=output)
    saved = model_file.save(less, output, force=force)
    printer = Printer(quiet)
    printer.line(f"removed {', '.join(dict.fromkeys(effects))} from {base.name}")
    if saved.effects:
        printer.show(tables.parameters(editing.rows_of(saved), f"effects of {saved.name}"))
    if json is not None:
        body = {"removed": list(dict.fromkeys(effects)), "effects": editing.effects_json(saved), "model": str(output)}
        body["model_version"] = saved.history[-1].number
        write_json(json, document("remove", body, [source]), force=force)
    printer.wrote(**{f"model (version {saved.history[-1].number})": output, "result": json})
