"""Peak memory of each command on ten minutes at 200 Hz, beside the arrays that it keeps.

    python -m benchmarks.memory                           # a table; nothing is written
    python -m benchmarks.memory --page                    # and docs/performance.md
    python -m benchmarks.memory --command inspect where --json rows.json  # some of them, and the others later
    python -m benchmarks.memory --command compare learn --with-rows rows.json --page

The log is that of benchmarks/explain_speed.py. Each command runs in a process of its own, as a user types it, on ten
minutes and on `SHORT` seconds of the same flight: the difference of the largest resident memories is what the length
costs, without Python, numba and the libraries. *Kept* is what the flight amounts to once it is opened for the model:
the series, the stretches on one clock and the records, every buffer once.
"""

import json
import re
import resource
import subprocess
import sys
import tempfile
from dataclasses import fields, is_dataclass
from pathlib import Path

import numpy as np

from benchmarks import pages
from benchmarks.explain_speed import HIDDEN, long_flight
from wrenchgap import flight
from wrenchgap.learn.data.opening import open_flight
from wrenchgap.plant import model_file
from wrenchgap.plant.simulation.flight_plan import Plan, fly

MODEL, SHORT = "tilt_hexarotor", 12.0
COMMANDS = {
    "inspect": ["inspect", "LOG"],
    "inspect with a model": ["inspect", "LOG", "-m", MODEL],
    "compare": ["compare", "LOG", "-m", MODEL],
    "where": ["where", "LOG", "-m", MODEL],
    "explain": ["explain", "LOG", "-m", MODEL],
    "learn": ["learn", "LOG", "-m", MODEL, "-o", "FOLDER/new.gp"],
    "replay": ["replay", "LOG", "-m", MODEL, "--gp", "GP", "-o", "FOLDER/replayed.mcap"],
}


def buffers(item, found=None):
    """Bytes of all arrays in a dataclass, tuple or dict, each buffer once, by its owner."""
    found = {} if found is None else found
    if isinstance(item, np.ndarray):
        while isinstance(item.base, np.ndarray):
            item = item.base
        found[id(item)] = item.nbytes
    elif is_dataclass(item):
        for one in fields(item):
            buffers(getattr(item, one.name), found)
    elif isinstance(item, (tuple, list, dict)):
        for one in item.values() if isinstance(item, dict) else item:
            buffers(one, found)
    return found


def peak(words):
    """Largest resident memory [MB] of a command, and its processor time [s]."""
    code = "import resource, subprocess, sys; run = subprocess.run(sys.argv[1:], capture_output=True, text=True); "
    code += "use = resource.getrusage(resource.RUSAGE_CHILDREN); "
    code += "print(use.ru_maxrss, use.ru_utime + use.ru_stime, run.returncode, (run.stdout + run.stderr)[-300:])"
    line = [sys.executable, "-c", code, sys.executable, "-m", "wrenchgap", *words]
    memory, took, status, *said = subprocess.run(line, capture_output=True, text=True, check=True).stdout.split()
    if status != "0":
        raise RuntimeError(" ".join((*words, *said)))
    return int(memory) * 1024 / 1e6, float(took)


def measured(folder, chosen, minutes):
    """A line for each command, as it is measured."""
    model = model_file.load(MODEL)
    short = flight.write(
        fly(Plan(model, "multi_axis", SHORT, 1.0, 1, None, HIDDEN), name="short"), folder / "short.mcap"
    )
    log = flight.write(long_flight(minutes, HIDDEN), folder / "long.mcap")
    opened = open_flight(log, model)
    sizes = {"flight": sum(buffers(opened.flight).values()) / 1e6, "opened": sum(buffers(opened).values()) / 1e6}
    gp = folder / "it.gp"
    if "replay" in chosen:
        peak(["learn", str(short), "-m", MODEL, "-o", str(gp), "--no-guard", "--force"])
    for name in chosen:
        peaks = []
        for path in (short, log):
            said = {"LOG": str(path), "GP": str(gp), "FOLDER": str(folder)}
            words = [re.sub("LOG|GP|FOLDER", lambda m, said=said: said[m[0]], word) for word in COMMANDS[name]]
            peaks.append(peak([*words, *(["--force"] if "-o" in words else [])]))
        kept = sizes["flight" if name == "inspect" else "opened"]
        yield {
            "command": name,
            "short_MB": peaks[0][0],
            "peak_MB": peaks[1][0],
            "kept_MB": kept,
            "ratio": (peaks[1][0] - peaks[0][0]) / kept,
            "processor_s": peaks[1][1],
        }


def rows(chosen, minutes):
    """The lines, in a folder that goes again."""
    with tempfile.TemporaryDirectory() as folder:
        yield from measured(Path(folder), chosen, minutes) if chosen else ()


def table(found, load):
    """In Markdown."""
    heads = ("command", "peak, 12 s, MB", "peak, 10 min, MB", "difference, MB", "kept, MB", "difference / kept")
    lines = []
    for row in found:
        sizes = (row["short_MB"], row["peak_MB"], row["peak_MB"] - row["short_MB"], row["kept_MB"])
        lines.append([row["command"], *(f"{size:.0f}" for size in sizes), f"{row['ratio']:.1f}"])
    here = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
    return pages.markdown(heads, lines, f"The benchmark itself took {here} MiB. {load}")


def main():
    """Measure; with --page, renew the page."""
    parser = pages.options(__doc__)
    parser.add_argument("--minutes", type=int, default=10, help="of log")
    parser.add_argument("--command", nargs="*", choices=list(COMMANDS), default=list(COMMANDS))
    parser.add_argument(
        "--with-rows", type=Path, metavar="JSON", help="rows of an earlier run, in front of the new ones"
    )
    asked = parser.parse_args()
    earlier = json.loads(asked.with_rows.read_text(encoding="utf-8")) if asked.with_rows else []
    pages.measure(asked, "memory", rows(asked.command, asked.minutes), table, earlier)


if __name__ == "__main__":
    main()
