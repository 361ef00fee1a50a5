"""`wrenchgap demo`: the whole loop, from two flight logs to a smaller error.

A vehicle with effects that its model file lacks: they are found, one is added, the rest learnt, and compensated. Every
step is a command line, run as a user would type it, on the logs alone. The closing table is put together from the
steps' JSON results and speaks of the test flight only, which no step fitted.
"""

from dataclasses import dataclass
from json import dumps, loads
from pathlib import Path
from typing import Annotated, Any

import typer

from wrenchgap.replay.cli import options as o
from wrenchgap.replay.cli.requests import Run
from wrenchgap.replay.cli.values import usage_error

HIDDEN = ("com_offset=x:0.005,y:-0.007,z:0.004", "arm_twist=twist:0.0015")
"""What the vehicle has and its model file does not: a centre of mass 9 mm away from where it should be, and arms that
twist by 0.09 deg per newton of thrust."""
ADDED = "com_offset"
"""The effect that is added by name; a Gaussian process learns the rest, as it would if the rest had no name."""
WRITTEN = "demo-files.json"
"""In the demo's folder: the SHA-256 of every file that a demo wrote there. A later demo replaces these files while they
are unchanged."""
RUNS = {
    "recorded": "recorded",
    "null_run": "re-simulated unchanged",
    "counterfactual": "re-simulated with compensation",
}


@dataclass(frozen=True)
class Step:
    """What it is for, and the arguments of `wrenchgap`. Files are in the demo's folder."""

    title: str
    arguments: tuple[str, ...]

    @property
    def outputs(self) -> list[str]:
        """Names of the files that it writes."""
        pairs = zip(self.arguments, self.arguments[1:], strict=False)
        return [value for option, value in pairs if option in ("-o", "--json", "--csv", "--figure")]


STEPS = """
Fly a training flight: tilts about several axes, excitation on all of them
$ simulate -m {model} -t multi_axis --duration 40 --excitation 1 --seed 1 {hidden} -o train.mcap
Fly a test flight, to which nothing is fitted
$ simulate -m {model} -t multi_axis --duration 20 --seed 2 {hidden} -o test.mcap
What is in the log?
$ inspect test.mcap -m {model}
How large is the model's error?
$ compare test.mcap -m {model} --json before.json
Which effects are missing?
$ explain train.mcap -m {model} --validate test.mcap --json explain.json
Add one of them
$ add {added} -m {model} --from train.mcap -o fitted.toml
How large is the error with it?
$ compare test.mcap -m {model} --against fitted.toml --figure effect.png --json effect.json
Learn the residual as a Gaussian process
$ learn train.mcap -m fitted.toml --points 200 -o torque.gp --json learn.json
How large is the error with the process?
$ compare test.mcap -m fitted.toml --gp torque.gp --figure torque.png --json gp.json
Re-run the compensation on the test flight's recorded wrenches
$ replay test.mcap -m fitted.toml --gp torque.gp -o replayed.mcap --json replay.json
Re-simulate the test flight with the compensation in the loop
$ counterfactual test.mcap -m fitted.toml --gp torque.gp -o reflown.mcap --json reflown.json
"""
"""What each step is for, and its command line; file names are relative to the demo's folder."""


def _steps() -> list[Step]:
    """The steps of the demo."""
    hidden = " ".join(f"--hide {effect}" for effect in HIDDEN)
    lines = STEPS.format(model="tilt_hexarotor", hidden=hidden, added=ADDED).strip().splitlines()
    return [Step(title, tuple(line.split()[1:])) for title, line in zip(lines[::2], lines[1::2], strict=True)]


def _numbers(folder: Path) -> dict[str, Any]:
    """The closing table's numbers from the steps' results: torque rms (3,) [Nm], attitude error (3,) [rad]."""

    def read(file: str) -> Any:
        return loads((folder / file).read_text(encoding="utf-8"))

    def rms(file: str, index: int) -> list[float]:
        return [float(v) for v in read(file)["models"][index]["rms"][3:]]

    reflown = read("reflown.json")
    return {
        "hidden": list(HIDDEN),
        "found": read("explain.json")["effects"],
        "torque_rms": {
            "nominal": rms("before.json", 0),
            f"with {ADDED}": rms("effect.json", -1),
            f"with {ADDED} and the GP": rms("gp.json", -1),
            "sensor noise": [float(v) for v in read("before.json")["noise"][3:]],
        },
        "tracking": reflown["tracking"],
        "null_run": reflown["null_run"],
    }


def demo(
    ctx: typer.Context,
    output: Annotated[Path, o.output("FOLDER", "Folder for the files.")] = Path("demo-output"),
    json: o.JsonFile = None,
    force: o.Force = False,
) -> None:
    """Run the whole loop on two simulated flights: find hidden effects, add one, learn the residual, compensate.

    The steps are command lines; each is printed, then run, on the logs alone. A second run replaces the files of the
    first, unless they have been changed since.

    Example: `wrenchgap demo -o demo-output`
    """
    import contextlib

    if output.exists() and not output.is_dir():
        raise usage_error(f"{output}: is a file, expected a folder; choose another with -o")
    if not force:
        _refuse_to_overwrite(output)
    run, root = Run(json=json, force=force), ctx.find_root()
    run.claim({})
    output.mkdir(parents=True, exist_ok=True)

    with contextlib.chdir(output):
        for step in _steps():
            run.line()
            run.line(step.title, style="bold")
            run.line(f"$ {' '.join(('wrenchgap', *step.arguments))}", style="cyan")
            extra = ["--force"] if step.outputs else []
            command = root.command.get_command(root, step.arguments[0])  # type: ignore[attr-defined]
            with command.make_context(step.arguments[0], [*step.arguments[1:], *extra], parent=root) as context:
                command.invoke(context)
            _note_written(step.outputs)
        found = _numbers(Path())
    _result(run, found)
    run.line(f"figures: {output / 'effect.png'}, {output / 'torque.png'}; logs and results: {output}")
    run.write("demo", found)


def _refuse_to_overwrite(folder: Path) -> None:
    """Raise UsageError if a demo would replace a file that was changed, or if no demo wrote into this folder."""
    from wrenchgap.replay.present.documents import sha256

    if not folder.is_dir() or not any(folder.iterdir()):
        return
    how = "choose another folder with -o, or say --force to write into it"
    written = _written(folder)
    if not written:
        raise usage_error(f"{folder}: is not empty; {how}")
    for file in (folder / name for step in _steps() for name in step.outputs):
        if file.exists() and not (file.is_file() and sha256(file) == written.get(file.name)):
            raise usage_error(f"{file}: was changed since the demo wrote it; {how}")


def _written(folder: Path) -> dict[str, str]:
    """SHA-256 of the files that demos wrote into this folder, by name; empty if there is no record of any."""
    try:
        written = loads((folder / WRITTEN).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return written if isinstance(written, dict) else {}


def _note_written(files: list[str]) -> None:
    """Add these files of the working folder to the record of what demos wrote."""
    from wrenchgap.flight.atomic import write_text
    from wrenchgap.replay.present.documents import sha256

    written = _written(Path()) | {name: sha256(Path(name)) for name in files}
    write_text(Path(WRITTEN), dumps(written, indent=1) + "\n")


def _result(run: Run, found: dict[str, Any]) -> None:
    from wrenchgap.replay.present.numbers import change
    from wrenchgap.replay.present.tables import table

    run.line()
    run.line("Result on the test flight, to which nothing was fitted", style="bold")
    run.line(f"hidden: {', '.join(found['hidden'])}      found: {', '.join(found['found'])}")
    rows = []
    first = found["torque_rms"]["nominal"]
    for name, values in found["torque_rms"].items():
        falls = [change(v / n - 1) if name.startswith("with") else "" for v, n in zip(values, first, strict=True)]
        rows.append((name, *(f"{v:.4f}" for v in values), *falls))
    errors = {name: found["tracking"][key]["attitude_error"]["mean_abs"] for key, name in RUNS.items()}
    tracking = [(name, *(f"{v:.4f}" for v in values)) for name, values in errors.items()]
    run.show(table("torque error, rms [Nm]", ("", *"xyz", *"xyz"), rows))
    run.show(table("attitude error, mean |e_R| [rad]", ("", *"xyz"), tracking))
