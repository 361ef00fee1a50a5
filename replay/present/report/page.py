"""The report as one HTML page: nothing is fetched, every image is inside, readable on paper."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.flight import AXES
from wrenchgap.learn.diagnose.timing import sentences
from wrenchgap.learn.diagnose.where import (
    Where,
    autocorrelation_words,
    crosscorrelation_words,
    dependence_words,
    summary,
)
from wrenchgap.learn.identify.explain import Candidate
from wrenchgap.learn.identify.staircase import Staircase
from wrenchgap.learn.process import learning
from wrenchgap.plant import trajectory_file
from wrenchgap.plant.effects import find
from wrenchgap.replay.present import explanation, where_figures
from wrenchgap.replay.present import history as versions
from wrenchgap.replay.present.report import charts
from wrenchgap.replay.present.report.markup import (
    Child,
    Html,
    block,
    code,
    details,
    element,
    items,
    join,
    paragraph,
    section,
    table,
)
from wrenchgap.replay.present.tables import HEADS, number
from wrenchgap.replay.report.contents import Apart, Contents

Array = NDArray[np.float64]

INTERVAL = 1.96
"""Half-width of a 95 % interval in standard deviations."""
MOST_CANDIDATES = 12
STYLE = """
:root { color-scheme: light; }
body { font: 16px/1.5 system-ui, sans-serif; color: #1b1f24; background: #fff; max-width: 66rem; margin: 0 auto;
  padding: 1rem 1.5rem 4rem; }
h1 { font-size: 1.6rem; margin: 1rem 0 0; }
h2 { font-size: 1.2rem; margin: 2.5rem 0 .5rem; border-bottom: 1px solid #d5dae0; padding-bottom: .2rem; }
h3 { font-size: 1rem; margin: 1.5rem 0 .3rem; }
.sub { color: #57606a; margin: .1rem 0 1rem; }
.verdict { background: #eef3fa; border-left: 5px solid #4c72b0; padding: .8rem 1rem; font-size: 1.1rem;
  margin: 1rem 0; }
.verdict.unknown { background: #fdf3ea; border-color: #dd8452; }
.verdict.nothing { background: #eef7f0; border-color: #55a868; }
.warning { background: #fdf3ea; padding: .3rem .8rem; }
nav { font-size: .9rem; margin: 1rem 0; display: flex; flex-wrap: wrap; gap: .2rem 1rem; }
a { color: #2c5aa0; }
figure { margin: 1rem 0; }
img { max-width: 100%; height: auto; }
figcaption, caption, .small { color: #57606a; font-size: .88rem; }
caption { text-align: left; padding-bottom: .3rem; }
.wide { overflow-x: auto; margin: .8rem 0; }
table { border-collapse: collapse; font-size: .88rem; font-variant-numeric: tabular-nums; }
th, td { padding: .18rem .7rem .18rem 0; text-align: left; vertical-align: top; border-bottom: 1px solid #e7eaee; }
thead th { border-bottom: 1px solid #9aa4ae; }
.number { text-align: right; white-space: nowrap; }
code { font: .88em ui-monospace, monospace; background: #f4f5f7; padding: 0 .2em; overflow-wrap: anywhere; }
pre { background: #f4f5f7; padding: .7rem 1rem; white-space: pre-wrap; overflow-wrap: anywhere; font-size: .85rem; }
pre code { background: none; padding: 0; }
details { margin: .6rem 0; }
summary { cursor: pointer; color: #2c5aa0; }
@media print { body { max-width: none; font-size: 11pt; padding: 0; } nav { display: none; }
  figure, tr { break-inside: avoid-page; } .wide { overflow: visible; } h2, h3 { break-after: avoid; }
  ::details-content { content-visibility: visible; } }
"""


def page(contents: Contents) -> str:
    """The whole page."""
    parts = [
        ("timing", "Timing first", _timing(contents)),
        ("error", "The error falls", _error(contents)),
        ("ranking", "Which effect", _ranking(contents)),
        ("parameters", "How large", _parameters(contents)),
        ("where", "Where the model fails", _where(contents)),
        ("left", "What is left", _left(contents)),
        ("fly", "What to fly next", _fly(contents)),
        ("not-tried", "What was not tried", _not_tried(contents)),
        ("repeat", "How to repeat this", _repeat(contents)),
    ]
    found = contents.found
    head = element(
        "head",
        element("meta", charset="utf-8"),
        element("meta", name="viewport", content="width=device-width, initial-scale=1"),
        element("title", f"wrenchgap: {contents.title}"),
        element("style", Html(STYLE)),
    )
    body = element(
        "body",
        element("h1", contents.title),
        paragraph(f"wrenchgap report, {contents.date}. Vehicle {contents.model.vehicle.name}.", class_="sub"),
        element("div", explanation.sentence(found), class_=f"verdict {found.verdict}"),
        paragraph(_plain_words(contents)),
        [paragraph(w, class_="warning") for w in (contents.validation.warnings if contents.validation else [])],
        element("nav", [element("a", title, href=f"#{anchor}") for anchor, title, _ in parts]),
        [section(title, content, anchor=anchor) for anchor, title, content in parts],
    )
    return f"<!doctype html>\n{element('html', head, body, lang='en')}\n"


def _plain_words(contents: Contents) -> str:
    """The staircases in a sentence or two."""
    said = []
    for case in contents.staircases:
        first, last = case.falling[0], case.falling[-1]
        share, floor = (100.0 * s.in_all / max(first.in_all, 1e-30) for s in (last, case.noise))
        if last is not first:
            said.append(
                f"On {case.title}, {share:.1f} % of the nominal error remain{_with(case)}; "
                f"the noise of the sensors alone is {floor:.1f} %."
            )
        else:
            said.append(f"On {case.title}, the noise of the sensors alone is {floor:.1f} % of the nominal error.")
    return " ".join(said)


def _with(case: Staircase) -> str:
    names = [s.name.removeprefix("+ ") for s in case.falling[1:]]
    return f" with {', '.join(names)}" if names else ""


def image(figure: Any, alt: str, caption: str, form: str = "png") -> Html:
    """A chart with its text for those who do not see it, and a caption."""
    return element("figure", element("img", src=charts.inline(figure, form), alt=alt), element("figcaption", caption))


def _timing(contents: Contents) -> Html:
    """Offsets between the topics of each flight, and what to do about them."""
    parts: list[Child] = []
    for found in contents.timing:
        listed = [[found.flight if k == 0 else "", words] for k, words in enumerate(sentences(found))]
        parts.append(details(f"{found.flight}: offsets between topics", table(["flight", "offset"], listed, texts=[1])))
        parts += [paragraph(w, class_="warning") for w in found.warnings]
    parts.append(paragraph("Nothing was shifted or removed: lags and delays are candidates like any other effect."))
    return join(parts)


def _error(contents: Contents) -> Html:
    parts: list[Child] = [
        image(
            charts.staircase_figure(contents.staircases),
            f"Staircase of the error. {_plain_words(contents)}",
            "Each step adds one effect, all effects so far fitted together. Left: all axes on one scale, newtons and "
            "newton metres weighted by the vehicle's size. Right: rms by axis, logarithmic; dashed: noise of the "
            "sensors after the filter. Held-out time was predicted by parameters fitted without it; on unseen flights "
            "the accelerometer's bias is not taken out.",
            "svg",
        )
    ]
    parts += [_stairs_table(case) for case in contents.staircases]
    parts.append(paragraph(_process_words(contents)))
    if contents.unseen is not None:
        comparison = contents.unseen
        last = len(contents.staircases[-1].falling) - 1
        index = [e.name for e in comparison.evaluations].index(contents.staircases[-1].falling[last].name)
        names = ("nominal", comparison.evaluations[index].name.removeprefix("+ ") if last else "nominal")
        if last:
            names = ("nominal", f"with all steps ({names[1]} last)")
            parts.append(
                image(
                    charts.residual_figure(comparison, 0, index, names),
                    f"Measured minus predicted wrench over time on {comparison.flights[0]}, before and after.",
                    "Measured minus predicted. The table above has the rms.",
                )
            )
    if contents.absorbs is not None:
        words = learning.absorption_words(contents.absorbs)
        parts.append(paragraph(words[:1].upper() + words[1:] or "The GP absorbs no effect of the catalogue."))
    return join(parts)


def _process_words(contents: Contents) -> str:
    """What the Gaussian process among the stairs is, or why there is none."""
    process = contents.process
    if process is None:
        return contents.no_process
    axes = ", ".join(process.gp.outputs)
    if process.given:
        return f"The GP that was given knows {axes}; it sits on the model as given."
    return (
        f"A Gaussian process of the commanded wrench takes more off {axes}: learnt for this report from what the last "
        "effect leaves, on held-out time by processes that did not see it. It has no name: it shows what is left."
    )


def _stairs_table(case: Staircase) -> Html:
    start = max(case.stairs[0].in_all, 1e-30)
    rows: list[Sequence[Child]] = []
    for stair in (*case.stairs, case.noise):
        name = f"{stair.name} ({stair.note})" if stair.note else stair.name
        share = f"{100.0 * stair.in_all / start:.1f} %"
        rows.append([element("i", name) if stair.beside else name, share, *(number(float(v)) for v in stair.rms)])
    caption = f"rms on {case.title}; in all: share of the nominal error."
    if any(s.beside for s in case.stairs):
        caption += " In italics: no step, for comparison."
    return table(["", "in all", *HEADS], rows, caption=caption)


def _ranking(contents: Contents) -> Html:
    found = contents.found
    candidates = found.ranking
    if not candidates:
        return paragraph("No effect could be tried.")
    shown = candidates[:MOST_CANDIDATES]
    parts: list[Child] = [
        image(
            charts.ranking_figure(shown, found.effects),
            f"Effects ranked by the share of the error energy that each takes off; first {shown[0].name}.",
            "Each effect fitted alone, on top of the given model; judged on time that was not fitted.",
            "svg",
        ),
        _candidates("first step: each effect alone", shown),
    ]
    for step in found.steps:
        if step.on:
            parts.append(
                details(
                    f"On top of {', '.join(step.on)}: "
                    + (f"{step.chosen} is next" if step.chosen else "no further effect stands out"),
                    _candidates(f"on top of {', '.join(step.on)}", step.candidates[:6]),
                )
            )
    if found.members:
        rows = [
            [
                m.name,
                f"{100 * found.probability(m):.0f} %",
                f"{100 * m.share:.1f} %",
                f"{m.significance:.1f}",
                ", ".join(f"{r.name} ({r.separation:.1f}, cosine {r.cosine:.2f})" for r in m.rivals[:4]) or "none near",
            ]
            for m in found.members
        ]
        heads = ["effect", "sure", "lost without it", "t", "what else was tried in its place (separation)"]
        caption = (
            "Each named effect was taken out again, and others were put in its place. A separation below 2.5 means "
            "that these flights cannot tell the two apart. Sure: how often a name with this much behind it was right "
            "on hidden effects of an independent engine."
        )
        parts.append(table(heads, rows, texts=[4], caption=caption))
    if found.groups:
        listed = "; ".join(" or ".join(group) for group in found.groups)
        parts.append(paragraph(f"These flights cannot tell apart: {listed}.", class_="warning"))
    if found.dropped:
        parts.append(paragraph(f"Chosen at first and no longer needed in the end: {', '.join(found.dropped)}."))
    return join(parts)


def _candidates(caption: str, candidates: Sequence[Candidate]) -> Html:
    rows = [
        [
            c.name,
            _value_words(c.values()) + (" (implausible: at its limit)" if c.implausible else ""),
            f"{100 * c.score:.1f} %",
            *(_change(-float(f)) for f in c.falls),
            f"{c.evidence:.2f}",
            f"{c.significance:.1f}",
        ]
        for c in candidates
    ]
    heads = ["effect", "parameters", "gone", *(h.split(" ")[0] for h in HEADS), "evidence", "t"]
    words = (
        f"{caption}. Gone: error energy of the given model. F, M: change of rms. Evidence: sum of log ratios of rms. "
        "t: paired over blocks of time; above 3 is beyond chance."
    )
    return table(heads, rows, left=2, caption=words)


def _change(value: float) -> str:
    """A fraction as a signed percentage, zero without a sign."""
    text = f"{100 * value:+.0f} %"
    return "0 %" if text in ("+0 %", "-0 %") else text


def _value_words(values: Sequence[tuple[str, float, float, str]]) -> str:
    clearest = sorted(values, key=lambda v: -abs(v[1]) / max(v[2], 1e-30))
    shown = values if len(values) <= 3 else clearest[:2]
    more = f", ... ({len(values)})" if len(values) > 3 else ""
    return ", ".join(f"{n} {number(v)} {'' if u == '1' else u}".strip() for n, v, _, u in shown) + more


def _parameters(contents: Contents) -> Html:
    fitted = contents.fitted.fit
    if not fitted.parameters:
        return paragraph("The model has no effect.")
    rows: list[Sequence[Child]] = []
    last = ""
    for (name, p), value, std in zip(fitted.parameters, fitted.theta, fitted.std, strict=True):
        low, high = value - INTERVAL * std, value + INTERVAL * std
        interval = f"{number(float(low), 3)} to {number(float(high), 3)}"
        unit = "" if p.unit == "1" else p.unit
        limits = f"{number(p.low)} to {number(p.high)}"
        bound = f"{name}.{p.name}" in fitted.at_bound
        rows.append(
            [
                name if name != last else "",
                p.name,
                unit,
                number(float(value), 4),
                interval,
                limits + (" !" if bound else ""),
            ]
        )
        last = name
    heads = ["effect", "parameter", "unit", "value", "95 % interval", "plausible"]
    caption = (
        "All effects of the model fitted together to all given logs. Intervals come from the scatter between blocks of "
        "time, so that they stay honest where neighbouring samples are alike."
    )
    parts: list[Child] = [table(heads, rows, left=3, caption=caption)]
    if fitted.at_bound:
        parts.append(paragraph(f"At the limit of what is plausible: {', '.join(fitted.at_bound)}.", class_="warning"))
    for name in dict.fromkeys(n for n, _ in fitted.parameters):
        words = (find(name).__class__.__doc__ or "").strip()
        parts.append(details(f"What {name} is", block(_unindented(words))))
    return join(parts)


def _unindented(text: str) -> str:
    import inspect

    return inspect.cleandoc(text)


def _where(contents: Contents) -> Html:
    parts: list[Child] = [paragraph(f"Looked at on {contents.where_on}.")]
    same = contents.before is contents.after
    pair = [("The model as given" if not same else "The model", contents.before)]
    if not same:
        pair.append(("With all effects", contents.after))
    for title, where in pair:
        parts += [element("h3", title), items(summary(where)), _maps(where)]
    return join(parts)


def _maps(where: Where) -> Html:
    shown = where.failure_map.dependences[: where_figures.MOST]
    alt = f"Error of {where.name} against {', '.join(d.label for d in shown)}."
    caption = (
        "Error (rms of the force and of the torque vector) against what the vehicle did; pale: noise of the sensors."
    )
    rows = [
        [d.label, dependence_words(d).partition(" (")[2].rstrip(")"), f"{100 * d.score:.1f} %", f"{d.p:.2g}"]
        for d in shown
    ]
    heads = ["quantity", "how the error goes with it", "share", "p"]
    worst = [
        [s.flight, f"{s.start:.1f} - {s.stop:.1f} s", s.axis, *(number(float(v)) for v in s.rms)] for s in where.worst
    ]
    parts: list[Child] = []
    if shown:
        parts.append(image(where_figures.maps_figure(where), alt, caption))
        parts.append(details("The same as a table", table(heads, rows, left=2)))
    if where.failure_map.grid is not None:
        grid = where.failure_map.grid
        words = (
            f"Error over {grid.x_label} and {grid.y_label}; empty where hardly flown. Each map has a scale of its own."
        )
        parts.append(image(where_figures.grid_figure(where), words, words))
    parts.append(details("The worst stretches", table(["flight", "time", "most on", *HEADS], worst, left=3)))
    return join(parts)


def _left(contents: Contents) -> Html:
    where = contents.after
    shares = where.budget.whole()
    rows = [
        [name.capitalize(), f"{100 * shares[name]:.1f} %", *(f"{100 * float(v):.1f} %" for v in values)]
        for name, values in where.budget.shares().items()
    ]
    rows = [[{"Physics": "Effects", "Process": "Gaussian process"}.get(str(r[0]), r[0]), *r[1:]] for r in rows]
    budget_words = f"Of the nominal error energy on {contents.where_on}: " + ", ".join(
        f"{str(r[0]).lower()} {r[1]}" for r in rows
    )
    white = [
        [a.axis, autocorrelation_words(a), crosscorrelation_words(where.whiteness.strongest(a.axis))]
        for a in where.whiteness.autocorrelation
    ]
    relevant = [
        [
            g.label,
            "yes" if g.chosen else "no",
            f"{100 * g.alone:.1f} %",
            f"{100 * g.lost:.1f} %",
            f"{g.significance:.1f}",
        ]
        for g in where.relevance.groups[:8]
    ]
    return join(
        [
            image(where_figures.budget_figure(where), budget_words, "Error budget of the nominal error, by axis."),
            table(["part", "in all", *(h.split(" ")[0] for h in HEADS)], rows),
            element("h3", "Is the rest white?"),
            table(["axis", "with itself", "with the inputs"], white, left=3),
            details(
                "Correlations",
                image(
                    where_figures.correlation_figure(where),
                    "Correlation of the residual with itself and with its surest input.",
                    "Grey: what filtered sensor noise would show, and its band.",
                ),
            ),
            element("h3", "On what the rest depends"),
            table(
                ["input", "chosen", "explains alone", "lost without it", "t"],
                relevant,
                left=2,
                caption="Shares of the residual's variance on time that was not fitted.",
            ),
        ]
    )


def _fly(contents: Contents) -> Html:
    parts: list[Child] = []
    heads = ["effect", "what shows it"]
    for place, apart in enumerate(contents.together, 1):
        parts.append(element("h3", f"To tell apart: {' or '.join(apart.names)}"))
        parts.append(table(heads, [[name, find(name).excited_by] for name in apart.names], left=2))
        parts.append(_next_flight(apart, place))
    if not contents.together:
        parts.append(paragraph("Of the effects that were named, none has to be told from another."))
    if contents.unshown:
        parts.append(paragraph("These flights could not show the following; they may be there all the same:"))
        parts.append(table(heads, [[name, find(name).excited_by] for name in contents.unshown], left=2))
    if contents.found.verdict == "unknown" and (chosen := contents.after.relevance.chosen):
        listed = ", ".join(g.label for g in chosen)
        parts.append(paragraph(f"What is left follows {listed}: a flight that changes these one at a time shows more."))
    return join(parts)


def _next_flight(apart: Apart, place: int) -> Html:
    """The designed flight, its expected gain, and a link to save it."""
    found = apart.design
    if found is None:
        return paragraph(f"No flight was designed: {apart.why_not}")
    before, expected = found.before.separation, found.expected.separation
    moves = ", then ".join(str(s) for s in found.segments)
    said = f"Fly {found.file.trajectory.duration:.0f} s: {moves}. "
    said += f"Expected separation {expected:.1f}, on the given logs {before:.1f}; above 2.5 they are told apart. "
    said += "" if found.separable else "No flight that was tried tells them apart for sure. "
    name = f"next-flight-{place}.toml"
    text = trajectory_file.dumps(found.file)
    rows = [
        [f.truth, imitator, f"{value:.1f}", f"{np.degrees(f.tilt_max):.0f}", f"{f.speed_max:.1f}"]
        for f in found.flown
        for imitator, value in f.separation.items()
    ]
    heads = ["if there is", "and the model has", "separation", "largest tilt [deg]", "speed [m/s]"]
    return join(
        [
            paragraph(said, _saved(text, name, "application/toml")),
            table(heads, rows, left=2, caption="The same flown on the simulated vehicle.") if rows else None,
            items([f"Or {words}." for words in found.advice]) if found.advice else None,
            paragraph("To try it: ", code(f"wrenchgap simulate -m MODEL -t {name} -o next.mcap"), "."),
            details(name, block(text)),
        ]
    )


def _saved(text: str, name: str, kind: str) -> Html:
    """A link that saves a text as a file."""
    data = base64.b64encode(text.encode()).decode("ascii")
    return element("a", f"Save it as {name}", href=f"data:{kind};base64,{data}", download=name)


def _not_tried(contents: Contents) -> Html:
    reasons = explanation.not_tried(contents.found)
    if not reasons:
        return paragraph("Every effect of the catalogue was tried.")
    return items([f"{', '.join(names)}: {_reason(reason, names)}" for reason, names in reasons.items()])


def _reason(reason: str, names: Sequence[str]) -> str:
    """The reason without a name that stands before it already."""
    return reason.removeprefix(f"{names[0]}: ")


def _history(contents: Contents) -> Html | None:
    """The versions that led to the given model."""
    if not contents.model.history:
        return None
    rows = [
        [str(v.number), v.date or "-", versions.words(v, changed), ", ".join(file for file, _ in v.flights) or "-"]
        for v, changed in versions.steps(contents.model)
    ]
    heads = ["version", "date", "what changed", "fitted to"]
    return table(heads, rows, left=4, caption=f"Versions of {contents.model.name}.")


def _repeat(contents: Contents) -> Html:
    name = "fitted.toml"
    return join(
        [
            block("\n".join(contents.commands)),
            table(
                ["input", "file", "SHA-256"],
                [[i.role, i.file, code(i.sha256)] for i in contents.inputs],
                left=3,
            ),
            table(["option", "value"], list(contents.options), left=2),
            table(["package", "version"], list(contents.versions), left=2),
            _history(contents),
            paragraph("The fitted model, with its history. ", _saved(contents.fitted_text, name, "application/toml")),
            details(name, block(contents.fitted_text)),
            [element("h3", "Notes"), items(contents.notes)] if contents.notes else None,
        ]
    )


__all__ = ["AXES", "page"]
