"""Tables for the terminal. They show; nothing is computed here."""

from __future__ import annotations

from collections.abc import Sequence
from os.path import commonpath
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich import box
from rich.markup import escape
from rich.table import Table

from wrenchgap.flight.checks import Check
from wrenchgap.flight.inspection import Inspection
from wrenchgap.learn.data.comparison import Comparison, Stretch
from wrenchgap.learn.identify.explain import Candidate, Explanation, Step

Array = NDArray[np.float64]

HEADS = ("F_x [N]", "F_y [N]", "F_z [N]", "M_x [Nm]", "M_y [Nm]", "M_z [Nm]")


def table(title: str, *heads: str, left: int = 1) -> Table:
    """An empty table; the first `left` columns are texts."""
    out = Table(title=escape(title), box=box.SIMPLE_HEAD, title_justify="left", title_style="bold", pad_edge=False)
    for index, head in enumerate(heads):
        out.add_column(escape(head), justify="left" if index < left else "right", overflow="fold")
    return out


def number(value: float | None, digits: int = 3) -> str:
    """Significant digits without exponent where a reader expects none."""
    if value is None or not np.isfinite(value):
        return "-"
    if value == 0:
        return "0"
    if 1e-4 <= abs(value) < 1e5:
        decimals = max(0, digits - 1 - int(np.floor(np.log10(abs(value)))))
        return f"{value:.{min(decimals, 6)}f}"
    return f"{value:.{digits - 1}e}"


def percent(value: float) -> str:
    """A fraction as a signed percentage."""
    return f"{100 * value:+.0f} %" if np.isfinite(value) else "-"


def row(values: Array, digits: int = 3) -> list[str]:
    """Six numbers."""
    return [number(float(v), digits) for v in values]


def fall(values: Array) -> list[str]:
    """Six falls, coloured where they say something."""
    out = []
    for value in values:
        text = f"{-100 * value:+.0f} %".replace("-0 %", "0 %").replace("+0 %", "0 %") if np.isfinite(value) else "-"
        out.append(f"[green]{text}[/]" if value > 0.1 else f"[red]{text}[/]" if value < -0.1 else text)
    return out


def errors(comparison: Comparison) -> Table:
    """Errors by model and axis, and the noise floor."""
    flights = comparison.flights
    where = flights[0] if len(flights) == 1 else f"{len(flights)} flights"
    out = table(f"|measured - predicted| on {where}", "model", "", *HEADS, left=2)
    for index, one in enumerate(comparison.evaluations):
        e = one.pooled
        name = escape(one.name)
        out.add_row(f"[bold]{name}[/]", "mean", *row(e.mean_abs))
        out.add_row("", "std", *row(e.std_abs))
        out.add_row("", "rms", *row(e.rms))
        out.add_row("", "max", *row(e.max_abs), end_section=index == 0)
        if index:
            out.add_row("", "change of rms", *fall(comparison.falls(one)), end_section=True)
    out.add_row("[dim]sensor noise[/]", "rms", *row(comparison.noise))
    return out


def by_flight(comparison: Comparison) -> Table:
    """Root mean square by flight."""
    out = table("rms by flight", "flight", "model", *HEADS, left=2)
    for index, flight in enumerate(comparison.flights):
        for place, one in enumerate(comparison.evaluations):
            last = place == len(comparison.evaluations) - 1
            name = escape(flight) if place == 0 else ""
            out.add_row(name, escape(one.name), *row(one.by_flight[index].rms), end_section=last)
    return out


def worst(name: str, stretches: Sequence[Stretch]) -> Table:
    """The worst stretches of one model."""
    heads = ("flight", "time [s]", "most on", "F rms [N]", "M rms [Nm]", "tilt [deg]", "|F| [N]")
    out = table(f"where {name} is worst", *heads, "|omega| [rad/s]", "speed [m/s]", left=3)
    for s in stretches:
        force, torque = (float(np.linalg.norm(part)) for part in (s.rms[:3], s.rms[3:]))
        state = [number(v if v is None else round(v, 3), 2) for v in (s.tilt_deg, s.force, s.rate, s.speed)]
        out.add_row(escape(s.flight), f"{s.start:.1f} - {s.stop:.1f}", s.axis, number(force), number(torque), *state)
    return out


def parameters(rows: Sequence[tuple[str, str, float, float | None, str]], title: str) -> Table:
    """(effect, parameter, value, standard deviation, unit)."""
    out = table(title, "effect", "parameter", "value", "+-", "unit", left=2)
    out.columns[-1].justify = "left"
    last = ""
    for effect, name, value, std, unit in rows:
        first = escape(effect) if effect != last else ""
        out.add_row(first, escape(name), number(value, 4), number(std, 2), _unit(unit))
        last = effect
    return out


def before_after(title: str, rows: Sequence[tuple[str, Array]], falls: Array | None = None) -> Table:
    """Rows of six numbers, and the change from the first to the last."""
    out = table(title, "", *HEADS)
    for name, values in rows:
        out.add_row(escape(name), *row(values))
    if falls is not None:
        out.add_row("change", *fall(falls))
    return out


def mean_and_std(title: str, rows: Sequence[tuple[str, Array, Array]], falls: Array) -> Table:
    """The paper's prediction table: mean and std of absolute errors, and the change of the mean."""
    out = table(title, "model", "", *HEADS, left=2)
    for name, mean, std in rows:
        out.add_row(f"[bold]{escape(name)}[/]", "mean", *row(mean))
        out.add_row("", "std", *row(std), end_section=True)
    out.add_row("", "change of mean", *fall(falls))
    return out


def plain(title: str, heads: Sequence[str], rows: Sequence[Sequence[Any]], left: int = 1) -> Table:
    """Any rows of texts."""
    out = table(title, *heads, left=left)
    for values in rows:
        out.add_row(*(escape(str(v)) for v in values))
    return out


def ranking(title: str, step: Step, most: int | None = None) -> Table:
    """Candidates of one step of the selection, best first; those that can stand for the chosen one are marked."""
    out = table(title, "", "effect", "score", *(h.split(" ")[0] for h in HEADS), "t", "parameters", left=2)
    out.columns[-1].justify = "left"
    alike = {name for name, _ in step.alike}
    for candidate in step.candidates[:most]:
        mark = "*" if candidate.name == step.chosen else "=" if candidate.name in alike else ""
        limit = " [red](implausible: at its limit)[/]" if candidate.implausible else ""
        out.add_row(
            mark,
            candidate.name,
            f"{candidate.score:.3f}",
            *fall(candidate.falls),
            f"{candidate.significance:.1f}",
            escape(values_of(candidate)) + limit,
            style="bold" if mark == "*" else "",
        )
    return out


def members(explanation: Explanation) -> Table:
    """The effects that were named: how sure, how large, and what comes nearest in their place."""
    out = table("named", "effect", "sure", "share", "t", "its group", "nearest other", left=1)
    for column in out.columns[-2:]:
        column.justify = "left"
    for m in explanation.members:
        group = ", ".join(f"{r.name} (cos {r.cosine:.2f})" for r in m.alike)
        others = [r for r in m.rivals if not r.alike and r.candidate.worthy]
        far = f"{others[0].name} ({others[0].separation:.1f})" if others else "-"
        sure_and_share = (f"{100 * x:.0f} %" for x in (explanation.probability(m), m.share))
        out.add_row(m.name, *sure_and_share, f"{m.significance:.1f}", group or "-", far)
    return out


def members_legend() -> str:
    """What the columns of `members` mean."""
    return (
        "sure: how often a name with this much behind it was right   share: of the error energy, lost without it   "
        "group: cannot be told from it here   nearest other: and by how many standard errors it does worse"
    )


def ranking_legend() -> str:
    """What the columns of `ranking` mean."""
    return (
        "* chosen   = cannot be told from it   score: share of the error energy that is gone   "
        "F, M: change of rms on held-out time   t: above 3 is beyond chance"
    )


def values_of(candidate: Candidate) -> str:
    """The values in a few words: all of up to three, else the clearest two."""
    values = candidate.values()
    if len(values) == 1:
        name, value, std, unit = values[0]
        return f"{name} {number(value)} +- {number(std, 2)} {_unit(unit)}".rstrip()
    clearest = sorted(values, key=lambda v: -abs(v[1]) / max(v[2], 1e-30))
    shown = values if len(values) <= 3 else clearest[:2]
    more = f", ... ({len(values)})" if len(values) > 3 else ""
    return ", ".join(f"{n} {number(v)} {_unit(u)}".rstrip() for n, v, _, u in shown) + more


def _unit(unit: str) -> str:
    return "" if unit == "1" else unit


def topics(seen: Inspection) -> Table:
    """Topics of a log: roles, rates, gaps."""
    size = f"{seen.size / 1e6:.1f} MB" if seen.size >= 1e5 else f"{seen.size / 1e3:.1f} kB"
    title = f"{seen.path} ({seen.format}, {size}, {seen.duration:.1f} s)"
    common = _namespace([t.topic for t in seen.topics])
    heads = (
        f"topic in\n{common}" if common else "topic",
        "type",
        "role",
        "messages",
        "rate [Hz]",
        "jitter [ms]",
        "gaps",
        "left out",
    )
    out = table(title, *heads, left=3)
    for t in seen.topics:
        kind = t.type.split("/")[-1]
        gaps = f"{t.gaps} (to {t.longest_gap:.2f} s)" if t.gaps else "0"
        jitter = "-" if t.jitter is None else number(round(1e3 * t.jitter, 3), 2)
        role = f"[bold green]{escape(', '.join(t.plays))}[/]" if t.plays else "[dim]-[/]"
        lost = str(sum(t.dropped.values())) if t.dropped else "0"
        out.add_row(
            escape(t.topic.removeprefix(common)),
            escape(kind),
            role,
            str(t.count),
            number(t.rate, 4),
            jitter,
            gaps,
            lost,
        )
    return out


def _namespace(names: Sequence[str]) -> str:
    """The namespace that all topics share, with its last slash, if it is worth leaving out."""
    shared = commonpath(names) + "/" if len(names) > 1 else ""
    return shared if len(shared) > 8 else ""


def checks(found: Sequence[Check]) -> Table:
    """Findings, the bad ones first."""
    out = Table(box=None, show_header=False, pad_edge=False, padding=(0, 1))
    colours = {"ok": "[green]ok[/]", "warn": "[yellow]warn[/]", "bad": "[bold red]bad[/]"}
    for check in sorted(found, key=lambda c: ("bad", "warn", "ok").index(c.level)):
        out.add_row(colours[check.level], escape(check.name), escape(check.message))
    return out
