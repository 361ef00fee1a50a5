"""`wrenchgap model show`: what a model file says, as it was understood."""

from __future__ import annotations

from typing import Annotated

import typer

from wrenchgap.replay.cli import options as o
from wrenchgap.replay.cli.requests import Run


def show(
    model: Annotated[
        str,
        typer.Argument(
            metavar="MODEL",
            help="Model file (.toml), or the name of a shipped model.",
            autocompletion=o.complete_models,
            show_default=False,
        ),
    ],
    figure: o.Figure = None,
    *,
    run: Run,
) -> None:
    """What a model file says, as it was understood: mass properties, rotors, the command curve, effects.

    With --figure a top view is drawn: arms, rotors with their direction of turn, centre of mass, IMU.

    Example: `wrenchgap model show vehicle.toml --figure vehicle.png`
    """
    from wrenchgap.replay import modelling

    run.claim({"--figure": figure}, model)
    sheet = modelling.sheet(run.model(model))
    run.result(sheet)
    run.draw(sheet, figure)
    run.write("model", sheet.to_json())
    run.wrote(figure=figure)
