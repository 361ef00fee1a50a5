"""`wrenchgap batch inspect`: what is in thousands of logs."""

from __future__ import annotations

from wrenchgap.replay.cli import batches as b
from wrenchgap.replay.cli.requests import Reading, Run


def inspect(
    logs: b.Sources, output: b.Output, model: b.SomeModels = None, *, reading: Reading, where: b.Where, run: Run
) -> None:
    """Check every log: a row with its worst check and all that `wrenchgap inspect --json` says.

    Example: `wrenchgap batch inspect flights/ -o inspected`
    """
    from wrenchgap.replay.batch.plan import Plan, parsed_models

    b.batch(Plan("inspect", parsed_models(model or []), reading.options.to_json()), logs, output, where, run)
