"""`wrenchgap where`: where a model fails, and what the error is made of."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

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
    parse_between,
    parse_shifts,
    parse_topics,
)

if TYPE_CHECKING:
    from wrenchgap.learn.diagnose.budget import Budget
    from wrenchgap.learn.diagnose.failure_map import Dependence
    from wrenchgap.learn.diagnose.relevance import Relevance
    from wrenchgap.learn.diagnose.where import Where
    from wrenchgap.learn.diagnose.whiteness import Whiteness
    from wrenchgap.replay.cli.console import Printer

QUANTITIES = 3
"""Most quantities whose bins are printed."""
WORTH = 0.05
"""Share of the error that a quantity must go with for its bins to be printed."""
SIDES = ("front", "front left", "left", "back left", "back", "back right", "right", "front right")
"""Sectors of the side that is down, from 0 deg in steps of 45."""
BAR = 24
"""Characters of the longest bar."""


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("where")(where)


def where(
    logs: Logs,
    model: ModelOption,
    gp: Annotated[
        Path | None, typer.Option("--gp", metavar="GP", help="A GP of `wrenchgap learn`, on top of the model.")
    ] = None,
    figure: Annotated[
        Path | None, typer.Option("--figure", metavar="PNG", help="Draw maps, correlations and budget.")
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
    """Show where MODEL fails: with which tilt, thrust, speed, height ... its error goes, and what it is made of.

    Prints an error budget (noise, effects in the model, what a Gaussian process would add, unexplained), the quantities
    that most of the error goes with, the worst stretches, whether the residual is white, and the inputs that predict it
    on held-out time. docs/where.md says how to read it.

    Example: `wrenchgap where flight.mcap -m tilt_hexarotor --figure where.png`
    """
    from wrenchgap.learn.data import comparison
    from wrenchgap.learn.data.opening import open_flights
    from wrenchgap.learn.diagnose.where import examine
    from wrenchgap.learn.process import store
    from wrenchgap.plant import model_file
    from wrenchgap.replay.cli.console import Printer, progress
    from wrenchgap.replay.present.documents import claim, document, file_input, log_input, model_input, write_json

    inputs: list[str | Path] = [*logs, model, *([gp] if gp else ())]
    claim({"--json": json, "--figure": figure}, force=force, inputs=inputs)
    printer = Printer(quiet)
    base = model_file.load(model)
    process = store.load(gp) if gp is not None else None
    hz = comparison.cutoff_checked(cutoff)
    with progress("where", quiet) as report:
        report(0.0, "reading logs")
        topics, shifts = parse_topics(topic), parse_shifts(shift)
        flights = open_flights(logs, base, topics=topics, cutoff_hz=hz, between=parse_between(between), shifts=shifts)
        result = examine(flights, base, process, report)
    _print(printer, result)
    printer.notes([*base.notes, *result.notes])
    if figure is not None:
        from wrenchgap.replay.present.where_figures import save, where_figure

        save(where_figure(result), figure, force=force)
    if json is not None:
        read = [*(log_input(f.flight) for f in flights), model_input(base)]
        read += [file_input(gp, "gp")] if gp is not None else []
        write_json(json, document("where", result.to_json(), read), force=force)
    printer.wrote(figure=figure, result=json)


def _print(printer: Printer, result: Where) -> None:
    from wrenchgap.learn.diagnose.where import summary
    from wrenchgap.replay.present import tables

    for sentence in summary(result):
        printer.line(sentence, style="bold")
    printer.line()
    printer.show(_budget(result.budget))
    for dependence in [d for d in result.failure_map.significant if d.score >= WORTH][:QUANTITIES]:
        printer.show(_map(dependence))
    printer.show(_others(result))
    printer.show(tables.worst(result.name, result.worst))
    printer.show(_whiteness(result.whiteness))
    printer.show(_relevance(result.relevance))
    for name, reason in result.failure_map.lacking.items():
        printer.line(f"not mapped: {name}: {reason}", style="dim")


def _budget(budget: Budget) -> Any:
    """Root mean square of the nominal error, and its parts in percent."""
    import numpy as np

    from wrenchgap.learn.diagnose.budget import PARTS
    from wrenchgap.replay.present import tables

    out = tables.table("error budget: parts of the nominal model's mean square error", "", *tables.HEADS, "whole")
    out.add_row("nominal rms", *tables.row(np.sqrt(budget.nominal)), "", end_section=True)
    names = {"physics": "effects", "process": f"Gaussian process ({budget.source})", "noise": "sensor noise"}
    shares, whole = budget.shares(), budget.whole()
    for part in PARTS:
        if part == "physics" and not budget.physics.any():
            continue
        values = [*shares[part], whole[part]]
        out.add_row(names.get(part, part), *(f"{100 * v:.1f} %" for v in values))
    return out


def _map(dependence: Dependence) -> Any:
    """The bins of one quantity: how long, how large the error, and the share of it that sits there."""
    import numpy as np

    from wrenchgap.replay.present import tables

    b = dependence.binned
    title = (
        f"{dependence.label} [{dependence.unit}]: explains {100 * dependence.of_mean:.0f} % of the mean error, "
        f"{100 * dependence.of_size:.0f} % of its size"
    )
    heads = ("", "time", "F rms [N]", "noise", "M rms [Nm]", "noise", "error", "of all error above the noise")
    out = tables.table(title, *heads)
    out.columns[-1].justify = "left"
    longest = max(float(b.whole_share.max()), 1e-9)
    for i in range(len(b)):
        span = _span(dependence.name, float(b.low[i]), float(b.high[i]))
        sizes = [float(np.linalg.norm(v[i, part])) for part in (slice(0, 3), slice(3, 6)) for v in (b.rms, b.noise)]
        bar = "#" * round(BAR * float(b.whole_share[i]) / longest)
        share = f"{100 * b.whole_share[i]:.0f} %"
        out.add_row(span, f"{100 * b.time_share[i]:.0f} %", *(tables.number(s) for s in sizes), share, bar)
    return out


def _span(name: str, low: float, high: float) -> str:
    """A bin in words."""
    if low != low:  # not a number: no sector
        return "level" if name == "direction" else "elsewhere"
    if name == "direction":
        return SIDES[round(0.5 * (low + high) / 45.0) % 8]
    return f"{low:.3g} to {high:.3g}"


def _others(result: Where) -> Any:
    """All quantities in one line each."""
    from wrenchgap.replay.present import tables

    rows = [
        (
            d.label,
            f"{100 * d.of_mean:.0f} %",
            f"{100 * d.of_size:.0f} %",
            f"{d.p:.3f}",
            "yes" if d.significant else "no",
            *(f"{100 * v:.0f} %" for v in d.axes_mean),
        )
        for d in result.failure_map.dependences
    ]
    heads = ("quantity", "of mean", "of size", "p", "beyond chance", *(h.split(" ")[0] for h in tables.HEADS))
    return tables.plain("share of the error that goes with each quantity, beyond chance", heads, rows)


def _whiteness(white: Whiteness) -> Any:
    """In words, per axis."""
    from wrenchgap.learn.diagnose.where import autocorrelation_words, crosscorrelation_words
    from wrenchgap.replay.present import tables

    rows = [
        (a.axis, autocorrelation_words(a), crosscorrelation_words(white.strongest(a.axis)))
        for a in white.autocorrelation
    ]
    return tables.plain(
        "is the residual white?", ("axis", "in itself", "strongest correlation with an input"), rows, left=3
    )


def _relevance(relevant: Relevance) -> Any:
    """Groups of inputs: what they explain on held-out time."""
    from wrenchgap.replay.present import tables

    rows = [
        (
            str(g.step or ""),
            g.label,
            f"{100 * g.alone:.0f} %",
            f"{100 * g.lost:.0f} %",
            f"{g.significance:.1f}",
            *(f"{100 * v:.0f} %" for v in g.alone_axes),
        )
        for g in relevant.groups
    ]
    heads = ("step", "inputs", "alone", "lost without", "t", *(h.split(" ")[0] for h in tables.HEADS))
    title = f"inputs that predict the residual on held-out time (chosen: {100 * relevant.explained:.0f} % of it)"
    return tables.plain(title, heads, rows, left=2)
