"""Notes as sentences: what was assumed, left out, repaired or not tried, what checks found, and what to do about it."""

import re
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from wrenchgap.compensate.lbfgs import NotCompiled
from wrenchgap.flight.check import Check, Finding, TimeLeftOut
from wrenchgap.learn.data.candidates import Lack, Untried
from wrenchgap.learn.data.checks.vehicle import OTHER_WEIGHT
from wrenchgap.learn.data.comparison import LeftOut
from wrenchgap.learn.diagnose.where import FittedHere, NoProcess
from wrenchgap.learn.process.predictors import OtherFilter, OtherPhysics, WithoutEffects
from wrenchgap.replay.present.numbers import by_reason, entries
from wrenchgap.replay.present.tables import Line

SENTENCES: dict[type, str] = {
    LeftOut: "{0.model}: left out, {0.reason}",
    WithoutEffects: "{0.model}: has no effects; it differs from nominal only where its vehicle does.",
    OtherFilter: "the GP was learnt with a low-pass of {0.learnt_hz:g} Hz, this analysis uses {0.used_hz:g} Hz; say "
    "--cutoff {0.learnt_hz:g} to use the same one.",
    OtherPhysics: "the GP was learnt on another version of this model ({0.physics}); its sum with this one is shown.",
    NoProcess: "too little data to hold anything out for a Gaussian process; its part of the budget is zero.",
    NotCompiled: "the compensation is not compiled, its steps take tens of times as long: {0.reason}. Corrections are "
    "those of L-BFGS on plain models.",
}
"""What a note says, by its class."""


def sentences(notes: Iterable[object]) -> list[str]:
    """All of them, each once; what checks found and times left out are `warnings`."""
    told = (note for note in notes if not isinstance(note, Finding | TimeLeftOut))
    return list(dict.fromkeys(sentence(note) for note in told))


def grouped(said: Iterable[str], few: int = 3) -> list[str]:
    """Sentences; more than `few` that differ by names and numbers alone are one, as those of a damaged log."""
    groups: dict[str, list[str]] = {}
    for text in dict.fromkeys(said):
        start, mark, rest = text.partition(": ")
        groups.setdefault(re.sub(r"[\d.,]+", "0", rest if mark and " " not in start else text), []).append(text)
    alike = ([f"{many[0]} ({len(many) - 1} more like it.)"] if len(many) > few else many for many in groups.values())
    return [text for many in alike for text in many]


def of_flights(flights: Iterable[Any]) -> list[str]:
    """Notes of flights as sentences."""
    return sentences(note for flight in flights for note in flight.notes)


def sentence(note: object) -> str:
    """One note. What readers of logs say is a sentence already."""
    if isinstance(note, FittedHere):
        what = "the GP was learnt" if note.model is None else f"the effects of {note.model} were fitted"
        return f"{what} on {', '.join(note.flights)}: this part is not held out."
    return SENTENCES[type(note)].format(note) if type(note) in SENTENCES else str(note)


def too_short(seconds: float) -> list[str]:
    """A warning where less flight was left than an analysis needs."""
    from wrenchgap.learn.health.answers import NEEDS  # here: a page does not wait for statistics

    if seconds >= NEEDS.flight:
        return []
    return [
        f"Only {seconds:.1f} s of flight could be used: too short to tell small effects from chance. "
        f"Give longer flights, at least {NEEDS.flight:.0f} s (`inspect` lists what was left out)."
    ]


PLACES = ("flights", "unseen", "training", "validation", "inference", "recording", "explanation")
"""Attributes of results in which their flights, or the notes of these, are found."""


def findings(result: Any, depth: int = 3) -> Iterator[Finding | TimeLeftOut]:
    """What was found of the flights of a result, at most `depth` attributes below it, and the times left out."""
    if isinstance(result, list | tuple):
        for item in result:
            yield from findings(item, depth)
        return
    for note in getattr(result, "notes", ()):
        if isinstance(note, Finding | TimeLeftOut):
            yield note
    for place in PLACES if depth else ():
        if (inside := getattr(result, place, None)) is not None and not isinstance(inside, str):
            yield from findings(inside, depth - 1)


def warnings(found: Iterable[object], several: int = 3, *, brief: bool = False) -> list[str]:
    """What a user should know before any number, as sentences; one of more than `several` flights once for all. The
    `brief` ones leave out what a check says after its first sentence.
    """  # noqa: D205
    by_name: dict[str, dict[str, str]] = {}
    for note in found:
        if isinstance(note, Finding) and note.check.level != "ok":
            by_name.setdefault(note.check.name, {}).setdefault(
                f"{note.flight}: {_words(note.check, brief)}", note.flight
            )
    out = []
    for name, said in by_name.items():
        flights = list(dict.fromkeys(said.values()))
        if len(flights) > several:
            out.append(f"{name}: {len(flights)} flights, e.g. {next(iter(said))}")
        else:
            out += [f"{name}: {words}" for words in said]
    return out


def _words(check: Check, brief: bool) -> str:
    if check.level == "bad":
        return f"{check.words.rstrip('. ')} (accepted)"
    if brief and not check.mend:
        return f"{check.words.partition('. ')[0].rstrip('.')}."
    return f"{check.words.rstrip('. ')}. Read it with {check.mend}" if check.mend else check.words


MISSING = ("gaps", "left-out", "spikes")
"""Checks that say which samples are missing: where they ask for nothing, the details have what they say."""


def findings_to_tell(result: Any) -> list[Finding | TimeLeftOut]:
    """The findings without what `changed` compares: a weight that effects make, on no healthy flight."""
    found = list(findings(result))
    weighed = {note.flight for note in found if _of_weight(note)}
    healthy: Sequence[str] = getattr(result, "healthy", ())
    compared = bool(healthy) and weighed.isdisjoint(healthy)
    return [note for note in found if not (compared and _of_weight(note) and not _of_another(note))]


def _of_weight(note: object) -> bool:
    return isinstance(note, Finding) and note.check.name == "weight" and note.check.level != "ok"


def _of_another(note: object) -> bool:
    return isinstance(note, Finding) and OTHER_WEIGHT in note.check.words


def doubted_mass(result: Any) -> list[Line]:
    """What to say first where the model weighs otherwise than what flew, beyond what effects make; else nothing."""
    said = "Correct the model's mass first, and doubt what follows: it weighs otherwise than what flew (check: weight)."
    return [Line(said, "bold")] if any(map(_of_another, findings(result))) else []


def banner(result: Any, *, details: bool = True) -> list[Line]:
    """The warnings of a result, to stand above it; without `details` those of missing samples are one line."""
    found = findings_to_tell(result)
    some = [n for n in found if isinstance(n, Finding) and n.check.name in MISSING and n.check.level == "warn"]
    some = [] if details else [n for n in some if not n.check.mend]
    said = warnings((n for n in found if n not in some), brief=not details)
    names = ", ".join(dict.fromkeys(n.check.name for n in some))
    said += [f"{names}: samples are missing or left out (--details)"] if names else []
    return [Line(f"check: {text}", "yellow") for text in said]


def checks_json(result: Any) -> dict[str, Any]:
    """The keys `checks` and `left_out` of every result."""
    notes = list(dict.fromkeys(findings(result)))
    keys = ("name", "level", "words", "mend", "accepted")
    return {
        "checks": [{"flight": n.flight, **entries(n.check, *keys)} for n in notes if isinstance(n, Finding)],
        "left_out": [vars(n) for n in notes if isinstance(n, TimeLeftOut)],
    }


def not_tried(untried: Sequence[Untried]) -> dict[str, list[str]]:
    """Effects that these logs or this model do not allow, by reason."""
    return by_reason((reason(one), one.effect) for one in untried)


def not_tried_lines(untried: Sequence[Untried]) -> list[Line]:
    """The same, a line for each reason."""
    return [Line(f"not tried: {', '.join(names)}: {why}", "dim") for why, names in not_tried(untried).items()]


def not_tried_json(untried: Sequence[Untried]) -> list[dict[str, str]]:
    """The key `not_tried` of results."""
    return [{"effect": u.effect, "lack": str(u.lack), "reason": reason(u)} for u in untried]


def reason(one: Untried) -> str:
    """Why an effect is not tried, without its name."""
    return f"could not be fitted ({one.detail})" if one.lack is Lack.FIT else one.reason
