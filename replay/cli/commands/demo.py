"""`wrenchgap demo`: the whole loop, from two flight logs to a smaller error."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from wrenchgap.replay.cli import options as o
from wrenchgap.replay.cli.requests import Run

RUNS = {
    "recorded": "recorded",
    "null_run": "re-simulated unchanged",
    "counterfactual": "re-simulated with compensation",
}


def demo(
    ctx: typer.Context,
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FOLDER", help="Folder for the files.")] = Path(
        "demo-output"
    ),
    json: o.JsonFile = None,
    force: o.Force = False,
) -> None:
    """Run the whole loop on two simulated flights: find hidden effects, add one, learn the residual, compensate.

    The steps are command lines; each is printed, then run, on the logs alone.

    Example: `wrenchgap demo -o demo-output`
    """
    import contextlib

    from wrenchgap.replay.cli import demo

    if output.exists() and not output.is_dir():
        raise o.usage_error(f"{output}: is a file, expected a folder; choose another with -o")
    if output.is_dir() and any(output.iterdir()) and not force:
        raise o.usage_error(f"{output}: is not empty; choose another folder with -o, or say --force to write into it")
    run, root = Run(json=json and json.resolve(), force=force), ctx.find_root()
    run.claim({"--json": json})
    output.mkdir(parents=True, exist_ok=True)

    def execute(step: demo.Step) -> None:
        run.line()
        run.line(step.title, style="bold")
        run.line(f"$ {step.line}", style="cyan")
        writes = any(word in step.arguments for word in ("-o", "--json", "--csv", "--figure"))
        extra = ["--force"] if force and writes else []
        command = root.command.get_command(root, step.arguments[0])  # type: ignore[attr-defined]
        with command.make_context(step.arguments[0], [*step.arguments[1:], *extra], parent=root) as context:
            command.invoke(context)

    with contextlib.chdir(output):
        found = demo.run(Path(), execute)
    _result(run, found)
    run.line(f"figures: {output / 'effect.png'}, {output / 'torque.png'}; logs and results: {output}")
    run.write("demo", found)
    run.json = json
    run.wrote()


def _result(run: Run, found: dict[str, Any]) -> None:
    """The closing tables: torque error by model, attitude error by run."""
    from wrenchgap.replay.present.tables import table

    run.line()
    run.line("Result on the test flight, to which nothing was fitted", style="bold")
    run.line(f"hidden: {', '.join(found['hidden'])}      found: {', '.join(found['found'])}")
    errors = table("torque error, rms [Nm]", "", "x", "y", "z", "x", "y", "z")
    first = found["torque_rms"]["nominal"]
    for name, values in found["torque_rms"].items():
        falls = [
            f"{100 * (v / n - 1):+.0f} %" if name.startswith("with") else "" for v, n in zip(values, first, strict=True)
        ]
        errors.add_row(name, *(f"{v:.4f}" for v in values), *falls)
    tracking = table("attitude error, mean |e_R| [rad]", "", "x", "y", "z")
    for key, name in RUNS.items():
        tracking.add_row(name, *(f"{v:.4f}" for v in found["tracking"][key]["attitude_error"]["mean_abs"]))
    run.show(errors, tracking)
