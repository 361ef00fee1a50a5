"""What half and twice of each number that the search decides by does to its answers.

    python -m benchmarks.search_settings --json docs/search-settings.json --page docs/search-settings.md

The flights are of the engine of `benchmarks.hidden_effects`, at seeds that its published flights do not have.
Candidates are linearised once a flight; the rest of the search is done anew for every number
(`learn.posterior.settings`).
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from benchmarks import pages
from benchmarks.hidden_effects import cases
from benchmarks.hidden_effects.engine import fly
from benchmarks.hidden_effects.judge import judge
from wrenchgap import open_flights
from wrenchgap.learn.data.candidates import candidates
from wrenchgap.learn.data.dataset import dataset
from wrenchgap.learn.diagnose.timing import answering_axes, timing_of
from wrenchgap.learn.posterior import explain as searching
from wrenchgap.learn.posterior.sensor_causes import sensor_causes
from wrenchgap.learn.posterior.settings import DEFAULT, SearchSettings
from wrenchgap.plant import model_file
from wrenchgap.plant.effects import family


def varied(name: str, factor: float) -> SearchSettings:
    """With half or twice of one number; of a share that is nearly all, of what it lacks: twice is nearer to one."""
    value = getattr(DEFAULT, name)
    if name in ("firm", "certain"):
        new = 1.0 - (1.0 - value) / factor
    else:
        new = type(value)(max(1, round(factor * value))) if isinstance(value, int) else factor * value
    return replace(DEFAULT, **{name: new})


def sample(seed: int, every: int) -> list[cases.Case]:
    """Flights with one effect, with two, with none, and with what is in no catalogue."""
    flown = [c for c in cases.everything(seed) if not c.scales or min(c.scales) >= cases.SMALL]
    return flown[::every]


def answers(case: cases.Case) -> Callable[[SearchSettings], dict[str, Any]]:
    """What is said of one flight with given settings."""
    model = model_file.load("tilt_hexarotor")
    recorded, truth = fly(
        case.effects, case.sizes or None, case.trajectory, case.seconds, case.seed, pair_split=case.split,
        crisp=case.crisp,
    )  # fmt: skip
    opened = open_flights(recorded, model)
    timing = tuple(timing_of(f, model) for f in opened)
    data = dataset([r for f in opened for r in f.records], model, answering_axes(timing))
    chosen = candidates(data.records, model)
    causes = sensor_causes([f.flight for f in opened], timing)
    expected = {family(a) for given in truth.answers for a in given} | {family(a) for a in truth.always}

    def answer(settings: SearchSettings) -> dict[str, Any]:
        found = searching.search_dataset(data, model, chosen, causes=causes, settings=settings)
        firm = sorted({family(n) for n in found.firm})
        return {
            "verdict": str(found.verdict), "firm": firm, "right": judge(found, truth)["right"],
            "wrong": [n for n in firm if n not in expected],
        }  # fmt: skip

    return answer


def remembered(compute: Callable[..., Any]) -> Callable[..., Any]:
    """Candidates by themselves depend on no setting: what was found of the same data is found again."""
    known: dict[tuple[Any, ...], Any] = {}

    def single_effects(on: Any, *args: Any, **more: Any) -> Any:
        key = (on.data.answering, len(on.data.records))
        if key not in known:
            known[key] = compute(on, *args, **more)
        return known[key]

    return single_effects


def run(case: cases.Case) -> dict[str, Any]:
    """All answers for one flight, by setting and factor."""
    compute, limits = searching.single_effects, searching.detection_limits
    searching.single_effects = remembered(compute)  # type: ignore[assignment]
    searching.detection_limits = lambda *a: ()  # which would take half of the time
    try:
        answer = answers(case)
        row = {"case": case.name, "as set": answer(DEFAULT)}
        for f in fields(SearchSettings):
            row |= {f"{f.name} x{factor:g}": answer(varied(f.name, factor)) for factor in (0.5, 2.0)}
        return row
    finally:
        searching.single_effects, searching.detection_limits = compute, limits


def table(rows: list[dict[str, Any]]) -> str:
    """In Markdown, by setting."""
    lines = []
    for f in fields(SearchSettings):
        cells = [f.name, f"{getattr(DEFAULT, f.name):g}"]
        for factor in (0.5, 2.0):
            own = [(r["as set"], r[f"{f.name} x{factor:g}"]) for r in rows]
            other = sum(a["firm"] != b["firm"] or a["verdict"] != b["verdict"] for a, b in own)
            wrong = sum(len(b["wrong"]) for _, b in own)
            firm = sum(len(b["firm"]) for _, b in own)
            cells += [f"{getattr(varied(f.name, factor), f.name):g}", str(other), f"{wrong} of {firm}"]
        lines.append(tuple(cells))
    wrong, firm = (sum(len(r["as set"][key]) for r in rows) for key in ("wrong", "firm"))
    load = f"{len(rows)} flights; as set, {wrong} of {firm} firm names are wrong."
    heads = (
        "setting",
        "is",
        "half",
        "answers that differ",
        "firm and wrong",
        "twice",
        "answers that differ",
        "firm and wrong",
    )
    return pages.markdown(heads, lines, load)


def main() -> None:
    """Fly, search, compare; write."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seed", type=int, default=9000)
    parser.add_argument("--every", type=int, default=12, help="only every so many of the flights")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--page", type=Path)
    asked = parser.parse_args()
    rows: list[dict[str, Any]] = json.loads(asked.json.read_text()) if asked.json and asked.json.exists() else []
    for case in sample(asked.seed, asked.every):
        if case.name not in {r["case"] for r in rows}:
            rows.append(run(case))
            print(case.name, json.dumps(rows[-1]["as set"]), flush=True)
            if asked.json:
                asked.json.write_text("[\n" + ",\n".join(map(json.dumps, rows)) + "\n]\n", encoding="utf-8")
    text = table(rows)
    print(text)
    if asked.page:
        pages.renew(asked.page, {"settings": text})


if __name__ == "__main__":
    main()
