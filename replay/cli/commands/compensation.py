"""`wrenchgap learn`, `replay`, `counterfactual`: a Gaussian process, and the compensation on a recorded flight."""

import math
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

import wrenchgap as wg
from wrenchgap.replay.cli import options as o
from wrenchgap.replay.cli import values
from wrenchgap.replay.cli.requests import FOUND_BAD, DetailedRun, Omit, Run

Subsample = StrEnum("Subsample", ["fasterpam", "pyclustering"])
Mean = StrEnum("Mean", ["physics", "zero", "linear", "constant"])
Inference = StrEnum("Inference", ["exact", "sparse"])
Search = StrEnum("Search", {"closed_form": "closed-form", "gpy": "gpy"})
Scale = StrEnum("Scale", ["standardised", "raw"])


def learn(
    reading: o.Reading,
    run: DetailedRun,
    logs: o.Logs,
    model: o.ModelOption,
    output: Annotated[Path, o.output("GP", "File to write.")],
    validate: o.Validate = None,
    points: Annotated[int, o.option("N", "Training points kept.", min=2)] = 200,
    outputs: Annotated[str, o.option("WHAT", "torque, wrench, or axes like torque_x,force_z.")] = "torque",
    subsample: Annotated[
        Subsample, typer.Option(help="k-medoids library; pyclustering is the paper's.")
    ] = Subsample.fasterpam,
    inputs: Annotated[
        str | None,
        o.option("WHAT", "Inputs besides the command: past, velocity, rates, position, with commas; or auto."),
    ] = None,
    mean: Annotated[
        Mean | None,
        typer.Option(
            help="Mean function; zero is the paper's, physics the effects of MODEL.",
            show_default="physics if MODEL has effects, else zero",
        ),
    ] = None,
    inference: Annotated[
        Inference, typer.Option(help="exact: on N samples, as in the paper; sparse: on all, through N.")
    ] = Inference.exact,
    search: Annotated[
        Search, typer.Option(help="Of the hyperparameters: closed-form, or GPy's, the paper's; slower.")
    ] = Search.closed_form,
    scale: Annotated[Scale, typer.Option(help="Inputs of k-medoids; raw is the paper's.")] = Scale.standardised,
    restarts: Annotated[int, o.option("N", "Random starts of the likelihood.", min=0, max=1000)] = 1,
    seed: Annotated[int, o.option("N", "Seed of k-medoids and restarts.", min=0)] = 0,
    no_guard: Annotated[
        bool, typer.Option("--no-guard", help="Search neither for better inputs nor for an effect that the GP absorbs.")
    ] = False,
    as_fitted: Annotated[
        bool,
        typer.Option(
            "--as-fitted", help="As in the paper: believe the fit in full, whatever held-out time and stability say."
        ),
    ] = False,
) -> None:
    """Learn the wrench residual of the model, as a function of the commanded wrench.

    With physics as its mean the process learns the residual of MODEL's effects; the compensation contains both. So name
    effects first, then learn the residual. If the process reproduces an effect of the catalogue, the result names it.

    Example: `wrenchgap learn train.mcap -m fitted.toml --validate test.mcap -o rest.gp`
    """
    # Long because typer reads the options from the signature, one a line.
    from wrenchgap.learn.identify.learning import default_mean, physics_of
    from wrenchgap.learn.process.gp import FitSettings

    run.claim({"--output": output}, *logs, *(validate or ()), model)
    wanted, base = values.parse_outputs(outputs), run.model(model)
    names = () if inputs == "auto" else values.parse_names(inputs)
    kind = default_mean(base) if mean is None else mean.value
    how: dict[str, Any] = {"method": subsample.value, "scale": scale.value, "mean": kind, "inference": inference.value}
    how["search"] = search.value
    settings = FitSettings(points, inputs=names, restarts=restarts, seed=seed, guarded=not as_fitted, **how)
    physics_of(base, settings)  # or it raises, before any log is read
    with run.progress("learning") as report:
        flights, tests = run.open(reading.options, logs, base, validate)
        learnt = wg.learn_gp(
            flights,
            base,
            outputs=wanted,
            settings=settings,
            validate=tests,
            best_inputs=inputs == "auto",
            guard=not no_guard,
            progress=report,
        )
    wg.save_gp(learnt, output, force=run.force)
    run.result(learnt)
    run.notes(base.notes)
    run.write("learn", {**learnt.to_json(), "gp": str(output)}, GP=output)


def replay(
    reading: o.Reading,
    gate: o.Gate,
    run: DetailedRun,
    log: o.Log,
    model: o.OptionalModel = None,
    gp: Annotated[Path | None, o.option("GP", "A GP of `wrenchgap learn`.")] = None,
    export: Annotated[
        Path | None,
        o.option(
            "FOLDER",
            "Instead of -m and --gp: prove that the code of this folder of `wrenchgap export` made LOG's records "
            "(it is compiled and run).",
        ),
    ] = None,
    output: o.LogOut = None,
    source: Annotated[
        str | None,
        o.option(
            "desired|commanded",
            "Logged wrench to compensate; default: desired where it is logged.",
            autocompletion=lambda incomplete: [n for n in ("desired", "commanded") if n.startswith(incomplete)],
        ),
    ] = None,
    lead: o.Lead = None,
    csv: o.Csv = None,
    parquet: Annotated[Path | None, o.option("FILE", "Every step as Parquet.")] = None,
    figure: o.Figure = None,
) -> None:
    """Re-run optimiser and uncertainty filter on the logged wrenches, at the log's own stamps.

    LOG2 holds the recorded flight and, under /replay/, what the compensation would have commanded and why. Two runs
    give identical files; solve times are printed and put into the JSON only.

    With --export, LOG holds records of an exported compensation in flight: its C is stepped again from the state and
    input of each, and must give what was flown. The exit code is 3 where it does not.

    Example: `wrenchgap replay test.mcap -m tilt_hexarotor --gp torque.gp -o replayed.mcap --figure replay.png`
    """
    # Long because every option is one line of the signature.
    if export is not None:
        _prove(log, export, csv, reading, run)
        return
    from wrenchgap.learn.process.predictors import cutoff_of
    from wrenchgap.replay.compensation.source import source_by_name
    from wrenchgap.replay.present.documents import check_tables, write_csv, write_parquet
    from wrenchgap.replay.present.replay import write_log

    if model is None or gp is None:
        missing = "--model MODEL" if model is None else "--gp GP"
        raise values.usage_error(
            f"replay {log}: {missing} is missing; give --model and --gp, or --export for a flown export"
        )
    check_tables(csv, parquet)
    run.claim({"--output": output, "--csv": csv, "--parquet": parquet, "--figure": figure}, log, model, gp)
    settings = gate.settings()
    base, process, wanted = run.model(model), run.gp(gp), source_by_name(source)
    assert process is not None
    process.check_vehicle(base.vehicle.name)
    options = reading.options.changed(cutoff_hz=reading.options.cutoff_hz or cutoff_of(process))
    with run.progress("replaying", "reading the log") as report:
        ((opened,), _) = run.open(options, [log], base, rate_hz=math.inf, incomplete=True)
        result = wg.replay_compensation(opened, base, process, settings, source=wanted, lead=lead, progress=report)
    if output is not None:
        write_log(result, output, force=run.force)
    if csv is not None:
        write_csv(result.to_frame(), csv, digits=None)
    if parquet is not None:
        write_parquet(result.to_frame(), parquet)
    run.draw(result, figure)
    run.result(result)
    run.write("replay", result.to_json(), log=output, table=csv, parquet=parquet, figure=figure)


def _prove(log: Path, folder: Path, csv: Path | None, reading: o.Reading, run: Run) -> None:
    """Whether the records in a log are what an exported folder makes of them."""
    from wrenchgap.replay.present.documents import check_tables

    used = ("log", "export", "csv", "budget", "own", "json", "force", "quiet")
    if idle := sorted(filter(None, run.given(lambda name: name not in used))):
        raise values.usage_error(f"replay --export: {', '.join(idle)} says nothing about a flown export; leave it out")
    check_tables(csv)
    run.claim({"--csv": csv}, log, *(folder.iterdir() if folder.is_dir() else ()))
    with run.progress("proving", "reading the log"):
        found = wg.prove_flown(log, folder, budget=reading.options.budget)
    if log.is_file():
        run.note_input(log, "log")
    run.result(found, details=True)
    run.save("replay-export", found, csv=csv, folder=str(folder))
    if not found.proved:
        raise typer.Exit(FOUND_BAD)


def counterfactual(
    reading: Annotated[o.Reading, Omit("cutoff")],
    run: DetailedRun,
    log: o.Log,
    model: o.ModelOption,
    output: o.LogOut = None,
    gp: Annotated[Path | None, o.option("GP", "Compensate with this GP of `wrenchgap learn`.")] = None,
    lead: o.Lead = None,
    baselines: Annotated[
        bool,
        typer.Option(
            "--baselines",
            help="Re-simulate with the baselines of a GP too: observer, INDI, L1, effects, straight line.",
        ),
    ] = False,
    feedback: Annotated[
        list[str] | None,
        o.option("LAW[=HZ]", "Re-simulate with this feedback instead: observer, indi or l1, and its cut-off."),
    ] = None,
    despite_verdict: o.DespiteVerdict = False,
    without: Annotated[
        list[str] | None,
        o.option(
            "EFFECT", "Re-simulate the vehicle without this effect of MODEL.", autocompletion=values.complete_effects
        ),
    ] = None,
    with_: Annotated[
        list[str] | None,
        o.option(
            "EFFECT=P:V,...",
            "Re-simulate it with this effect as well.",
            "--with",
            autocompletion=values.complete_effects,
        ),
    ] = None,
    gains: Annotated[
        list[str] | None, o.option("NAME=VALUE", "Other gains, e.g. integral=0 or omega_attitude=5,5,4.")
    ] = None,
    believe: Annotated[
        str | None,
        o.option(
            "MODEL2",
            "Controller and allocation know mass, inertia and centre of mass of MODEL2.",
            autocompletion=values.complete_models,
        ),
    ] = None,
    allocation: Annotated[
        str | None,
        o.option(
            "MODEL3",
            "Allocate by the effectiveness as flown of MODEL3 (`wrenchgap effectiveness`).",
            autocompletion=values.complete_models,
        ),
    ] = None,
    start: Annotated[float, o.option("S", "Start of the re-simulation, in seconds.")] = 0.0,
    duration: Annotated[float | None, o.option("S", "Its length, in seconds; default: to the end.")] = None,
) -> None:
    """Re-simulate a recorded flight with something changed.

    What MODEL does not explain of the recorded motion is inferred as a disturbance over time and acts in the
    re-simulation too, from the recorded initial state, along the recorded reference. The null run, with nothing
    changed, must reproduce the recorded flight; its error bounds the accuracy of the rest.

    Example: `wrenchgap counterfactual test.mcap -m tilt_hexarotor --gp torque.gp -o compensated.mcap`
    """
    # Long because typer reads the options from the signature, one a line.
    from wrenchgap.replay.present.counterfactual import write_log

    run.claim({"--output": output}, log, gp)
    base, other = run.model(model), None if believe is None else run.model(believe, "believed")
    process, flown = run.gp(gp), None if allocation is None else run.model(allocation, "allocation")
    with run.progress("counterfactual", "reading the log") as report:
        ((flight,), _) = run.open(reading.options, [log], base)
        result = wg.counterfactual(
            flight,
            base,
            gp=process,
            gp_name="" if gp is None else gp.name,
            lead=lead,
            without=without or (),
            having=with_ or (),
            gains=gains or (),
            believe=other,
            allocation=flown,
            baselines=baselines,
            feedback=feedback or (),
            despite_verdict=despite_verdict,
            start=start,
            duration=duration,
            progress=report,
        )
    if output is not None:
        write_log(result, output, run.read, force=run.force)
    run.result(result)
    run.write("counterfactual", result.to_json(), log=output)
