"""`wrenchgap model new`, `model show`, `add`, `calibrate`, `remove`, `history`: model files."""

import shlex
from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

import wrenchgap as wg
from wrenchgap._escaping import file_word
from wrenchgap.plant.targets import TARGETS
from wrenchgap.replay.cli import options as o
from wrenchgap.replay.cli.commands.export import Precision
from wrenchgap.replay.cli.requests import DetailedRun, Run
from wrenchgap.replay.cli.values import complete_effects, parse_budget, parse_effects, parse_numbers, usage_error

Target = StrEnum("Target", list(TARGETS))  # type: ignore[misc]  # known when this is imported, not to mypy
"""What `write` writes for."""


def new(
    run: Run,
    output: o.ModelOut,
    source: Annotated[
        Path | None,
        o.option(
            "SOURCE",
            "PX4 log (.ulg), ArduPilot log or parameters (.bin, .param), URDF, SDF or MuJoCo XML, RotorPy (.py) or "
            "drone-models (.toml) parameters.",
            "--from",
        ),
    ] = None,
    mass: Annotated[float | None, o.option("KG", "What the vehicle weighs, with its battery.")] = None,
    mass_tolerance: Annotated[float | None, o.option("KG", "How well that is known, e.g. 0.005.")] = None,
    name: Annotated[str | None, o.option("NAME", "Name of the vehicle; of a drone, where SOURCE has several.")] = None,
    frame: Annotated[str | None, o.option("FRAME", "Frame with --arm, e.g. quad_x.")] = None,
    arm: Annotated[float | None, typer.Option(help="From the middle to a motor, in metres.")] = None,
    radius: Annotated[float | None, typer.Option("--rotor-radius", help="Of the rotors, in metres.")] = None,
    thrust_max: Annotated[float | None, o.option("N", "Thrust of one rotor at full throttle.")] = None,
    interactive: Annotated[bool, typer.Option("--interactive", "-i", help="Ask for what SOURCE does not say.")] = False,
    figure: o.Figure = None,
    budget: o.BudgetOption = None,
) -> None:
    """Write a model file from what is known: every number in it carries a comment that says where it is from.

    What nobody said is marked ASSUMED, in the file and on the screen: replace it where you know better. Inertia is
    estimated from mass and geometry, with a tolerance, where nothing is known of it. The level of the thrust curve is
    fitted where SOURCE is a log in which the vehicle flies.

    Example: `wrenchgap model new --from flight.ulg --mass 1.52 --mass-tolerance 0.005 -o vehicle.toml`
    """
    from wrenchgap.plant.drafts.sources import Given, beside

    run.claim({"--output": output, "--figure": figure}, source)
    needed = {"--mass KG": mass, "--frame FRAME": frame, "--arm METRES": arm}
    missing = [option for option, value in needed.items() if value is None]
    if source is None and not interactive and missing:
        listed = " and ".join(", ".join(missing).rsplit(", ", 1))
        start = f"nothing to start from; say --from SOURCE, or {listed}" if len(missing) == 3 else f"say {listed} too"
        raise usage_error(f"model new: {start}, or --interactive to be asked")
    given = Given(name, mass, mass_tolerance, frame, arm, radius, thrust_max)
    ask = questions if interactive else None
    allowed = parse_budget(budget)
    sheet = wg.draft_model(source, given=given, command=run.command_line(), ask=ask, budget=allowed)
    for path in [source, *beside(source)] if source is not None else []:
        run.note_input(path, "source")
    saved = wg.save_draft(sheet, output, force=run.force)
    run.result(saved)
    run.draw(saved, figure)
    run.write("model", {**saved.to_json(), "model": str(output)}, model=output, figure=figure)
    flown = source if source is not None and source.suffix.lower() in (".ulg", ".bin", ".csv", ".parquet") else None
    log = "LOG" if flown is None else file_word(flown)
    run.line(f"next: wrenchgap check {log} -m {shlex.quote(str(output))} --details")


def questions(question: str, kind: type, default: str | None, choices: Sequence[str]) -> str:
    """The answer to one question as text, asked again until it is of its kind; "" where it may be left open.

    `kind` is float or str; `default` None makes an answer necessary, "" makes it optional.
    """
    words = question + (f" ({', '.join(choices)})" if choices else "")
    while True:
        answer = str(typer.prompt(words, default=default, show_default=bool(default), err=True)).strip()
        if answer == "" and default == "":
            return ""
        if choices and answer not in choices:
            typer.echo(f"got {answer!r}, expected one of {', '.join(choices)}", err=True)
        elif kind is float and not _positive(answer):
            typer.echo(f"got {answer!r}, expected a positive number", err=True)
        else:
            return answer


def _positive(text: str) -> bool:
    from wrenchgap.plant.reader import BOUNDS

    try:
        return BOUNDS.smallest <= float(text) <= BOUNDS.largest
    except ValueError:
        return False


def show(
    run: Run,
    model: o.ModelFile,
    output: Annotated[Path | None, o.output("FILE", "Write the file as it is, to be changed.")] = None,
    figure: o.Figure = None,
) -> None:
    """What a model file says, as it was understood: mass properties, rotors, the command curve, effects.

    With --figure a top view is drawn: arms, rotors with their direction of turn, centre of mass, IMU.

    Example: `wrenchgap model show crazyflie -o mine.toml --figure mine.png`
    """
    from wrenchgap.plant import model_file
    from wrenchgap.plant.drafts.draft import Sheet

    run.claim({"--output": output, "--figure": figure}, model)
    sheet = Sheet(run.model(model))
    run.result(sheet)
    if output is not None:
        model_file.save(sheet.model, output, force=run.force)
        run.line(f"wrote model {output}")
    run.save("model", sheet, figure=figure)


def add(
    reading: o.Reading,
    run: DetailedRun,
    model: o.ModelOption,
    output: o.ModelOut,
    effects: Annotated[
        list[str] | None, typer.Argument(metavar="EFFECT...", help="Effects to fit.", autocompletion=complete_effects)
    ] = None,
    logs: o.FromLogs = None,
    value: Annotated[
        list[str] | None, o.option("EFFECT=P:V,...", "Set values by hand instead, e.g. servo_lag=tau:0.05.")
    ] = None,
) -> None:
    """Fit effects to logs and write the model that has them; the model file's comments stay.

    All effects of the new model are fitted together, those that MODEL had already too. Logs, hashes, date and version
    are written beside the values, and the new file carries the history of all its versions (`wrenchgap history`).

    Example: `wrenchgap add com_offset servo_lag -m tilt_hexarotor --from train.mcap -o fitted.toml`
    """
    run.claim({"--output": output}, *(logs or ()))
    base, command = run.model(model), run.command_line()
    if value and (effects or logs):
        raise usage_error("add: --value sets values by hand; leave out EFFECT and --from, or fit in a second step")

    if value:
        from wrenchgap.plant.effect_values import with_values
        from wrenchgap.replay.present.addition import effects_json, model_table

        saved = wg.save_model(with_values(base, value), output, before=base, command=command, force=run.force)
        run.show(model_table(saved))
        run.write_model("add", {"effects": effects_json(saved.snapshot), "refitted": []}, saved, output)
        return
    if not effects:
        raise usage_error("add: no effect named, e.g. com_offset; find one with wrenchgap explain")
    if not logs:
        raise usage_error("add: nothing to fit to; give logs with --from LOG..., or values with --value EFFECT=P:V")
    parse_effects(",".join(effects))
    with run.progress("fitting") as report:
        flights, _ = run.open(reading.options, logs, base)
        added = wg.add(base, effects, flights, progress=report)
    saved = wg.save_model(added, output, command=command, force=run.force)
    run.result(added)
    run.write_model("add", added.to_json(), saved, output)


def calibrate(
    reading: o.Reading,
    run: DetailedRun,
    logs: o.Logs,
    model: o.ModelOption,
    output: o.ModelOut,
    validate: o.Validate = None,
) -> None:
    """Trim a model on healthy flights: thrust, centre of mass, torque ratio, IMU, timing; only what helps is changed.

    An effect is kept where it lowers the error on blocks of time that its fit did not see, and, with several flights,
    on flights that were left out whole. Values are written with their standard deviation, which has the scatter
    between flights, and with logs, hashes, date and version.

    Example: `wrenchgap calibrate monday.ulg tuesday.ulg -m vehicle.toml -o calibrated.toml`
    """
    run.claim({"--output": output}, *logs, *(validate or ()))
    base, command = run.model(model), run.command_line()
    with run.progress("calibrating") as report:
        flights, tests = run.open(reading.options, logs, base, validate)
        found = wg.calibrate(flights, base, validate=tests, progress=report)
    kept = found.given if found.added is None else found.added
    saved = wg.save_model(kept, output, before=base, command=command, force=run.force)
    run.result(found)
    run.write_model("calibrate", found.to_json(), saved, output, unchanged=found.added is None)
    run.line(f"next, with another flight: wrenchgap explain LOG -m {shlex.quote(str(output))}")


def remove(effects: o.Effects, model: o.ModelOption, output: o.ModelOut, *, run: Run) -> None:
    """Take effects out of a model; the others keep their values (fit them anew with `wrenchgap add`).

    Example: `wrenchgap remove servo_lag -m fitted.toml -o without.toml`
    """
    from wrenchgap.replay.present.addition import effects_json, model_table

    run.claim({"--output": output})
    base = run.model(model)
    saved = wg.save_model(base.without(effects), output, before=base, command=run.command_line(), force=run.force)
    names = list(dict.fromkeys(effects))
    run.line(f"removed {', '.join(names)} from {base.name}")
    run.show(*([model_table(saved)] if saved.effects else []))
    run.write_model("remove", {"removed": names, "effects": effects_json(saved.snapshot)}, saved, output)


def write(
    run: Run,
    model: o.ModelFile,
    target: Annotated[Target, typer.Option("--to", help="An autopilot, a format of robot descriptions, a simulator.")],
    output: Annotated[Path | None, o.output("FILE", "File to write; none: look at it only.")] = None,
    parameters: Annotated[
        Path | None, o.option("LOG|FILE", "Parameters that were set: a log of PX4 or ArduPilot, or a file of them.")
    ] = None,
    budget: o.BudgetOption = None,
) -> None:
    """Write what was identified for an autopilot, or the vehicle for a simulator.

    An autopilot's file has the parameters that fitted effects of MODEL move, each with its standard deviation and what
    was set before; what no parameter can say is listed. Look at every value before it flies.

    Example: `wrenchgap write fitted.toml --to px4 --parameters flight.ulg -o fitted.params`
    """
    from wrenchgap.flight.atomic import write_text

    run.claim({"--output": output}, model, parameters)
    read = run.model(model)
    made = wg.export_model(
        read, target.value, parameters=parameters, origin=run.command_line(), budget=parse_budget(budget)
    )
    if parameters is not None:
        run.note_input(parameters, "parameters")
    run.result(made)
    if output is not None:
        write_text(output, made.text)
    elif not made.parameters:  # of an autopilot the table has it all
        for line in ("", *made.text.splitlines()):
            run.line(line)
    run.write("write", made.to_json(), **{target.value: output})


def effectiveness(
    run: DetailedRun,
    model: o.ModelFile,
    tilt: Annotated[str, o.option("DEG[,DEG...]", "Tilt of all arms, or of each, about which it hovers.")] = "0",
    output: Annotated[Path | None, o.output("FOLDER", "Write the corrected allocation, as C99 and Python.")] = None,
    precision: Annotated[Precision, typer.Option(help="Of the C, unless its build says otherwise.")] = Precision.double,
    figure: o.Figure = None,
    csv: o.Csv = None,
) -> None:
    """What rotors make of what is asked of them as flown, beside the nominal matrix, and the corrected allocation.

    From all fitted effects on thrusts, torques, tilts and the centre of mass, with standard deviations. Of the thrusts
    that make a wrench, the allocation that is written takes those with the largest distance to the limits.

    Example: `wrenchgap effectiveness fitted.toml --tilt 20 --figure effectiveness.png -o allocation/`
    """
    import numpy as np

    from wrenchgap.flight.atomic import resolved
    from wrenchgap.flight.errors import ModelError

    run.claim({"--figure": figure, "--csv": csv}, model)
    for option, path in (("--figure", figure), ("--csv", csv), ("--json", run.json)):
        if output is not None and path is not None and resolved(output) in resolved(path).parents:
            raise usage_error(f"{option} {path}: is in --output {output}, which is replaced as a whole; choose another")
    angles = np.radians(parse_numbers("--tilt", tilt, "degrees, one or several with commas between"))
    read = run.model(model)
    found = wg.effectiveness(read, angles.tolist())
    more: dict[str, Any] = {"left": None, "margins": None, "folder": None if output is None else str(output)}
    words: Any = "float" if precision is Precision.float else "double"
    try:
        made = wg.export_allocation(read, output, precision=words, command=run.command_line(), force=run.force)
    except ModelError as error:
        if output is not None:
            raise
        run.result(found)
        run.notes([str(error)], "warning")
    else:
        said = made.to_json()
        more |= {"left": said["left"], "margins": said["margins"]}
        run.result(found)
        run.result(made, details=True)
    run.save("effectiveness", found, figure=figure, csv=csv, **more)
    if output is not None:
        run.line(f"wrote allocation {output}")
        run.line(f"next: make -C {shlex.quote(str(output))} test")


def history(model: o.ModelFile, *, run: Run) -> None:
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
