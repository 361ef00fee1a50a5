"""`wrenchgap calibrate` and `learn`: a model trimmed on healthy flights, a Gaussian process of what it leaves."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from wrenchgap.replay.cli import options as o
from wrenchgap.replay.cli.requests import Reading, Run
from wrenchgap.replay.cli.values import parse_names, parse_outputs


def calibrate(
    logs: o.Logs, model: o.ModelOption, output: o.ModelOut, validate: o.Validate = None, *, reading: Reading, run: Run
) -> None:
    """Trim a model on healthy flights: thrust, centre of mass, torque ratio, IMU, timing; only what helps is changed.

    An effect is kept where it lowers the error on blocks of time that its fit did not see, and, with several flights,
    on flights that were left out whole. Values are written with their standard deviation, which has the scatter
    between flights, and with logs, hashes, date and version.

    Example: `wrenchgap calibrate monday.ulg tuesday.ulg -m vehicle.toml -o calibrated.toml`
    """
    from wrenchgap.replay import api, api_models

    run.claim({"--output": output}, *logs, *(validate or ()))
    base, command = run.model(model), run.command_line()
    with run.progress("calibrating") as report:
        flights, tests = run.open(reading.options, logs, base, validate)
        found = api_models.calibrate(flights, base, validate=tests, progress=report)
    kept = found.given if found.added is None else found.added
    saved = api.save_model(kept, output, before=base, command=command, force=run.force)
    run.result(found)
    run.write_model("calibrate", found.to_json(), saved, output)


Subsample = StrEnum("Subsample", ["fasterpam", "pyclustering"])
Mean = StrEnum("Mean", ["physics", "zero", "linear", "constant"])
Inference = StrEnum("Inference", ["exact", "sparse"])
Search = StrEnum("Search", {"closed_form": "closed-form", "gpy": "gpy"})
Scale = StrEnum("Scale", ["standardised", "raw"])

Points = Annotated[int, typer.Option("--points", metavar="N", min=2, help="Training points kept.")]
Outputs = Annotated[
    str, typer.Option("--outputs", metavar="WHAT", help="torque, wrench, or axes like torque_x,force_z.")
]
Library = Annotated[Subsample, typer.Option("--subsample", help="k-medoids library; pyclustering is the paper's.")]
Inputs = Annotated[
    str | None,
    typer.Option(
        "--inputs",
        metavar="WHAT",
        help="Inputs besides the command: past, velocity, rates, position, with commas; or auto.",
    ),
]
MeanFunction = Annotated[
    Mean | None,
    typer.Option(
        "--mean",
        help="Mean function; zero is the paper's, physics the effects of MODEL.",
        show_default="physics if MODEL has effects, else zero",
    ),
]
Samples = Annotated[
    Inference, typer.Option("--inference", help="exact: on N samples, as in the paper; sparse: on all, through N.")
]
Searching = Annotated[
    Search, typer.Option("--search", help="Of the hyperparameters: closed-form, or GPy's, the paper's; slower.")
]
Scaling = Annotated[Scale, typer.Option("--scale", help="Inputs of k-medoids; raw is the paper's.")]
Restarts = Annotated[
    int, typer.Option("--restarts", metavar="N", min=0, max=1000, help="Random starts of the likelihood.")
]
Seed = Annotated[int, typer.Option("--seed", metavar="N", min=0, help="Seed of k-medoids and restarts.")]
NoGuard = Annotated[
    bool, typer.Option("--no-guard", help="Search neither for better inputs nor for an effect that the GP absorbs.")
]


AsFitted = Annotated[
    bool,
    typer.Option(
        "--as-fitted", help="As in the paper: believe the fit in full, whatever held-out time and stability say."
    ),
]


def learn(
    logs: o.Logs,
    model: o.ModelOption,
    output: Annotated[Path, typer.Option("--output", "-o", metavar="GP", help="File to write.")],
    validate: o.Validate = None,
    points: Points = 200,
    outputs: Outputs = "torque",
    subsample: Library = Subsample.fasterpam,
    inputs: Inputs = None,
    mean: MeanFunction = None,
    inference: Samples = Inference.exact,
    search: Searching = Search.closed_form,
    scale: Scaling = Scale.standardised,
    restarts: Restarts = 1,
    seed: Seed = 0,
    no_guard: NoGuard = False,
    as_fitted: AsFitted = False,
    *,
    reading: Reading,
    run: Run,
) -> None:
    """Learn the wrench residual of the model, as a function of the commanded wrench.

    With physics as its mean the process learns the residual of MODEL's effects; the compensation contains both. So name
    effects first, then learn the residual. If the process reproduces an effect of the catalogue, the result names it.

    Example: `wrenchgap learn train.mcap -m fitted.toml --validate test.mcap -o rest.gp`
    """
    from wrenchgap.learn.identify.learning import default_mean, physics_of
    from wrenchgap.learn.process.gp import FitSettings
    from wrenchgap.replay import api

    run.claim({"--output": output}, *logs, *(validate or ()), model)
    wanted, base = parse_outputs(outputs), run.model(model)
    names = () if inputs == "auto" else parse_names(inputs)
    kind = default_mean(base) if mean is None else mean.value
    how: dict[str, Any] = {"method": subsample.value, "scale": scale.value, "mean": kind, "inference": inference.value}
    how["search"] = search.value
    settings = FitSettings(points, inputs=names, restarts=restarts, seed=seed, guarded=not as_fitted, **how)
    physics_of(base, settings)  # or it raises, before any log is read
    with run.progress("learning") as report:
        flights, tests = run.open(reading.options, logs, base, validate)
        learnt = api.learn_gp(
            flights,
            base,
            outputs=wanted,
            settings=settings,
            validate=tests,
            best_inputs=inputs == "auto",
            guard=not no_guard,
            progress=report,
        )
    api.save_gp(learnt, output, force=run.force)
    run.result(learnt)
    run.notes(base.notes)
    run.write("learn", {**learnt.to_json(), "gp": str(output)}, GP=output)
