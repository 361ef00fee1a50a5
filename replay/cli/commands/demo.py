"""`wrenchgap demo`: the whole loop, from two flight logs to a smaller error."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from wrenchgap.replay.cli.options import Force, JsonFile


def register(app: typer.Typer) -> None:
    """Add the command."""

    @app.command("demo")
    def demo(
        ctx: typer.Context,
        output: Annotated[Path, typer.Option("--output", "-o", metavar="FOLDER", help="Folder for the files.")] = Path(
            "demo-output"
        ),
        json: JsonFile = None,
        force: Force = False,
    ) -> None:
        """Run the whole loop on two simulated flights: find hidden effects, add one, learn the residual, compensate.

        The steps are command lines; each is printed, then run, on the logs alone.

        Example: `wrenchgap demo -o demo-output`
        """
        run(ctx.find_root(), output, json, force)


def run(root: Any, output: Path, json: Path | None, force: bool) -> None:
    """Run the demo in the folder `output`, which must be new or empty unless `force`."""
    import contextlib

    from wrenchgap.flight.errors import UsageError
    from wrenchgap.replay.cli import demo
    from wrenchgap.replay.cli.console import Printer
    from wrenchgap.replay.present import tables
    from wrenchgap.replay.present.documents import claim, document, write_json

    if output.exists() and not output.is_dir():
        raise UsageError(f"{output}: is a file, expected a folder; choose another with -o")
    if output.is_dir() and any(output.iterdir()) and not force:
        raise UsageError(f"{output}: is not empty; choose another folder with -o, or say --force to write into it")
    claim({"--json": json}, force=force)
    target = json.resolve() if json is not None else None
    output.mkdir(parents=True, exist_ok=True)
    printer = Printer()
    written = ("-o", "--json", "--csv", "--figure")

    def execute(step: demo.Step) -> None:
        printer.line()
        printer.line(step.title, style="bold")
        printer.line(f"$ {step.line}", style="cyan")
        extra = ["--force"] if force and any(word in step.arguments for word in written) else []
        command = root.command.get_command(root, step.arguments[0])
        with command.make_context(step.arguments[0], [*step.arguments[1:], *extra], parent=root) as context:
            command.invoke(context)

    with contextlib.chdir(output):
        found = demo.run(Path(), execute)
    printer.line()
    printer.line("Result on the test flight, to which nothing was fitted", style="bold")
    printer.line(f"hidden: {', '.join(found['hidden'])}      found: {', '.join(found['found'])}")
    errors = tables.table("torque error, rms [Nm]", "", "x", "y", "z", "x", "y", "z")
    first = found["torque_rms"]["nominal"]
    for name, values in found["torque_rms"].items():
        falls = [
            f"{100 * (v / n - 1):+.0f} %" if name.startswith("with") else "" for v, n in zip(values, first, strict=True)
        ]
        errors.add_row(name, *(f"{v:.4f}" for v in values), *falls)
    tracking = tables.table("attitude error, mean |e_R| [rad]", "", "x", "y", "z")
    for name in ("recorded", "null_run", "counterfactual"):
        values = found["tracking"][name]["attitude_error"]["mean_abs"]
        label = {
            "recorded": "recorded",
            "null_run": "re-simulated unchanged",
            "counterfactual": "re-simulated with compensation",
        }
        tracking.add_row(label[name], *(f"{v:.4f}" for v in values))
    printer.show(errors, tracking)
    printer.line(f"figures: {output / 'effect.png'}, {output / 'torque.png'}; logs and results: {output}")
    if target is not None:
        write_json(target, document("demo", found, []), force=force)
        printer.wrote(result=json)
