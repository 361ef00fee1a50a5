"""`wrenchgap add`: put effects into a model."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from wrenchgap.replay.cli import options as o
from wrenchgap.replay.cli.requests import Reading, Run

if TYPE_CHECKING:
    from wrenchgap.plant.model import Model

MANY = ("--from", "--value")


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
    *,
    reading: Reading,
    run: Run,
) -> None:
    """Fit effects to logs and write the model that has them; the model file's comments stay.

    All effects of the new model are fitted together, those that MODEL had already too. Logs, hashes, date and version
    are written beside the values, and the new file carries the history of all its versions (`wrenchgap history`).

    Example: `wrenchgap add com_offset servo_lag -m tilt_hexarotor --from train.mcap -o fitted.toml`
    """
    run.claim({"--output": output}, *(logs or ()))
    base, command = run.model(model), o.command_line(ctx)
    if value and (effects or logs):
        raise o.usage_error("add: --value sets values by hand; leave out EFFECT and --from, or fit in a second step")
    if value:
        _set(run, base, value, output, command)
        return
    if not effects:
        raise o.usage_error("add: no effect named, e.g. com_offset; find one with wrenchgap explain")
    if not logs:
        raise o.usage_error("add: nothing to fit to; give logs with --from LOG..., or values with --value EFFECT=P:V")
    o.parse_effects(",".join(effects))
    from wrenchgap.replay import api

    with run.progress("fitting") as report:
        flights, _ = run.open(reading.options, logs, base)
        added = api.add(base, effects, flights, progress=report)
    saved = api.save_model(added, output, command=command, force=run.force)
    run.result(added)
    number = saved.history[-1].number
    run.write("add", {**added.to_json(), "model": str(output), "model_version": number})
    run.wrote(**{f"model (version {number})": output})


def _set(run: Run, base: Model, values: list[str], output: Path, command: str) -> None:
    from wrenchgap.plant.effect_values import set_by_hand
    from wrenchgap.replay import api
    from wrenchgap.replay.present.addition import effects_json, model_table

    saved = api.save_model(set_by_hand(base, values), output, before=base, command=command, force=run.force)
    run.show(model_table(saved))
    kept = {"model": str(output), "model_version": saved.history[-1].number}
    run.write("add", {"effects": effects_json(saved.snapshot), "refitted": [], **kept})
    run.wrote(model=output)
