"""`wrenchgap discover`: a law for what the catalogue has no name for."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from wrenchgap.replay.cli import options as o
from wrenchgap.replay.cli.requests import DetailedRun
from wrenchgap.replay.cli.values import usage_error


def discover(
    logs: o.Logs,
    model: o.ModelOption,
    validate: o.Validate = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FILE", help="Effect file of the law to write (.py).")
    ] = None,
    figure: o.Figure = None,
    *,
    reading: o.Reading,
    run: DetailedRun,
) -> None:
    """Find the law of what `explain` cannot name, or say that these logs carry none.

    Hundreds of laws (powers of velocity, rates, thrust, height, time, angles; along body axes, fixed directions, rotors
    and arms) are tried on what the named effects leave. A law must beat what chance finds in residuals that have
    nothing to do with the flights, be found again in halves of the time, and predict time or flights (--validate) that
    it was not fitted to. The file written is an effect of your own: add, simulate and export it with --effects.

    Example: `wrenchgap discover train.mcap -m tilt_hexarotor --validate test.mcap -o law.py`
    """
    from wrenchgap.flight.atomic import atomic
    from wrenchgap.replay import api
    from wrenchgap.replay.present.discovery import what_next

    run.claim({"--output": output, "--figure": figure}, *logs, *(validate or ()), model)
    if output is not None and output.suffix != ".py":
        raise usage_error(f"--output {output}: the law is a Python file; expected a name that ends in .py")
    base = run.model(model)
    with run.progress("discovering") as report:
        flights, tests = run.open(reading.options, logs, base, validate)
        found = api.discover(flights, base, validate=tests, progress=report)
    run.result(found)
    if output is not None and found.source:
        with atomic(output) as partial:
            partial.write_text(found.source, encoding="utf-8")
    written = output if found.source else None
    run.show(*what_next(found, model, [str(p) for p in logs], None if written is None else str(written)))
    run.notes([*base.notes, *(note for f in tests for note in f.notes)])
    run.save("discover", found, figure=figure, **({} if written is None else {"law": written}))
