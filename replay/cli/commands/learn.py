"""`wrenchgap learn`: a Gaussian process on what the model leaves."""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from wrenchgap.replay.cli.options import (
    Between,
    Cutoff,
    Force,
    JsonFile,
    Logs,
    ModelOption,
    OwnEffects,
    Quiet,
    Shift,
    Topics,
    many,
    parse_between,
    parse_names,
    parse_shifts,
    parse_topics,
)

if TYPE_CHECKING:
    from rich.table import Table

    from wrenchgap.learn.identify.learning import Learnt
    from wrenchgap.learn.process.alternatives import Choices
    from wrenchgap.replay.cli.console import Printer


class Subsample(StrEnum):
    """k-medoids libraries."""

    fasterpam = "fasterpam"
    pyclustering = "pyclustering"


class Mean(StrEnum):
    """Mean functions of the process."""

    physics = "physics"
    zero = "zero"
    linear = "linear"
    constant = "constant"


class Inference(StrEnum):
    """Which samples count."""

    exact = "exact"
    sparse = "sparse"


class Scale(StrEnum):
    """Inputs for the distance between samples."""

    standardised = "standardised"
    raw = "raw"


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("learn", cls=many("--validate"))(learn)


def learn(
    logs: Logs,
    model: ModelOption,
    output: Annotated[Path, typer.Option("--output", "-o", metavar="GP", help="File to write.", show_default=False)],
    validate: Annotated[
        list[Path] | None, typer.Option("--validate", metavar="LOG...", help="Flights to test on; never fitted.")
    ] = None,
    points: Annotated[int, typer.Option("--points", metavar="N", help="Training points kept.")] = 200,
    outputs: Annotated[
        str, typer.Option("--outputs", metavar="WHAT", help="torque, wrench, or axes like torque_x,force_z.")
    ] = "torque",
    subsample: Annotated[
        Subsample, typer.Option("--subsample", help="k-medoids library; pyclustering is the paper's.")
    ] = Subsample.fasterpam,
    inputs: Annotated[
        str | None,
        typer.Option(
            "--inputs",
            metavar="WHAT",
            help="Inputs besides the command: past, velocity, rates, position, with commas; or auto.",
        ),
    ] = None,
    mean: Annotated[
        Mean | None,
        typer.Option(
            "--mean",
            help="Mean function; zero is the paper's, physics the effects of MODEL.",
            show_default="physics if MODEL has effects, else zero",
        ),
    ] = None,
    inference: Annotated[
        Inference, typer.Option("--inference", help="exact: on N samples, as in the paper; sparse: on all, through N.")
    ] = Inference.exact,
    scale: Annotated[
        Scale, typer.Option("--scale", help="Inputs of k-medoids; raw is the paper's.")
    ] = Scale.standardised,
    restarts: Annotated[int, typer.Option("--restarts", metavar="N", help="Random starts of the likelihood.")] = 1,
    seed: Annotated[int, typer.Option("--seed", metavar="N", help="Of k-medoids and restarts.")] = 0,
    no_guard: Annotated[
        bool,
        typer.Option("--no-guard", help="Look neither for better inputs nor for the effect that the GP is absorbing."),
    ] = False,
    topic: Topics = None,
    shift: Shift = None,
    cutoff: Cutoff = 8.0,
    between: Between = None,
    own: OwnEffects = None,
    json: JsonFile = None,
    force: Force = False,
    quiet: Quiet = False,
) -> None:
    """Learn what the model leaves of the measured wrench, as a function of the commanded one.

    With a mean of physics the process learns what the effects of MODEL leave, and the compensation is that of both; so
    name effects first and learn the rest. If the process reproduces an effect of the catalogue, that is said.

    Example: `wrenchgap learn train.mcap -m fitted.toml --validate test.mcap -o rest.gp`
    """
    from wrenchgap.flight.errors import UsageError
    from wrenchgap.learn.data import comparison
    from wrenchgap.learn.data.opening import open_flights
    from wrenchgap.learn.process import learning, store
    from wrenchgap.learn.process.alternatives import Choices
    from wrenchgap.learn.process.gp import FitSettings
    from wrenchgap.plant import model_file
    from wrenchgap.replay.cli.console import Printer, progress
    from wrenchgap.replay.present.documents import claim, document, log_input, model_input, write_json

    unseen = validate or []
    claim({"--output": output, "--json": json}, force=force, inputs=[*logs, *unseen, model])
    if points < 2 or restarts < 0 or seed < 0:
        raise UsageError(f"learn: got {points} points, {restarts} restarts, seed {seed}; expected >= 2, >= 0, >= 0")
    wanted = learning.parse_outputs(outputs)
    base = model_file.load(model)
    settings = FitSettings(
        points=points,
        method=subsample.value,
        scale=scale.value,
        mean=learning.default_mean(base) if mean is None else mean.value,
        inputs=() if inputs == "auto" else parse_names(inputs),
        inference=inference.value,
        restarts=restarts,
        seed=seed,
    )
    on = learning.physics_of(base, settings)
    hz = comparison.cutoff_checked(cutoff)
    with progress("learning", quiet) as report:
        report(0.0, "reading logs")
        topics, shifts = parse_topics(topic), parse_shifts(shift)
        every = open_flights(
            [*logs, *unseen], base, topics=topics, cutoff_hz=hz, between=parse_between(between), shifts=shifts
        )
        flights, tests = every[: len(logs)], every[len(logs) :]
        choices = Choices((), settings)
        if inputs == "auto" or not no_guard:
            choices = learning.alternatives(flights, base, wanted, settings, progress=report)
        if inputs == "auto":
            settings = choices.best
        learnt = learning.learn(flights, base, wanted, settings, validation=tests, progress=report)
        absorbs = None if no_guard else learning.guard(flights, on, learnt.gp, progress=report)
    store.save(learnt.gp, output, force=force)
    printer = Printer(quiet)
    _print(printer, learnt)
    printer.show(*_alternatives(choices, wanted))
    if inputs != "auto" and (said := learning.choice_words(choices)):
        printer.line(said, style="bold")
    notes = [*base.notes, *(note for f in every for note in f.notes)]
    if absorbs is not None and (said := learning.absorption_words(absorbs)):
        printer.line(said, style="bold")
    printer.notes(learnt.warnings, "warning")
    printer.notes(notes)
    if json is not None:
        read = [*(log_input(f.flight) for f in flights), *(log_input(f.flight, "validation") for f in tests)]
        body = {**learnt.to_json(), "gp": str(output), "notes": notes}
        body["alternatives"] = learning.choices_json(choices)
        body["absorbs"] = None if absorbs is None else learning.absorption_json(absorbs)
        write_json(json, document("learn", body, [*read, model_input(base)]), force=force)
    printer.wrote(GP=output, result=json)


def _print(printer: Printer, learnt: Learnt) -> None:
    from wrenchgap.replay.present import tables

    gp = learnt.gp
    printer.line(
        f"{len(gp.inputs)} of {learnt.samples} samples ({1e3 * learnt.spacing:.0f} ms apart) on top of "
        f"{gp.provenance.physics}"
    )
    for title, result in (("training", learnt.training), ("unseen", learnt.validation)):
        if result is None:
            continue
        rows = [(e.name, e.pooled.mean_abs, e.pooled.std_abs) for e in result.evaluations]
        name = f"{title}: {', '.join(result.flights)}, |measured - predicted|"
        fall = 1.0 - result.evaluations[-1].pooled.mean_abs / result.evaluations[0].pooled.mean_abs
        printer.show(tables.mean_and_std(name, rows, fall))
    sigmas = [
        (name, tables.number(float(prior)), tables.number(float(seen)))
        for name, prior, seen in zip(gp.outputs, gp.sigma_prior, gp.sigma_training, strict=True)
    ]
    heads = ("output", "far from the data", "99 % of the training samples below")
    printer.show(tables.plain("standard deviation of a prediction", heads, sigmas))
    printer.show(_calibration(learnt))
    low, middle, high = learnt.real_min
    printer.line(
        f"conditioning: smallest eigenvalue of I + dmu/dW {low:.2f} (1st percentile), {middle:.2f} (median), "
        f"{high:.2f} (largest); 1 is no mismatch, 0 cannot be inverted"
    )


def _alternatives(choices: Choices, outputs: Sequence[str]) -> list[Table]:
    from wrenchgap.replay.present import tables

    rows = [
        (
            ", ".join(("command", *c.settings.inputs)),
            c.settings.inference,
            *(tables.number(float(v)) for v in c.rms),
            f"{100 * c.gain:.0f} %" if k else "asked for",
            "best" if c.settings == choices.best else "",
        )
        for k, c in enumerate(choices.tried)
    ]
    heads = ("inputs", "inference", *outputs, "smaller by", "")
    return [tables.plain("rms on time that was left out, with other inputs", heads, rows, left=2)] if rows else []


def _calibration(learnt: Learnt) -> Table:
    from wrenchgap.replay.present import tables

    rows = []
    for flights, (before, after) in learnt.coverage.items():
        for k, name in enumerate(learnt.gp.outputs):
            shares = (before.within_95[k], after.within_95[k], before.within_3_sigma[k], after.within_3_sigma[k])
            scale = f"{learnt.gp.sigma_scale[k]:.2f}"
            rows.append((flights, name, scale, *(f"{100 * s:.1f} %" for s in shares)))
    heads = ("flights", "output", "sigma times", "in 1.96 sigma, before", "after", "in 3 sigma, before", "after")
    return tables.plain("calibration: expected 95 % and 99.7 %", heads, rows, left=2)
