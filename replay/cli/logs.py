"""Logs as arguments: a folder of flights stands for the flights in it, wherever a command takes several logs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def existing(paths: list[Path] | Path | None) -> list[Path] | Path | None:
    """The same paths, once all are there: asked before anything heavy is imported."""
    for path in [paths] if isinstance(paths, Path) else paths or ():
        if not path.exists():
            raise typer.BadParameter(f"{path}: no such file or folder")
    return paths


def flights(paths: list[Path] | None) -> list[Path] | None:
    """The same logs, with each folder that is no bag replaced by the logs in it."""
    existing(paths)
    if not paths or not any(path.is_dir() for path in paths):
        return paths
    from wrenchgap.flight.formats.folders import flights_in

    return [log for path in paths for log in flights_in(path)]


Logs = Annotated[
    list[Path],
    typer.Argument(
        metavar="LOG...",
        help="Logs: .mcap, .bag, ROS 2 bag, .ulg, .bin, .csv, .parquet, or folders of them.",
        show_default=False,
        callback=flights,
    ),
]
FromLogs = Annotated[
    list[Path] | None,
    typer.Option("--from", metavar="LOG...", help="Logs to fit to.", show_default=False, callback=flights),
]
Validate = Annotated[
    list[Path] | None,
    typer.Option("--validate", metavar="LOG...", help="Flights to test the result on; never fitted.", callback=flights),
]
Log = Annotated[
    Path,
    typer.Argument(
        metavar="LOG",
        help="Log: .mcap, .bag, ROS 2 bag folder, .ulg, .bin, .csv, .parquet.",
        show_default=False,
        callback=existing,
    ),
]
