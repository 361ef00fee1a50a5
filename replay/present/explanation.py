"""What `explain` found: the verdict in sentences, tables, JSON."""

import shlex
from collections.abc import Sequence
from typing import Any

from wrenchgap.flight.flight import AXES
from wrenchgap.learn import Explanation, Verdict
from wrenchgap.learn.data.comparison import Validation
from wrenchgap.learn.data.errors import force_and_torque
from wrenchgap.learn.posterior.members import Member
from wrenchgap.learn.posterior.single_effects import Candidate
from wrenchgap.replay.present import comparison, detection, fitted_effects, posterior, tables, timing, what_to_inspect
from wrenchgap.replay.present.addition import ALIKE, apart, cosine
from wrenchgap.replay.present.answer import (
    MOST_PLACES,
    answer_lines,
    evidence,
    granted_thrust,
    short,
    summary,
    thrust_beyond,
)
from wrenchgap.replay.present.design import design_command
from wrenchgap.replay.present.figures import style
from wrenchgap.replay.present.notes import doubted_mass, not_tried_json, not_tried_lines, of_flights
from wrenchgap.replay.present.numbers import (
    AXIS_HEADS,
    by_axis,
    certainty,
    entries,
    listed,
    number,
    parameter_rows,
    parameters_in_words,
    share,
    unmeasured,
)
from wrenchgap.replay.present.tables import Line, Part, Table, note_lines, styled, table


def parts(found: Explanation) -> list[Part]:
    """The answer, timing, members, classes, candidates, errors before and after."""
    out = brief(found)
    if found.members:
        out += [Line(MEMBERS_LEGEND, "dim"), Line()]
    out += [Line(text) for text in (*evidence(found), *what_to_inspect.of_explanation(found)[MOST_PLACES:])]
    for one in found.timing:
        out += [Line(text, "dim") for text in timing.certain_offsets(one)]
        out += note_lines(timing.warnings(one), "warning")
    out += [*map(Line, open_in_words(found)), Line(), *detection.lines(found), Line()]
    out += [ranking(found), Line(RANKING_LEGEND, "dim"), Line()]
    if found.fit.snapshot:
        fitted = tables.parameters(found.fit.snapshot, "fitted together", found.model.vehicle)
        out += [fitted, Line(tables.INTERVAL_LEGEND, "dim"), Line()]
    title = "held-out time of the given logs"
    title += "".join(f", filtered at {f.records[0].cutoff_hz:g} Hz" for f in found.flights[:1])
    out.append(tables.before_after(title, found.rms_before, found.rms_after, found.reduction, found.noise))
    if tested := found.validation:
        title = f"unseen: {', '.join(tested.comparison.flights)}"
        out.append(tables.before_after(title, tested.before, tested.after, tested.reduction))
        out += note_lines(comparison.validation_warnings(tested)[1:], "warning")
    return [*out, *not_tried_lines(found.untried), *note_lines(of_flights(found.flights))]


def what_next(
    found: Explanation, model: str, paths: Sequence[str], options: str = "", to_design: str = ""
) -> list[Line]:
    """The commands that follow from the verdict, for the model and the logs as the user named them.

    `options` are those with which the logs were read, `to_design` those of them that `wrenchgap design` knows; with a
    space before them.
    """
    unknown = found.verdict is Verdict.UNKNOWN
    if short(found) and not found.effects:
        return [Line("next: give a longer flight")]
    if posterior.is_nothing_missing(found):
        return []
    designs = [
        f"a flight that separates {listed(g, len(g))}, if there is one: {design_command(g, model, paths, to_design)}"
        for g in found.separable
    ]
    model, logs = shlex.quote(model), shlex.join(paths) + options
    firm = [name for name in found.effects if name in found.firm]
    sure, out = bool(firm) and not unknown, []
    if not sure or any(name in WITH_A_HEALTHY_FLIGHT for name in found.effects):
        first = "" if sure else "next, "
        changed = f"wrenchgap changed {logs} --healthy HEALTHY_LOG -m {model}"
        out.append(f"{first}with an earlier flight, or one of a healthy vehicle of the same kind: {changed}")
    out += designs
    if unknown:
        out.append(f"no name of the catalogue is all of it; its law: wrenchgap discover {logs} -m {model} -o law.py")
    if found.effects:
        first = "next" if sure else f"what is {'named' if firm else 'not established'} can be added all the same"
        thrust, also = [], ""
        fit, last = found.fit, found.fit.jacobian.shape[2] - 1
        same = any(abs(cosine(fit, k, last)) > ALIKE for k in range(len(fit.theta)))
        if fit.thrust.size and (not same or thrust_beyond(found)):
            thrust, known = ["thrust_scale"], share(found.model.vehicle.tolerances.thrust or 0.0)
            also = f" (with the scale of all thrust, which the model knows to {known})"
        names = " ".join([*(firm or found.effects), *thrust])
        out.append(f"{first}{also}: wrenchgap add {names} -m {model} --from {logs} -o fitted.toml")
    return [Line(text) for text in out]


WITH_A_HEALTHY_FLIGHT = ("rotor_thrust", "com_offset", "constant_wrench")
"""What a healthy flight tells from a trim that every vehicle has."""
MEMBERS_LEGEND = (
    "confidence: weight of the sets of effects that name it, in any of its forms, or one of its group, less "
    "what its own evidence leaves to chance   share: of the error energy that "
    "returns without it   nearest other: of what these flights tell from it, and by how many standard errors (sigma) "
    "it fits worse"
)
RANKING_LEGEND = (
    "* named   = indistinguishable from one that is   score: share of the error energy that is gone   F, M: change of "
    "rms on held-out time   t: paired over blocks of time, significant above 3"
)


def open_in_words(found: Explanation) -> tuple[str, ...]:
    """Classes of sets with their weights, and what would settle which of them is true, a sentence each."""
    return (
        *posterior.classes_in_words(found.classes),
        *(line.text for line in posterior.settle_lines(found.posterior.settle)),
    )


def how_sure(found: Explanation, member: Member) -> str:
    """The confidence in a name; where another is like it, of itself and of the two together."""
    sure = "not established" if posterior.is_doubted(found, member) else certainty(found.confidence(member))
    own = sum(one.weight for one in found.posterior.sets if member.name in one.names)
    return f"{share(own)}, {sure} with what is like it" if member.alike and own < found.confidence(member) else sure


def members(found: Explanation) -> Table:
    """The effects that were named: confidence, size, and what comes nearest in their place."""
    rows = []
    for m in found.members:
        others = [r for r in m.rivals if not r.alike]
        far = f"{others[0].name} ({others[0].separation:.1f} sigma worse)" if others else "-"
        rows.append((m.name, how_sure(found, m), share(m.share), f"{m.significance:.1f}", far))
    return table("named", ("effect", "confidence", "share", "t", "nearest other"), rows, texts=(-1,))


def ranking(found: Explanation, most: int = 10) -> Table:
    """Candidates, each by itself, best first: `most` of them, and all that are marked as named or indistinguishable."""
    heads = ("", "effect", "score", *AXIS_HEADS, "t", "parameters")
    out = table("each effect by itself", heads, left=2, texts=(-1,))
    alike = {name for m in found.members for r in m.alike for name in r.names}
    for k, candidate in enumerate(found.ranking):
        mark = "*" if candidate.name in found.effects else "=" if candidate.name in alike else ""
        if k >= most and not mark:
            continue
        limit = styled(" (implausible: at its limit)" if candidate.implausible else "", "red")
        sizes = (f"{candidate.score:.3f}", *tables.reductions(candidate.reduction), f"{candidate.significance:.1f}")
        words = styled(parameters_in_words(candidate.values, found.model.vehicle)) + limit
        out.add_row(mark, " + ".join(candidate.names), *sizes, words, style="bold" if mark == "*" else "")
    return out


def to_json(found: Explanation) -> dict[str, Any]:
    """The body of the `explain` schema."""
    fitted = {s.effect: s.values for s in found.fit.snapshot}
    names = ("effect=name", "heldout_fall=reduction", "score", "parameters=values", "evidence", "significance")
    ranked = [entries(c, *names, "companions", "implausible") for c in found.ranking]
    first = next((c.name for c in found.ranking if c.name in found.effects), None)
    return {
        "verdict": str(found.verdict),
        "effects": list(found.effects),
        "groups": [list(group) for group in found.groups],
        "members": [
            {
                "effect": m.name,
                "probability": found.confidence(m),
                **entries(m, "share", "significance", "evidence"),
                "group": [m.name, *(r.name for r in m.alike)],
                "rivals": [
                    entries(r, "effect=name", "members", "separation", "cosine", "alike", "weight") for r in m.rivals
                ],
            }
            for m in found.members
        ],
        "left": posterior.residual_json(found),
        "ranking": ranked,
        "axes": list(AXES),
        "summary": summary(found),
        "already": fitted_effects.already_in(found.model, found.effects),
        "fitted": [{"effect": name, "parameters": fitted.get(name, ())} for name in found.effects],
        "steps": [{"on": [], "chosen": first, "alike": [], "candidates": ranked}],
        "classes": [posterior.class_json(c, found.model.vehicle) for c in found.classes],
        "settle": posterior.settle_json(found.posterior.settle),
        "firm": list(found.firm),
        "open": [axis for axis, left in zip(AXES, found.open, strict=True) if left],
        "air": None if found.air is None else entries(found.air, "wind_E", "std"),
        "dropped": [],
        "not_tried": not_tried_json(found.untried),
        "sensitivity": detection.to_json(found),
        **entries(found, "rms_before", "rms_after", "noise"),
        "unmeasured": unmeasured(found.noise),
        "validation": None if found.validation is None else _validation_json(found.validation),
        "flights": [f.records[0].flight for f in found.flights],
        "timing": [timing.to_json(one) for one in found.timing],
        "cutoff_hz": found.flights[0].records[0].cutoff_hz if found.flights else None,
        "notes": [*apart(found.apart), *granted_thrust(found), *of_flights(found.flights)],
    }


def _validation_json(tested: Validation) -> dict[str, Any]:
    body = comparison.to_json(tested.comparison)
    ranges = [
        {"flight": flight, "ranges": [{**vars(r), "outside": r.outside} for r in found]}
        for flight, found in tested.ranges
    ]
    return {**body, "fall": tested.reduction, "ranges": ranges, "warnings": comparison.validation_warnings(tested)}


def brief(found: Explanation) -> list[Part]:
    """The verdict, what to inspect, what would settle it, unseen flights, warnings, what the flights could not show,
    and the members.
    """  # noqa: D205
    said: list[Part] = [*(doubted := doubted_mass(found)), *(Line(text, "bold") for text in apart(found.apart))]
    said += answer_lines(found)
    said += map(Line, filter(None, (fitted_effects.already_in(found.model, found.effects),)))
    said += [] if doubted else map(Line, posterior.first_check(posterior.checks_of(found)))
    if tested := found.validation:
        before, after = force_and_torque(tested.before), force_and_torque(tested.after)
        sizes = [f"{number(a)} to {number(b)} {u}" for a, b, u in zip(before, after, ("N", "Nm"), strict=True)]
        said.append(Line(f"On flights it never saw ({', '.join(tested.comparison.flights)}): {', '.join(sizes)} rms."))
        said += note_lines(comparison.validation_warnings(tested)[:1], "warning")
    said += note_lines([*short(found), *timing.in_short(found.timing, of_topics=True)][:1], "warning")
    room = max(MOST_PLACES, tables.ANSWER_LINES - len(said))
    said += map(Line, detection.in_short(found)[:room])
    return [*said, Line(), *([members(found)] if found.members else [])]


def of_axes(found: Explanation) -> dict[str, Any]:
    """On held-out time; `open` are axes on which structure is left."""
    return entries(found, "rms_before", "rms_after", "reduction", "noise", "open")


def of_parameters(found: Explanation) -> list[dict[str, Any]]:
    """Of the members and of what the model has, fitted together."""
    return parameter_rows(found.fit.snapshot)


def frame(found: Explanation) -> list[dict[str, Any]]:
    """One row for each candidate of the first step: effect, score, t, evidence, reduction by axis, parameters."""
    return [
        {
            "effect": c.name,
            "named": c.name in found.effects,
            **entries(c, "score", "t=significance", "evidence"),
            **by_axis("reduction", c.reduction),
            "parameters": parameters_in_words(c.values),
        }
        for c in found.ranking
    ]


COLOURS = {
    "named": "tab:blue",
    "indistinguishable from a named one": "#8fb3dc",
    "not named": "0.8",
    "implausible: at its limit": "#e3b5b5",
}


def picture(found: Explanation) -> style.Picture:
    """Bars, the longest on top.

    One panel. Held-out time, on top of the model as given; the named effects are dark, with their confidence.
    """
    flights = ", ".join(f.records[0].flight for f in found.flights)
    title = f"{found.model.name}: what each effect alone explains" + (f" of {flights}" if flights else "")
    size = (9.0, 1.5 + 0.27 * max(1, len(_shown(found))))
    return style.Picture((), size, lambda panel: _draw(found, panel), title=title)


def _shown(found: Explanation, most: int = 20) -> list[Candidate]:
    """Candidates that are drawn: `most` of them, and all that are named."""
    return [c for k, c in enumerate(found.ranking) if k < most or c.name in found.effects]


def _draw(found: Explanation, panel: Any) -> None:
    shown = _shown(found)[::-1]
    if not shown:
        style.nothing(panel, "no effect of the catalogue could be tried")
        return
    kinds = [_kind(found, c) for c in shown]
    for word, colour in COLOURS.items():
        rows = [k for k, kind in enumerate(kinds) if kind == word]
        if rows:
            panel.barh(rows, [100.0 * max(shown[k].score, 0.0) for k in rows], 0.75, color=colour, label=word)
    for row, c in enumerate(shown):
        sure = [posterior.confidence(found, m) for m in found.members if m.name == c.name]
        words = ", ".join([share(c.score), *sure])
        place = (100.0 * max(c.score, 0.0), row)
        panel.annotate(words, place, (4, 0), textcoords="offset points", va="center", fontsize=8)
    panel.set_yticks(range(len(shown)), [c.name for c in shown], fontsize=style.SMALL)
    panel.set_ylim(-0.6, len(shown) - 0.4)
    panel.set_xlim(0.0, 125.0)
    style.labelled(panel, "error energy explained on held-out time", "%", "x")
    panel.set_xticks(range(0, 101, 20))
    style.grid(panel, without="y")
    style.legend(panel)


def _kind(found: Explanation, candidate: Candidate) -> str:
    if candidate.name in found.effects:
        return "named"
    if any(candidate.name in group for group in found.groups):
        return "indistinguishable from a named one"
    return "implausible: at its limit" if candidate.implausible else "not named"
