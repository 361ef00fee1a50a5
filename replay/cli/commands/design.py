"""`wrenchgap design`: the flight that separates effects."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from wrenchgap.replay.cli import options as o
from wrenchgap.replay.cli.requests import Omit, Reading, Run

if TYPE_CHECKING:
    from wrenchgap.learn.design.manoeuvres import Limits
    from wrenchgap.plant.vehicle import Vehicle

MANY = ("--from", "--also")
READ = ("topic", "shift", "between", "unmeasured", "accept", "keep")
"""Options that say how logs are read: nothing that a simulation needs."""
Trajectory = Annotated[
    Path, typer.Option("--output", "-o", metavar="FLIGHT", help="Trajectory to write (.toml).", show_default=False)
]
SizesFrom = Annotated[
    list[Path] | None,
    typer.Option("--from", metavar="LOG...", help="Logs to take the effects' sizes from, and to compare with."),
]
Duration = Annotated[float, typer.Option("--duration", metavar="S", help="Length of the flight, in seconds.")]
Room = Annotated[
    str | None, typer.Option("--room", metavar="X,Y,Z", help="Free space in metres, floor at z = 0 (default 4,4,3).")
]
Tilt = Annotated[
    float | None,
    typer.Option("--max-tilt", metavar="DEG", help="Largest tilt, in degrees; default: 60, or 30 for fixed rotors."),
]
Speed = Annotated[float, typer.Option("--max-speed", metavar="M/S", help="Largest speed, in m/s.")]
Also = Annotated[
    list[str] | None,
    typer.Option(
        "--also",
        metavar="EFFECT...",
        help="Effects that are fitted along with these (default: inertia and a command delay; none: nothing).",
        autocompletion=o.complete_effects,
    ),
]
Anyway = Annotated[bool, typer.Option("--anyway", help="Write the best flight found even if it separates nothing.")]
Sampled = Annotated[
    Path | None, typer.Option("--csv", metavar="FILE", help="The sampled reference, for other flight stacks.")
]
Seed = Annotated[int, typer.Option("--seed", metavar="N", min=0, help="Seed of the sensor noise.")]


def design(
    ctx: typer.Context,
    effects: o.Effects,
    model: o.ModelOption,
    output: Trajectory,
    logs: SizesFrom = None,
    duration: Duration = 30.0,
    room: Room = None,
    max_tilt: Tilt = None,
    max_speed: Speed = 2.0,
    also: Also = None,
    anyway: Anyway = False,
    csv: Sampled = None,
    figure: o.Figure = None,
    seed: Seed = 0,
    *,
    reading: Annotated[Reading, Omit("cutoff")],
    run: Run,
) -> None:
    """Find the reference trajectory that separates effects, and check it on the simulated vehicle.

    Sizes of the effects are those of MODEL, else fitted to the logs, else typical. Where no trajectory can separate
    them, the result says what would, and no file is written. Fly the result with `wrenchgap simulate -t FLIGHT`.

    Example: `wrenchgap design com_offset constant_wrench -m tilt_hexarotor -o flight.toml`
    """
    # Long because typer reads the options from the signature, one a line.
    from wrenchgap.replay import api
    from wrenchgap.replay.present import design as present

    run.claim({"--output": output, "--csv": csv, "--figure": figure}, *(logs or ()), model)
    if output.suffix != ".toml":
        raise o.usage_error(f"--output {output}: trajectories are written as TOML; expected a name that ends in .toml")
    base = run.model(model)
    along = None if also is None else o.parse_effects(",".join(n for n in also if n != "none"))
    with run.progress("designing") as report:
        found = api.design(
            o.parse_effects(",".join(effects)),
            base,
            run.open(reading.options, logs or [], base)[0],
            limits=_limits(base.vehicle, room, max_tilt, max_speed),
            duration=duration,
            also=along,
            unmeasured=reading.options.unmeasured,
            seed=seed,
            progress=report,
        )
    written = found.separable or anyway
    if written:
        present.write(found, output, csv, figure, force=run.force)
    run.result(found)
    run.write("design", {**found.to_json(), "trajectory": str(output) if written else None})
    run.wrote(**({"trajectory": output, "csv": csv, "figure": figure} if written else {}))
    if written:
        fly = shlex.join(["wrenchgap", "simulate", "-m", model, "-t", str(output), "-o", "flight.mcap"])
        run.line(f"next: {fly}{o.common_options(ctx, *READ)}, or fly it")


def _limits(vehicle: Vehicle, room: str | None, tilt_deg: float | None, speed: float) -> Limits:
    from dataclasses import replace

    import numpy as np

    from wrenchgap.learn.design.manoeuvres import usual

    limits = usual(vehicle)
    tilt = limits.tilt if tilt_deg is None else float(np.radians(tilt_deg))
    return replace(limits, room=o.parse_room(room) or limits.room, tilt=tilt, speed=speed)
