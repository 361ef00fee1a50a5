"""One flight flown, explained and judged; a row of plain values."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from benchmarks.hidden_effects.cases import UNSEEN, Case
from benchmarks.hidden_effects.engine import Truth, fly
from benchmarks.hidden_effects.truths import true_values
from wrenchgap import compare, explain, open_flights
from wrenchgap.learn.identify.explain import Explanation
from wrenchgap.plant.model import Model
from wrenchgap.replay.present import explanation
from wrenchgap.replay.present.documents import plain

Row = dict[str, Any]


def run(case: Case, model: Model) -> Row:
    """Fly, explain, judge."""
    recorded, truth = fly(
        case.flown,
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
                "rivals": [[r.name, r.separation, r.cosine, r.candidate.worthy] for r in m.rivals],
            }
            for m in found.members
        ],
        "swing": None if found.oscillation is None else explanation.oscillation_in_words(found.oscillation),
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
    groups = {g[0]: list(g) for g in found.groups}
    expected = [a for answers in truth.answers for a in answers]
    main = [e for e in found.effects if e not in truth.always or e in expected]
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
    if set(answers) & set(main):
        return "name"
    return "group" if any(set(answers) & set(groups.get(m, ())) for m in main) else ""


def _parameters(found: Explanation, truth: Truth) -> list[Row]:
    """Fitted against true values, where the same quantity exists."""
    rows: list[Row] = []
    for effect, values in true_values(truth).items():
        fitted = explanation.values_json(found.fit.values(effect))
        rows += [{"effect": effect, **v, "true": float(values[v["name"]])} for v in fitted if v["name"] in values]
    return rows


def _unseen(case: Case, found: Explanation, model: Model) -> Row | None:
    """Share of the torque and force error above the noise that is gone on a flight of another kind."""
    if case.kind not in ("one", "two") or not found.effects:
        return None
    trajectory = UNSEEN[case.trajectory]
    seed = case.seed
    recorded, _ = fly(case.flown, case.sizes, trajectory, 25.0, seed, pair_split=case.split)
    compared = compare(open_flights(recorded, model), model, found.model)
    before, after = (compared.evaluations[k].pooled.rms for k in (0, -1))
    out: Row = {"trajectory": trajectory, "before": before.tolist(), "after": after.tolist()}
    for what, axes in (("force", slice(0, 3)), ("torque", slice(3, 6))):
        b, a, n = (float(np.linalg.norm(v[axes])) for v in (before, after, compared.noise))
        out[what] = (b - a) / (b - n) if b > 1.5 * n else None
    return out
