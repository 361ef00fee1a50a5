"""A comparison of models on flights: tables, JSON, samples."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from wrenchgap.flight.flight import AXES
from wrenchgap.learn.data.comparison import Comparison, Stretch
from wrenchgap.learn.data.errors import force_and_torque
from wrenchgap.replay.present.notes import sentences
from wrenchgap.replay.present.numbers import UNIT_HEADS, number, row, unmeasured
from wrenchgap.replay.present.tables import Part, Table, note_lines, reductions, styled, table

if TYPE_CHECKING:
    import pandas as pd


def parts(result: Comparison, *, signed: bool = False) -> list[Part]:
    """Errors, by flight where there are several, and where the last model is worst; `signed`: with means by flight."""
    several = [by_flight(result)] if len(result.flights) > 1 else []
    if signed:
        several = [means_by_flight(result)]
    last = result.evaluations[-1]
    return [errors(result), *several, worst(last.name, last.worst), *note_lines(sentences(result.notes))]


def errors(comparison: Comparison) -> Table:
    """Errors by model and axis, and the noise floor."""
    flights = comparison.flights
    where = flights[0] if len(flights) == 1 else f"{len(flights)} flights"
    out = table(f"|measured - predicted| on {where}, {filtered(comparison)}", "model", "", *UNIT_HEADS, left=2)
    for index, one in enumerate(comparison.evaluations):
        e = one.pooled
        out.add_row(styled(one.name, "bold"), "mean", *row(e.mean_abs))
        out.add_row("", "std", *row(e.std_abs))
        out.add_row("", "rms", *row(e.rms))
        out.add_row("", "max", *row(e.max_abs), end_section=index == 0)
        if index:
            out.add_row("", "change of rms", *reductions(comparison.reduction(one)), end_section=True)
    out.add_row(styled("sensor noise", "dim"), "rms", *row(comparison.noise))
    return out


def filtered(comparison: Comparison) -> str:
    """Behind which filter the errors are: both sides, the same."""
    return f"both filtered at {comparison.records[0].cutoff_hz:g} Hz"


def by_flight(comparison: Comparison) -> Table:
    """Root mean square by flight."""
    out = table("rms of |measured - predicted| by flight", "flight", "model", *UNIT_HEADS, left=2)
    for index, flight in enumerate(comparison.flights):
        for place, one in enumerate(comparison.evaluations):
            last = place == len(comparison.evaluations) - 1
            name = flight if place == 0 else ""
            out.add_row(name, one.name, *row(one.by_flight[index].rms), end_section=last)
    return out


def means_by_flight(comparison: Comparison) -> Table:
    """Mean of the residual with its sign, and its root mean square, by flight."""
    title = "measured - predicted by flight: signed mean, and rms"
    out = table(title, "flight", "model", "", *UNIT_HEADS, left=3)
    for index, flight in enumerate(comparison.flights):
        for place, one in enumerate(comparison.evaluations):
            own, last = one.by_flight[index], place == len(comparison.evaluations) - 1
            means = [text if text.startswith(("-", "0")) else f"+{text}" for text in row(own.mean)]
            out.add_row(flight if place == 0 else "", one.name, "mean", *means)
            out.add_row("", "", "rms", *row(own.rms), end_section=last)
    out.add_row(styled("sensor noise", "dim"), "", "rms", *row(comparison.noise))
    return out


def worst(name: str, stretches: Sequence[Stretch]) -> Table:
    """The worst stretches of one model."""
    heads = ("flight", "time [s]", "largest on", "F rms [N]", "M rms [Nm]", "tilt [deg]", "|F| [N]")
    out = table(f"where {name} is worst", *heads, "|omega| [rad/s]", "speed [m/s]", left=3)
    for s in stretches:
        force, torque = force_and_torque(s.rms)
        state = [number(v if v is None else round(v, 3), 2) for v in (s.tilt_deg, s.force, s.rate, s.speed)]
        out.add_row(s.flight, f"{s.start:.1f} - {s.stop:.1f}", s.axis, number(force), number(torque), *state)
    return out


def stretch_in_words(stretch: Stretch) -> str:
    """On which axis the error is largest in a stretch, and what the vehicle was doing there."""
    known = (("tilt {:.0f} deg", stretch.tilt_deg), ("{:.2f} rad/s", stretch.rate), ("{:.2f} m/s", stretch.speed))
    return ", ".join([stretch.axis.replace("_", " "), *(form.format(v) for form, v in known if v is not None)])


def to_json(result: Comparison) -> dict[str, Any]:
    """The body of the `compare` schema."""
    return {
        "axes": list(AXES),
        "flights": list(result.flights),
        "models": [
            {
                "name": e.name,
                **vars(e.pooled),
                "fall_of_rms": result.reduction(e),
                "per_flight": [{"flight": f, **vars(own)} for f, own in zip(result.flights, e.by_flight, strict=True)],
                "worst": e.worst,
            }
            for e in result.evaluations
        ],
        "by_flight": [
            {"flight": flight, "model": e.name, "mean": e.by_flight[k].mean, "rms": e.by_flight[k].rms}
            for k, flight in enumerate(result.flights)
            for e in result.evaluations
        ],
        "noise": result.noise,
        "unmeasured": unmeasured(result.noise),
        "samples": sum(len(r) for r in result.records),
        "cutoff_hz": result.records[0].cutoff_hz,
        "notes": sentences(result.notes),
    }


def to_frame(result: Comparison) -> pd.DataFrame:
    """One row for each compared sample: flight, time, then `commanded.force_x`, `measured...`, `<model>...`."""
    import pandas as pd  # here: others need not wait for it

    found = []
    for index, record in enumerate(result.records):
        columns: dict[str, object] = {"flight": record.flight, "time": record.time}
        wrenches = {"commanded": record.commanded, "measured": record.measured}
        wrenches |= {e.name: e.predictions[index] for e in result.evaluations}
        for name, values in wrenches.items():
            columns |= {f"{name}.{axis}": values[:, k] for k, axis in enumerate(AXES)}
        found.append(pd.DataFrame(columns))
    return pd.concat(found, ignore_index=True)
