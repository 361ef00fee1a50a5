"""Parameters over flights: what stepped or drifted in sentences, tables, JSON, a table of every value."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from wrenchgap.flight.flight import AXES
from wrenchgap.learn.changed.places import towards
from wrenchgap.learn.identify.moved_centre import MovedCentre
from wrenchgap.learn.identify.steps_and_drift import COURSE, Drift, Step, Verdict
from wrenchgap.learn.identify.trend import ParameterTrend, Trend
from wrenchgap.plant.vehicle import PART, Vehicle
from wrenchgap.replay.present import numbers, parameters, season
from wrenchgap.replay.present.notes import sentences
from wrenchgap.replay.present.numbers import (
    entries,
    label,
    listed,
    number,
    share,
    signed,
    size_in_words,
    unit,
    user_name,
)
from wrenchgap.replay.present.tables import ANSWER_LINES, Line, Part, Table, first_only, note_lines, table

WORDS = {
    Verdict.STEADY: "steady",
    Verdict.STEPS: "steps",
    Verdict.DRIFT: "drifts",
    Verdict.SCATTERED: "differs between flights",
    Verdict.FEW: "too few flights",
    Verdict.OPEN: "not shown by these flights",
}
LEGEND = (
    "scatter: standard deviation of the flights about their level (or line)   error: standard error of one flight by "
    "itself, median   p: of a change as large anywhere where there is none, corrected for the places and parameters "
    f"looked at; below {COURSE.significant:g} it counts"
)


picture = season.picture


CAVEAT = (
    "Told of the effects that were fitted; another one may explain the same change. A new session (a battery put in "
    "anew, a propeller taken off) is a step like any other: docs/trend.md."
)
"""What stands below changes."""


def parts(found: Trend) -> list[Part]:
    """The summary, parameters, steps and drifts, values by flight, notes."""
    by_part: list[Part] = [Line(season.LEGEND, "dim"), overview(found)] if found.by_part else []
    out = [*brief(found), *by_part, *steps(found), Line(LEGEND, "dim"), Line(), values(found)]
    return [*out, *parameters.parts(parameters.of_flights(found.flights)), *note_lines(notes(found))]


def brief(found: Trend, most: int = ANSWER_LINES - 2) -> list[Part]:
    """The summary, of which the first is the clearest, and the parameters."""
    said = summary(found)
    looks = said[-1:] if places(found) else []
    said = said if len(said) <= most else [*said[: most - 1 - len(looks)], "More parameters changed.", *looks]
    caveat = [*(Line(text) for text in found.notes)]
    caveat += [Line(CAVEAT, "dim")] if found.changed or found.scattered else []
    if (pair := found.at_once) is not None:
        first, second = (found.names[k] for k in pair)
        twice = (
            f"By their clocks {first} and {second} were flown at the same time: one flight in two logs, which counts "
        )
        twice += "twice, or clocks that begin anew with each flight?"
        caveat.insert(0, Line(twice, "yellow"))
    shown = season.health(found) if found.by_part else overview(found)
    return [*(Line(text, "bold") for text in said), *caveat, Line(), shown]


def summary(found: Trend) -> list[str]:
    """One sentence for each parameter that changed, the most significant first, and what to look at."""
    count = len(found.flights)
    if count < COURSE.fewest:
        return [f"{count} flights: nothing can be said about steps and drifts; {COURSE.fewest} or more are needed."]
    if not found.changed and not found.scattered:
        return [f"Nothing changed over these {count} flights beyond the scatter between them."]
    first = [] if found.changed else [f"Whether by a step or a drift, {count} flights do not tell."]
    rotors, looks = found.rotors, places(found)
    alike = rotors if found.all_rotors else ()
    said = [sentence(p, found) for p in (*found.changed, *found.scattered) if p not in alike]
    inspect = [f"Look at: {', '.join(looks)}."] if looks else []
    if alike:
        said.insert(0, f"All rotors alike, as {sentence(alike[0], found)}")
        inspect = ["Look at: the weight, the battery and its voltage, the air, and whether the accelerometer reads g."]
    elif 2 * len(rotors) > found.thrusts.shape[1] > 3:
        one = f"{len(rotors)} rotors changed: likelier by one cause than each; `wrenchgap changed` looks for it."
        inspect = [f"{one} Look at: {looks[0]} first."]
    if (moved := found.moved_centre) is not None:
        said.insert(0, _moved(moved, found))
        inspect = [f"Look at: the battery and what is mounted; then {', '.join(looks)}."]
    return [*said, *first, *inspect]


def _moved(moved: MovedCentre, found: Trend) -> str:
    """That rotors change together as a centre of mass that moves makes them."""
    far = size_in_words(float(np.hypot(moved.x, moved.y)), "m")
    side = towards(found.model.vehicle, moved.x, moved.y)
    return (
        f"{share(moved.share)} of the change in thrust is what a centre of mass makes that moves {far} towards the "
        f"{side} from flight {moved.first + 1} ({found.names[moved.first]}) to flight {moved.last + 1} "
        f"({found.names[moved.last]}): as a battery that was put in elsewhere, and likelier than several weak rotors."
    )


def sentence(p: ParameterTrend, found: Trend, most_steps: int = 2) -> str:
    """What one parameter did; of more steps than `most_steps` the clearest, and the line where that is significant."""
    name = f"{p.effect} {user_name(p.name, found.model.vehicle)}"
    if p.course.verdict is Verdict.SCATTERED:
        return f"{name} {_differs(p, found)}."
    if p.course.verdict is Verdict.DRIFT and p.course.drift is not None:
        return f"{name} drifts by {_slope(p.course.drift, p.unit)}."
    steps, line = p.course.steps, p.course.drift
    if len(steps) <= most_steps:
        return f"{name} steps: {'; '.join(_step(step, p.unit, found.names) for step in steps)}."
    clearest = max(steps, key=lambda step: abs(step.t))
    told = f"{name} steps {len(steps)} times; the clearest is {_step(clearest, p.unit, found.names)}."
    return told + (f" A line through all flights: {_slope(line, p.unit)}." if line else "")


def _differs(p: ParameterTrend, found: Trend, most: int = 6) -> str:
    """Between which flights a parameter differs, by how much, and which of them lie apart."""
    low, high = int(np.argmin(p.values)), int(np.argmax(p.values))
    ends = " to ".join(f"{_signed(float(p.values[k]), p.unit)} (flight {k + 1}, {found.names[k]})" for k in (low, high))
    scatter, error = (size_in_words(float(x), p.unit) for x in (p.course.scatter, np.median(p.errors)))
    said = f"differs between flights, {ends}: scatter {scatter}, error of a flight {error}"
    if not p.course.apart:
        return said
    flights = [str(k + 1) for k in p.course.apart]
    return f"{said}; outside the scatter of the others: flight{'s' * (len(flights) > 1)} {listed(flights, most)}"


def _step(step: Step, unit_name: str, names: Sequence[str]) -> str:
    size = _signed(step.size, unit_name)
    return f"{size} from flight {step.flight + 1} ({names[step.flight]}) on, {_interval(step, unit_name)}"


def _slope(drift: Drift, unit_name: str) -> str:
    return f"{_signed(drift.slope, unit_name)} a flight, {_interval(drift, unit_name)}"


def _interval(found: Step | Drift, unit_name: str) -> str:
    low, high = (size_in_words(end, unit_name) for end in (found.low, found.high))
    return f"95 % interval {low} to {high}, t {found.t:.1f}"


def _signed(value: float, unit_name: str) -> str:
    return signed(value, size_in_words(value, unit_name))


def places(found: Trend) -> list[str]:
    """Parts of the vehicle whose parameters changed, by the user's names, each once."""
    vehicle = found.model.vehicle
    return list(dict.fromkeys(w for p in (*found.changed, *found.scattered) if (w := where(p, vehicle)) is not None))


def where(p: ParameterTrend, vehicle: Vehicle) -> str | None:
    """The user's name of the rotor or arm that a parameter belongs to; None for one of the whole vehicle."""
    if PART.fullmatch(p.name):
        return vehicle.called(p.name)
    return "centre of mass" if p.effect == "com_offset" else None


def overview(found: Trend) -> Table:
    """One row for each parameter: mean, scatter, error of a flight, what it did."""
    heads = ("effect", "parameter", "over the flights", "mean", "scatter", "error", "unit")
    out = table(f"{len(found.flights)} flights, each fitted by itself", heads, left=3, texts=(-1,))
    for first, p in zip(first_only(p.effect for p in found.parameters), found.parameters, strict=True):
        sizes = (number(float(p.values.mean())), number(p.course.scatter, 2), number(float(np.median(p.errors)), 2))
        name = label(p.name, found.model.vehicle)
        style = (
            "bold" if p in found.changed or p in found.scattered else "dim" if p.course.verdict is Verdict.OPEN else ""
        )
        out.add_row(first, name, WORDS[p.course.verdict], *sizes, unit(p.unit), style=style)
    return out


def steps(found: Trend) -> list[Table]:
    """One row for each step: flight, levels before and after, size with its interval, t and p; no table without any."""
    out = table("steps", ("parameter", "from flight", "before", "after", "size", "95 %", "t", "p"), left=2)
    for p in found.changed:
        for k, step in enumerate(p.course.steps):
            name = column(p, found) if k == 0 else ""
            place = f"{step.flight + 1} {found.names[step.flight]}"
            interval = f"{number(step.low)} to {number(step.high)}"
            sizes = (number(step.before), number(step.after), number(step.size), interval)
            test = (f"{step.t:.1f}", f"{step.p:.1g}")
            out.add_row(name, place, *sizes, *test, end_section=step is p.course.steps[-1])
    return [out] if out.row_count else []


def column(p: ParameterTrend, found: Trend) -> str:
    """Effect, parameter and unit."""
    return f"{p.effect} {label(p.name, found.model.vehicle)}{f' [{p.unit}]' if unit(p.unit) else ''}"


def values(found: Trend, most: int = 7) -> Table:
    """Every value by flight, with a mark on the first flight after a step; of more than `most`, those that changed."""
    shown = [p for p in found.parameters if p.course.verdict is not Verdict.OPEN]
    shown = shown if len(shown) <= most else [*found.changed, *found.scattered][:most]
    heads = [column(p, found).split(" ", 1) for p in shown]
    rows = []
    for k, name in enumerate(found.names):
        texts = [f"{'> ' if any(s.flight == k for s in p.course.steps) else ''}{number(p.values[k])}" for p in shown]
        rows.append((k + 1, name, *texts))
    return table("values by flight; > the first flight after a step", ("", "flight", *heads), rows, left=2)


def notes(found: Trend) -> list[str]:
    """In which order the flights are, what was not fitted, what ended at a limit; the notes of the flights."""
    out = [f"effect {one.reason.effect} is not fitted: {one.flight}: {one.reason.reason}" for one in found.left_out]
    for p in found.parameters:
        if p.at_limit and p.course.verdict is not Verdict.OPEN:
            flights = ", ".join(found.names[k] for k in p.at_limit)
            name = f"{p.effect}.{user_name(p.name, found.model.vehicle)}"
            out.append(f"{name} ended at the limit of what is plausible on {flights}")
    return [*found.notes, *out, *sentences(found.model.notes), *_of_flights(found)]


def _of_flights(found: Trend) -> list[str]:
    """Notes of the flights; one that all of them have is said once."""
    named = zip(found.names, found.flights, strict=True)
    said = numbers.by_reason((text.removeprefix(f"{n}: "), text) for n, one in named for text in sentences(one.notes))
    every = len(found.flights)
    return [
        note for rest, texts in said.items() for note in ([f"all flights: {rest}"] if len(texts) == every else texts)
    ]


def to_json(found: Trend) -> dict[str, Any]:
    """The body of the `trend` schema."""
    noise = np.sum([f.noise for f in found.flights], axis=0)
    few = len(found.flights) < COURSE.fewest
    return {
        "verdict": "few" if few else "changed" if found.changed else "scattered" if found.scattered else "steady",
        "summary": " ".join(summary(found)),
        "model": found.model.name,
        "effects": list(found.effects),
        "flights": list(found.names),
        "dates": [date or None for date in found.dates],
        "parameters": [_parameter_json(p, found) for p in found.parameters],
        "inspect": places(found),
        "significant": COURSE.significant,
        "axes": list(AXES),
        "rms": found.left,
        "unmeasured": numbers.unmeasured(noise),
        "effects_left_out": [
            entries(one, "effect=reason.effect", "flight", "reason=reason.reason") for one in found.left_out
        ],
        "autopilot_parameters": parameters.to_json(parameters.of_flights(found.flights)),
        "cutoff_hz": found.flights[0].cutoff_hz,
        "notes": notes(found),
    }


def _parameter_json(p: ParameterTrend, found: Trend) -> dict[str, Any]:
    test = ("low", "high", "t", "p")
    line = p.course.drift
    return {
        **entries(p, "effect", "name", "unit", "values", "std", "errors"),
        "where": where(p, found.model.vehicle),
        "verdict": str(p.course.verdict),
        **entries(p.course, "scatter", "level"),
        "steps": [
            {"flight": found.names[s.flight], "index": s.flight, **entries(s, "before", "after", "size", *test)}
            for s in p.course.steps
        ],
        "drift": None if line is None else entries(line, "slope", *test),
        "apart": [found.names[k] for k in p.course.apart],
        "at_limit": [found.names[k] for k in p.at_limit],
    }


def frame(found: Trend) -> list[dict[str, Any]]:
    """One row for each flight and parameter."""
    rows = []
    for p in found.parameters:
        segment = np.zeros(len(found.names), dtype=int)
        for step in p.course.steps:
            segment[step.flight :] += 1
        for k, one in enumerate(found.flights):
            file = {"file": one.flight.path.name, "sha256": one.flight.content_hash}
            which = {"effect": p.effect, "parameter": p.name, "where": where(p, found.model.vehicle), "unit": p.unit}
            sizes = {"value": float(p.values[k]), "std": float(p.std[k]), "error": float(p.errors[k])}
            course = {"segment": int(segment[k]), "level": float(p.course.level[k]), "scatter": p.course.scatter}
            about = {"flight": found.names[k], "index": k, **file}
            rows.append({**about, **which, **sizes, **course, "verdict": str(p.course.verdict)})
    return rows
