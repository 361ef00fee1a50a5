"""Whether to fly: the decision and its reason, what each part needs, the margins of the loops, what to check first."""

from typing import Any

import numpy as np

from wrenchgap.flight.flight import GRAVITY
from wrenchgap.replay.loop_margins import GAIN, GO, PHASE, Gains, LoopMargins
from wrenchgap.replay.present import what_to_inspect
from wrenchgap.replay.present.figures import style
from wrenchgap.replay.present.notes import sentences
from wrenchgap.replay.present.numbers import capitalised, entries, label, listed, number, quantity, share
from wrenchgap.replay.present.tables import Line, Part, Table, note_lines, table
from wrenchgap.replay.readiness import ROOM, Decision, Readiness

BEGINS = {Decision.GO: "Go", Decision.CARE: "Go with care", Decision.NO_GO: "No go"}
LEGEND = (
    "needs: the most that the flight takes, as a share of what the part has; enough: it leaves a tenth to the "
    "controller; 5 to 95 %: by the standard deviations of the model's values, and by what the model left on these "
    "flights, as another flight may have it"
)
TRY = {"constant_wrench": "Fly longer: a constant that differs from flight to flight is not found on a bench."}
"""What tells the values of an effect better than a bench."""
NOT_SAID = (
    "Margins of the attitude loops are not said: these flights do not show that the gains of the model file, or of the "
    "autopilot's parameters, flew them."
)
NOT_ABOUT_Z = (
    "Nothing is said about z: rotors that speed up turn the body at once. Give the model rotor_gyroscopic, the inertia "
    "of one about its axis (a third of the propeller's mass times its radius squared)."
)


def parts(found: Readiness) -> list[Part]:
    """The answer, what each part needs, margins, notes."""
    loops: list[Part] = [_loops(found)] if found.loops else []
    return [*brief(found), Line(LEGEND, "dim"), *loops, *note_lines(sentences(found.notes))]


def brief(found: Readiness) -> list[Part]:
    """The decision and its reasons, and what each part needs."""
    first, *others = summary(found)
    return [Line(first, "bold"), *map(Line, others), Line(), _parts(found)]


def summary(found: Readiness) -> list[str]:
    """The decision in one sentence, then margins, what was not flown yet, what to check on the bench."""
    weakest, out = found.authority[0], _decided(found)
    if found.loops and all(one.probability >= GO for one in found.loops):
        least = min(float(one.phase[0]) for one in found.loops), min(float(one.gain[0]) for one in found.loops)
        out.append(f"The attitude loops keep their margins: {least[0]:.0f} deg and {least[1]:.0f} dB at the least.")
    if found.below > 1.0 - GO:
        out.append(
            f"In {share(found.below)} of the draws a rotor would have to push less than it can: what the model leaves "
            "of these flights turns the vehicle more than rotors near idle answer. Fit what is missing, or give calmer "
            "flights (--between)."
        )
    if found.gains.upper_bounds:
        out.append(
            "The model has no lag of motors or servos: the margins are upper bounds. Fit one (wrenchgap add motor_lag) "
            "or write that of a bench into the model."
        )
    if found.gains is not Gains.MODEL and [one.axis for one in found.loops] == ["torque_x", "torque_y"]:
        out.append(NOT_ABOUT_Z)
    if found.beyond:
        words = ", ".join(f"{r.quantity} {_of(r.percentile, r)} (flown: {_of(r.maximum, r)})" for r in found.beyond)
        out.append(f"It goes beyond these flights: {words}. What acts there only is not in these numbers.")
    if found.designed_for and found.designed_for != found.vehicle.name:
        out.append(f"It was designed for {found.designed_for}, and {found.vehicle.name} flies it here.")
    if found.unseen > 0.5 and found.decision is not Decision.GO:
        out.append(
            f"Of the scatter {share(found.unseen)} is a constant disturbance that {found.analysed:.0f} s of flight do "
            "not tell from slow gusts: more flight narrows it."
        )
    if not found.known:
        out.append(
            "No value of the model has a standard deviation: how wrong it may be is not known. Fit it first (wrenchgap "
            "calibrate, wrenchgap add)."
        )
    if found.first and weakest.probability < GO:
        one = found.first[0]
        size = f"{number(one.value)} +- {number(one.std, 2)}"
        out.append(
            f"Most depends on {one.effect}, {label(one.parameter, found.vehicle)}, {size}: it makes {share(one.share)} "
            f"of the uncertainty of what {weakest.part} needs. {TRY.get(one.effect, 'Check it on the bench first.')}"
        )
    if found.wind and not found.feels_wind:
        out.insert(
            1,
            f"The wind of {number(found.wind, 2)} m/s is not in these numbers, as the model has no drag: fit body_drag "
            "or rotor_drag to a flight that moves.",
        )
    if found.voltage is not None and not found.feels_voltage:
        out.append("The thrust of the model does not depend on the battery's voltage: --voltage changes nothing.")
    return out if found.loops else [*out, NOT_SAID]


def _contradictions(found: Readiness) -> str:
    """In words; a rotor by its name where it is the only one: several may stand for another one, or for a weight."""
    changes: dict[str, dict[str, float]] = {}
    for one in found.contradicted:
        changes.setdefault(one.effect, {})[one.parameter] = one.change
    said = [f"commands take effect {1e3 * late:.0f} ms later" for late in changes.get("command_delay", {}).values()]
    less = changes.get("thrust_scale", {}).values()
    said += [f"all thrust is {share(-change)} less, or the vehicle heavier" for change in less]
    weak = changes.get("rotor_thrust", {})
    if len(weak) > 1:
        said.append(f"one or several rotors give up to {share(-min(weak.values()))} less thrust")
    else:
        said += [f"{found.vehicle.called(name)} gives {share(-change)} less thrust" for name, change in weak.items()]
    constant = changes.get("constant_wrench", {})
    if off := changes.get("com_offset"):  # its torque in hover
        weight = found.vehicle.body.mass * GRAVITY
        constant = {"torque_x": -off.get("y", 0.0) * weight, "torque_y": off.get("x", 0.0) * weight}
    said += [f"there is {cause}" for cause in what_to_inspect.causes_of_constant(constant, found.vehicle)]
    return " and ".join(said)


def _decided(found: Readiness) -> list[str]:
    """The decision, the loops without their margins, and what has failed already."""
    weakest = found.authority[0]
    low, middle, high = (share(float(x)) for x in weakest.needs)
    whole = "its full thrust" if weakest.used == "thrust" else f"its {weakest.used}"
    needs = f"{weakest.part} needs {middle} of {whole} ({low} to {high}), nominal {share(weakest.nominal)}: enough with"
    lost = sorted((one for one in found.loops if one.probability < GO), key=lambda one: one.probability)
    out = [f"{needs} {share(weakest.probability)}.", *map(_margins, lost)]
    if lost and lost[0].probability < weakest.probability:  # then the loop decides
        out.insert(0, out.pop(1))
    out = [capitalised(text) if k else text for k, text in enumerate(out)]
    begins = "Once it is sound" if found.crashed else BEGINS[found.decision]
    if found.decision is Decision.CARE and (why := _cares(found)):
        begins = f"{begins} ({why})"
    out[0] = f"{begins}: on {found.trajectory}{_conditions(found)} {out[0]}"
    names = ", ".join(found.crashed)
    crashed = f"No go: {names} ended in a crash or a loss of control; inspect the whole vehicle first."
    out = [crashed, *out] if names else out
    if found.contradicted:
        out.append(
            f"These flights contradict the model: {_contradictions(found)}. "
            "That is in these numbers; find out why (wrenchgap explain), and fit it, before this flight."
        )
    if found.weakened:
        weak = [f"{found.vehicle.called(w.rotor)} has lost {share(w.lost)} of its thrust" for w in found.weakened]
        out.append(
            f"By the model, {listed(weak, 3)}: a propeller or motor that fails may fail further. Mend it and fit the "
            "model again before this flight."
        )
    return out


def _cares(found: Readiness) -> str:
    """Why it is no plain "go", in a few words; sentences below say more."""
    reasons = {
        "the flights contradict the model": bool(found.contradicted),
        "a weak rotor": bool(found.weakened),
        "little authority": found.authority[0].probability < GO,
        "small margins": any(one.probability < GO for one in found.loops),
        "more than was flown": bool(found.beyond),
        "no lag in the model": found.gains.upper_bounds,
        "no drag in the model": bool(found.wind) and not found.feels_wind,
        "how wrong the model may be is not known": not found.known,
    }
    return ", ".join(reason for reason, so in reasons.items() if so)


def _of(value: float, of: Any) -> str:
    return quantity(value, of.unit, 2)


def _conditions(found: Readiness) -> str:
    parts = [
        (found.payload, f"{number(found.payload, 2)} kg more"),
        (found.wind * found.feels_wind, f"wind of {number(found.wind, 2)} m/s"),
    ]
    parts.append((found.voltage or 0.0, f"{number(found.voltage)} V"))
    said = [text for value, text in parts if value]
    return f" with {', '.join(said)}," if said else ""


def _margins(one: LoopMargins) -> str:
    said = (
        f"the margins about {one.axis[-1]} are {one.phase[1]:.0f} deg and {one.gain[1]:.0f} dB (nominal "
        f"{one.nominal[0]:.0f} deg and {one.nominal[1]:.0f} dB); {PHASE:.0f} deg and {GAIN:.0f} dB are kept with "
        f"{share(one.probability)}"
    )
    if one.factor is None:
        return f"{said}; less gain does not bring them back."
    return f"{said}; gains times {one.factor:.2f} bring them back with {share(GO)}."


def _parts(found: Readiness) -> Table:
    rows = [
        (a.part, a.used, share(a.nominal), *(share(float(x)) for x in a.needs[[1, 0, 2]]), share(a.probability))
        for a in found.authority
    ]
    heads = ("part", "of its", "nominal", "needs", "5 %", "95 %", "enough with")
    return table(f"what {found.trajectory} takes, {found.duration:.0f} s", heads, rows, left=2)


def _loops(found: Readiness) -> Table:
    rows = [
        (
            one.axis,
            *(f"{x:.0f}" for x in (one.nominal[0], *one.phase[[1, 0, 2]], one.nominal[1], *one.gain[[1, 0, 2]])),
            share(one.probability),
            "-" if one.factor is None else f"{one.factor:.2f}",
        )
        for one in found.loops
    ]
    whose = "the model file" if found.gains is Gains.MODEL else f"{found.gains.partition(',')[0]}'s parameters"
    heads = ("loop", "nominal [deg]", "phase", "5 %", "95 %", "nominal [dB]", "gain", "5 %", "95 %")
    return table(f"margins with the gains of {whose}", (*heads, "both with", "gains times"), rows)


def to_json(found: Readiness) -> dict[str, Any]:
    """The body of the `ready` schema."""
    body = {name: value for name, value in vars(found).items() if name not in ("vehicle", "notes")}
    return {"summary": summary(found), "vehicle": found.vehicle.name, **body, "notes": sentences(found.notes)}


def frame(found: Readiness) -> list[dict[str, Any]]:
    """A row for each part."""
    rows = []
    for one in found.authority:
        needs = dict(zip(("p05", "p50", "p95"), map(float, one.needs), strict=True))
        rows.append({**entries(one, "part", "used", "nominal"), **needs, "probability": one.probability})
    return rows


def picture(found: Readiness) -> style.Picture:
    """One panel: of each part what it needs, its interval, and the whole that it has."""
    size = (9.0, 1.2 + 0.32 * len(found.authority))
    title = f"{BEGINS[found.decision]}: what {found.trajectory} takes of each part"
    return style.Picture((1, 1), size, lambda axes: _draw(found, axes), title=title)


def _draw(found: Readiness, axes: Any) -> None:
    panel = np.ravel(axes)[0]
    for k, one in enumerate(reversed(found.authority)):
        low, middle, high = one.needs
        panel.plot([low, high], [k, k], color="C0", lw=4.0, alpha=0.5, label="5 to 95 %" if k == 0 else None)
        panel.plot([middle], [k], "o", color="C0", label="needs" if k == 0 else None)
        panel.plot([one.nominal], [k], "|", color=style.NOISE, ms=12.0, label="nominal" if k == 0 else None)
    panel.axvline(1.0, color="0.2", lw=1.2)
    panel.axvline(ROOM, color="0.2", lw=1.2, ls="--", label="left to the controller beyond")
    names = [one.part if one.used == "thrust" else f"{one.part}, {one.used}" for one in reversed(found.authority)]
    panel.set_yticks(range(len(names)), names, fontsize=style.USUAL)
    panel.set_xlim(0.0, max(1.05, 1.05 * max(float(one.needs[2]) for one in found.authority)))
    panel.set_xlabel("share of what the part has")
    style.grid(axes)
    style.legend(panel)
