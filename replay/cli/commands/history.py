"""`wrenchgap history`: the versions of a model file."""

from __future__ import annotations

from typing import Annotated

import typer

from wrenchgap.replay.cli import options as o
from wrenchgap.replay.cli.requests import write_result


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("history")(history)


def history(
    model: Annotated[
        str,
        typer.Argument(
            metavar="MODEL", help="Model file (.toml).", autocompletion=o.complete_models, show_default=False
        ),
    ],
    own: o.OwnEffects = None,
    json: o.JsonFile = None,
    force: o.Force = False,
    quiet: o.Quiet = False,
) -> None:
    """Versions of a model: what each changed, from which flights, and what that did to the error.

    The model file carries its history itself; the files that it came from need not exist any more. Errors are on
    held-out time.

    Example: `wrenchgap history fitted.toml`
    """
    from wrenchgap.replay import api
    from wrenchgap.replay.cli.console import Printer
    from wrenchgap.replay.present import history as present
    from wrenchgap.replay.present.documents import claim

    claim({"--json": json}, force=force, inputs=[model])
    read = api.load_model(model)
    printer = Printer(quiet)
    printer.show(*present.parts(read))
    write_result(json, "history", present.to_json(read), force=force, models=[(read, "model")])
    printer.wrote(result=json)
