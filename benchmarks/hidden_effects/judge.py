"""One flight flown, explained and judged; a row of plain values."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from benchmarks.hidden_effects.airframe import MASS
from benchmarks.hidden_effects.cases import UNSEEN, Case
from benchmarks.hidden_effects.engine import ALWAYS, Truth, fly
from benchmarks.hidden_effects.hidden import HOVER_THRUST
from wrenchgap import compare, explain, open_flights
from wrenchgap.learn.posterior.explain import Explanation
from wrenchgap.plant.effects import family
from wrenchgap.plant.model import Model
from wrenchgap.replay.present import explanation, posterior
from wrenchgap.replay.present.documents import plain

Row = dict[str, Any]
Values = dict[str, float]


def run(case: Case, model: Model) -> Row:
    """Fly, explain, judge."""
    recorded, truth = fly(
        case.effects,
        case.sizes or None,
        case.trajectory,
        case.seconds,
        case.seed,
        pair_split=case.split,
        crisp=case.crisp,
    )
    start = time.process_time()
    found = explain(open_flights(recorded, model), model, jobs=1)
    seconds = time.process_time() - start
    return {
        "case": case.name,
        "kind": case.kind,
        "hidden": list(case.effects),
        "scales": list(case.scales),
        "sizes": list(case.sizes),
        "trajectory": case.trajectory,
        **_named(found),
        **judge(found, truth),
        "parameters": _parameters(found, truth),
        "members": [
            {
                "effect": m.name,
                "share": m.share,
                "significance": m.significance,
                "evidence": m.evidence,
                "probability": m.probability,
                "rivals": [[r.name, r.separation, r.cosine, r.weight] for r in m.rivals],
            }
            for m in found.members
        ],
        "firm": list(found.firm),
        "classes": [[c.weight, [[*s.names] for s in c.sets]] for c in found.classes if c.weight > 0.01],
        "swing": None if found.oscillation is None else posterior.oscillation_in_words(found.oscillation),
        "depends": None if found.depends is None else [g.name for g in found.depends.chosen],
        "concentrated": found.concentrated,
        "left": found.left,
        "unseen": _unseen(case, found, model),
        "rms_before": found.rms_before.tolist(),
        "rms_after": found.rms_after.tolist(),
        "noise": found.noise.tolist(),
        "cpu_seconds": seconds,
    }


def _named(found: Explanation) -> Row:
    body = plain(explanation.to_json(found))
    return {key: body[key] for key in ("verdict", "effects", "groups", "fitted")}


def judge(found: Explanation, truth: Truth) -> Row:
    """Whether what was named is what was hidden.

    `main` are the effects named that the vehicle does not have anyway (`Truth.always`); `right` is "name" where the
    first of them, or for several hidden effects that many of them, is an accepted answer, "group" where a member of
    its group is, "missed" where none was named, "unknown" where the verdict says so, else "wrong".
    """
    groups = {g[0]: [n for name in g for n in name.split(" + ")] for g in found.groups}
    expected = [a for answers in truth.answers for a in answers]
    main = [e for e in found.effects if family(e) not in _families(truth.always) or family(e) in _families(expected)]
    row: Row = {"main": main, "answers": [list(a) for a in truth.answers]}
    if not truth.effects:
        return {**row, "right": "wrong" if main else "name"}
    if "unknown" in expected:
        ok = found.verdict == "unknown"
        named = (bool(main) and main[0] in expected) or any(set(groups.get(m, ())) & set(expected) for m in main[:1])
        return {**row, "right": "unknown" if ok else "name" if named else "missed" if not main else "wrong"}
    score = [_found(answers, main[: len(truth.effects)], groups) for answers in truth.answers]
    row["found"] = score
    if all(score):
        right = "name" if all(s == "name" for s in score) else "group"
        return {**row, "right": right if found.verdict != "unknown" else f"{right}, unknown"}
    if not main:
        return {**row, "right": "missed"}
    if found.verdict == "unknown":
        return {**row, "right": "unknown"}
    if len(truth.effects) > 1 and any(score):
        return {**row, "right": "half"}
    return {**row, "right": "wrong"}


def _found(answers: tuple[str, ...], main: list[str], groups: dict[str, list[str]]) -> str:
    accepted = _families(answers)
    if accepted & _families(main):
        return "name"
    return "group" if any(accepted & _families(groups.get(m, ())) for m in main) else ""


def _families(names: Iterable[str]) -> set[str]:
    """A form of an effect is that effect."""
    return {family(n) for n in names}


def _parameters(found: Explanation, truth: Truth) -> list[Row]:
    """Fitted against true values, where the same quantity exists."""
    rows: list[Row] = []
    for effect, values in true_values(truth).items():
        fitted = plain(found.fit.values(effect))
        rows += [{"effect": effect, **v, "true": float(values[v["name"]])} for v in fitted if v["name"] in values]
    return rows


def _unseen(case: Case, found: Explanation, model: Model) -> Row | None:
    """Share of the torque and force error above the noise that is gone on a flight of another kind."""
    if case.kind not in ("one", "two") or not found.effects:
        return None
    trajectory = UNSEEN[case.trajectory]
    seed = case.seed
    recorded, _ = fly(case.effects, case.sizes, trajectory, 25.0, seed, pair_split=case.split)
    compared = compare(open_flights(recorded, model), model, found.model)
    before, after = (compared.evaluations[k].pooled.rms for k in (0, -1))
    out: Row = {"trajectory": trajectory, "before": before.tolist(), "after": after.tolist()}
    for what, axes in (("force", slice(0, 3)), ("torque", slice(3, 6))):
        b, a, n = (float(np.linalg.norm(v[axes])) for v in (before, after, compared.noise))
        out[what] = (b - a) / (b - n) if b > 1.5 * n else None
    return out


# What the parameters of a named effect should be, where the hidden physics has the same quantity.


def _xyz(given: Row) -> Values:
    return {axis: float(given[axis]) for axis in "xyz"}


def _inertia(given: Row) -> Values:
    x, y, z = given["sx"], given["sy"], given["sz"]
    return {"xx": y + z, "yy": x + z, "zz": x + y, "xy": 0.0, "xz": 0.0, "yz": 0.0}


def _rotors(given: Row) -> Values:
    return {f"rotor_{k}": -given["loss"] if k == given["rotor"] else 0.0 for k in range(12)}


def _jet(given: Row) -> Values:
    force = np.array(given["force"])
    wrench = (*force, *np.cross(given["at"], force))
    names = [f"{kind}_{axis}" for kind in ("force", "torque") for axis in "xyz"]
    return {name: float(value) for name, value in zip(names, wrench, strict=True)}


TRUE: dict[tuple[str, str], Callable[[Row], Values]] = {
    ("com_offset", "com_offset"): _xyz,
    ("inertia", "inertia"): _inertia,
    ("mass", "mass"): lambda g: {"added": MASS * g["relative"]},
    ("payload", "payload"): lambda g: {"mass": g["mass"], **_xyz(g)},
    ("heavy_arms", "arm_reaction"): lambda g: {"inertia": ALWAYS["arm_reaction"] + g["added"]},
    ("servo_lag", "servo_lag"): lambda g: {"tau": ALWAYS["servo_lag"] + g["added"]},
    ("motor_lag", "motor_lag"): lambda g: {"tau": g["tau"]},
    ("command_delay", "command_delay"): lambda g: {"delay": g["delay"]},
    ("tilt_offset", "tilt_offset"): lambda g: {f"arm_{k}": a for k, a in enumerate(g["per_arm"])},
    ("backlash", "backlash"): lambda g: {"play": g["gap"]},
    ("droop", "arm_twist"): lambda g: {"twist": -g["angle"] / (2 * HOVER_THRUST)},
    ("weak_rotor", "rotor_thrust"): _rotors,
    ("thin_air", "thrust_scale"): lambda g: {"scale": -g["missing"]},
    ("wind", "wind"): lambda g: {
        "velocity_x": g["speed"] * np.cos(g["heading"]),
        "velocity_y": g["speed"] * np.sin(g["heading"]),
    },
    ("fan", "tether"): lambda g: {f"force_{axis}": g[axis] for axis in "xyz"},
    ("jet", "constant_wrench"): _jet,
    ("drag_torque", "drag_torque"): lambda g: {"change": g["relative"]},
    ("gyroscopic", "rotor_gyroscopic"): lambda g: {"inertia": g["inertia"]},
    ("imu_turned", "imu_misalignment"): _xyz,
    ("imu_moved", "imu_lever_arm"): _xyz,
}
"""(hidden effect, catalogue effect) to the true values of the latter's parameters."""


def true_values(truth: Truth) -> dict[str, Values]:
    """By catalogue effect: what its parameters really are on this flight, as far as that can be said."""
    out: dict[str, Values] = {}
    for (hidden, named), values in TRUE.items():
        if hidden in truth.effects:
            out[named] = values(truth.parameters[hidden])
    return out
