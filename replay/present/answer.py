"""The answer of `explain`: what is missing, how sure that is, what cannot be told apart, and what is left."""

import numpy as np

from wrenchgap.learn import Explanation, Verdict
from wrenchgap.learn.identify.bias_and_trim import mean_force_error
from wrenchgap.learn.posterior.verdict import UNEXPLAINED
from wrenchgap.replay.present import fitted_effects, posterior, what_to_inspect
from wrenchgap.replay.present.notes import too_short
from wrenchgap.replay.present.numbers import capitalised, share
from wrenchgap.replay.present.tables import Line

MOST_PLACES = 2
"""Sentences on what to inspect that belong to the answer."""


def short(found: Explanation) -> list[str]:
    """A warning where hardly any flight was left to judge by."""
    seconds = [float(r.time[-1] - r.time[0]) for f in found.flights for r in f.records]
    return too_short(sum(seconds)) if seconds else []


def summary(found: Explanation) -> str:
    """The verdict in plain words with what to inspect, and what speaks for it and against it."""
    return " ".join([in_full(found), *evidence(found)])


def in_full(found: Explanation) -> str:
    """The verdict in plain words, with what to inspect."""
    return " ".join([*answer(found), *what_to_inspect.of_explanation(found)[:MOST_PLACES]])


def answer(found: Explanation) -> list[str]:
    """The verdict: what is named and how sure, what is as likely, what a pilot can look for, the largest residual."""
    before, after = _around_groups(found)
    return [*before, *(fitted_effects.either(found, group) for group in fitted_effects.likely_groups(found)), *after]


def answer_lines(found: Explanation) -> list[Line]:
    """The same, what to inspect before what else may be so; a line for each of what cannot be told apart, where that is
    one group: several are a sentence each, as the answer has to fit a screen.
    """  # noqa: D205
    places = [Line(text, "bold") for text in what_to_inspect.of_explanation(found)[:MOST_PLACES]]
    if not found.groups:
        return [Line(" ".join(answer(found)), "bold"), *places]
    before, after = _around_groups(found)
    out = [Line(" ".join(before), "bold")] if before else []
    groups = fitted_effects.likely_groups(found)
    if len(groups) == 1:
        out.append(Line(f"One of these, {fitted_effects.which_flights(found)} cannot tell which:", "bold"))
        out += [Line(f"  {weight:>5}  {clause}") for weight, clause in fitted_effects.alternatives(found, groups[0])]
    else:
        out += [Line(fitted_effects.either(found, group), "bold") for group in groups]
    return [*out, *places, Line(" ".join(after))]


def _around_groups(found: Explanation) -> tuple[list[str], list[str]]:
    """Sentences before and after those on what cannot be told apart."""
    grouped = {name for group in found.groups for name in group[0].split(" + ")}
    beside = [m for m in found.members if m.name not in grouped]
    names, by = posterior.members_in_words(found, beside or found.members)
    before, after = [f"{by('Partly explained' if is_partial(found) else 'Explained')} {names}."], []
    match found.verdict:
        case Verdict.NOTHING if not short(found):
            before = [posterior.nothing_missing(found), posterior.nearest(found), posterior.unproven(found)]
        case Verdict.UNKNOWN if any(m.share > 0.0 for m in found.members):
            said = f"{by('Partly explained')} {names}" if beside else "Part of it has more than one explanation"
            before = [f"{said}; more is missing than the catalogue can explain."]
            after = [posterior.residual_causes(found)]
        case Verdict.NOTHING | Verdict.UNKNOWN if short(found):
            before = ["Too short to tell what is missing.", posterior.nearest(found, at_all=True)]
        case Verdict.UNKNOWN:
            before = ["Something is missing, but no effect of the catalogue explains it."]
            after = [posterior.residual_causes(found)]
        case Verdict.GROUP:
            before = []
            if beside:
                after = [f"{'Beside it' if by('is') == 'is by' else 'Perhaps beside it'}: {names}."]
    if found.verdict is not Verdict.NOTHING and (shared := what_to_inspect.granted(found, "")):
        after.append(f"{capitalised(shared)}.")
    after += [thrust_beyond(found), posterior.large_residual(found), posterior.largest_residual(found)]
    return [text for text in before if text], [text for text in after if text]


def is_partial(found: Explanation) -> bool:
    """Whether an axis keeps as much as the verdict calls structure, even if commands answered it, as they do gusts."""
    after, least = found.rms_after, found.posterior.settings.structure * found.noise
    return bool(np.any((after > least) & (after > UNEXPLAINED * found.rms_before)))


def evidence(found: Explanation) -> list[str]:
    """What the answer leaves to the details: what depends on what, what stays open, and what may have made it."""
    if found.verdict is Verdict.UNKNOWN:
        short_one = short(found) and not found.members
        said = [] if short_one else [posterior.residual_in_words(found), posterior.unproven(found)]
    else:
        said = [posterior.turbulence(found), "" if found.verdict is Verdict.NOTHING else posterior.unproven(found)]
    return [text for text in (*said, *([] if thrust_beyond(found) else granted_thrust(found))) if text]


def thrust_off(found: Explanation) -> float | None:
    """By how much the mean force exceeds that of the commands, relative to it; None where the model is sure of its
    thrust, or no flight measured it.
    """  # noqa: D205
    return mean_force_error([r for f in found.flights for r in f.records]) if found.fit.thrust.size else None


def thrust_beyond(found: Explanation) -> str:
    """That thrust, or the mass, is off by more than one standard deviation of what the model knows of its thrust."""
    off, known = thrust_off(found), found.model.vehicle.tolerances.thrust or 0.0
    if off is None or abs(off) <= known:
        return ""
    return (
        f"All thrust is {share(abs(off))} {'less' if off < 0.0 else 'more'} than the model has it, or the vehicle "
        f"{share(abs(1.0 / (1.0 + off) - 1.0))} {'heavier' if off < 0.0 else 'lighter'} (the model knows its thrust to "
        f"{share(known)}): weigh it; if the mass is right, `add thrust_scale`."
    )


def granted_thrust(found: Explanation) -> list[str]:
    """What a model that is not sure of its thrust was granted, from one per cent on."""
    off, known = thrust_off(found), share(found.model.vehicle.tolerances.thrust or 0.0)
    if off is None or abs(off) < 0.01:
        return []
    return [
        f"The model knows its thrust to {known}, and these flights ask for {100.0 * off:+.1f} %: no effect is "
        "named for that; `add thrust_scale` takes it into the model."
    ]
