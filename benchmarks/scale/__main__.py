"""Fly the fleet, run what is missing, and renew docs/scale.md.

python -m benchmarks.scale fly --count 300
python -m benchmarks.scale run --minutes 60
python -m benchmarks.scale page
"""

from __future__ import annotations

import argparse
from pathlib import Path

from benchmarks.harm.rows import keep_on
from benchmarks.scale import fleet, runs
from benchmarks.scale.page import RESULTS, renew

COUNT = 300
MANY = 6000
"""Files that are no logs, for the memory of the scheduler."""
SMALLER = (30, 99)
"""Fleets for the cost per log against the number of logs."""


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description="What do thousands of logs cost?")
    parser.add_argument("what", choices=("fly", "run", "page"))
    parser.add_argument("--folder", type=Path, default=Path("demo-output/scale"))
    parser.add_argument("--count", type=int, default=COUNT)
    parser.add_argument("--minutes", type=float, default=60.0)
    a = parser.parse_args()
    logs, count = a.folder / "logs", a.count
    if a.what == "fly":
        fleet.make(logs, count)
        return
    if a.what == "run":
        whole, alone = a.folder / f"cluster-{count}", a.folder / f"serial-{count}"
        smaller = [f"cluster {n}" for n in SMALLER if n < count]
        jobs = {
            f"cluster {count}": lambda: runs.on_cluster(logs, whole, count, kill=True),
            f"ranking {count}": lambda: runs.ranked(whole),
            f"course {count}": lambda: runs.course(whole),
            f"serial {count}": lambda: runs.serial(logs, alone, count, 0.4 * a.minutes),
            f"difference {count}": lambda: runs.differences(whole, alone),
            f"refused {MANY}": lambda: runs.refused(a.folder / "refused", a.folder / f"refused-{MANY}", MANY),
        }
        for key in smaller:
            n = int(key.split()[1])
            jobs[key] = lambda n=n: runs.on_cluster(logs, a.folder / f"cluster-{n}", n, kill=False)
        keep_on(RESULTS, jobs, lambda key: jobs[key](), a.minutes)
    renew()


if __name__ == "__main__":
    main()
