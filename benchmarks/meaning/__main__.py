"""The meaning suite.

    python -m benchmarks.meaning --json docs/reliability.json --page docs/reliability.md     # the published logs
    python -m benchmarks.meaning --only quad --fault stuck                                    # a few, printed
    python -m benchmarks.meaning --open-only ...             # opens and mends the logs, and does not explain them
    python -m benchmarks.meaning --rows rows.jsonl ...       # goes on where it was interrupted

Nothing that flies imports `plant` or above.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Iterator
from pathlib import Path

from benchmarks.faults.page import HEADING
from benchmarks.hidden_effects.engine import fly as fly_hexarotor
from benchmarks.meaning.faults import FAULTS, Fault
from benchmarks.meaning.flying import HEX, NANO, QUAD, Manner, fly
from benchmarks.meaning.healthy import healthy_of
from benchmarks.meaning.judge import Row, judge, plain, read
from benchmarks.meaning.page import detail, page
from benchmarks.pages import NOTES
from wrenchgap.flight.flight import Flight

ROOT = Path(__file__).resolve().parents[2]
CRAFTS = {craft.name: craft for craft in (QUAD, NANO, HEX)}
TILTING = "tilt_hexarotor"
SEED = 11
ASKED = ("excited", "hover without excitation", "cheap IMU", "aerobatics")
"""Healthy logs that are explained too."""
CALM = Manner(excitation=0.2, reach=0.5)
"""A flight that hardly excites anything, on which less can be seen."""


def flights(seed: int, only: str) -> Iterator[tuple[str, Flight, str, bool]]:
    """Vehicle, healthy flight, its model file's text, and whether its arms tilt."""
    for name, craft in CRAFTS.items():
        if only in ("", name):
            yield name, fly(craft, 16.0, seed), craft.model(), False
    if only in ("", TILTING):
        text = (ROOT / "models" / f"{TILTING}.toml").read_text(encoding="utf-8")
        yield TILTING, fly_hexarotor((), None, "train", 16.0, seed)[0], text, True
    if only in ("", "quad, calm"):
        yield "quad, calm", fly(QUAD, 16.0, seed, CALM), QUAD.model(), False


class Rows:
    """Rows as they come, in a file of lines; those that are there already are not made again."""

    def __init__(self, path: Path | None, folder: Path, *, explain: bool = True) -> None:
        self.path, self.folder, self.explain = path, folder, explain
        lines = path.read_text(encoding="utf-8").splitlines() if path is not None and path.exists() else []
        self.known = [(kind, read(row)) for kind, row in map(json.loads, lines)]

    def judged(self, kind: str, vehicle: str, flight: Flight, model: str, fault: Fault, *, ask: bool) -> Row:
        """The row of a log, printed."""
        for known, row in self.known:
            if (known, row.vehicle, row.fault) == (kind, vehicle, fault.name):
                return row
        row = judge(vehicle, flight, model, fault, self.folder, ask=ask and self.explain)
        print(_line(row), flush=True)
        if self.path is not None:
            with self.path.open("a", encoding="utf-8") as out:
                out.write(json.dumps((kind, plain(row))) + "\n")
        return row


def run(seed: int, only: str, words: str, rows: Rows) -> tuple[list[Row], list[Row]]:
    """Rows of faults, and of healthy logs."""
    faults, healthy = [], []
    for name, flight, model, tilting in flights(seed, only):
        for fault in FAULTS:
            if words in fault.name and fault.tilting in (None, tilting):
                faults.append(rows.judged("fault", name, flight, model, fault, ask=not tilting))
        if not words and name == TILTING:
            for trajectory in ("train", "figure8", "fast", "low"):
                flown = fly_hexarotor((), None, trajectory, 16.0, seed)[0]
                healthy.append(rows.judged("healthy", name, flown, model, Fault(trajectory, ()), ask=False))
    for name, craft in CRAFTS.items() if not words else ():
        if only in ("", name):
            for case, flight in healthy_of(craft, seed):
                ask = case in ASKED
                healthy.append(rows.judged("healthy", name, flight, craft.model(), Fault(case, ()), ask=ask))
    return faults, healthy


def _line(row: Row) -> str:
    said = "named" if row.named else "seen" if row.seen else "silent"
    firm = "" if row.firm is None else f"; firm {', '.join(row.firm) or 'nothing'}; wrong {row.wrong or 'nothing'}"
    return f"{row.vehicle}: {row.fault}: {said}; {', '.join(row.found)}; mended {row.mended}{firm}"


def main() -> None:
    """Run, print, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--only", default="", help="a vehicle")
    parser.add_argument("--fault", default="", help="words of a fault's name")
    parser.add_argument("--rows", type=Path, help="lines of rows, one for each log, that are not made again")
    parser.add_argument("--open-only", action="store_true", help="open and mend, without asking explain")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--page", type=Path)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        faults, healthy = run(
            asked.seed, asked.only, asked.fault, Rows(asked.rows, Path(folder) / "log", explain=not asked.open_only)
        )
    if asked.json is not None:
        rows = {"seed": asked.seed, "faults": [plain(r) for r in faults], "healthy": [plain(r) for r in healthy]}
        asked.json.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    if asked.page is not None:
        old = asked.page.read_text(encoding="utf-8") if asked.page.exists() else ""
        behind = old[old.index(f"\n{HEADING}") :] if HEADING in old else ""  # of the other benchmark, and by hand
        asked.page.write_text(page(faults, healthy, asked.seed) + behind, encoding="utf-8")
        (NOTES / "meaning.md").write_text(detail(faults, healthy, asked.seed), encoding="utf-8")


if __name__ == "__main__":
    main()
