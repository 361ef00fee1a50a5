"""`wrenchgap explain`: which physical effect is missing."""

from __future__ import annotations

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
    from wrenchgap.learn.identify.explain import Explanation
    from wrenchgap.replay.cli.console import Printer
    from wrenchgap.replay.present.explanation import Validation


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("explain", cls=many("--validate"))(explain)


def explain(
    logs: Logs,
    model: ModelOption,
    validate: Annotated[
        list[Path] | None,
        typer.Option("--validate", metavar="LOG...", help="Flights to test the result on; never fitted."),
    ] = None,
    effects_only: Annotated[
        str | None, typer.Option("--effects-only", metavar="A,B", help="Try only these effects.")
    ] = None,
    topic: Topics = None,
    shift: Shift = None,
    cutoff: Cutoff = 8.0,
    between: Between = None,
    own: OwnEffects = None,
    json: JsonFile = None,
    force: Force = False,
    quiet: Quiet = False,
) -> None:
    """Rank the effects that could explain what the model misses, by the error that they take off held-out time.

    Effects already in MODEL stay, fitted together with each candidate. Effects that these logs cannot tell apart are
    reported as one group. Put the result into a model file with `wrenchgap add`.

    Example: `wrenchgap explain train.mcap -m tilt_hexarotor --validate test.mcap`
    """
    from wrenchgap.learn.data import comparison
    from wrenchgap.learn.data.opening import open_flights
    from wrenchgap.learn.diagnose.timing import barred, timing_of
    from wrenchgap.learn.identify.explain import explain as find_missing
    from wrenchgap.learn.identify.fit import dataset
    from wrenchgap.learn.parallel import cores, get_ready
    from wrenchgap.plant import model_file
    from wrenchgap.plant.effects import find
    from wrenchgap.replay.cli.console import Printer, progress
    from wrenchgap.replay.present import explanation
    from wrenchgap.replay.present.documents import claim, document, log_input, model_input, write_json

    unseen = validate or []
    claim({"--json": json}, force=force, inputs=[*logs, *unseen, model])
    printer = Printer(quiet)
    base = model_file.load(model)
    names = parse_names(effects_only)
    for name in names:
        find(name)
    topics = parse_topics(topic)
    hz = comparison.cutoff_checked(cutoff)
    with progress("explaining", quiet) as report:
        report(0.0, "reading logs")
        get_ready(cores())
        every = open_flights(
            [*logs, *unseen],
            base,
            topics=topics,
            cutoff_hz=hz,
            between=parse_between(between),
            shifts=parse_shifts(shift),
        )
        flights, tests = every[: len(logs)], every[len(logs) :]
        report(0.0, "timing")
        offsets = [timing_of(f, base) for f in flights]
        data = dataset([r for f in flights for r in f.records], base)
        found = find_missing(
            data,
            base,
            names=names or None,
            barred={} if names else barred(offsets),
            jobs=cores(),
            progress=lambda words, k, n: report(min(1.0, k / max(n, 1)), words),
        )
    checked = explanation.validate(tests, flights, base, found.model) if tests else None
    for found_timing in offsets:
        for line in explanation.timing_first(found_timing):
            printer.line(line, style="dim")
        printer.notes(found_timing.warnings, "warning")
    _print(printer, found, checked, model, " ".join(map(str, logs)))
    printer.notes([*base.notes, *(note for f in every for note in f.notes)])
    if json is not None:
        read = [*(log_input(f.flight) for f in flights), *(log_input(f.flight, "validation") for f in tests)]
        body = {**explanation.to_json(found, checked), "flights": [f.records[0].flight for f in flights]}
        body["cutoff_hz"] = cutoff
        body["timing"] = [t.to_json() for t in offsets]
        body["notes"] = list(dict.fromkeys(note for f in every for note in f.notes))
        write_json(json, document("explain", body, [*read, model_input(base)]), force=force)
    printer.wrote(result=json)


def _print(printer: Printer, found: Explanation, checked: Validation | None, source: str, logs: str) -> None:
    from wrenchgap.replay.present import explanation, tables

    printer.line(explanation.sentence(found), style="bold")
    printer.line()
    if found.members:
        printer.show(tables.members(found))
        printer.line(tables.members_legend() + "\n", style="dim")
    for step in found.steps:
        if step.chosen is None and step.on:
            printer.line(f"on top of {', '.join(step.on)}: no further effect stands out\n")
            continue
        title = f"how it was found: on top of {', '.join(step.on)}" if step.on else "candidates"
        printer.show(tables.ranking(title, step, most=4 if step.on else 10))
    printer.line(tables.ranking_legend() + "\n", style="dim")
    fitted = explanation.parameters(found)
    if fitted:
        rows = [(name, *values) for name, listed in fitted.items() for values in listed]
        printer.show(tables.parameters(rows, "fitted together"))
    rows_of = [("rms before", found.rms_before), ("rms after", found.rms_after), ("sensor noise", found.noise)]
    change = 1.0 - found.rms_after / found.rms_before
    printer.show(tables.before_after("held-out time of the given logs", rows_of, change))
    if checked is not None:
        first, last = checked.comparison.evaluations[0], checked.comparison.evaluations[-1]
        where = ", ".join(checked.comparison.flights)
        rows_of = [("rms before", first.pooled.rms), ("rms after", last.pooled.rms)]
        printer.show(tables.before_after(f"unseen: {where}", rows_of, checked.falls))
        printer.notes(checked.warnings, "warning")
    if found.dropped:
        printer.line(f"found on the way, then dropped or replaced: {', '.join(found.dropped)}")
    for reason, names in explanation.not_tried(found).items():
        printer.line(f"not tried: {', '.join(names)}: {reason}", style="dim")
    for line in explanation.what_next(found, source, logs):
        printer.line(line)
