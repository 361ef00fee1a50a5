"""`wrenchgap inspect`: what is in a log."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from replay.options import Cutoff, Force, JsonFile, Logs, Quiet, Topics, complete_models, parse_topics

if TYPE_CHECKING:
    from flight.checks import Check
    from flight.inspection import Inspection
    from replay.console import Printer


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("inspect")(inspect)


def inspect(
    logs: Logs,
    model: Annotated[
        str | None,
        typer.Option(
            "--model", "-m", metavar="MODEL", help="Check the log against a model too.", autocompletion=complete_models
        ),
    ] = None,
    topic: Topics = None,
    cutoff: Cutoff = 8.0,
    json: JsonFile = None,
    force: Force = False,
    quiet: Quiet = False,
) -> None:
    """What is in a log: topics, the roles they play, rates, gaps, clocks, and whether the numbers make sense.

    Each check that fails says what to do. With a model, its mass, rotors and actuation are checked as well.

    Example: `wrenchgap inspect flight.mcap -m crazyflie --topic imu=/my/imu`
    """
    from plant import model_file
    from replay import checking, comparison
    from replay.console import Printer
    from replay.results import claim, document, model_input, write_json

    claim({"--json": json}, force=force, inputs=logs)
    topics = parse_topics(topic)
    hz = comparison.cutoff_checked(cutoff)
    known = model_file.load(model) if model is not None else None
    printer = Printer(quiet)
    bodies = []
    for path in logs:
        seen = checking.inspect(path, topics, known)
        against = checking.checks(path, topics, known, hz) if known is not None else ()
        _print(printer, seen, against)
        bodies.append({**seen.to_json(), "model_checks": [c.__dict__ for c in against]})
    if json is not None:
        read = [{"role": "log", "file": b["path"], "sha256": b["sha256"]} for b in bodies]
        read += [model_input(known)] if known is not None else []
        write_json(json, document("inspect", {"logs": bodies}, read), force=force)
    printer.wrote(result=json)


def _print(printer: Printer, seen: Inspection, against: tuple[Check, ...]) -> None:
    from replay import tables

    printer.show(tables.topics(seen), tables.checks((*seen.checks, *against)))
    printer.notes(seen.notes)
    unused = {part: t for t in seen.topics for part in t.could_play if not t.plays}
    if unused:
        others = ", ".join(f"--topic {part}={t.topic}" for part, t in unused.items())
        printer.line(f"could also be read: {others}", style="dim")
    printer.line()
