"""Run what is missing of an experiment, for a while, and renew the page.

python -m benchmarks.harm vehicles --minutes 25
python -m benchmarks.harm parts --minutes 25
python -m benchmarks.harm smooth
python -m benchmarks.harm page
"""

from __future__ import annotations

import argparse

from benchmarks.harm import parts, rows, smooth, vehicles
from benchmarks.harm.page import renew


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description="Does a compensation ever harm?")
    parser.add_argument("what", choices=("vehicles", "parts", "smooth", "page"))
    parser.add_argument("--minutes", type=float, default=25.0)
    parser.add_argument("--vehicles", type=int, default=vehicles.VEHICLES)
    a = parser.parse_args()
    if a.what == "vehicles":
        keys = vehicles.keys(a.vehicles)
        rows.keep_on(rows.RESULTS / "vehicles.jsonl", keys, vehicles.one, a.minutes)
    if a.what == "parts":
        rows.keep_on(rows.RESULTS / "parts.jsonl", parts.keys(), parts.one, a.minutes)
        rows.complete(
            rows.RESULTS / "parts.jsonl",
            lambda row: not parts.FEEDBACK.keys() <= row.keys(),
            lambda row: parts.by_feedback(row["key"], row["told"]),
        )
    if a.what == "smooth":
        rows.keep_on(rows.RESULTS / "smooth.jsonl", smooth.keys(), smooth.one, a.minutes)
    renew()


if __name__ == "__main__":
    main()
