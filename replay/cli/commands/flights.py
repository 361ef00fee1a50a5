"""`wrenchgap simulate`, `design`, `ready` and `predict`: flights flown, planned, judged and predicted."""

import shlex
from pathlib import Path
from typing import Annotated, Any

import typer

import wrenchgap as wg
from wrenchgap.replay.cli import options as o
from wrenchgap.replay.cli import values
from wrenchgap.replay.cli.requests import DetailedRun, Omit, Run


def _list(asked: bool) -> None:
    if not asked:
        return
    from wrenchgap.plant.trajectory import TRAJECTORIES
    from wrenchgap.replay.present.tables import table

    rows = [(name, f"{seconds:g} s", words) for name, (_, seconds, words) in TRAJECTORIES.items()]
    Run().show(table("trajectories", ("name", "length", "description"), rows, left=3))
    raise typer.Exit()


def simulate(
    run: Run,
    model: o.ModelOption,
    trajectory: Annotated[
        str,
        o.option(
            "NAME",
            "See --list; or a file of `wrenchgap design`.",
            "--trajectory",
            "-t",
            autocompletion=values.complete_trajectories,
        ),
    ],
    output: Annotated[Path, o.output("LOG", "Log to write (.mcap).")],
    duration: Annotated[float | None, o.option("S", "Length in seconds.")] = None,
    excitation: Annotated[float, o.option("SIZE", "Multisine on all axes: 1 is usual for training logs.")] = 0.0,
    seed: Annotated[int, o.option("N", "Seed of sensor noise and excitation.")] = 0,
    integral: Annotated[
        bool | None, typer.Option("--integral/--no-integral", help="Integral action of the controller.")
    ] = None,
    hide: Annotated[
        list[str] | None, o.option("EFFECT=P:V,...", "Effect of the plant that MODEL does not have.")
    ] = None,
    truth: Annotated[Path | None, o.option("FILE", "Write the true model, with the hidden effects.")] = None,
    list_: Annotated[
        bool, typer.Option("--list", callback=_list, is_eager=True, help="List the trajectories and exit.")
    ] = False,
) -> None:
    """Fly a simulated vehicle along a trajectory and write its log.

    The controller believes MODEL. With --hide the plant flies MODEL and the hidden effects, which the log does not
    reveal: parameters by name, or all of them in order.

    Example: `wrenchgap simulate -m voliro_x -t multi_axis --excitation 1 --hide com_offset=x:-0.004,y:0.007 -o a.mcap`
    """
    from wrenchgap.flight.write import write
    from wrenchgap.plant import model_file
    from wrenchgap.plant.simulation.flight_plan import Plan, fly, prepare, provenance, summary
    from wrenchgap.replay.present import simulation

    run.claim({"--output": output, "--truth": truth}, trajectory)
    values.check_ending(output, "logs are written as MCAP", ".mcap")
    plan = Plan(run.model(model), trajectory, duration, excitation, seed, integral, tuple(hide or ()))
    true, _, _ = prepare(plan)
    with run.progress("flying", "flying") as report:
        flown = fly(plan, name=output.stem, progress=lambda fraction: report(fraction, "flying"))
    write(flown, output, metadata=provenance(plan), force=run.force)
    if truth is not None:
        model_file.save(true, truth, force=run.force)
    went = summary(flown)
    run.line(simulation.line(output, plan, went))
    run.notes(flown.notes, "warning")
    run.write("simulate", simulation.to_json(output, plan, flown, went), log=output, true_model=truth)


READ = ("topic", "shift", "between", "unmeasured", "accept", "keep")
"""Options that say how logs are read: nothing that a simulation needs."""


def design(
    reading: Annotated[o.Reading, Omit("cutoff")],
    run: Run,
    effects: o.Effects,
    model: o.ModelOption,
    output: Annotated[Path, o.output("FLIGHT", "Trajectory to write (.toml).")],
    logs: Annotated[
        list[Path] | None, o.option("LOG...", "Logs to take the effects' sizes from, and to compare with.", "--from")
    ] = None,
    duration: Annotated[float, o.option("S", "Length of the flight, in seconds.")] = 30.0,
    room: Annotated[str | None, o.option("X,Y,Z", "Free space in metres, floor at z = 0 (default 4,4,3).")] = None,
    max_tilt: Annotated[
        float | None, o.option("DEG", "Largest tilt, in degrees; default: 60, or 30 for fixed rotors.")
    ] = None,
    max_speed: Annotated[float, o.option("M/S", "Largest speed, in m/s.")] = 2.0,
    also: Annotated[
        list[str] | None,
        o.option(
            "EFFECT...",
            "Effects that are fitted along with these (default: inertia and a command delay; none: nothing).",
            autocompletion=values.complete_effects,
        ),
    ] = None,
    anyway: Annotated[
        bool, typer.Option("--anyway", help="Write the best flight found even if it separates nothing.")
    ] = False,
    csv: Annotated[Path | None, o.option("FILE", "The sampled reference, for other flight stacks.")] = None,
    figure: o.Figure = None,
    seed: Annotated[int, o.option("N", "Seed of the sensor noise.", min=0)] = 0,
) -> None:
    """Find the reference trajectory that separates effects, and check it on the simulated vehicle.

    Sizes of the effects are those of MODEL, else fitted to the logs, else typical. Where no trajectory can separate
    them, the result says what would, and no file is written. Fly the result with `wrenchgap simulate -t FLIGHT`.

    Example: `wrenchgap design com_offset constant_wrench -m tilt_hexarotor -o flight.toml`
    """
    # Long because typer reads the options from the signature, one a line.
    from dataclasses import replace

    import numpy as np

    from wrenchgap.learn.design.manoeuvres import usual
    from wrenchgap.replay.present import design as present

    run.claim({"--output": output, "--csv": csv, "--figure": figure}, *(logs or ()), model)
    values.check_ending(output, "trajectories are written as TOML", ".toml")
    base = run.model(model)
    limits = usual(base.vehicle)
    x, y, z = limits.room
    if room is not None:
        x, y, z = values.parse_numbers("--room", room, "three lengths in metres, e.g. --room 4,4,3", 3)
    tilt = limits.tilt if max_tilt is None else float(np.radians(max_tilt))
    along = None if also is None else values.parse_effects(",".join(n for n in also if n != "none"))
    with run.progress("designing") as report:
        found = wg.design(
            values.parse_effects(",".join(effects)),
            base,
            run.open(reading.options, logs or [], base)[0],
            limits=replace(limits, room=(x, y, z), tilt=tilt, speed=max_speed),
            duration=duration,
            also=along,
            unmeasured=reading.options.unmeasured,
            seed=seed,
            progress=report,
        )
    written = found.separable or anyway
    if written:
        present.write(found, output, csv)
        run.draw(found, figure)
    run.result(found)
    run.write(
        "design",
        {**found.to_json(), "trajectory": str(output) if written else None},
        **({"trajectory": output, "csv": csv, "figure": figure} if written else {}),
    )
    if written:
        fly = shlex.join(["wrenchgap", "simulate", "-m", model, "-t", str(output), "-o", "flight.mcap"])
        run.line(f"next: {fly}{run.common_options(*READ)}, or fly it")


def ready(
    reading: o.Reading,
    run: DetailedRun,
    logs: o.Logs,
    model: o.ModelOption,
    trajectory: Annotated[
        str, o.option("TRAJECTORY", "What to fly: a name, or a file of `wrenchgap design`.", "--for")
    ],
    duration: Annotated[float | None, o.option("S", "Its length; by default its own.")] = None,
    payload: Annotated[float, o.option("KG", "Mass more, at the centre of mass.")] = 0.0,
    wind: Annotated[float, o.option("M/S", "A steady wind, from any side.")] = 0.0,
    voltage: Annotated[float | None, o.option("V", "Of the battery; by default the lowest that was logged.")] = None,
    figure: o.Figure = None,
) -> None:
    """Say whether to fly: go, go with care, or no go, with the part that limits and how sure that is.

    What the trajectory takes of every rotor and arm, by the effects of MODEL with their standard deviations and what it
    leaves of these flights; margins of the attitude loops where the gains are in MODEL; what to check first.

    Example: `wrenchgap ready test.mcap -m fitted.toml --for figure8 --payload 0.4 --wind 5`
    """
    from wrenchgap.plant.simulation.flight_plan import Plan, trajectory_file, trajectory_path

    file = trajectory_path(trajectory)
    run.claim({"--figure": figure}, *logs, model, file)
    base = run.model(model)
    if file is not None:
        trajectory_file(Plan(base, trajectory, duration))  # refused before logs are read
        run.note_input(file, "trajectory")
    with run.progress("reading") as report:
        flights, _ = run.open(reading.options, logs, base)
        asked: Any = {"duration": duration, "payload": payload, "wind": wind, "voltage": voltage}
        found = wg.ready(flights, base, trajectory, progress=report, **asked)
    run.result(found)
    checked = shlex.join(["wrenchgap", "check", *map(str, logs)])
    run.line(f"next, for vibration, battery and estimator, of which no model knows: {checked}")
    run.save("ready", found, figure=figure)


def predict(
    reading: o.Reading,
    run: DetailedRun,
    logs: o.Logs,
    model: o.ModelOption,
    against: o.Against = None,
    gp: o.GpOption = None,
    horizon: Annotated[str | None, o.option("S,S", "How far ahead, in seconds. Default: 0.1,0.5,1.")] = None,
    figure: o.Figure = None,
) -> None:
    """Predict the motion from the logged commands alone, from every sample, and say how far off that is.

    Position, velocity, attitude and body rates after each horizon: of a motion that goes on as it began, of the vehicle
    without effects, of MODEL, other models and a GP. Give a flight that no model was fitted to.

    Example: `wrenchgap predict test.mcap -m fitted.toml --horizon 0.1,0.5,1`
    """
    run.claim({"--figure": figure}, *logs, model, *(against or ()), gp)
    base, others = run.model(model), [run.model(name, "against") for name in against or ()]
    asked = {}
    if horizon is not None:
        asked["horizons"] = values.parse_numbers("--horizon", horizon, "numbers of seconds, e.g. --horizon 0.1,0.5,1")
    process = run.gp(gp)
    with run.progress("predicting") as report:
        flights, _ = run.open(reading.options, logs, base)
        found = wg.predict(flights, base, *others, gp=process, progress=report, **asked)
    run.result(found)
    run.save("predict", found, figure=figure)
