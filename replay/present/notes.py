"""Notes as sentences: what was assumed, left out or repaired, and what to do about it."""

from __future__ import annotations

from collections.abc import Iterable
from functools import singledispatch

from wrenchgap.learn.data.comparison import LeftOut
from wrenchgap.learn.diagnose.where import FittedHere, NoProcess
from wrenchgap.learn.process.predictors import OtherFilter, OtherPhysics, WithoutEffects


def sentences(notes: Iterable[object]) -> list[str]:
    """All of them, each once."""
    return list(dict.fromkeys(sentence(note) for note in notes))


@singledispatch
def sentence(note: object) -> str:
    """One note. What readers of logs say is a sentence already."""
    return str(note)


@sentence.register
def _(note: LeftOut) -> str:
    return f"{note.model}: left out, {note.reason}"


@sentence.register
def _(note: WithoutEffects) -> str:
    return f"{note.model}: has no effects; it differs from nominal only where its vehicle does."


@sentence.register
def _(note: OtherFilter) -> str:
    return (
        f"the GP was learnt with a low-pass of {note.learnt_hz:g} Hz, this analysis uses {note.used_hz:g} Hz; say "
        f"--cutoff {note.learnt_hz:g} to use the same one."
    )


@sentence.register
def _(note: OtherPhysics) -> str:
    return f"the GP was learnt on another version of this model ({note.physics}); its sum with this one is shown."


@sentence.register
def _(note: FittedHere) -> str:
    what = "the GP was learnt" if note.model is None else f"the effects of {note.model} were fitted"
    return f"{what} on {', '.join(note.flights)}: this part is not held out."


@sentence.register
def _(note: NoProcess) -> str:
    return "too little data to hold anything out for a Gaussian process; its part of the budget is zero."
