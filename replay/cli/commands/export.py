"""`wrenchgap export`: the compensation as C99 for the vehicle."""

import shlex
import sys
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Literal

import typer

import wrenchgap as wg
from wrenchgap.replay.cli import options as o
from wrenchgap.replay.cli.requests import Run
from wrenchgap.replay.cli.values import complete_effects, usage_error

Precision = StrEnum("Precision", ["double", "float"])


def export(
    gate: o.Gate,
    run: Run,
    model: o.ModelOption,
    output: Annotated[Path, o.output("FOLDER", "Folder to write.")],
    gp: Annotated[
        Path | None, typer.Argument(metavar="[GP]", help="A GP of `wrenchgap learn`; without one, the effects alone.")
    ] = None,
    precision: Annotated[Precision, typer.Option(help="Of the build, unless it says otherwise.")] = Precision.double,
    dt: Annotated[
        float | None, o.option("S", "Control period in seconds; default: that of MODEL's controller.")
    ] = None,
    evaluations: Annotated[int, o.option("N", "Evaluations of the model in one search, at most.", min=1)] = 12,
    lead: o.Lead = None,
    without: Annotated[
        list[str] | None, o.option("EFFECT", "Leave this effect of MODEL out.", autocompletion=complete_effects)
    ] = None,
    observer: Annotated[
        str | None,
        o.option(
            "HZ|log", "With an observer of what the rest leaves: of this bandwidth, or log for the one in GP's file."
        ),
    ] = None,
    observer_max: Annotated[
        float | None,
        o.option("NM", "Largest torque that the observer corrects; default: three times the largest mismatch learnt."),
    ] = None,
) -> None:
    """Write the compensation as C99 without dependencies: a library, its self-test, a Makefile, a README.

    The process, the effects that it was learnt on, the gate, the search and an observer, without allocation and with
    bounded iterations. What a step costs at worst is printed. An effect that cannot be exported is refused by name.

    Example: `wrenchgap export torque.gp -m fitted.toml -o compensator/`
    """
    # Long because typer reads the options from the signature, one a line.
    from wrenchgap.flight.atomic import resolved

    run.claim({}, model, gp)
    for path in (model, gp):
        if path is not None and resolved(output) in Path(path).resolve().parents:
            raise usage_error(f"--output {output}: holds {path}, which is read; choose another folder")
    base, process = run.model(model), run.gp(gp)
    settings = gate.settings(dt=1.0 / base.controller.rate_hz if dt is None else dt, max_evaluations=evaluations)
    with run.progress("exporting", "compiling, the first time on this machine"):
        made = wg.export_compensator(
            process,
            base,
            output,
            settings,
            lead=lead,
            precision="float" if precision is Precision.float else "double",
            without=without or (),
            names=(Path(model).name, "-" if gp is None else gp.name),
            command=shlex.join(["wrenchgap", *sys.argv[1:]]),
            force=run.force,
            observer=_bandwidth(observer),
            observer_max=observer_max,
        )
    run.result(made)
    run.write("export", {**made.to_json(), "folder": str(output)}, folder=output)
    run.line(f"next: make -C {shlex.quote(str(output))} test")


def _bandwidth(text: str | None) -> float | Literal["log"] | None:
    """A number of Hz, or that of the training log."""
    if text is None or text == "log":
        return None if text is None else "log"
    try:
        return float(text)
    except ValueError:
        raise usage_error(f"--observer {text}: expected a bandwidth in Hz, or log") from None
