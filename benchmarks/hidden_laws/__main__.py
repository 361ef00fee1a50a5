"""Whether `discover` finds hidden laws, and nothing where none is: python -m benchmarks.hidden_laws; then --page.

    laws      those of `laws`, on the quadrotor (seeds N, N + 1, ...) and on the hexarotor in MuJoCo
    memory    what has a state of its own (`hidden_effects`: slosh, rope, ringing, resonance): no law is right
    nothing   nothing, gusts, motors logged at 10 Hz, an IMU stamped early: no law is right

Each flight lasts 40 s and is explained as a user would; laws are tested on a second flight. Seeds from 300 on were
flown once; smaller ones were looked at while `discover` was made.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import wrenchgap as wg
from benchmarks import pages
from benchmarks.hidden_effects import engine
from benchmarks.hidden_laws.flights import MODELS, flown, true_size
from benchmarks.hidden_laws.laws import LAWS
from tests.independent import flown_quadrotor as quadrotor
from wrenchgap.flight.errors import UsageError
from wrenchgap.flight.flight import Flight

DOCS = Path(__file__).parents[2] / "docs"
KEPT, PAGE = DOCS / "hidden-laws.json", DOCS / "discover.md"
OWN = "law_force_w_cross_e_z"
"""What the hexarotor has by itself: its arms follow the turning hull within the 2.5 ms of their servos, so that 39 N of
thrust lag behind by 0.09 N s of body rate; no effect of the catalogue says it."""
SLOW = "motors at 10 Hz"
MEMORY = ("slosh", "slung_load", "ringing", "resonance")
NOTHING: dict[str, dict[str, float]] = {
    "nothing": {"excited": 1.0},
    "calm mission": {"excited": 0.15},
    "gusts": {"excited": 0.15, "gusts": 0.5},
    "strong gusts": {"excited": 1.0, "gusts": 1.0},
    "hover in gusts": {"gusts": 0.7},
    SLOW: {"excited": 0.3, "motor_hz": 10.0, "gusts": 0.3},
    "IMU 4 ms early": {"excited": 1.0, "imu_early": 0.004},
}


Case = tuple[str, str, str, Callable[[], list[Flight]]]


def cases(seed: int) -> Iterator[Case]:
    """Kind, name, vehicle, and what flies two flights: one to search, one to test on."""
    for vehicle in MODELS:
        for name, law in LAWS.items():
            if vehicle in law.vehicles:
                seed += 1
                yield "law", name, vehicle, partial(flights_of, name, vehicle, law.kind, seed)
    for name in MEMORY:
        seed += 1
        yield "memory", name, "hexarotor", partial(remembering, name, seed)
    for name, how in NOTHING.items():
        for _ in range(2):
            seed += 1
            both = [quadrotor.Case(f"{name}-{s}", seed=s, seconds=44.0, **how) for s in (seed, seed + 500)]  # type: ignore[arg-type]
            yield "nothing", f"{name} {seed}", "quadrotor", partial(quadrotor.fly, both)


def flights_of(name: str, vehicle: str, kind: str, seed: int) -> list[Flight]:
    """With a hidden law."""
    return [flown(vehicle, name, 1.0, kind, s) for s in (seed, seed + 500)]


def remembering(name: str, seed: int) -> list[Flight]:
    """With what has a state of its own."""
    return [engine.fly(name, None, "train", 40.0, s)[0] for s in (seed, seed + 500)]


def judged(kind: str, name: str, vehicle: str, flights: list[Flight]) -> dict[str, Any]:
    """What `discover` said of one case."""
    model = MODELS[vehicle]()
    cutoff = 3.8 if name.startswith(SLOW) else None  # as the command asks for where motors come at 10 Hz
    train, test = wg.open_flights(flights, model, cutoff_hz=cutoff, accept=("rate",) if cutoff else ())
    found = wg.discover(train, model, validate=test)
    own = OWN if vehicle == "hexarotor" else ""
    hidden = [law for law in found.laws if law.name != own]  # what is said of the hidden law
    said = [n for law in hidden[:1] for n in (law.name, *(n for n, _ in law.alike))]
    right = kind == "law" and any(re.match(f"law_{p}", n) for p in LAWS[name].right for n in said)
    itself = right and any(re.match(f"law_{p}", hidden[0].name) for p in LAWS[name].right)
    values = hidden[0].coefficients if itself else ()  # those of one that predicts the same are others
    lead = max(values, key=lambda c: abs(c.value), default=None)
    size = true_size(name, vehicle) if kind == "law" else np.nan
    return {
        "kind": kind, "name": name, "vehicle": vehicle, "verdict": str(found.explanation.verdict),
        "named": list(found.explanation.effects), "outcome": str(found.outcome), "right": right,
        "formula": hidden[0].formula if hidden else "", "gone": found.gone, "laws": len(hidden),
        "off_sigma": None if lead is None else abs(abs(lead.value) - size) / max(lead.std, 1e-12),
    }  # fmt: skip


def rows(seed: int, known: Sequence[dict[str, Any]]) -> Iterator[dict[str, Any]]:
    """What was measured, as it comes; of `known` cases nothing."""
    done = {(r["kind"], r["name"], r["vehicle"]) for r in known}
    for *case, fly in cases(seed):
        if tuple(case) in done:
            continue
        try:
            yield judged(*case, fly())
        except UsageError as lost:  # the vehicle could not be flown with it
            yield dict(zip(("kind", "name", "vehicle"), case, strict=True)) | {"lost": str(lost)}


def table(found: list[dict[str, Any]], load: str) -> str:
    """In Markdown: a row for each case with a law, then counts."""
    lines = []
    for r in found:
        if "lost" in r:
            lines.append((r["name"], r["vehicle"], "", "the flight was lost", "", ""))
        elif r["kind"] == "law":
            said = r["formula"] or {"nothing": f"named: {', '.join(r['named'])}"}.get(r["outcome"], "no law")
            right = "no" if not r["right"] else "in its class" if r["off_sigma"] is None else "yes"
            sigma = "" if r["off_sigma"] is None else f"{r['off_sigma']:.1f}"
            lines.append((r["name"], r["vehicle"], right, said.replace("|", "\\|"), f"{100 * r['gone']:.0f}", sigma))
    for kind in ("memory", "nothing"):
        own = [r for r in found if r["kind"] == kind and "lost" not in r]
        wrong = [f"{r['name']}: {r['formula']}" for r in own if r["laws"]]
        lines.append((f"{kind}, {len(own)} flights", "", f"{len(wrong)} false", "; ".join(wrong), "", ""))
    return pages.markdown(("hidden", "vehicle", "right", "said", "gone, %", "off by, sigma"), lines, load)


def main() -> None:
    """Measure; with --page, renew the page from what was kept."""
    parser = pages.options(__doc__)
    parser.add_argument("--seed", type=int, default=300)
    asked = parser.parse_args()
    if asked.page:
        kept = json.loads(KEPT.read_text(encoding="utf-8"))
        pages.renew(PAGE, {"hidden-laws": table(kept, "")})
        return
    asked.json = asked.json or KEPT
    known = json.loads(asked.json.read_text(encoding="utf-8")) if asked.json.exists() else []
    pages.measure(asked, "hidden-laws", rows(asked.seed, known), table, known)


if __name__ == "__main__":
    main()
