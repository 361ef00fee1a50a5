"""Fuzz the readers, model files, trajectories and stored GPs.

    python -m benchmarks.faults.fuzz --minutes 30 --findings /tmp/findings       # from the kept corpus and new seeds
    python -m benchmarks.faults.fuzz --try FINDING                               # one input again, with its traceback
    python -m benchmarks.faults.fuzz --keep                                      # the corpus kept anew, small

Exit code 1 where something was found.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.faults.fuzz import seeds
from benchmarks.faults.fuzz.targets import TARGETS

KEPT = Path(__file__).with_name("corpus")
WORK = Path(tempfile.gettempdir()) / "wrenchgap-fuzz"
TURN = 120
"""Seconds of one target before it is the next one's turn."""
LIMITS = ("-timeout=40", "-rss_limit_mb=3000", "-max_len=16384", "-print_final_stats=1", "-verbosity=0")
LARGEST, ALL = 4000, 30_000
"""Bytes of an input that is kept, and of all of a target."""


def turn(target: str, corpus: Path, findings: Path, seconds: int) -> dict[str, float]:
    """One turn of a target: executions, new inputs, and how long it took."""
    (corpus / target).mkdir(parents=True, exist_ok=True)
    known = [str(folder) for folder in (KEPT / target, WORK / "seeds" / target) if folder.is_dir()]
    findings.mkdir(parents=True, exist_ok=True)
    words = ["-m", "benchmarks.faults.fuzz.child", target, str(findings), str(corpus / target), *known, *LIMITS]
    words += [f"-max_total_time={seconds}", f"-artifact_prefix={findings / target}-"]
    start = time.monotonic()
    run = subprocess.run([sys.executable, *words], capture_output=True, text=True, errors="replace", check=False)
    found = dict(re.findall(r"stat::(\w+):\s*(\d+)", run.stderr))
    if not found:
        (findings / f"{target}-log.txt").write_text(run.stderr[-20000:], encoding="utf-8")
    return {
        "executions": int(found.get("number_of_executed_units", 0)),
        "new_inputs": int(found.get("new_units_added", 0)),
        "seconds": round(time.monotonic() - start, 1),
    }


def keep(corpus: Path) -> None:
    """Of every target the inputs that together cover most, small ones first, up to `ALL` bytes."""
    for target in TARGETS:
        found = (
            sorted((corpus / target).iterdir(), key=lambda p: p.stat().st_size) if (corpus / target).is_dir() else []
        )
        place = KEPT / target
        place.mkdir(parents=True, exist_ok=True)
        left = ALL - sum(p.stat().st_size for p in place.iterdir())
        for path in found:
            size = path.stat().st_size
            if size <= min(LARGEST, left) and not (place / path.name).exists():
                (place / path.name).write_bytes(path.read_bytes())
                left -= size


def main() -> None:
    """Take turns until the time is over."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=5.0)
    parser.add_argument("--target", action="append", choices=sorted(TARGETS))
    parser.add_argument("--findings", type=Path, default=WORK / "findings")
    parser.add_argument("--json", type=Path, help="what was done, written after every turn")
    parser.add_argument("--try", dest="again", type=Path, metavar="FINDING")
    parser.add_argument("--keep", action="store_true")
    asked = parser.parse_args()
    if asked.again is not None:
        TARGETS[asked.again.name.partition("-")[0]](asked.again.read_bytes())
        return
    if asked.keep:
        keep(WORK / "corpus")
        return
    seeds.write(WORK / "seeds")
    total = {target: {"executions": 0, "new_inputs": 0, "seconds": 0.0} for target in asked.target or TARGETS}
    end = time.monotonic() + 60.0 * asked.minutes
    while time.monotonic() < end:
        for target, sums in total.items():
            seconds = min(TURN * (2 if target == "log" else 1), int(end - time.monotonic()))
            if seconds < 1:
                break
            for key, value in turn(target, WORK / "corpus", asked.findings, seconds).items():
                sums[key] = round(sums[key] + value, 1)
            if asked.json is not None:
                asked.json.write_text(json.dumps(total, indent=1) + "\n", encoding="utf-8")
    found = sorted(asked.findings.iterdir())
    print(json.dumps(total))
    print("\n".join(map(str, found)) or "nothing found")
    sys.exit(bool(found))


if __name__ == "__main__":
    main()
