"""What a search over sets of effects found, in sentences: classes, what settles them, the nearest, the residual."""

import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from wrenchgap.flight.flight import AXES, GRAVITY, Array
from wrenchgap.learn.data.blocks import SIGNIFICANCE
from wrenchgap.learn.diagnose.residual_patterns import Oscillation
from wrenchgap.learn.identify.fit import MATERIAL, Fit
from wrenchgap.learn.posterior.discriminating_tests import Check
from wrenchgap.learn.posterior.explain import Explanation
from wrenchgap.learn.posterior.members import Member
from wrenchgap.learn.posterior.posterior import EquivalenceClass, NamedSet
from wrenchgap.learn.posterior.settings import DEFAULT
from wrenchgap.learn.posterior.single_effects import Candidate
from wrenchgap.learn.posterior.verdict import Verdict
from wrenchgap.plant import Model, Vehicle
from wrenchgap.plant.effects import catalogue, family, find
from wrenchgap.plant.history import Value
from wrenchgap.replay.present import what_to_inspect, where
from wrenchgap.replay.present.numbers import LIGHT, certainty, quantity, share, unit_of, user_name, with_std
from wrenchgap.replay.present.tables import Line

SMALL = 0.05
"""Share of the error energy below which a sentence says that an effect explains little of it, however sure it is."""
KINDS = {"bench": "on the bench", "flight": "in flight"}


def settle_lines(checks: Sequence[Check]) -> list[Line]:
    """One numbered line for each check, the cheapest first; none where nothing is open."""
    if not checks:
        return []
    head = Line("What would settle it, cheapest first:", "bold")
    return [head, *(Line(f"  {k}. {KINDS[check.kind]}: {check.what}") for k, check in enumerate(checks, 1))]


def checks_of(found: Explanation) -> list[Check]:
    """Those that ask about an effect which the answer has named, or about none by name."""
    told = {m.name for m in found.members}
    told |= {name for m in found.members for r in m.alike if r.weight >= LIGHT for name in r.names}
    asked = [
        (check, {word for said in re.findall(r"\bif ([^;.]*)", check.what) for word in said.split()} & set(catalogue()))
        for check in found.posterior.settle
    ]
    return [check for check, names in asked if not names or names & told]


def first_check(checks: Sequence[Check], longest: int = 160) -> list[str]:
    """That which settles most, of equals the cheapest, as a sentence; without the readings where they make it long."""
    out = []
    for check in sorted(checks, key=lambda one: -one.settles)[:1]:
        done = check.what.partition(": ")[0]
        what = check.what if len(check.what) <= longest else f"{done} (what each explanation predicts: --details)."
        out.append(f"To settle what is open, {KINDS[check.kind]}: {what}")
    return out


def settle_json(checks: Sequence[Check]) -> list[dict[str, Any]]:
    """The `settle` key of a class: groups of sets of effects, every set a list of names."""
    return [
        {"kind": c.kind, "what": c.what, "separates": [[list(names) for names in group] for group in c.separates]}
        for c in checks
    ]


def classes_in_words(classes: Sequence[EquivalenceClass], most: int = 3, most_sets: int = 5) -> list[str]:
    """The heaviest classes, a sentence each: their heaviest sets with their weights, and on what all of them agree."""
    out = []
    for one in (c for c in classes[:most] if c.weight >= LIGHT):
        shown = [s for s in one.sets[:most_sets] if s.weight >= LIGHT or s is one.sets[0]]
        listed = " or ".join(f"{' + '.join(s.names) or 'nothing'} ({share(s.weight)})" for s in shown)
        alike = ", indistinguishable here" if len(shown) > 1 else ""
        common = f"; in all of them: {', '.join(one.established)}" if alike and one.established else ""
        out.append(f"{share(one.weight)} of the weight{alike}: {listed}{common}")
    return out


def class_json(one: EquivalenceClass, vehicle: Vehicle) -> dict[str, Any]:
    """One entry of `classes`."""
    return {
        "weight": one.weight,
        "sets": [{"effects": list(s.names), "weight": s.weight} for s in one.sets],
        "established": [{"effect": name, "parameters": one.sets[0].values(vehicle)[name]} for name in one.established],
        "settle": settle_json(one.settle),
    }


def nothing_missing(found: Explanation) -> str:
    """Nothing is named; but not that nothing is missing, where most of the weight says that something is, or an axis
    stays above all that noise, commands and their answers may have made.
    """  # noqa: D205
    if is_nothing_missing(found):
        of = "of the catalogue " if answered(found) else ""
        return f"Nothing {of}is missing that these logs can show{what_to_inspect.granted(found, ', but ')}."
    none, likeliest = _likeliest(found)
    if likeliest is None:
        return f"Nothing is established{what_to_inspect.granted(found, '; ')}."
    small = "" if found.open.any() else f"nothing is missing ({share(none)} of the weight), or something small, "
    likely = f"most likely {' + '.join(likeliest.names)} ({share(likeliest.weight)})"
    shared = what_to_inspect.granted(found, "; ")
    return f"Nothing is established: {small}{likely}; fly longer, or with excitation, to tell{shared}."


def is_nothing_missing(found: Explanation) -> bool:
    """Whether nothing is named, likely, open, or taken for an answer of the controller."""
    named = found.verdict is not Verdict.NOTHING or _likeliest(found)[1] is not None
    return not (named or unproven(found) or found.open.any())


def _likeliest(found: Explanation) -> tuple[float, NamedSet | None]:
    """The weight of the empty set, and the most probable other set where that is less than half."""
    sets = found.posterior.sets
    none = sum(s.weight for s in sets if not s.names)
    return none, next((s for s in sets if s.names), None) if none < 0.5 else None


def turbulence(found: Explanation) -> str:
    """Axes on which more than noise is left that nothing predicts."""
    axes = [axis for axis, left in zip(AXES, found.open, strict=True) if left]
    if not axes:
        return ""
    predicted = "" if unproven(found) else ", and nothing that was logged predicts it"
    return f"Open: on {', '.join(axes)} the remaining error is larger than sensor noise{predicted}: as gusts make it."


def large_residual(found: Explanation, most: float = 0.05) -> str:
    """Of turbulence above `most` of the weight, which is not believed, what to look at first."""
    force = found.rms_after[:3][np.isfinite(found.rms_after[:3])]
    of_weight = float(force.max(initial=0.0)) / (found.model.vehicle.body.mass * GRAVITY)
    if found.verdict is Verdict.UNKNOWN or not found.open.any() or of_weight <= most:
        return ""
    return (
        f"The remaining force error is {share(of_weight)} of the weight: look at clocks, units and frames "
        "(`wrenchgap inspect`) first."
    )


def unproven(found: Explanation, most: float = 0.5, t_least: float = 3.0) -> str:
    """Of axes on which commands answer the motion: the candidate that takes most off them and has no name.

    It takes more than the share `most` of the error energy off each, with a t above `t_least`. What a controller does
    about a disturbance can look like it.
    """
    named = {family(n) for m in found.members for n in (m.name, *(n for r in m.alike for n in r.names))}
    fair = [c for c in found.ranking if c.significance > t_least and not c.implausible and family(c.name) not in named]

    def axes(c: Candidate) -> list[int]:
        return [k for k in found.answering if c.reduction[k] > 1.0 - np.sqrt(1.0 - most)]

    best = max(fair, key=lambda c: float(sum(c.reduction[axes(c)])), default=None)
    if best is None or not axes(best):
        return ""
    listed = ", ".join(f"{AXES[k]} by {share(best.reduction[k])}" for k in axes(best))
    return (
        f"Not established: {with_values(best.fit, found.model, best.name)} alone reduces the error of {listed}; the "
        "controller's answer to a disturbance can look the same."
    )


def largest_residual(found: Explanation) -> str:
    """The axis on which most is left, in units of the noise; above what structure is, that something is left."""
    axis = _worst_axis(found)
    said = f"Largest remaining error: {AXES[axis]}, {found.rms_after[axis]:.2g} {unit_of(axis)} rms"
    if not all(r.has_imu for f in found.flights for r in f.records):  # what an estimator smoothed has no known noise
        return f"{said}."
    times = found.rms_after[axis] / max(found.noise[axis], 1e-300)  # a sensor that stands still has none
    said += f" (sensor noise {found.noise[axis]:.2g})"
    if times <= found.posterior.settings.structure or found.verdict is Verdict.UNKNOWN:
        return f"{said}."
    why = "gusts, slowly logged commands, or something that is not named" if found.members else answered(found)
    return f"{said}, {times:.0f} times the noise: {why}." if why else f"{said}."


def answered(found: Explanation) -> str:
    """What may have made the largest remaining error, where commands answered the motion and no structure is left."""
    axis = _worst_axis(found)
    closed = axis in found.answering and not found.open[axis]
    if not closed or found.rms_after[axis] <= found.posterior.settings.structure * found.noise[axis]:
        return ""
    return (
        "gusts that the commands answered, slowly logged commands, or a number of the model (inertia, order of rotors, "
        "units)"
    )


def _worst_axis(found: Explanation) -> int:
    return int(np.nanargmax(found.rms_after / np.maximum(found.noise, 1e-30)))


def nearest(
    found: Explanation,
    *,
    at_all: bool = False,
    share_least: float = 0.1,
    t_least: float = 1.5,
    alike_least: float = 0.9,
) -> str:
    """The best single effect where nothing is established.

    It explains a share of the error energy of `share_least` or more, with a t above `t_least`; nothing in turbulence,
    which fits much, except `at_all`. Two others of `alike_least` times its score or more are said with it.
    """
    fair = [c for c in found.ranking if at_all or (c.significance > t_least and not c.implausible)]
    near = [] if found.open.any() and not at_all else sorted(fair, key=lambda c: -c.score)
    if not near or near[0].score < share_least:
        return ""
    best = near[0]
    alike = [c.name for c in near[1:3] if c.score > alike_least * best.score]
    first = with_values(best.fit, found.model, best.name)
    names = " or ".join([first, *alike])
    return f"Nearest, and not established: {names}, which would remove {share(best.score)} of the error energy."


def with_values(
    fit: Fit,
    model: Model,
    name: str,
    given: Mapping[str, Array] | None = None,
    prominent: float = 0.3,
    likely: float = 1.5,
) -> str:
    """The effect with its parameters that are beyond chance, or the clearest where none is, and standard deviations;
    of one that the `given` model has, (P,) by name, those that are beyond chance from that, which is said.

    Of many, and of rotors or arms, the three largest above `prominent` times the largest; sizes are multiples of the
    parameters' typical ones. The largest that is above `likely` of its standard deviations alone, and large enough for
    a name, is said with "perhaps".
    """  # noqa: D205
    every, typical = fit.values(name), {p.name: p.scale for owner, p in fit.parameters if owner == name}
    had = None if given is None else given.get(name)
    before = dict(zip((v.name for v in every), np.zeros(len(every)) if had is None else had, strict=True))
    size = {v.name: abs(v.value - before[v.name]) for v in every}
    clear = [v for v in every if size[v.name] > SIGNIFICANCE.alone * (v.std or 0.0)]
    clearest = sorted(every, key=lambda v: -size[v.name] / max(v.std or 0.0, 1e-30))
    shown: Sequence[Value] = clear or clearest[:1]
    if len(shown) > 3 or find(name).sparse:
        by_size = sorted(shown, key=lambda v: -size[v.name] / typical[v.name])
        largest = size[by_size[0].name] / typical[by_size[0].name]
        shown = [v for v in by_size[:3] if size[v.name] / typical[v.name] > prominent * largest]
    if not shown:
        return name
    unsure = [v for v in every if v not in clear and size[v.name] > likely * (v.std or 0.0)]
    large = max(unsure, key=lambda v: size[v.name] / typical[v.name], default=None)
    perhaps = ""
    if clear and large is not None and size[large.name] > MATERIAL * typical[large.name]:
        perhaps = f", perhaps {user_name(large.name, model.vehicle)} {with_std(large)}"
    limit = "; at the limit of what is plausible" if name in fit.stuck else ""
    own = "" if had is None else f"; the model has {', '.join(quantity(before[v.name], v.unit) for v in shown)}"
    values = ", ".join(f"{user_name(v.name, model.vehicle)} {with_std(v)}" for v in shown)
    return f"{name} ({values}{perhaps}{own}{limit})"


def members_in_words(found: Explanation, members: Sequence[Member]) -> tuple[str, Callable[[str], str]]:
    """These of the named effects, with their sizes, those that are firm (`Explanation.firm`) first; and
    what makes of a word, "Explained", how strongly it is said: "Explained by", or "Perhaps explained by".
    """  # noqa: D205
    sure = [m for m in members if m.name in found.firm]
    others = [m for m in members if m not in sure]
    told = {}
    for m in members:
        how = "not established" if is_doubted(found, m) else confidence(found, m)
        told[m.name] = f"{with_values(found.fit, found.model, m.name, found.given)}, {how}"
    sized, less = (" and ".join(told[m.name] for m in some) for some in (sure or others, others))
    listed = f"{sized}; less sure: {less}" if sure and less else sized
    return listed, lambda word: f"{word} by" if sure else f"Perhaps {word.lower()} by"


def is_doubted(found: Explanation, member: Member) -> bool:
    """Whether a name is in nearly all sets and not firm all the same, for another reason than what it is like."""
    return found.confidence(member) >= DEFAULT.firm and not member.alike and member.name not in found.firm


def confidence(found: Explanation, member: Member) -> str:
    """How sure a name is, and of an effect that explains little of the error, how little."""
    small = f" ({share(member.share)} of the error)" if member.share < SMALL else ""
    return f"confidence {certainty(found.confidence(member))}{small}"


def residual_in_words(found: Explanation, concentrated: float = 0.7) -> str:
    """On what the residual depends and where it is: also whether `concentrated` of it is in a tenth of the time."""
    said = []
    for axis in dict.fromkeys(b.axis for b in found.bands):  # the loudest first
        own = [b for b in found.bands if b.axis == axis]
        low, high = min(b.low_hz for b in own), max(b.high_hz for b in own)
        times = max(b.over_noise for b in own)
        said.append(f"{AXES[axis]} at {low:.2g} to {high:.2g} Hz ({times:.2g} times the noise)")
    clues = [f"What is named leaves more than noise in {', '.join(said)}."] if said else []
    if found.depends is not None and found.depends.chosen:
        inputs = " and ".join(g.label for g in found.depends.chosen[:3])
        clues.append(
            f"The residual depends on {inputs} ({100 * found.depends.explained:.0f} % of it can be predicted from them "
            "on held-out time)."
        )
    if found.concentrated > concentrated:
        clues.append(
            f"{100 * found.concentrated:.0f} % of the residual sits in a tenth of the time: see `wrenchgap where`."
        )
    return " ".join(clues)


def residual_causes(found: Explanation) -> str:
    """Sentences on what of the residual looks like a load that swings, or a rotor that comes and goes; and that what
    explains most does so at the limit of what is plausible.
    """  # noqa: D205
    said = [
        f"{name} explains most, at the limit of what is plausible: its law is another one, or the logged commands are"
        for name in found.effects[:1]
        if name in found.fit.stuck
    ]
    said += [] if found.oscillation is None else [oscillation_in_words(found.oscillation)]
    if (one := found.one_rotor) is not None:
        rotors = " or ".join(found.model.vehicle.rotor_name(k) for k in one.rotors)
        several = ", or a rotor that is weak on some of these flights only: explain them one by one"
        said.append(
            f"{100 * one.share:.0f} % of the residual pushes where rotor {rotors} pushes, at moments that nothing "
            "logged tells: a propeller or hub that slips, a motor or its controller that stutters"
            + several
            * (len(found.flights) > 1)
        )
    return " ".join(f"{words[:1].upper()}{words[1:]}." for words in said)


def oscillation_in_words(found: Oscillation) -> str:
    """One clause."""
    where = {
        "E": "fixed in the inertial frame, as a load on a rope is",
        "B": "body-fixed",
        None: "whether it is fixed in the inertial frame, like a load on a rope, or body-fixed is not clear",
    }[found.frame]
    return (
        f"a lightly damped mode at {found.frequency_hz:.2g} Hz (damping {found.damping:.2g}, {100 * found.share:.0f} % "
        f"of the residual): {where}"
    )


def residual_json(found: Explanation) -> dict[str, Any]:
    """The same for machines."""
    mode, depends, rotor = found.oscillation, found.depends, found.one_rotor
    name = found.model.vehicle.rotor_name
    return {
        "over_noise": found.left,
        "in_worst_tenth": found.concentrated,
        "bands": [{**vars(b), "axis": AXES[b.axis]} for b in found.bands],
        "swing": None if mode is None else {**vars(mode), "words": oscillation_in_words(mode)},
        "one_rotor": None if rotor is None else {"rotors": [name(k) for k in rotor.rotors], "share": rotor.share},
        "depends_on": None if depends is None else where.relevance_json(depends),
    }
