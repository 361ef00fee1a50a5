"""Every attack of this folder, the table of benchmarks/notes/attacks.md, and its sums in docs/reliability.md.

python -m benchmarks.attacks --json docs/attacks.json --page docs/reliability.md
python -m benchmarks.attacks --only joblib          # those with this word in them, printed
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path
from time import perf_counter

from benchmarks.attacks import Attack, Outcome, areas
from benchmarks.pages import NOTES, Row, renew


def row(area: str, attack: Attack) -> Row:
    """Make one attack in a folder that is removed afterwards."""
    start = perf_counter()
    with tempfile.TemporaryDirectory(prefix="attack-") as folder:
        try:
            outcome = attack.run(Path(folder))
        except Exception as error:  # an attack that breaks off has shown nothing
            outcome = Outcome(False, f"broke off: {error!r}")
    return {
        "area": area,
        "attack": attack.what,
        "bound": attack.bound,
        "happened": outcome.happened,
        "held": outcome.held,
        "seconds": round(perf_counter() - start, 1),
    }


def cell(text: str) -> str:
    """Of a Markdown table."""
    return " ".join(text.replace("|", "\\|").replace("<", "&lt;").split())


HEAD = """# Notes: attacks

Written by `python -m benchmarks.attacks --page docs/reliability.md`; each row is a test too
(`tests/independent/test_attacks.py`). What holds, by area: [reliability](../../docs/reliability.md#attacks).

"""


def sums(rows: list[Row]) -> str:
    """Attacks and bounds that held, by area."""
    lines = ["| area | attacks | bound held |", "|---|---:|---:|"]
    for area in dict.fromkeys(row["area"] for row in rows):
        own = [row["held"] for row in rows if row["area"] == area]
        lines.append(f"| {area} | {len(own)} | {sum(own)} |")
    return "\n".join(lines)


def table(rows: list[Row]) -> str:
    """Attack, what happens, bound, by area."""
    lines = []
    for area in dict.fromkeys(row["area"] for row in rows):
        lines += [f"## {area}", "", "| attack | what happens | bound | held |", "|---|---|---|---|"]
        lines += [
            "| "
            + " | ".join([*(cell(row[k]) for k in ("attack", "happened", "bound")), "yes" if row["held"] else "**no**"])
            + " |"
            for row in rows
            if row["area"] == area
        ]
        lines.append("")
    return "\n".join([*lines, f"{sum(row['held'] for row in rows)} of {len(rows)} bounds held."])


def main() -> int:
    """Make the attacks, print them, write what was asked; exit code 1 where a bound was broken."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="", help="attacks with this word in area or description")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--page", type=Path)
    asked = parser.parse_args()
    rows = []
    for area, attacks in areas().items():
        for attack in attacks:
            if asked.only.lower() in f"{area} {attack.what}".lower():
                rows.append(row(area, attack))
                print(json.dumps(rows[-1]), flush=True)
    if asked.json is not None:
        asked.json.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    if asked.page is not None:
        renew(asked.page, {"attacks": sums(rows)})
        (NOTES / "attacks.md").write_text(f"{HEAD}{table(rows)}\n", encoding="utf-8")
    return 0 if rows and all(row["held"] for row in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
