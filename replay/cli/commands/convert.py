"""`wrenchgap convert`: any log as MCAP with our roles."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from wrenchgap.replay.cli import options as o
from wrenchgap.replay.cli.requests import Omit, Reading, Run


def convert(
    ctx: typer.Context,
    logs: o.Logs,
    output: Annotated[
        Path,
        typer.Option(
            "--output", "-o", metavar="OUT", help="Log to write (.mcap), or an existing folder.", show_default=False
        ),
    ],
    *,
    reading: Annotated[Reading, Omit("cutoff", "between", "accept", "keep")],
    run: Run,
) -> None:
    """Write logs of any format as MCAP with ROS 2 messages, which Foxglove, PlotJuggler and the rosbag tools open.

    Only what plays a role is written, in SI, FLU and ENU, on one clock, without what was left out. Several logs go into
    a folder, under their own names. Reading the result gives the same flight.

    Example: `wrenchgap convert flight.ulg -o flight.mcap`
    """
    from wrenchgap import flight
    from wrenchgap.replay.present.documents import log_input

    asked = reading.options
    targets = _targets(logs, output)
    run.claim({f"--output {log.name}": target for log, target in targets.items()}, *logs)
    bodies = []
    with run.progress("converting") as told:
        for number, (log, target) in enumerate(targets.items()):
            told(number / len(targets), f"reading {log.name}")
            found = flight.load(log, asked.topics, unmeasured=asked.unmeasured, budget=asked.budget)
            found = flight.shifted(found, asked.shifts or {})
            source = {"source": str(log), "source_sha256": found.content_hash, "command": o.command_line(ctx)}
            flight.write(found, target, metadata=source | {"notes": "\n".join(found.notes)}, force=run.force)
            run.inputs.append(log_input(found))
            played = found.series().items()
            run.line(f"{log}: {', '.join(f'{role} ({len(series.time)})' for role, series in played)}")
            run.notes(found.notes)
            run.line(f"wrote log {target}")
            roles = {role: {"topic": series.topic, "samples": len(series.time)} for role, series in played}
            bodies.append({"log": str(log), "output": str(target), "roles": roles, "notes": list(found.notes)})
    run.write("convert", {"logs": bodies})
    run.wrote()


def _targets(logs: list[Path], output: Path) -> dict[Path, Path]:
    """Where each log goes; raises UsageError for several logs and no folder."""
    if output.is_dir():
        return {log: output / f"{log.name if log.is_dir() else log.stem}.mcap" for log in logs}
    if len(logs) > 1:
        raise o.usage_error(f"--output {output}: {len(logs)} logs go into a folder; expected one that exists")
    if output.suffix != ".mcap":
        raise o.usage_error(
            f"--output {output}: logs are written as MCAP; expected a name that ends in .mcap, or a folder"
        )
    return {logs[0]: output}
