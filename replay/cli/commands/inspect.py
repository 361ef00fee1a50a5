"""`wrenchgap inspect`: what is in a log."""

from __future__ import annotations

from typing import Annotated

import typer

from wrenchgap.replay.cli import options as o
from wrenchgap.replay.cli.requests import Omit, Reading, Run

FOUND_BAD = 3
"""Exit code where the command did its work and the log is bad."""


def inspect(
    logs: o.Logs,
    model: Annotated[
        str | None,
        typer.Option(
            "--model",
            "-m",
            metavar="MODEL",
            help="Check the log against this model too.",
            autocompletion=o.complete_models,
        ),
    ] = None,
    *,
    reading: Annotated[Reading, Omit("between")],
    run: Run,
) -> None:
    """What is in a log: topics, the roles they play, rates, gaps, clocks, and whether the values are plausible.

    Each check that fails says what to do. With a model, its mass, rotors and actuation are checked as well. Then the
    delays between the topics and, with a model, of the response behind its commands (docs/timing.md).

    The exit code is 3 where a check is bad and not accepted, so that a script does not go on.

    Example: `wrenchgap inspect flight.mcap -m crazyflie --topic imu=/my/imu`
    """
    from wrenchgap._lazy import uncollected

    with uncollected():
        from wrenchgap.learn.diagnose import model_checks

    run.claim({}, *logs)
    known = None if model is None else run.model(model)
    bodies = []
    for path in logs:
        seen = model_checks.inspect(path, known, reading.options)
        run.result(seen)
        bodies.append(seen.to_json())
    run.inputs[:0] = [{"role": "log", "file": b["path"], "sha256": b["sha256"]} for b in bodies]
    run.write("inspect", {"logs": bodies})
    run.wrote()
    found = [check for body in bodies for check in (*body["checks"], *body["model_checks"])]
    if any(check["level"] == "bad" and not check["accepted"] for check in found):
        raise typer.Exit(FOUND_BAD)
