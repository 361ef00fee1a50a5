"""Batches in sentences, tables and JSON."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from wrenchgap.learn.data.errors import force_and_torque
from wrenchgap.learn.posterior.fleet_ranking import RankedSet
from wrenchgap.plant.effects import find
from wrenchgap.replay.batch.driver import Batch
from wrenchgap.replay.batch.fleet import FleetRanking
from wrenchgap.replay.batch.tasks import Plan, model_of
from wrenchgap.replay.present.numbers import entries, number
from wrenchgap.replay.present.tables import Line, Part, table

HELD_OUT = (
    "weight: share of the sets ranked   gain: how much better than no effect a set predicts flights that were held out "
    "(sum of log likelihoods)   better: share of the flights   left: rms on them over that with no effect, force and "
    "torque"
)
IN_SAMPLE = (
    "weight: share of the sets ranked   gain and left are in-sample: fewer than three flights cannot be held out   "
    "left: rms over that with no effect, force and torque"
)


def parts(found: Batch, most: int = 10) -> list[Part]:
    """What is printed, with `most` of the logs that failed."""
    out: list[Part] = [Line(summary(found), "bold"), Line(), _by_vehicle(found)]
    for one in found.rankings:
        out += _ranking(one)
    if found.rankings and not found.settled:
        out.append(
            Line("note: values still move from pass to pass; --passes takes candidates nearer to where they fit", "dim")
        )
    if failures := found.failures:
        rows = [(r["log"], r["reason"]) for r in failures[:most]]
        out.append(table("logs that failed", ("log", "reason"), rows, left=2))
        if len(failures) > most:
            out.append(Line(f"and {len(failures) - most} more; all are rows of the table", "dim"))
    return out


def summary(found: Batch) -> str:
    """One sentence."""
    failed = len(found.failures)
    new, before, same = len(found.outcome.rows), found.outcome.before, len(found.outcome.same)
    text = f"{len(found.rows)} logs: {len(found.rows) - failed} done, {failed} failed"
    text += f" ({new} now, {before} before" + (f"; {same} more have the content of another" if same else "") + ")."
    return f"{text} Rows: {found.output}"


def _by_vehicle(found: Batch) -> Part:
    """One row for each vehicle."""
    heads = {"inspect": ("ok", "warn", "bad"), "changed": ("verdicts",)}.get(found.plan.command)
    if found.plan.command == "compare":
        heads = ("nominal force [N]", "torque [Nm]", "model force [N]", "torque [Nm]")
    rows = []
    for vehicle in sorted({r["vehicle"] for r in found.rows}):
        own = [r for r in found.rows if r["vehicle"] == vehicle]
        good = [r for r in own if r["status"] == "ok"]
        seconds = sum(r["seconds"] or 0.0 for r in good)
        cells = (len(own), len(own) - len(good), number(seconds))
        rows.append((vehicle, *cells, *_of_command(found.plan.command, good)))
    return table("by vehicle", ("vehicle", "logs", "failed", "flight [s]", *(heads or ())), rows)


def _of_command(command: str, rows: Sequence[Mapping[str, Any]]) -> list[str]:
    verdicts = [r["verdict"] for r in rows]
    if command == "inspect":
        return [str(verdicts.count(level)) for level in ("ok", "warn", "bad")]
    if command == "changed":
        counted = {v: verdicts.count(v) for v in dict.fromkeys(verdicts)}
        return [", ".join(f"{v} {count}" for v, count in counted.items())]
    if command == "compare":
        return [number(v) for name in ("rms_nominal", "rms") for v in median_rms(rows, name)]
    return []


def median_rms(rows: Sequence[Mapping[str, Any]], name: str) -> list[float]:
    """Median over flights of the rms of force [N] and torque [Nm], each over its measured axes; NaN without any."""
    sizes = [force_and_torque(np.array(r[name], dtype=float)) for r in rows if r[name] is not None]
    known = [column[~np.isnan(column)] for column in np.reshape(sizes, (-1, 2)).T]
    return [float(np.median(column)) if len(column) else np.nan for column in known]


def _ranking(one: FleetRanking, most: int = 5, least: float = 0.01) -> list[Part]:
    """A vehicle: `most` of the sets whose weight is `least` or more."""
    if one.ranking is None:
        return [*_repeats(one), Line(f"{one.vehicle}: not ranked: {one.reason}", "yellow")]
    r = one.ranking
    title = f"{one.vehicle}: which effects are missing, {len(r.flights)} flights of {number(r.seconds)} s in all"
    rows = []
    for s in [s for s in r.sets if s.weight >= least or s is r.sets[0]][:most]:
        left = force_and_torque(s.rms) / np.maximum(force_and_torque(r.rms), 1e-150)
        cells = [f"{100 * s.weight:.0f} %", number(s.log_odds), number(s.gain), f"{100 * s.better:.0f} %"]
        named = ", ".join(s.names) or "nothing"
        cells += ["-" if np.isnan(v) else f"{100 * v:.0f} %" for v in left]
        rows.append((named, ", ".join(s.keys) or "-", *cells))
    heads = ("effects named", "set", "weight", "log odds", "gain", "better", "left, force", "torque")
    found: list[Part] = [*_repeats(one), table(title, heads, rows, left=2)]
    alike = list(dict.fromkeys(" + ".join(s.names) or "nothing" for s in r.groups[0]))
    if len(alike) > 1:
        weight = sum(s.weight for s in r.groups[0])
        words = f"indistinguishable, as far as laws are known, and together {100 * weight:.0f} %: "
        found.append(Line(words + " or ".join(alike[:most])))
    found.append(Line(HELD_OUT if r.held_out else IN_SAMPLE, "dim"))
    values = []
    for key in r.sets[0].keys:
        pairs = zip(r.sets[0].theta[key], r.sets[0].std[key], strict=True)
        values.append(f"{key}: {', '.join(f'{number(float(v))} +- {number(float(s), 2)}' for v, s in pairs)}")
    return [*found, *([Line("; ".join(values))] if values else []), Line()]


def _repeats(one: FleetRanking) -> list[Line]:
    """How many logs are of a flight that another log has, with the first of them."""
    if not one.repeats:
        return []
    log, other = next(iter(one.repeats.items()))
    several = f"{len(one.repeats)} logs hold the flight" if len(one.repeats) > 1 else "1 log holds the flight"
    return [Line(f"{one.vehicle}: {several} of another, and count once with it: {log} is {other}.", "yellow")]


def to_json(found: Batch) -> dict[str, Any]:
    """The body of the `batch` schema."""
    columns = ("log", "vehicle", "date", "flight", "status", "seconds", "verdict", "rms", "cpu_s")
    return {
        **entries(found, "command=plan.command", "output", "passes=plan.number", "settled"),
        "logs": len(found.rows),
        "failed": len(found.failures),
        "done_now": len(found.outcome.rows),
        "done_before": found.outcome.before,
        "same": [{"log": log, "as": other} for log, other in found.outcome.same.items()],
        "failures": [{k: r[k] for k in ("log", "vehicle", "reason")} for r in found.failures],
        "rows": [{k: r.get(k) for k in columns} for r in found.rows],
        "rankings": [_ranking_json(one, found.plan) for one in found.rankings],
    }


def _ranking_json(one: FleetRanking, plan: Plan) -> dict[str, Any]:
    r = one.ranking
    repeats = [{"log": log, "as": other} for log, other in one.repeats.items()]
    if r is None:
        return {"vehicle": one.vehicle, "reason": one.reason, "repeats": repeats, "sets": []}
    return {
        "vehicle": one.vehicle,
        "repeats": repeats,
        "reason": "",
        **entries(r, "flights", "seconds", "held_out", "rms", "left_out"),
        "effects": [{"effect": n, "probability": p} for n, p in r.effects.items()],
        "sets": [_set_json(s, plan, one.vehicle) for s in r.sets],
        "groups": [
            {"weight": sum(s.weight for s in g), "sets": [{"effects": list(s.names), "weight": s.weight} for s in g]}
            for g in r.groups
        ],
        "alone": [{"candidate": k, "log_odds": v} for k, v in r.alone.items()],
    }


def _set_json(s: RankedSet, plan: Plan, vehicle: str) -> dict[str, Any]:
    values = []
    for key in s.keys:
        names = [(n, p) for n in key.split(" + ") for p in parameters(n, plan, vehicle)]
        for (effect, p), value, std in zip(names, s.theta[key], s.std[key], strict=True):
            values.append({"effect": effect, "name": p[0], "value": float(value), "std": float(std), "unit": p[1]})
    return {**entries(s, "set=keys", "effects=names", "weight", "log_odds", "gain", "better", "rms"), "values": values}


def parameters(effect: str, plan: Plan, vehicle: str) -> list[tuple[str, str]]:
    """Names and units of an effect's parameters on a vehicle."""
    text = plan.model_text(vehicle)
    return [] if text is None else [(p.name, p.unit) for p in find(effect).parameters(model_of(text).vehicle)]
