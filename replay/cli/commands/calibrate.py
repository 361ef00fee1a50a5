"""`wrenchgap calibrate`: trim a model on flights that are known to be healthy."""

from __future__ import annotations

import typer

from wrenchgap.replay.cli import options as o
from wrenchgap.replay.cli.requests import Reading, Run

MANY = ("--validate",)


def calibrate(
    ctx: typer.Context,
    logs: o.Logs,
    model: o.ModelOption,
    output: o.ModelOut,
    validate: o.Validate = None,
    *,
    reading: Reading,
    run: Run,
) -> None:
    """Trim a model on healthy flights: thrust, centre of mass, torque ratio, IMU, timing; only what helps is changed.

    An effect is kept where it lowers the error on blocks of time that its fit did not see, and, with several flights,
    on flights that were left out whole. Values are written with their standard deviation, which has the scatter
    between flights, and with logs, hashes, date and version.

    Example: `wrenchgap calibrate monday.ulg tuesday.ulg -m vehicle.toml -o calibrated.toml`
    """
    from wrenchgap.replay import api, modelling

    run.claim({"--output": output}, *logs, *(validate or ()))
    base, command = run.model(model), o.command_line(ctx)
    with run.progress("calibrating") as report:
        flights, tests = run.open(reading.options, logs, base, validate)
        found = modelling.calibrate(flights, base, validate=tests, progress=report)
    kept = found.given if found.added is None else found.added
    saved = api.save_model(kept, output, before=base, command=command, force=run.force)
    run.result(found)
    number = saved.history[-1].number
    run.write("calibrate", {**found.to_json(), "model": str(output), "model_version": number})
    run.wrote(**{f"model (version {number})": output})
