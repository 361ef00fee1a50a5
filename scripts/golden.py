"""Golden results: run the commands over a set of logs, keep their JSON, and compare two such runs.

    python scripts/golden.py record FOLDER [--pairs FOLDER=MODEL] [--log LOG=MODEL]... [--command "wrenchgap"]
    python scripts/golden.py diff BEFORE AFTER [--tolerance 1e-6]

`record` runs inspect, compare, explain, add, learn, replay and counterfactual on every pair NAME.train.mcap and
NAME.test.mcap of a folder, on single logs (fitted and judged on the same), and on two vehicles that it simulates first.
`diff` compares numbers and identifiers, not sentences, and ends with exit code 1 where they differ.
"""

import argparse
import json
import math
import shlex
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

SIMULATED = {
    "hexarotor": ("voliro_x", "multi_axis", "pitch", "com_offset=x:-0.004,y:0.007,z:-0.005"),
    "quadrotor": ("asymmetric_quadrotor", "hover", "hover", "thrust_scale=scale:-0.08"),
}
"""Name: model, trajectory to fit, trajectory to judge, hidden effect."""
IGNORED = {
    "version",
    "solve_mean_ms",
    "solve_p99_ms",
    "solve_max_ms",
    "notes",
    "words",
    "summary",
    "warnings",
    "message",
    "reason",
    "file",
    "sha256",
}
"""Keys that may differ: times of the wall clock, prose, and files, which bear dates."""


class Runner:
    """Runs commands in a folder and keeps what each printed; a command that fails is a result too."""

    def __init__(self, command, folder):
        self.command, self.folder = shlex.split(command), folder

    def __call__(self, name, *words):
        """Run one command; its JSON is NAME.json, what it printed NAME.txt."""
        out = self.folder / f"{name}.json"
        if out.exists():
            return
        start = time.monotonic()
        run = subprocess.run(
            [*self.command, *map(str, words), "--json", out.name, "--force"],
            cwd=self.folder, capture_output=True, text=True, check=False,
        )  # fmt: skip
        (self.folder / f"{name}.txt").write_text(run.stdout + run.stderr)
        if run.returncode:
            out.write_text(json.dumps({"exit_code": run.returncode}))
        print(
            f"{time.monotonic() - start:6.1f} s  {name}  {run.stderr.strip()[:150] if run.returncode else ''}",
            flush=True,
        )


def loop(run, name, train, test, model):
    """The whole loop on one pair of flights."""
    run(f"{name}.inspect", "inspect", train, test, "-m", model)
    run(f"{name}.compare", "compare", train, test, "-m", model)
    run(f"{name}.explain", "explain", train, "-m", model, *(() if train == test else ("--validate", test)))
    found = json.loads((run.folder / f"{name}.explain.json").read_text())
    fitted, gp = f"{name}.toml", f"{name}.gp"
    run(f"{name}.add", "add", *(found.get("effects") or ["mass"]), "-m", model, "--from", train, "-o", fitted)
    run(f"{name}.against", "compare", test, "-m", model, "--against", fitted)
    run(f"{name}.learn", "learn", train, "-m", model, "-o", gp, "--points", "80")
    run(f"{name}.replay", "replay", test, "-m", model, "--gp", gp, "-o", f"{name}.replay.mcap")
    run(f"{name}.counterfactual", "counterfactual", test, "-m", model, "--gp", gp, "-o", f"{name}.cf.mcap")


def record(args):
    """Run everything; what is there already is kept."""
    args.folder.mkdir(parents=True, exist_ok=True)
    run = Runner(args.command, args.folder.resolve())
    cases = []
    for name, (model, fly, judge, hidden) in SIMULATED.items():
        for part, trajectory, extra in (("train", fly, ["--excitation", "1"]), ("test", judge, ["--seed", "1"])):
            log = f"{name}.{part}.mcap"
            words = ("-m", model, "-t", trajectory, "--duration", "20", "--hide", hidden, *extra, "-o", log)
            run(f"{name}.simulate-{part}", "simulate", *words)
        cases.append((name, f"{name}.train.mcap", f"{name}.test.mcap", model))
    for text in args.pairs:
        folder, _, model = text.partition("=")
        for train in sorted(Path(folder).resolve().glob("*.train.mcap")):
            stem = train.name.removesuffix(".train.mcap")
            cases.append((stem, train, train.with_name(f"{stem}.test.mcap"), model))
    for text in args.log:
        path, _, model = text.partition("=")
        log = Path(path).resolve()
        cases.append((log.stem, log, log, str(Path(model).resolve()) if model.endswith(".toml") else model))
    with ThreadPoolExecutor(args.jobs) as pool:
        list(pool.map(lambda case: loop(run, *case), cases))


def differences(before, after, tolerance, where=""):
    """Places in which two results differ, each with both values."""
    if isinstance(before, dict) and isinstance(after, dict):
        for key in before:
            if key in IGNORED:
                continue
            if key not in after:
                yield f"{where}.{key}", before[key], "missing"
            else:
                yield from differences(before[key], after[key], tolerance, f"{where}.{key}")
    elif isinstance(before, list) and isinstance(after, list):
        if len(before) != len(after):
            yield f"{where} (length)", len(before), len(after)
        for k, pair in enumerate(zip(before, after, strict=False)):
            yield from differences(*pair, tolerance, f"{where}[{k}]")
    elif isinstance(before, int | float) and isinstance(after, int | float) and not isinstance(before, bool):
        if not math.isclose(before, after, rel_tol=tolerance, abs_tol=1e-12):
            yield where, before, after
    elif before != after and not (isinstance(before, str) and isinstance(after, str) and " " in before):
        yield where, before, after


def diff(args):
    """Print what differs, by command; exit code 1 where something does."""
    count = files = 0
    for path in sorted(args.before.glob("*.json")):
        other = args.after / path.name
        if not other.exists():
            print(f"{path.name}: missing")
            count += 1
            continue
        files += 1
        found = list(differences(*(json.loads(p.read_text()) for p in (path, other)), args.tolerance))
        count += len(found)
        for where, old, new in found[: args.most]:
            print(f"{path.name}{where}: {str(old)[:90]} -> {str(new)[:90]}")
        if len(found) > args.most:
            print(f"{path.name}: ... {len(found) - args.most} more")
    print(f"{files} results compared, {count} differences beyond {args.tolerance:g}")
    return int(count > 0)


def main():
    """Parse the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(required=True)
    one = commands.add_parser("record")
    one.add_argument("folder", type=Path)
    one.add_argument("--pairs", action="append", default=[], metavar="FOLDER=MODEL")
    one.add_argument("--log", action="append", default=[], metavar="LOG=MODEL")
    one.add_argument("--command", default="wrenchgap")
    one.add_argument("--jobs", type=int, default=1)
    one.set_defaults(run=record)
    two = commands.add_parser("diff")
    two.add_argument("before", type=Path)
    two.add_argument("after", type=Path)
    two.add_argument("--tolerance", type=float, default=1e-6)
    two.add_argument("--most", type=int, default=6)
    two.set_defaults(run=diff)
    args = parser.parse_args()
    return args.run(args)


if __name__ == "__main__":
    sys.exit(main())
