"""Notes as sentences: what was assumed, left out or repaired, and what to do about it."""

from __future__ import annotations

from collections.abc import Iterable

from wrenchgap.compensate.not_compiled import NotCompiled
from wrenchgap.flight.check import Finding, TimeLeftOut
from wrenchgap.learn.data.comparison import LeftOut
from wrenchgap.learn.diagnose.where import FittedHere, NoProcess
from wrenchgap.learn.process.predictors import OtherFilter, OtherPhysics, WithoutEffects

SHORT = 8.0
"""Flight [s] below which blocks of held-out time are shorter than half of those of `learn.data.dataset.dataset`."""


def sentences(notes: Iterable[object]) -> list[str]:
    """All of them, each once; what checks found and times left out stand elsewhere (`present.checks`)."""
    told = (note for note in notes if not isinstance(note, Finding | TimeLeftOut))
    return list(dict.fromkeys(sentence(note) for note in told))


def sentence(note: object) -> str:
    """One note. What readers of logs say is a sentence already."""
    match note:
        case LeftOut():
            return f"{note.model}: left out, {note.reason}"
        case WithoutEffects():
            return f"{note.model}: has no effects; it differs from nominal only where its vehicle does."
        case OtherFilter():
            return (
                f"the GP was learnt with a low-pass of {note.learnt_hz:g} Hz, this analysis uses {note.used_hz:g} Hz; "
                f"say --cutoff {note.learnt_hz:g} to use the same one."
            )
        case OtherPhysics():
            physics = note.physics
            return f"the GP was learnt on another version of this model ({physics}); its sum with this one is shown."
        case FittedHere():
            what = "the GP was learnt" if note.model is None else f"the effects of {note.model} were fitted"
            return f"{what} on {', '.join(note.flights)}: this part is not held out."
        case NoProcess():
            return "too little data to hold anything out for a Gaussian process; its part of the budget is zero."
        case NotCompiled():
            return (
                f"the compensation is not compiled, its steps take tens of times as long: {note.reason}. Corrections "
                "are those of L-BFGS on plain models."
            )
        case _:
            return str(note)


def too_short(seconds: float) -> list[str]:
    """A warning where hardly any flight was left to judge by."""
    if seconds >= SHORT:
        return []
    return [
        f"Only {seconds:.1f} s of flight could be used: too short to tell small effects from chance. "
        f"Give longer flights, at least {SHORT:.0f} s (`inspect` lists what was left out)."
    ]
