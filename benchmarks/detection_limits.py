"""Whether the limits of what a log could have shown are right: effects injected at them, and at half of them.

    pip install -e '.[benchmark]'                                     # drone-models
    python -m benchmarks.detection_limits                             # others to tune on, first seed 0
    python -m benchmarks.detection_limits --seed 9400 --json docs/detection-limits.json --page docs/detection-limits.md

Flights of two independent engines, a tilt-arm hexarotor in MuJoCo and a quadrotor whose motors are logged at 25 and
400 Hz, with nothing or something hidden; and comparisons of one flight with three others of the same vehicle. Into
each, six effects are injected: three of its limits, drawn by lot, whole and halved. The second command flies the
published flights, which nobody tunes on.
"""

from __future__ import annotations

import argparse
import itertools
import json
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from time import process_time
from typing import Any

import drone_models  # noqa: F401  before scipy, whose arrays it chooses

import wrenchgap as wg
from benchmarks import pages
from benchmarks.autopilot_logs.__main__ import ANYWAY, HIDDEN, cutoff
from benchmarks.autopilot_logs.engine import QUAD, Case
from benchmarks.autopilot_logs.engine import fly as fly_quad
from benchmarks.hidden_effects import engine
from wrenchgap.plant.effects import family

INJECTIONS = 6
THERE = {"hexarotor": frozenset(engine.ALWAYS), "quadrotor": frozenset(ANYWAY)}
"""What the vehicles of the engines have anyway: its name is not wrong."""
FLOWN = ("hover", "train", "figure8", "mission", "turn")
"""Trajectories of the hexarotor."""


def flights(seed: int) -> Iterator[tuple[str, Any, wg.Model]]:
    """Names, opened flights, and the models that they are compared with."""
    hexarotor = wg.load_model("tilt_hexarotor")
    for k, (trajectory, hidden) in enumerate(itertools.product(FLOWN, ("none", "com_offset"))):
        flight = engine.fly(hidden, None, trajectory, seed=seed + k, seconds=40.0)[0]
        yield f"hexarotor.{trajectory}.{hidden}", wg.open_flights([flight], hexarotor), hexarotor
    kinds = itertools.product(("hover", "mission", "excited"), ((25.0, 50.0), (400.0, 200.0)), ("nothing", "mass"))
    cases = [
        Case(
            f"quadrotor.{flying}.{motor:g}.{hidden}", flying, motor, imu, seconds=45.0, seed=seed + 100 + k,
            hidden=(hidden,), **HIDDEN[hidden][0],
        )
        for k, (flying, (motor, imu), hidden) in enumerate(kinds)
    ]  # fmt: skip
    for case, flight in zip(cases, fly_quad(cases), strict=True):
        yield case.name, wg.open_flights([flight], QUAD.model, cutoff_hz=cutoff(case), accept=("rate",)), QUAD.model


def comparisons(seed: int) -> Iterator[tuple[str, Any, Any, wg.Model]]:
    """Names, a flight, three others of the same vehicle, and the model; nothing changed."""
    hexarotor = wg.load_model("tilt_hexarotor")
    for k, trajectory in enumerate(("hover", "train", "mission")):
        flown = [engine.fly("none", None, trajectory, seed=seed + 200 + 4 * k + n, seconds=30.0)[0] for n in range(4)]
        opened = wg.open_flights(flown, hexarotor)
        yield f"hexarotor.{trajectory}.changed", opened[:1], opened[1:], hexarotor
    for k, (flying, motor, imu) in enumerate((("hover", 25.0, 50.0), ("mission", 400.0, 200.0))):
        cases = [Case(f"{flying}.{n}", flying, motor, imu, seconds=45.0, seed=seed + 220 + 4 * k + n) for n in range(4)]
        opened = wg.open_flights(fly_quad(cases), QUAD.model, cutoff_hz=cutoff(cases[0]), accept=("rate",))
        yield f"quadrotor.{flying}.changed", opened[:1], opened[1:], QUAD.model


def row(name: str, ask: Callable[..., Any]) -> dict[str, Any]:
    """One answer: what could have been shown, and what was found again."""
    start = process_time()
    found = ask(injections=INJECTIONS, jobs=1)
    keys = ("effect", "parameter", "size", "share", "firm")
    return {
        "flight": name, "verdict": str(found.verdict), "firm": list(found.firm), "cpu_seconds": process_time() - start,
        "shown": sum(limit.shown for limit in found.limits), "limits": len(found.limits),
        "injected": [{**{k: getattr(r, k) for k in keys}, "others": list(r.others)} for r in found.recoveries],
    }  # fmt: skip


def wrong(row: dict[str, Any]) -> int:
    """Of how many injections another name was firm, of what is not there."""
    vehicle, _, what = row["flight"].split(".", 2)
    hidden = HIDDEN.get(what.rpartition(".")[2], ({}, ()))[1]
    there = frozenset() if what == "changed" else THERE[vehicle] | set(hidden)
    return sum(bool(set(map(family, i["others"])) - there) for i in row["injected"])


def kind_of(row: dict[str, Any]) -> str:
    """Vehicle and way of flying, or that flights were compared."""
    vehicle, flying, what = row["flight"].split(".", 2)
    return f"{vehicle}, changed" if what == "changed" else f"{vehicle}, {flying}"


def table(rows: list[dict[str, Any]]) -> str:
    """In Markdown: a line for each vehicle and way of flying."""
    lines = []
    for kind, group in itertools.groupby(rows, key=kind_of):
        own = list(group)
        injected = [i for r in own for i in r["injected"]]
        whole, half = ([i for i in injected if i["share"] == share] for share in (1.0, 0.5))
        lines.append((
            kind, str(len(own)), f"{sum(r['shown'] for r in own)} of {sum(r['limits'] for r in own)}",
            f"{sum(i['firm'] for i in whole)}/{len(whole)}", f"{sum(i['firm'] for i in half)}/{len(half)}",
            f"{sum(map(wrong, own))}/{len(injected)}",
        ))  # fmt: skip
    every = [i for r in rows for i in r["injected"]]
    whole = [i for i in every if i["share"] == 1.0]
    said = (
        f"In all: firm at its limit {sum(i['firm'] for i in whole)} of {len(whole)}; another firm name "
        f"{sum(map(wrong, rows))} of {len(every)}."
    )
    heads = ("flying", "flights", "parameters with a limit", "firm at it", "firm at half of it", "another firm name")
    return pages.markdown(heads, lines, said)


def by_effect(rows: list[dict[str, Any]]) -> str:
    """In Markdown: how many limits of each effect hold, by vehicle."""
    injected = [(r["flight"].split(".")[0], i) for r in rows for i in r["injected"] if i["share"] == 1.0]
    cells: dict[str, list[str]] = {}
    for effect in sorted({i["effect"] for _, i in injected}):
        for vehicle in THERE:
            own = [i["firm"] for v, i in injected if v == vehicle and i["effect"] == effect]
            cells.setdefault(effect, []).append(f"{sum(own)}/{len(own)}" if own else "-")
    return pages.markdown(("effect, firm at its limit", *THERE), [(n, *own) for n, own in cells.items()], "").strip()


def main() -> None:
    """Fly, explain, inject; write."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--page", type=Path)
    parser.add_argument("--every", type=int, default=1, help="only every so many of the flights")
    asked = parser.parse_args()
    rows: list[dict[str, Any]] = json.loads(asked.json.read_text()) if asked.json and asked.json.exists() else []
    done = {r["flight"] for r in rows}
    single = ((name, partial(wg.explain, opened, model)) for name, opened, model in flights(asked.seed))
    several = ((name, partial(wg.changed, one, others, model)) for name, one, others, model in comparisons(asked.seed))
    for name, ask in itertools.islice(itertools.chain(single, several), 0, None, asked.every):
        if name not in done:
            rows.append(row(name, ask))
            print(json.dumps(rows[-1]), flush=True)
            if asked.json:
                asked.json.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    text = {"limits": table(rows), "by effect": by_effect(rows)}
    print("\n\n".join(text.values()))
    if asked.page:
        pages.renew(asked.page, text)


if __name__ == "__main__":
    main()
