"""`wrenchgap remove`: take effects out of a model."""

from __future__ import annotations

import typer

from wrenchgap.replay.cli import options as o
from wrenchgap.replay.cli.requests import Run


def remove(
    ctx: typer.Context,
    effects: o.Effects,
    model: o.ModelOption,
    output: o.ModelOut,
    *,
    run: Run,
) -> None:
    """Take effects out of a model; the others keep their values (fit them anew with `wrenchgap add`).

    Example: `wrenchgap remove servo_lag -m fitted.toml -o without.toml`
    """
    from wrenchgap.replay import api
    from wrenchgap.replay.present.addition import effects_json, model_table

    run.claim({"--output": output})
    base = run.model(model)
    saved = api.save_model(base.without(effects), output, before=base, command=o.command_line(ctx), force=run.force)
    names = list(dict.fromkeys(effects))
    run.line(f"removed {', '.join(names)} from {base.name}")
    run.show(*([model_table(saved)] if saved.effects else []))
    number = saved.history[-1].number
    body = {"removed": names, "effects": effects_json(saved.snapshot), "model": str(output), "model_version": number}
    run.write("remove", body)
    run.wrote(**{f"model (version {number})": output})
