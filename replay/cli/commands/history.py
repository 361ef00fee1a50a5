"""`wrenchgap history`: the versions of a model file."""

from __future__ import annotations

from typing import Annotated

import typer

from wrenchgap.replay.cli import options as o
from wrenchgap.replay.cli.requests import Run


def history(
    model: Annotated[
        str,
        typer.Argument(
            metavar="MODEL", help="Model file (.toml).", autocompletion=o.complete_models, show_default=False
        ),
    ],
    *,
    run: Run,
) -> None:
    """Versions of a model: what each changed, from which flights, and what that did to the error.

    The model file carries its history itself; the files that it came from need not exist any more. Errors are on
    held-out time.

    Example: `wrenchgap history fitted.toml`
    """
    from wrenchgap.replay.present import history as present

    run.claim({}, model)
    read = run.model(model)
    run.show(*present.parts(read))
    run.write("history", present.to_json(read))
    run.wrote()
