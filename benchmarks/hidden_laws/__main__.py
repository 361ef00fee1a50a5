"""Whether `discover` finds hidden laws, and nothing where none is: python -m benchmarks.hidden_laws; then --page.

    laws      those of `laws`, on the quadrotor (seeds N, N + 1, ...) and on the hexarotor in MuJoCo
    memory    what has a state of its own (`hidden_effects`: slosh, rope, ringing, resonance): no law is right
    nothing   nothing, gusts, motors logged at 10 Hz, an IMU stamped early: no law is right

Each flight lasts 40 s and is explained as a user would; laws are tested on a second flight. Seeds from 300 on were
flown once; smaller ones were looked at while `discover` was made.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import beta

import wrenchgap as wg
from benchmarks import pages
from benchmarks.hidden_effects import engine
from benchmarks.hidden_laws.flights import MODELS, flown, true_size
from benchmarks.hidden_laws.laws import LAWS
from tests.independent import flown_quadrotor as quadrotor
from wrenchgap.flight.errors import UsageError
from wrenchgap.flight.flight import Flight
from wrenchgap.replay.present.discovery import summary

DOCS = Path(__file__).parents[2] / "docs"
KEPT, PAGE = DOCS / "hidden-laws.json", DOCS / "discover.md"
OWN = "law_force_w_cross_e_z"
"""What the hexarotor has by itself: its arms follow the turning hull within the 2.5 ms of their servos, so that 39 N of
thrust lag behind by 0.09 N s of body rate; no effect of the catalogue says it."""
EXAMPLE = ("yaw4", "quadrotor")
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
    names = {f"law_{atom}" for atom in LAWS[name].right} if kind == "law" else set()
    itself = any(law.name in names for law in hidden[:1])
    right = itself or any(n in names for law in hidden[:1] for n, _ in law.equivalents)
    lead = hidden[0].coefficients[0] if itself else None  # those of one that predicts the same are others
    true = LAWS[name].sign * true_size(name, vehicle) if kind == "law" else np.nan
    return {
        "kind": kind, "name": name, "vehicle": vehicle, "verdict": str(found.explanation.verdict),
        "named": list(found.explanation.effects), "outcome": str(found.outcome), "right": right,
        "formula": hidden[0].formula if hidden else "", "energy_reduction": found.energy_reduction,
        "laws": len(hidden), "true": true if kind == "law" else None,
        "value": None if lead is None else lead.value, "std": None if lead is None else lead.std,
        "summary": summary(found),
    }  # fmt: skip


def rows(seed: int) -> Iterator[dict[str, Any]]:
    """What was measured, as it comes."""
    for *case, fly in cases(seed):
        try:
            yield judged(*case, fly())
        except UsageError as lost:  # the vehicle could not be flown with it
            yield dict(zip(("kind", "name", "vehicle"), case, strict=True)) | {"lost": str(lost)}


def table(found: list[dict[str, Any]], load: str) -> str:
    """In Markdown: a row for each case with a law, then counts."""
    lines = []
    for r in (r for r in found if r["kind"] == "law"):
        if "lost" in r:
            lines.append((r["name"], r["vehicle"], "", "the flight was lost", "", "", ""))
            continue
        said = r["formula"] or {"nothing": f"named: {', '.join(r['named'])}"}.get(r["outcome"], "no law")
        known = r["value"] is not None
        right = "no" if not r["right"] else "yes" if known else "in its class"
        values = (f"{r['true']:.3g}", f"{r['value']:.3g} +- {r['std']:.1g}") if known else ("", "")
        share = f"{100 * r['energy_reduction']:.0f}"
        lines.append((r["name"], r["vehicle"], right, said.replace("|", "\\|"), share, *values))
    heads = ("hidden", "vehicle", "right", "said", "energy gone, %", "true", "found")
    return f"{pages.markdown(heads, lines, load)}\n{counts(found)}"


def counts(found: list[dict[str, Any]]) -> str:
    """How many were right, false, and within what is stated."""
    flown = [r for r in found if "lost" not in r]
    laws, none = ([r for r in flown if (r["kind"] == "law") is which] for which in (True, False))
    unknown = [r for r in laws if r["verdict"] == "unknown"]
    false = [f"{r['name']}: {r['formula']}" for r in none if r["laws"]]
    most = beta.ppf(0.975, len(false) + 1, len(none) - len(false))
    searched = sum(not r["summary"][0].startswith("Nothing is left") for r in none)  # the others have no rest
    off = [abs(r["value"] - r["true"]) / r["std"] for r in laws if r["value"] is not None]
    return (
        f"Right: {sum(r['right'] for r in laws)} of {len(laws)}, {sum(r['right'] for r in unknown)} of {len(unknown)} "
        f"where `explain` says unknown. False: {len(false)} in {len(none)} flights without a law (95 % interval up to "
        f"{100 * most:.0f} %){'; '.join(['', *false])}; in {searched} of them something was left to search. "
        f"Coefficients within one standard deviation: {sum(x < 1.0 for x in off)} of {len(off)}, "
        f"within a third of one {sum(x < 1 / 3 for x in off)}."
    )


def main() -> None:
    """Measure; with --page, renew the page from what was kept."""
    parser = pages.options(__doc__)
    parser.add_argument("--seed", type=int, default=300)
    asked = parser.parse_args()
    if asked.page:
        kept = json.loads(KEPT.read_text(encoding="utf-8"))
        example = next(r for r in kept if (r["name"], r["vehicle"]) == EXAMPLE)
        text = "\n".join(["```text", *example["summary"], "```"])
        pages.renew(PAGE, {"hidden-laws": table(kept, ""), "hidden-laws-example": text})
        return
    asked.json = asked.json or KEPT
    pages.measure(asked, "hidden-laws", rows(asked.seed), table)


if __name__ == "__main__":
    main()
