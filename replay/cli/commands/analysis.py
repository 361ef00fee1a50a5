"""`wrenchgap compare`, `where`, `explain`, `discover`, `report`, `changed`, `trend`: what flights say of models."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import wrenchgap as wg
from wrenchgap.replay.cli import options as o
from wrenchgap.replay.cli.commands.flights import READ
from wrenchgap.replay.cli.requests import DetailedRun, Run
from wrenchgap.replay.cli.values import check_ending, parse_effects, usage_error

if TYPE_CHECKING:
    from wrenchgap.learn.identify.trend import Trend
    from wrenchgap.plant.model import Model


def compare(
    reading: o.Reading,
    run: DetailedRun,
    logs: o.Logs,
    model: o.ModelOption,
    against: o.Against = None,
    gp: o.GpOption = None,
    figure: o.Figure = None,
    csv: o.Csv = None,
    by_flight: Annotated[
        bool, typer.Option("--by-flight", help="Signed mean and rms of the residual by flight and axis, in one table.")
    ] = False,
) -> None:
    """Errors of models on flights, per axis and per flight, and where they are worst.

    Always shown first: "nominal", the vehicle without effects. Effects of MODEL, other models and a GP follow, with the
    change of rms against it, and the noise of the sensors.

    Example: `wrenchgap compare test.mcap -m tilt_hexarotor --against fitted.toml --figure compare.png`
    """
    from wrenchgap.replay.present.documents import check_tables

    check_tables(csv)
    run.claim({"--figure": figure, "--csv": csv}, *logs, model, *(against or ()), gp)
    base, others = run.model(model), [run.model(name, "against") for name in against or ()]
    process = run.gp(gp)
    with run.progress("reading") as report:
        flights, _ = run.open(reading.options, logs, base)
        report(0.7, "comparing")
        result = wg.compare(flights, base, *others, gp=process)
    how = {"signed": True} if by_flight else {}
    run.result(result, details=run.details or by_flight, **how)
    compared = [model, *([model] if base.effects else []), *(against or ())]  # as the rows are, the nominal one first
    nearest = dict(enumerate(compared)).get(result.nearest, model)  # the last one is a process on top of one of them
    ask = shlex.join(["wrenchgap", "explain", *map(str, logs), "-m", nearest])
    run.line(f"next: {ask}{run.common_options()}")
    run.save("compare", result, figure=figure, csv=csv)


def where(
    reading: o.Reading,
    run: DetailedRun,
    logs: o.Logs,
    model: o.ModelOption,
    gp: o.GpOption = None,
    figure: o.Figure = None,
) -> None:
    """Show where MODEL fails: on which tilt, thrust, speed, height ... its error depends, and what it is made of.

    Prints an error budget (noise, effects in the model, what a Gaussian process would add, unexplained), the quantities
    that the error depends on most, the worst stretches, whether the residual is white, and the inputs that predict it
    on held-out time. docs/where.md says how to read it.

    Example: `wrenchgap where flight.mcap -m tilt_hexarotor --figure where.png`
    """
    run.claim({"--figure": figure}, *logs, model, gp)
    base, process = run.model(model), run.gp(gp)
    with run.progress("where") as report:
        flights, _ = run.open(reading.options, logs, base)
        result = wg.where(flights, base, gp=process, progress=report)
    run.result(result)
    run.notes(base.notes)
    run.save("where", result, figure=figure)


def explain(
    reading: o.Reading,
    run: DetailedRun,
    logs: o.Logs,
    model: o.ModelOption,
    validate: o.Validate = None,
    effects_only: Annotated[str | None, o.option("A,B", "Try only these effects.")] = None,
    injections: o.Injections = 1,
) -> None:
    """Rank the effects that could explain what the model misses, by the reduction of the error on held-out time.

    Effects already in MODEL stay, fitted together with each candidate. Effects that are indistinguishable on these logs
    are reported as one group. Put the result into a model file with `wrenchgap add`.

    Example: `wrenchgap explain train.mcap -m tilt_hexarotor --validate test.mcap`
    """
    from wrenchgap.learn.parallel import cores, get_ready
    from wrenchgap.replay.present.explanation import what_next

    run.claim({}, *logs, *(validate or ()), model)
    base, names = run.model(model), parse_effects(effects_only)
    with run.progress("explaining") as report:
        get_ready(cores())  # workers start while logs are read
        flights, tests = run.open(reading.options, logs, base, validate)
        asked: Any = {"names": names, "validate": tests, "injections": injections}
        found = wg.explain(flights, base, **asked, progress=report)
    run.result(found)
    read = (run.common_options(), run.common_options("cutoff"))
    run.show(*what_next(found, model, [str(p) for p in logs], *read))
    run.notes([*base.notes, *(note for f in tests for note in f.notes)])
    run.save("explain", found)


def discover(
    reading: o.Reading,
    run: DetailedRun,
    logs: o.Logs,
    model: o.ModelOption,
    validate: o.Validate = None,
    output: Annotated[Path | None, o.output("FILE", "Effect file of the law to write (.py).")] = None,
    figure: o.Figure = None,
) -> None:
    """Find the law of what `explain` cannot name, or say that these logs carry none.

    Hundreds of laws (powers of velocity, rates, thrust, height, time, angles; along body axes, fixed directions, rotors
    and arms) are tried on what the named effects leave. A law must beat what chance finds in residuals that have
    nothing to do with the flights, be found again in halves of the time, and predict time or flights (--validate) that
    it was not fitted to. The file written is an effect of your own: add, simulate and export it with --effects.

    Example: `wrenchgap discover train.mcap -m tilt_hexarotor --validate test.mcap -o law.py`
    """
    from wrenchgap.flight.atomic import write_text
    from wrenchgap.replay.present.discovery import what_next

    run.claim({"--output": output, "--figure": figure}, *logs, *(validate or ()), model)
    if output is not None:
        check_ending(output, "the law is a Python file", ".py")
    base = run.model(model)
    with run.progress("discovering") as report:
        flights, tests = run.open(reading.options, logs, base, validate)
        found = wg.discover(flights, base, validate=tests, progress=report)
    run.result(found)
    if output is not None and found.source:
        write_text(output, found.source)
    written = output if found.source else None
    read = (run.common_options(), run.common_options(*READ, "cutoff"))
    run.show(*what_next(found, model, [str(p) for p in logs], None if written is None else str(written), *read))
    run.notes([*base.notes, *(note for f in tests for note in f.notes)])
    if written is not None:
        run.line(f"wrote law {written}")
    elif output is not None:
        run.line(f"no law, so that {output} was not written{'; what is there is an older one' * output.exists()}")
    run.save("discover", found, figure=figure, **({} if written is None else {"law": written}))


def report(
    reading: o.Reading,
    run: Run,
    logs: o.Logs,
    model: o.ModelOption,
    output: Annotated[Path, o.output("HTML", "Page to write (.html).")],
    validate: o.Validate = None,
    gp: o.GpOption = None,
) -> None:
    """Write one page that says which effect is missing, with what confidence, and how far the error is reduced.

    The page needs nothing else: verdict, error step by step on held-out time and unseen flights, ranking, parameters,
    where the model fails before and after, residual, what to fly next, and how to repeat it all.

    Example: `wrenchgap report train.mcap -m tilt_hexarotor --validate test.mcap -o report.html`
    """
    from wrenchgap.replay.present.report import Repetition, save, to_json

    run.claim({"--output": output}, *logs, *(validate or ()), model, gp)
    if output.suffix.lower() not in (".html", ".htm"):
        raise usage_error(f"--output {output}: the report is a web page; expected a name that ends in .html")
    base, process = run.model(model), run.gp(gp)
    topics, shifts, between = (", ".join(t or []) for t in (reading.topic, reading.shift, reading.between))
    said = {"between": between, "topics": topics, "shift": shifts, "unmeasured": reading.unmeasured}
    options = {key: value for key, value in said.items() if value}
    with run.progress("reporting") as told:
        flights, tests = run.open(reading.options, logs, base, validate)
        found = wg.report(flights, base, validate=tests, gp=process, progress=told)
        told(1.0, "writing the page")
        repetition = Repetition.of(found, model, run.command_line(), run.common_options(), options, gp)
        save(found, output, force=run.force, repetition=repetition)
    run.result(found)
    run.write("report", {**to_json(found, repetition), "page": str(output)}, report=output)


def changed(
    reading: o.Reading,
    run: DetailedRun,
    suspects: Annotated[
        list[Path],
        typer.Argument(metavar="SUSPECT...", help="Logs of flights with something wrong.", callback=o.existing_paths),
    ],
    model: o.ModelOption,
    healthy: Annotated[
        list[Path],
        o.option(
            "LOG...",
            "Logs of the same vehicle when all was well; several say what is usual.",
            callback=o.existing_paths,
        ),
    ],
    effects_only: o.ChangesOnly = None,
    injections: o.Injections = 1,
    figure: o.Figure = None,
    page: o.Page = None,
) -> None:
    """Find what changed on suspect flights against healthy flights of the same vehicle, and what to inspect.

    What MODEL is wrong by in all of the flights drops out. A change must exceed what healthy flights differ by among
    themselves. Changes that are indistinguishable on these flights are one class. MODEL may be poor; it stays as it is.

    Example: `wrenchgap changed bad.mcap --healthy monday.mcap tuesday.mcap -m tilt_hexarotor`
    """
    from wrenchgap.learn.parallel import cores, get_ready
    from wrenchgap.replay.present.changed import what_next

    run.claim({"--figure": figure, "--page": page}, *suspects, *healthy, model)
    base, names = run.model(model), parse_effects(effects_only)
    with run.progress("comparing") as report:
        good, bad = run.open(reading.options, healthy, base, suspects, ("healthy", "suspect"), unseen_first=True)
        get_ready(cores(), "wrenchgap.learn.changed.changed")  # no earlier: an error would wait for them
        found = wg.changed(bad, good, base, names=names, injections=injections, progress=report)
    run.result(found)
    run.notes(base.notes)
    run.show(*what_next(found, [str(p) for p in healthy], model, run.common_options()))
    run.save("changed", found, figure=figure, page=page)


def trend(
    reading: o.Reading,
    run: DetailedRun,
    logs: o.Logs,
    model: o.ModelOption,
    fit: o.Fit = None,
    parts: Annotated[
        bool,
        typer.Option(
            "--parts", help="Health of each rotor, servo and arm: thrust, drag torque, lag, zero, play; by date."
        ),
    ] = False,
    figure: o.Figure = None,
    table: Annotated[Path | None, o.option("FILE", "Every value as a table (.parquet).")] = None,
    page: o.Page = None,
    vehicle: Annotated[str | None, o.option("NAME", "Of rows of `batch compare`: whose flights.")] = None,
) -> None:
    """Fit each flight by itself and say which parameters stepped or drifted over the flights.

    Give the logs in the order in which they were flown, or the folder of `wrenchgap batch compare`. A step is told with
    its flight, its size with a 95 % interval, and its significance against the scatter between flights; with fewer than
    four flights nothing is said of steps.

    Example: `wrenchgap trend monday.mcap tuesday.mcap wednesday.mcap friday.mcap -m my_quadrotor --page season.html`
    """
    from wrenchgap.replay.present.documents import check_tables

    run.claim({"--figure": figure, "--table": table, "--page": page}, *logs, model)
    if table is not None and table.suffix.lower() != ".parquet":
        raise usage_error(f"--table {table}: the table is a Parquet file; expected a name that ends in .parquet")
    check_tables(table)
    names = parse_effects(fit)
    base = run.model(model)
    with run.progress("following") as report:
        if len(logs) == 1 and (logs[0] / "run.json").is_file():
            if parts:
                raise usage_error("--parts: fits logs, and rows of `batch compare` hold fits; give the logs")
            found = _of_rows(run, logs[0], base, names, vehicle)
        elif vehicle is not None:
            raise usage_error(f"--vehicle {vehicle}: does nothing with logs; leave it out")
        else:
            flights, _ = run.open(reading.options, logs, base)
            found = wg.trend(flights, base, names, parts=parts, progress=report)
    run.result(found)
    run.save("trend", found, figure=figure, parquet=table, page=page)


def _of_rows(run: Run, folder: Path, base: Model, names: tuple[str, ...], vehicle: str | None) -> Trend:
    """The trend of rows of `batch compare`; raises UsageError for options of how logs are read."""
    from wrenchgap.flight.extras import needed_for

    if idle := run.common_options("own").strip():
        raise usage_error(f"{idle}: does nothing with rows of `batch compare`, whose logs are read; leave it out")
    with needed_for("rows of a batch", extra="batch"):
        from wrenchgap.replay.batch.fleet import trend_of_rows
        from wrenchgap.replay.batch.store import Store

    found = trend_of_rows(Store(str(folder)), base, names, vehicle)
    run.note_input(folder / "run.json", "batch")
    return found
