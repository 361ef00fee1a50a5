"""`wrenchgap changed` and `explain` on real flights with labelled defects: CrazyPAD, drone E8, as a page and JSON.

    python -m benchmarks.real_defects FOLDER --json docs/real-defects.json --page docs/real-defects.md --notes FILE

FOLDER holds the flights as logs, named as CrazyPAD names them (`normal_flight__E8_log00*.mcap`,
`cut_propeller_M3_2mm_2mm_43mm__E8_log01*.mcap`), and the nominal model, `e8.toml`. Every answer is that of
`wrenchgap.changed`, which the command calls; those without healthy flights beside are `wrenchgap.explain`'s. Source of
the flights: CrazyPAD, Data 2024, 9, 79, MIT licence.
"""

from __future__ import annotations

import argparse
import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import wrenchgap as wg
from wrenchgap.learn.changed.changed import Baseline
from wrenchgap.learn.changed.places import towards
from wrenchgap.replay.present.changed import summary

ROTORS = ("M1", "M2", "M3", "M4")
"""What CrazyPAD calls the rotors, in the order of the model file."""
UNMEASURED = ("force_x", "force_y")
"""The logs hold no lateral accelerations."""
LIKELY = 0.05
"""Weight from which on a set of effects is part of what `explain` says."""
CARRIED = ("mass", "com_offset", "payload", "inertia")
"""Names that say a weight."""


@dataclass(frozen=True)
class Row:
    """One comparison. `kind` is "cut", "weight", "tape" or "healthy"; `blades` are the cuts of the two blades [mm].

    `firm` are firm effects, `where` the place of the sparse one with its probability, `change`, `uncertain` and
    `significance` those of the largest parameter; `alone` is the change that came nearest, with its log odds;
    `com_towards` where the centre of mass by itself would have moved, with how many standard deviations.
    """

    case: str
    kind: str
    blades: tuple[float, ...]
    suspect: tuple[str, ...]
    healthy: tuple[str, ...]
    verdict: str
    firm: tuple[str, ...]
    where: str
    probability: float
    effect: str
    change: float
    uncertain: float
    significance: float
    nothing: float
    odd: tuple[str, ...]
    alone: str
    log_odds: float
    com_towards: str
    com_significance: float
    com_mm: float
    summary: str


def case_of(path: Path) -> str:
    """`cut_propeller_M3_2mm_2mm_43mm__E8_log01_con.mcap` as `cut_propeller_M3_2mm_2mm_43mm`."""
    return path.name.split("__")[0]


def blades_of(case: str) -> tuple[float, ...]:
    """Millimetres that the two blades lack: of `..._2mm_1.5mm_43.5mm` (2.0, 1.5), of `..._2mm` (2.0, 0.0).

    The last number of three, and of two, is what is left of a propeller of 47 mm.
    """
    numbers = [float(n) for n in re.findall(r"_([\d.]+)mm", case)]
    if not numbers:
        return ()
    cuts = [n for n in numbers if n < 20.0]
    return (cuts[0], cuts[1] if len(cuts) > 1 else 0.0)


def kind_of(case: str) -> str:
    """Of a case by its name."""
    kinds = {"cut": "cut", "add": "weight", "tape": "tape", "normal": "healthy"}
    return kinds[case.split("_")[0]]


def judged(case: str, suspects: Sequence[Path], healthy: Sequence[Path], baseline: Baseline) -> Row:
    """One answer of what `wrenchgap.changed` calls as a row."""
    model = baseline.model
    found = baseline.against(wg.open_flights(suspects, model, unmeasured=UNMEASURED))
    largest = max(found.parameters, key=lambda p: p.significance, default=None)
    place = found.places[0] if found.places else None
    near = found.alone[0]
    offset = next((a for a in found.alone if a.effect == "com_offset"), None)
    by = {s.name: s for s in offset.sizes} if offset else {}
    x, y = (by[a].change if a in by else 0.0 for a in "xy")
    return Row(
        case,
        kind_of(case),
        blades_of(case),
        tuple(p.name for p in suspects),
        tuple(p.name for p in healthy),
        str(found.verdict),
        found.firm,
        place.where if place else "",
        place.probability if place else 0.0,
        largest.effect if largest else "",
        largest.change if largest else 0.0,
        float((largest.std**2 + largest.scatter**2) ** 0.5) if largest else 0.0,
        largest.significance if largest else 0.0,
        found.nothing,
        tuple(o.flight for o in found.odd),
        f"{near.effect} {near.largest.where or near.largest.name} {near.largest.change:+.3g} {near.largest.unit}",
        near.odds,
        towards(model.vehicle, x, y),
        offset.largest.significance if offset else 0.0,
        1e3 * float((x**2 + y**2) ** 0.5),
        summary(found),
    )


@dataclass(frozen=True)
class Explained:
    """What `explain` says of all flights of a case, without healthy ones beside.

    `sets` are likely sets of effects, heaviest first; `rotors` the thrusts of the rotors where they were fitted.
    """

    case: str
    kind: str
    blades: tuple[float, ...]
    flights: tuple[str, ...]
    verdict: str
    firm: tuple[str, ...]
    sets: tuple[tuple[tuple[str, ...], float], ...]
    rotors: dict[str, float]


def explained(case: str, flights: Sequence[Path], model: wg.Model) -> Explained:
    """One answer of `wrenchgap.explain`."""
    found = wg.explain(wg.open_flights(flights, model, unmeasured=UNMEASURED), model, jobs=1)
    return Explained(
        case,
        kind_of(case),
        blades_of(case),
        tuple(p.name for p in flights),
        str(found.verdict),
        found.firm,
        tuple((s.names, round(s.weight, 4)) for s in found.posterior.sets if s.weight >= LIKELY),
        {
            ROTORS[int(v.name.removeprefix("rotor_"))]: v.value
            for s in found.fit.snapshot
            if s.effect == "rotor_thrust"
            for v in s.values
        },
    )


def comparisons(folder: Path) -> Iterator[tuple[str, list[Path], list[Path]]]:
    """Cases with all healthy flights, both flights together and each by itself; then healthy against healthy."""
    normal = sorted(folder.glob("normal_flight__E8*.mcap"))
    defects = [p for p in sorted(folder.glob("*__E8*.mcap")) if p not in normal]
    for case in dict.fromkeys(map(case_of, defects)):
        yield case, [p for p in defects if case_of(p) == case], normal
    for one in sorted(defects, key=lambda p: -min(blades_of(case_of(p)), default=0.0)):
        yield case_of(one), [one], normal
    for one in normal:
        yield "normal_flight", [one], [p for p in normal if p != one]
    for first in normal:
        for second in normal:
            if first != second:
                yield "normal_flight", [second], [first]


def main() -> None:
    """Judge all, write JSON as rows come, and the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--json", type=Path, required=True)
    parser.add_argument("--page", type=Path)
    parser.add_argument("--notes", type=Path)
    parser.add_argument("--only", default="", help="cases whose name holds this")
    given = parser.parse_args()
    model = wg.load_model(given.folder / "e8.toml")
    model = replace(model, vehicle=replace(model.vehicle, rotor_names=ROTORS))
    kept = json.loads(given.json.read_text()) if given.json.exists() else {}
    rows, alone = kept.get("rows", []), kept.get("explained", [])
    known: tuple[list[Path], Baseline] | None = None
    done = {(tuple(r["suspect"]), tuple(r["healthy"])) for r in rows}

    def keep() -> None:
        given.json.write_text(json.dumps({"rows": rows, "explained": alone}, indent=1) + "\n", encoding="utf-8")

    for case, suspects, healthy in comparisons(given.folder):
        key = (tuple(p.name for p in suspects), tuple(p.name for p in healthy))
        if given.only not in case or key in done:
            continue
        if known is None or known[0] != healthy:
            known = healthy, Baseline(wg.open_flights(healthy, model, unmeasured=UNMEASURED), model, jobs=1)
        rows.append(asdict(judged(case, suspects, healthy, known[1])))
        print(f"{case}: {rows[-1]['summary']}", flush=True)
        keep()
    flights = sorted(given.folder.glob("*__E8*.mcap"))
    for case in sorted(set(map(case_of, flights)) - {r["case"] for r in alone}):
        if given.only in case:
            alone.append(asdict(explained(case, [p for p in flights if case_of(p) == case], model)))
            print(f"explain {case}: {alone[-1]['verdict']}, firm {alone[-1]['firm']}", flush=True)
            keep()
    if given.page is not None:
        from benchmarks.real_defects_page import page

        given.page.write_text(page(rows), encoding="utf-8")
    if given.notes is not None:
        from benchmarks.real_defects_page import detail

        given.notes.write_text(detail(rows, alone), encoding="utf-8")


if __name__ == "__main__":
    main()
