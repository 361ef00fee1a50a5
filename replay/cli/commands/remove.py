"""`wrenchgap remove`: take effects out of a model."""

from __future__ import annotations

import typer

from wrenchgap.replay.cli import options as o
from wrenchgap.replay.cli.requests import write_result


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("remove")(remove)


def remove(
    ctx: typer.Context,
    effects: o.Effects,
    model: o.ModelOption,
    output: o.ModelOut,
    own: o.OwnEffects = None,
    json: o.JsonFile = None,
    force: o.Force = False,
    quiet: o.Quiet = False,
) -> None:
    """Take effects out of a model; the others keep their values (fit them anew with `wrenchgap add`).

    Example: `wrenchgap remove servo_lag -m fitted.toml -o without.toml`
    """
    from wrenchgap.replay import api
    from wrenchgap.replay.cli.console import Printer
    from wrenchgap.replay.present.addition import effects_json, model_table
    from wrenchgap.replay.present.documents import claim, model_input

    claim({"--output": output, "--json": json}, force=force)
    base = api.load_model(model)
    source = model_input(base)  # before the output may replace it
    saved = api.save_model(base.without(effects), output, before=base, command=o.command_line(ctx), force=force)
    names = list(dict.fromkeys(effects))
    printer = Printer(quiet)
    printer.line(f"removed {', '.join(names)} from {base.name}")
    printer.show(*([model_table(saved)] if saved.effects else []))
    number = saved.history[-1].number
    body = {"removed": names, "effects": effects_json(saved.snapshot), "model": str(output), "model_version": number}
    write_result(json, "remove", body, force=force, inputs=[source])
    printer.wrote(**{f"model (version {number})": output, "result": json})
