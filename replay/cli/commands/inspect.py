"""`wrenchgap inspect`: what is in a log."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

import typer

from wrenchgap.replay.cli.options import (
    Cutoff,
    Force,
    JsonFile,
    Logs,
    OwnEffects,
    Quiet,
    Shift,
    Topics,
    complete_models,
    parse_shifts,
    parse_topics,
)

if TYPE_CHECKING:
    from wrenchgap.flight.checks import Check
    from wrenchgap.flight.inspection import Inspection
    from wrenchgap.learn.diagnose.timing import Timing
    from wrenchgap.replay.cli.console import Printer


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
    shift: Shift = None,
    cutoff: Cutoff = 8.0,
    own: OwnEffects = None,
    json: JsonFile = None,
    force: Force = False,
    quiet: Quiet = False,
) -> None:
    """What is in a log: topics, the roles they play, rates, gaps, clocks, and whether the numbers make sense.

    Each check that fails says what to do. With a model, its mass, rotors and actuation are checked as well. Then by how
    much the topics lag one another and, with a model, the response its commands (docs/timing.md).

    Example: `wrenchgap inspect flight.mcap -m crazyflie --topic imu=/my/imu`
    """
    from wrenchgap import flight
    from wrenchgap.learn.data import comparison
    from wrenchgap.learn.diagnose import model_checks as checking
    from wrenchgap.learn.diagnose import timing as offsets
    from wrenchgap.plant import model_file
    from wrenchgap.replay.cli.console import Printer
    from wrenchgap.replay.present.documents import claim, document, model_input, write_json

    claim({"--json": json}, force=force, inputs=logs)
    topics, shifts = parse_topics(topic), parse_shifts(shift)
    hz = comparison.cutoff_checked(cutoff)
    known = model_file.load(model) if model is not None else None
    printer = Printer(quiet)
    bodies = []
    for path in logs:
        seen = checking.inspect(path, topics, known)
        against, opened = checking.checks(path, topics, known, hz, shifts) if known is not None else ((), None)
        moved = None if seen.flight is None else flight.shifted(seen.flight, shifts)
        notes = list(seen.notes if moved is None else moved.notes)
        found: Timing | None = None if moved is None or opened is not None else offsets.timing(moved)
        if opened is not None and known is not None:
            found = offsets.timing_of(opened, known)
        _print(printer, seen, against, found, notes)
        body = {**seen.to_json(), "model_checks": [c.__dict__ for c in against], "notes": notes}
        bodies.append({**body, "shift_s": shifts, "timing": None if found is None else found.to_json()})
    if json is not None:
        read = [{"role": "log", "file": b["path"], "sha256": b["sha256"]} for b in bodies]
        read += [model_input(known)] if known is not None else []
        write_json(json, document("inspect", {"logs": bodies}, read), force=force)
    printer.wrote(result=json)


def _print(
    printer: Printer, seen: Inspection, against: tuple[Check, ...], found: Timing | None, notes: Sequence[str]
) -> None:
    from wrenchgap.learn.diagnose import timing as offsets
    from wrenchgap.replay.present import tables

    printer.show(tables.topics(seen), tables.checks((*seen.checks, *against)))
    if found is not None and found.offsets:
        printer.show(offsets.offsets_table(found))
        printer.line(offsets.LEGEND, style="dim")
        printer.notes(offsets.problems(found), "cannot be estimated")
        printer.notes(found.warnings, "warning")
    printer.notes(notes)
    unused = {part: t for t in seen.topics for part in t.could_play if not t.plays}
    if unused:
        others = ", ".join(f"--topic {part}={t.topic}" for part, t in unused.items())
        printer.line(f"could also be read: {others}", style="dim")
    printer.line()
