"""What a user must know before compensating with a GP, in sentences."""

from __future__ import annotations

from wrenchgap.replay.compensation.compensators import LearntFromThisFlight, LearnWarned, OtherVersion, ProcessCaveat
from wrenchgap.replay.present.learning import caution


def sentence(caveat: ProcessCaveat) -> str:
    """One sentence."""
    match caveat:
        case LearnWarned(found):
            return f"when this GP was learnt: {caution(found)}"
        case OtherVersion(model, physics):
            return (
                f"the GP was learnt on another version of {model} ({physics}): the physics that is compensated is that "
                "of the model given here."
            )
        case LearntFromThisFlight(flight):
            return f"{flight}: the GP was learnt from this very flight: the result is optimistic; use an unseen one"


def sentences(caveats: tuple[ProcessCaveat, ...]) -> tuple[str, ...]:
    """One sentence each."""
    return tuple(sentence(one) for one in caveats)
