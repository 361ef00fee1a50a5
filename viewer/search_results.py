"""What a search found, what is in the model and what to fly next, as HTML."""

from __future__ import annotations

from functools import partial
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.flight import AXES
from wrenchgap.viewer import markup
from wrenchgap.viewer.analysis import Candidate, ModelState, NextFlight, Ranking, Value
from wrenchgap.viewer.html_links import Links
from wrenchgap.viewer.sliders import finer

Array = NDArray[np.float64]

VERDICTS = {
    "effect": ("#2a7d2e", "EFFECT", "this is missing"),
    "group": ("#b07800", "GROUP", "one of these is missing; this flight cannot say which"),
    "unknown": ("#b3261e", "UNKNOWN", "something is missing that no effect of the catalogue explains"),
    "nothing": ("#555555", "NOTHING", "nothing is missing that this flight can show"),
}
MOST = 12
"""Candidates that are listed."""
LINK = "color:#1c6fc4;font-weight:600"


class Acts(Protocol):
    """What the links of a ranking do."""

    def add(self, *names: str) -> None:
        """Put effects into the model."""

    def tell_apart(self, names: tuple[str, ...]) -> None:
        """Search for the flight that tells effects apart."""


def norms(rms: Array) -> tuple[float, float]:
    """Of the force [N] and of the torque [Nm]."""
    return float(np.linalg.norm(rms[:3])), float(np.linalg.norm(rms[3:]))


def by_axis(rms: Array) -> str:
    """The rms of every axis in words."""
    return ", ".join(f"{axis} {value:.3g}" for axis, value in zip(AXES, rms, strict=True))


def page(found: Ranking, model: str, inside: set[str], links: Links, acts: Acts) -> str:
    """The verdict, the effects that were named, what cannot be told apart, all candidates, how it was found."""
    colour, verdict, words = VERDICTS.get(found.verdict, ("#222", found.verdict.upper(), ""))
    badge = f'<span style="background:{colour};color:#fff;padding:1px 7px;border-radius:3px">{verdict}</span>'
    parts = [
        markup.paragraph(f"{badge} {markup.text(words)}"),
        markup.paragraph(markup.text(found.sentence)),
    ]
    if found.model != model:
        parts.append(markup.paragraph(f"searched on top of {markup.text(found.model)}", colour="#777"))
    if found.named:
        parts += [markup.heading("named"), _named(found, inside, links, acts)]
        rest = tuple(n.name for n in found.named if n.name not in inside)
        if len(rest) > 1:
            parts.append(links.to(partial(acts.add, *rest), f"add {' and '.join(map(markup.text, rest))}", LINK))
    for group in found.groups:
        content = f"what to fly to tell {' from '.join(map(markup.text, group))}"
        parts.append(markup.paragraph(links.to(partial(acts.tell_apart, group), f"&#9992; {content}", LINK)))
    if found.candidates:
        parts += [markup.heading("candidates, each by itself"), _candidates(found, inside, links, acts)]
    parts += [markup.paragraph(markup.text(words), colour="#777") for words in found.trace]
    parts += [markup.paragraph(f"not tried: {markup.text(words)}", colour="#777") for words in found.not_tried]
    return markup.box(*parts)


def _named(found: Ranking, inside: set[str], links: Links, acts: Acts) -> str:
    """Each with how sure it is, its share of the error, its values and what might be in its place."""
    out = []
    for n in found.named:
        sure = f"{markup.percent(n.sure)} sure, {markup.percent(n.share)} of the error, t&nbsp;{n.t:.1f}"
        line = f"<b>{markup.text(n.name)}</b> &nbsp;{sure} &nbsp;{_add(n.name, inside, links, acts)}"
        out.append(markup.paragraph(line))
        out.append(markup.paragraph(", ".join(markup.text(_value(v)) for v in n.values), colour="#555"))
        if n.alike:
            other = f"cannot be told from {markup.text(', '.join(n.alike))} on this flight"
            out.append(markup.paragraph(other, colour="#b07800"))
    return "".join(out)


def _candidates(found: Ranking, inside: set[str], links: Links, acts: Acts) -> str:
    marks = {"chosen": "font-weight:600", "alike": "color:#b07800", "implausible": "color:#999"}
    shown = found.candidates[:MOST]
    rows = [
        (
            f'<span title="{markup.text(_about(c))}">{markup.text(c.name)}</span>',
            markup.bar([(max(c.score, 0.0), "#3b82c4", f"{markup.percent(c.score)} of the error energy")], height=9),
            markup.percent(max(c.score, 0.0)),
            f"{c.t:.1f}",
            _add(c.name, inside, links, acts),
        )
        for c in shown
    ]
    styles = [marks.get(c.mark, "") for c in shown]
    legend = "score: share of the error energy that is gone on held-out time; t above 3 is no chance; grey: implausible"
    listed = markup.table(("effect", markup.wide(40), "score", "t", ""), rows, left=2, lead=styles)
    return listed + markup.paragraph(legend, colour="#777")


def _about(candidate: Candidate) -> str:
    falls = ", ".join(f"{axis} {-100 * f:+.0f} %" for axis, f in zip(AXES, candidate.falls, strict=True))
    return f"{candidate.values}; {candidate.mark + '; ' if candidate.mark else ''}rms: {falls}"


def _add(name: str, inside: set[str], links: Links, acts: Acts) -> str:
    if name in inside:
        return "in"
    return links.to(partial(acts.add, name), "add", LINK, f"put {markup.text(name)} into the model, fitted here")


def inside(state: ModelState) -> str:
    """What is in the model, with intervals and where the values come from."""
    if not state.installed:
        return markup.box(markup.paragraph("the nominal vehicle, without any effect", colour="#777"))
    rows = [
        (
            f"<b>{markup.text(i.name)}</b><br>{markup.text(i.source)}",
            "<br>".join(markup.text(_value(v)) for v in i.values),
        )
        for i in state.installed
    ]
    return markup.box(markup.table(("", "+- one standard deviation"), rows, left=2))


def lacking(state: ModelState) -> str:
    """What this flight or this model does not allow, and why."""
    words = (f"not here: {', '.join(names)}: {reason}" for reason, names in state.lacking)
    return markup.box(*(markup.paragraph(markup.text(w), colour="#777") for w in words))


def _value(value: Value) -> str:
    unit, factor = finer(value)
    spread = "" if value.std is None else f" +- {markup.number(factor * value.std, 2)}"
    return f"{value.name} {markup.number(factor * value.value)}{spread} {'' if unit == '1' else unit}".rstrip()


def plan(found: NextFlight) -> str:
    """A designed flight in words."""
    colour = "#2a7d2e" if found.separable else "#b3261e"
    parts = [markup.paragraph(markup.text(found.sentence), colour=colour)]
    parts += [markup.paragraph(f"instead: {markup.text(words)}") for words in found.advice]
    parts.append(markup.paragraph(f"moves: {markup.text(found.moves)}; {found.time[-1]:.0f} s", colour="#777"))
    return markup.box(*parts)
