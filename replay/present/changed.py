"""How an answer to "what changed" reads: verdict, sizes, classes, flights, and what to inspect."""

import shlex
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from wrenchgap.flight.autopilot import other_vehicle
from wrenchgap.flight.flight import AXES
from wrenchgap.learn.changed.changed import AT_ONCE, Changed, Verdict
from wrenchgap.learn.changed.priors import NAMELESS
from wrenchgap.learn.changed.sizes import Size
from wrenchgap.learn.identify.bias_and_trim import WORTH
from wrenchgap.learn.posterior.settings import CHANGES
from wrenchgap.plant.effects import family
from wrenchgap.replay.present import detection, numbers, parameters, posterior, timing, what_to_inspect
from wrenchgap.replay.present.figures import report as panels
from wrenchgap.replay.present.figures import style, vehicle
from wrenchgap.replay.present.notes import doubted_mass, not_tried_json, not_tried_lines, of_flights, sentences
from wrenchgap.replay.present.numbers import entries, number, quantity, row, share, signed, size_in_words, unit
from wrenchgap.replay.present.tables import ANSWER_LINES, Line, Part, Table, note_lines, table

MOST_PLACES = 3
"""Sentences on what to inspect that belong to the answer."""
SIZES_LEGEND = (
    "scatter: what healthy flights differ by in this parameter; fit +-: of the change, from within the flights; "
    "significance: change over both together, which is the +- of the first sentence"
)
ALONE_LEGEND = (
    "log odds: of this change alone against none, its prior included; above about 2 it is worth a name, in brackets "
    "where it is smaller than a fifth of what is typical of such changes, and no news"
)


def parts(found: Changed) -> list[Part]:
    """The answer, sizes, classes, each change by itself, flights, what cannot be compared."""
    out = brief(found)
    if found.parameters and found.verdict is not Verdict.NOTHING:
        out += [Line(SIZES_LEGEND, "dim"), Line()]
    out += [Line(text) for text in what_to_inspect.sentences(found)[MOST_PLACES:]]
    out += note_lines([*outliers(found)[1:], *other_recordings(found)[1:]], "warning")
    out += note_lines([baseline(found), *feedback(found)])
    out += [Line(said.replace(": nothing", ": nothing changed")) for said in posterior.classes_in_words(found.classes)]
    out += [*posterior.settle_lines(found.settle), Line(), *detection.lines(found), Line()]
    out += [alone(found), Line(ALONE_LEGEND, "dim"), Line(), flights(found), *by_flight(found)]
    out += [*note_lines(not_compared(found)), *not_tried_lines(found.untried), *note_lines(notes(found))]
    return [*out, *parameters.parts(parameters.of_flights(found.flights))]


def outliers(found: Changed, given: str = "given") -> list[str]:
    """Flights that were `given` as healthy and are not."""
    sure = [(o, share(min(CHANGES.certain, 1.0 / (1.0 + np.exp(-o.odds))))) for o in found.odd]
    return [f"{o.flight} was {given} as healthy and is not: {o.effect} (confidence {p})." for o, p in sure]


def not_compared(found: Changed) -> list[str]:
    """Quantities that some of the flights lack."""
    return [f"not compared, {n.quantity}: {n.reason}." for n in found.not_compared]


def baseline(found: Changed) -> str:
    """What the healthy flights say, in one sentence."""
    healthy = len(found.healthy)
    if not found.scatter_known:
        return (
            "one healthy flight does not show what healthy flights differ by: typical values instead (1 % thrust of "
            "each rotor, 2 % of the arm for the centre of mass, 1.5 % of all thrust), as one constant wrench; of "
            "excited flights, changes of these sizes may be named that are usual. Give more healthy flights."
        )
    heads = zip(numbers.UNIT_HEADS, found.scatter, strict=True)
    known = ", ".join(f"{head.split()[0]} {number(s, 2)}" for head, s in heads if s == s)
    return f"{healthy} healthy flights and {WORTH:g} typical ones differ by (standard deviation, N and Nm): {known}."


def other_recordings(found: Changed) -> list[str]:
    """Suspect flights that may be of another vehicle: of another autopilot, roles or topics than all healthy ones."""
    healthy = [one.flight for one in found.flights if one.records[0].flight in found.healthy]
    known, out = [(set(flight.series()), flight.mapping) for flight in healthy], []
    for one in found.flights:
        own, name = (set(one.flight.series()), one.flight.mapping), one.records[0].flight
        board = other_vehicle(one.flight.autopilot, (flight.autopilot for flight in healthy))
        if name not in found.suspect or (own in known and not board):
            continue
        lacks = ", ".join(sorted(set.intersection(*(roles for roles, _ in known)) - own[0])) if known else ""
        how = board or (f"no {lacks}" if lacks else "other topics")
        out.append(
            f"{name} was recorded otherwise than the healthy flights ({how}): if it is of another vehicle, that is "
            "what differs."
        )
    return out


def feedback(found: Changed) -> list[str]:
    """Where only means of flights were compared, and why."""
    if not found.by_means:
        return []
    return [
        "the flights are feedback-dominated: commands answer the motion and thrust hardly varies, so that the flights' "
        "means are compared and nothing else; flights with excitation on all axes say more."
    ]


def notes(found: Changed) -> list[str]:
    """Those of the flights, alike ones once."""
    by_text = numbers.by_reason(
        (text.removeprefix(f"{one.flight.name}: "), one.flight.name)
        for one in found.flights
        for text in sentences(one.notes)
    )
    return [
        f"{names[0]}{f' and {len(names) - 1} more' if len(names) > 1 else ''}: {text}"
        for text, names in by_text.items()
    ]


def summary(found: Changed) -> str:
    """The verdict in plain words, with its condition where a suspect flight may be of another vehicle."""
    said = _verdict(found)
    return f"If it is one vehicle: {said[0].lower()}{said[1:]}" if other_recordings(found) else said


def what_next(found: Changed, healthy: Sequence[str], model: str, options: str = "") -> list[Line]:
    """What to do after the answer, with the logs and the model as the user named them."""
    against = f"--healthy {shlex.join(healthy)} -m {shlex.quote(model)}{options}"
    if found.verdict is not Verdict.NOTHING and (exchanged := what_to_inspect.exchanged(found)):
        other = f"wrenchgap changed {exchanged} -m {shlex.quote(model)}{options}"
        return [Line(f"next, if the sides were exchanged: {other}")]
    if found.verdict is not Verdict.NOTHING:
        open_still = what_to_inspect.unlike_rates(found) if found.louder else not found.is_clear
        first = "fly again" if open_still else "mend it, fly again, and see whether it is gone"
        return [Line(f"next: {first}: wrenchgap changed NEW_LOG {against}")]
    kind = "flights of both kinds" if found.scatter_known else "healthy flights"
    said = f"more {kind}, or excitation on all axes, show smaller changes"
    return [Line(f"next: {said}: wrenchgap changed LOG... {against}")]


def _verdict(found: Changed) -> str:
    if found.verdict is Verdict.NOTHING:
        best, nearest = (found.alone[0] if found.alone else None), ""
        if best is not None and best.largest.significance > 1.0:  # what is less is chance
            words = in_words(found, best.largest)
            nearest = f" Nearest, and not established: {words}, {best.largest.significance:.1f} standard deviations."
        likely = what_to_inspect.likeliest(found)
        if likely is not None:
            return (
                f"Not established, but likely: {' + '.join(likely.names)} changed ({share(likely.weight)}; "
                f"nothing changed: {share(found.nothing)}). More suspect flights, or one with excitation, would tell."
                f"{nearest}"
            )
        few = what_to_inspect.beyond_these(found)
        return f"Nothing changed that is beyond what healthy flights {'usually ' * bool(few)}differ by.{nearest}{few}"
    if found.verdict is Verdict.UNKNOWN:
        return _unknown(found)
    if len(found.names) > AT_ONCE:
        return (
            f"Something changed, and no likely cause fits: it would take {' + '.join(found.names)} at once. No single "
            "effect is firm."
        )
    group = found.classes[0].sets if found.classes[0].sets[0].names else ()
    others = [" + ".join(s.names) for s in group[1:] if s.weight >= numbers.LIGHT]
    unclear = what_to_inspect.unclear(found)
    said, sure = [], found.established
    for name in found.names:
        first = max((p for p in found.parameters if p.effect == name), key=lambda p: p.significance, default=None)
        words = name if first is None else in_words(found, first)
        said.append(f"{words}, confidence {share(found.confidence(name))}" if sure else words)
    alike = f" Indistinguishable on these flights: {' or '.join(others)}." if others else ""
    firm = "" if found.firm else unclear or " No single effect is firm."
    apart = " and ".join(found.differing())
    mean = f" Suspect flights differ in {apart}, of which this is the mean: give each alone." if apart else ""
    return f"{'Changed' if sure else 'Perhaps changed'}: {' and '.join(said)}.{alike}{firm}{mean}"


def _unknown(found: Changed) -> str:
    if not found.louder:
        clear = what_to_inspect.constant_changes(found)
        if not clear:
            return "Something changed, and no effect of the catalogue says what."
        listed = ", ".join(
            f"{p.name} by {size_in_words(p.change, p.unit)} ({p.significance:.1f} standard deviations)" for p in clear
        )
        return f"Changed: {listed}. It is constant, and no single effect of the catalogue explains it."
    if rates := what_to_inspect.unlike_rates(found):
        return f"Not compared on {', '.join(found.louder)}, where the suspect flights leave far more: {rates}"
    nearest = [n for n in found.names if n not in NAMELESS]
    likeliest = f" Nearest, and not established: {' + '.join(nearest)}." if nearest else ""
    return (
        f"Something changed on {', '.join(found.louder)}, and no effect of the catalogue says what: beside the nearest "
        f"of them the suspect flights leave far more than any healthy flight does.{likeliest}"
    )


def in_words(found: Changed, size: Size) -> str:
    """A change with its place and what it is uncertain by: "rotor_thrust of M3 by -19 +- 3.6 %"."""
    place = next((p for p in found.places if p.effect == size.effect and p.parameter == size.name), None)
    own = size.where if size.where and size.name.split("_")[0] in ("rotor", "arm") else ""
    doubtful = place is not None and place.probability < what_to_inspect.INSPECTION.sure
    sure = f" ({share(place.probability)})" if place is not None and doubtful else ""
    of = f" of {own}{sure}" if own else f" ({size.name})"
    std = size.change_std
    if size.unit == "1":
        return f"{size.effect}{of} by {100 * size.change:+.1f} +- {number(100 * std, 2)} %"
    return f"{size.effect}{of} by {signed(size.change, number(size.change))} +- {quantity(std, size.unit, 2)}"


def sizes(found: Changed) -> list[Table]:
    """Parameters of the likeliest set; no table where nothing changed."""
    rows = [
        (
            *(p.effect, p.name, p.where),
            *(number(v) for v in (p.healthy, p.scatter, p.suspect, p.change)),
            *(number(p.std, 2), unit(p.unit), f"{p.significance:.1f}"),
        )
        for p in found.parameters
        if found.verdict is not Verdict.NOTHING
    ]
    of = ("effect", "parameter", "where")
    heads = (*of, "healthy", "scatter", "suspect", "change", "fit +-", "unit", "significance")
    return [table("changes", heads, rows, left=3, texts=(8,))] if rows else []


def alone(found: Changed, most: int = 8) -> Table:
    """Of `most` changes, each by itself, the largest size, likeliest first; odds of small ones in brackets."""
    rows = []
    for a in found.alone[:most]:
        s, odds = a.largest, f"{a.odds:.1f}" if a.large else f"({a.odds:.1f})"
        rows.append((a.effect, s.name, s.where, number(s.change), unit(s.unit), f"{s.significance:.1f}", odds))
    heads = ("effect", "parameter", "where", "change", "unit", "significance", "log odds")
    return table("each change by itself", heads, rows, left=3, texts=(4,))


def flights(found: Changed) -> Table:
    """Signed means of the residual by flight, and what healthy flights differ by."""
    out = table("mean residual of the given model by flight, signed", ("flight", "", *numbers.UNIT_HEADS), left=2)
    for k, r in enumerate(found.rows):
        last = k == len(found.rows) - 1 or found.rows[k + 1].role != r.role
        out.add_row(r.flight, r.role, *row(r.mean), style="bold" if r.role == "suspect" else "", end_section=last)
    out.add_row("scatter", "", *row(found.scatter))
    return out


def by_flight(found: Changed, wide: int = 5) -> list[Table]:
    """Values of what changed, on each flight alone; no table where no flight has any.

    Parameters are columns, unless there are more of them than a screen is `wide` and than there are flights.
    """
    flown, title = [r for r in found.rows if r.values], "what changed, on each flight by itself"
    if not flown:
        return []
    places = Counter((p.effect, p.where) for p in found.parameters)
    names = [p.where if p.where and places[p.effect, p.where] == 1 else p.name for p in found.parameters]
    units = [unit(p.unit) or "1" for p in found.parameters]
    cells = [[number(r.values[p.effect, p.name]) for p in found.parameters] for r in flown]
    if len(names) <= max(wide, len(flown)):
        heads = [f"{p.effect} {n} [{u}]" for p, n, u in zip(found.parameters, names, units, strict=True)]
        rows = [[r.flight, r.role, *c] for r, c in zip(flown, cells, strict=True)]
        return [table(title, ["flight", "", *heads], rows, left=2)]
    rows = [[p.effect, *cells] for p, *cells in zip(found.parameters, names, units, *cells, strict=True)]
    return [table(title, ["effect", "parameter", "unit", *(f"{r.flight} ({r.role})" for r in flown)], rows, left=3)]


def to_json(found: Changed) -> dict[str, Any]:
    """The body of the `changed` schema."""
    return {
        **entries(found, "verdict", "firm"),
        "classes": [posterior.class_json(c, found.model.vehicle) for c in found.classes],
        "parameters": [_parameter(p) for p in found.parameters],
        "odd": [o.flight for o in found.odd],
        "not_compared": [asdict(one) | {"reason": one.reason} for one in found.not_compared],
        "summary": summary(found),
        "inspect": what_to_inspect.sentences(found),
        "effects": [{"effect": n, "confidence": found.confidence(n), "family": family(n)} for n in found.names],
        **entries(found, "places", "nothing"),
        "alone": [
            {"effect": a.effect, "log_odds": a.odds, "large": a.large, "parameters": [_parameter(p) for p in a.sizes]}
            for a in found.alone
        ],
        "odd_because": found.odd,
        "settle": posterior.settle_json(found.settle),
        **entries(found, "healthy", "suspect", "scatter"),
        "scatter_from": "flights" if found.scatter_known else "typical values",
        "by_flight": [
            {
                **entries(r, "flight", "role", "mean", "rms"),
                "values": [{"effect": e, "name": n, "value": v} for (e, n), v in r.values.items()],
            }
            for r in found.rows
        ],
        "axes": list(AXES),
        "answering": [AXES[a] for a in found.answering],
        **entries(found, "by_means", "louder"),
        "not_tried": not_tried_json(found.untried),
        "sensitivity": detection.to_json(found),
        "unmeasured": numbers.unmeasured(found.scatter),
        "timing": [timing.to_json(one) for one in found.timing],
        "autopilot_parameters": parameters.to_json(parameters.of_flights(found.flights)),
        "cutoff_hz": found.flights[0].records[0].cutoff_hz if found.flights else None,
        "notes": of_flights(found.flights),
    }


def _parameter(p: Size) -> dict[str, Any]:
    return entries(p, "effect", "name", "healthy", "scatter", "suspect", "std", "unit", "significance", "where")


def brief(found: Changed) -> list[Part]:
    """The verdict, what to inspect, what would settle it, what the flights could have shown, and sizes."""
    said = [*(doubted := doubted_mass(found)), *note_lines(other_recordings(found)[:1], "warning")]
    said += [Line(text, "bold") for text in (summary(found), *what_to_inspect.sentences(found)[:MOST_PLACES])]
    said += [] if doubted else map(Line, posterior.first_check(found.settle))
    told = found.scatter_known or found.verdict is Verdict.NOTHING or not found.is_clear  # said elsewhere
    said += note_lines([*([] if told else [f"{baseline(found).partition(':')[0]}."]), *outliers(found)[:1]], "warning")
    room = ANSWER_LINES - len(said)
    return [*said, *map(Line, detection.in_short(found)[:room]), Line(), *sizes(found)]


def of_axes(found: Changed) -> dict[str, Any]:
    """Mean residual of the given model by flight, signed, and what healthy flights differ by."""
    return {**{r.flight: r.mean for r in found.rows}, "scatter": found.scatter}


def of_parameters(found: Changed) -> list[dict[str, Any]]:
    """Of the likeliest set of changes."""
    names = ("effect", "parameter=name", "where", "healthy", "scatter", "suspect", "change", "std", "unit")
    return [entries(p, *names, "significance") for p in found.parameters]


def frame(found: Changed) -> list[dict[str, Any]]:
    """One row for each parameter of each change by itself, the likeliest change first."""
    return [
        {**_parameter(p), "change": p.change, "log_odds": a.odds, "named": a.effect in found.names}
        for a in found.alone
        for p in a.sizes
    ]


def picture(found: Changed) -> style.Picture:
    """Left each flight's means against the healthy ones' scatter, in the middle each change, right what to inspect."""
    title = f"{found.model.name}: {', '.join(map(style.shortened, found.suspect))} against {len(found.healthy)} healthy"
    return style.Picture((1, 3), (15.0, 4.4), lambda axes: _draw(found, np.ravel(axes)), title=title)


def _draw(found: Changed, axes: Any) -> None:
    panels.means(found, axes[0])
    panels.changes(found, axes[1])
    marks, moved_B = panels.vehicle_marks(found)
    vehicle.draw(axes[2], found.model.vehicle, marks, moved_B=moved_B)
