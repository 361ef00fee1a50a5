"""Fuzz the readers, model files, trajectories and stored GPs.

    python -m benchmarks.faults.fuzz --minutes 30 --findings /tmp/findings       # from the kept corpus and new seeds
    python -m benchmarks.faults.fuzz --minutes 60 --json docs/fuzz.json --page docs/reliability.md
    python -m benchmarks.faults.fuzz --try FINDING                               # one input again, with its traceback
    python -m benchmarks.faults.fuzz --keep                                      # the corpus kept anew, small

Minutes are of processor time, so that a run on a busy machine does as much. With `--json` an interrupted run goes on
where it was. Exit code 1 where something was found.
"""

from __future__ import annotations

import argparse
import json
import re
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.faults.fuzz import seeds
from benchmarks.faults.fuzz.page import with_section
from benchmarks.faults.fuzz.targets import TARGETS

KEPT = Path(__file__).with_name("corpus")
WORK = Path(tempfile.gettempdir()) / "wrenchgap-fuzz"
TURN = 120
"""Seconds of one target before it is the next one's turn."""
LIMITS = (
    "-timeout=60",
    "-report_slow_units=60",
    "-rss_limit_mb=3000",
    "-max_len=16384",
    "-print_final_stats=1",
    "-verbosity=1",
)
LARGEST, ALL = 4000, 30_000
"""Bytes of an input that is kept, and of all of a target."""


def turn(target: str, corpus: Path, findings: Path, seconds: int) -> dict[str, float]:
    """One turn of a target: executions, new inputs, seconds by clock and of the processor, branches reached so far."""
    (corpus / target).mkdir(parents=True, exist_ok=True)
    places = [KEPT / target, WORK / "seeds" / target]
    if target == "compiled":  # begins with what was found with interpreted kernels
        places += [KEPT / "log", WORK / "seeds" / "log", corpus / "log"]
    known = [str(folder) for folder in places if folder.is_dir()]
    findings.mkdir(parents=True, exist_ok=True)
    old = inputs(findings)
    words = ["-m", "benchmarks.faults.fuzz.child", target, str(findings), str(corpus / target), *known, *LIMITS]
    words += [f"-max_total_time={seconds}", f"-artifact_prefix={findings / target}-"]
    start, before = time.monotonic(), resource.getrusage(resource.RUSAGE_CHILDREN)
    run = subprocess.run([sys.executable, *words], capture_output=True, text=True, errors="replace", check=False)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    found = dict(re.findall(r"stat::(\w+):\s*(\d+)", run.stderr))
    branches = re.findall(r"\b(INITED|DONE)\s+cov: (\d+)", run.stderr)
    if not found:
        (findings / f"{target}-log.txt").write_text(run.stderr[-20000:], encoding="utf-8")
    new = inputs(findings) - old
    for path in new:
        if passes(path):  # slow on a busy machine, and nothing else
            path.unlink()
    return {
        "found": len(new & inputs(findings)),
        "executions": int(found.get("number_of_executed_units", 0)),
        "new_inputs": int(found.get("new_units_added", 0)),
        "seconds": round(time.monotonic() - start, 1),
        "processor_s": round(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, 1),
        "branches_before": int(branches[0][1]) if branches else 0,
        "branches": int(branches[-1][1]) if branches else 0,
    }


def inputs(findings: Path) -> set[Path]:
    """The inputs that were found."""
    return {path for path in findings.iterdir() if path.suffix != ".txt"}


def passes(finding: Path) -> bool:
    """Whether an input, tried again alone, ends as it should."""
    words = ["-m", "benchmarks.faults.fuzz", "--try", str(finding)]
    try:
        return subprocess.run([sys.executable, *words], capture_output=True, timeout=120, check=False).returncode == 0
    except subprocess.TimeoutExpired:
        return False


def add(sums: dict[str, float], found: dict[str, float]) -> None:
    """Add a turn to a target's sums; branches are not added: the corpus of one turn is where the next begins."""
    for key, value in found.items():
        if key == "branches_before":
            sums[key] = sums.get(key) or value
        elif key == "branches":
            sums[key] = max(sums.get(key, 0), value)
        else:
            sums[key] = round(sums.get(key, 0) + value, 1)


def keep(corpus: Path) -> None:
    """Of every target the inputs that together cover most, small ones first, up to `ALL` bytes."""
    for target in TARGETS:
        if target == "compiled":  # has the inputs of log
            continue
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


def run(targets: list[str], minutes: float, findings: Path, kept: Path | None) -> dict[str, dict[str, float]]:
    """Take turns until so many minutes of processor time are over; what `kept` has is part of them."""
    total: dict[str, dict[str, float]] = {target: {} for target in targets}
    if kept is not None and kept.exists():
        total |= json.loads(kept.read_text(encoding="utf-8"))

    def left() -> int:
        return int(60.0 * minutes - sum(sums.get("processor_s", 0.0) for sums in total.values()))

    while left() >= 1:
        for target in sorted(targets, key=lambda target: total[target].get("processor_s", 0.0)):
            seconds = min(TURN * (2 if target == "log" else 1), left())
            if seconds < 1:
                break
            add(total[target], turn(target, WORK / "corpus", findings, seconds))
            if kept is not None:
                kept.write_text(json.dumps(total, indent=1) + "\n", encoding="utf-8")
    return total


def main() -> None:
    """Take turns until the time is over."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=5.0, help="of processor time, all targets together")
    parser.add_argument("--target", action="append", choices=sorted(TARGETS))
    parser.add_argument("--findings", type=Path, default=WORK / "findings")
    parser.add_argument("--json", type=Path, help="what was done, written after every turn; a run goes on from it")
    parser.add_argument("--page", type=Path, help="the page whose section is written anew")
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
    total = run(list(asked.target or TARGETS), asked.minutes, asked.findings, asked.json)
    found = sorted(inputs(asked.findings))
    if asked.page is not None:
        asked.page.write_text(with_section(asked.page.read_text(encoding="utf-8"), total), encoding="utf-8")
    print(json.dumps(total))
    print("\n".join(map(str, found)) or "nothing found")
    sys.exit(bool(found))


if __name__ == "__main__":
    main()
