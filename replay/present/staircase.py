"""The error step by step: names of the steps, a sentence, JSON."""

from typing import Any

from wrenchgap.learn.identify.staircase import Basis, Kind, Stair, Staircase
from wrenchgap.replay.present.numbers import entries, share

LABELS = {
    Kind.NOMINAL: "nominal",
    Kind.EFFECT: "+ {}",
    Kind.GIVEN: "{} as given",
    Kind.PROCESS: "+ GP of the residual",
    Kind.GIVEN_PROCESS: "{} as given + GP",
    Kind.NOISE: "sensor noise",
}
AT_THE_NOISE = "at the noise of the sensors"


HEADINGS = {
    Basis.HELD_OUT: "{}, held-out time",
    Basis.UNSEEN: "{} (held out)",
    Basis.FITTED: "{} (fitted to it)",
    Basis.RAW: "{}",
}


def label(stair: Stair) -> str:
    """A step's name."""
    return LABELS[stair.kind].format(stair.name)


def title(case: Staircase) -> str:
    """Which time it is about."""
    if case.basis is Basis.HELD_OUT:
        return "held-out time of the given logs"
    return f"unseen flights ({', '.join(case.flights)})"


def heading(case: Staircase) -> str:
    """The same in a few words, as the page has it above each."""
    flights = case.flights[0] if len(case.flights) == 1 else f"{len(case.flights)} other flights"
    return HEADINGS[case.basis].format(flights)


def remains(case: Staircase, stair: Stair) -> str:
    """The error of a step as a share of the nominal one; never less than the noise."""
    if stair.kind is not Kind.NOISE and case.at_the_noise(stair):
        return "at the noise"
    return share(case.share(stair))


def sentence(case: Staircase) -> str:
    """By how much all steps together reduce the error, and what remains."""
    first, last = case.falling[0], case.falling[-1]
    noise = f"the sensor noise is {share(case.share(case.noise))} of the nominal error"
    if last is first:
        ending = f"is {AT_THE_NOISE}" if case.at_the_noise(first) else f"is not reduced; {noise}"
        return f"On {title(case)}, the RMS error {ending}."
    names = ", ".join("a GP" if s.kind in (Kind.PROCESS, Kind.GIVEN_PROCESS) else s.name for s in case.falling[1:])
    gone = 1.0 - case.share(last)
    if gone <= 0.0:
        return f"On {title(case)}, the RMS error grows by {share(-gone)} with {names}; {noise}."
    words = f"{100 * gone:.1f} %" if gone > 0.99 else share(gone)  # else 99.6 % would be all of it
    rest = f"{share(1.0 - gone)} of it remains (sensor noise {share(case.share(case.noise))})"
    ending = f"is {AT_THE_NOISE}" if case.at_the_noise(last) else rest
    return f"On {title(case)}, the RMS error is reduced by {words} with {names}, and {ending}."


def to_json(case: Staircase) -> dict[str, Any]:
    """Steps by name."""
    return {
        "title": title(case),
        "stairs": [{"name": label(s), **entries(s, "rms", "in_all", "beside", "learnt_here")} for s in case.stairs],
        "noise": entries(case.noise, "rms", "in_all"),
    }
