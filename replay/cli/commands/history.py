"""`wrenchgap history`: the versions of a model file."""

from __future__ import annotations

from typing import Annotated

import typer

from wrenchgap.replay.cli.options import Force, JsonFile, OwnEffects, Quiet, complete_models


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("history")(history)


def history(
    model: Annotated[
        str,
        typer.Argument(metavar="MODEL", help="Model file (.toml).", autocompletion=complete_models, show_default=False),
    ],
    own: OwnEffects = None,
    json: JsonFile = None,
    force: Force = False,
    quiet: Quiet = False,
) -> None:
    """Versions of a model: what each changed, from which flights, and what that did to the error.

    The model file carries its history itself; the files that it came from need not exist any more. Errors are those
    on time that was not fitted.

    Example: `wrenchgap history fitted.toml`
    """
    from wrenchgap.plant import model_file
    from wrenchgap.replay.cli.console import Printer
    from wrenchgap.replay.present import history as versions
    from wrenchgap.replay.present.documents import claim, document, model_input, write_json

    claim({"--json": json}, force=force, inputs=[model])
    read = model_file.load(model)
    printer = Printer(quiet)
    if not read.history:
        printer.line(f"{read.name}: no history; wrenchgap add and wrenchgap remove write one")
    else:
        printer.show(versions.table_of_versions(read))
        moved = versions.table_of_changes(read)
        if moved.row_count:
            printer.show(moved)
    printer.notes(versions.notes(read))
    if json is not None:
        write_json(json, document("history", versions.to_json(read), [model_input(read)]), force=force)
    printer.wrote(result=json)
