"""Processor time of `learn` with all its guards, stage by stage, beside GPy's own fit of the same process, in one run.

    python -m benchmarks.learn_speed                     # ten minutes, a table; nothing is written
    python -m benchmarks.learn_speed --minutes 2 --page  # and docs/performance.md

The log is that of benchmarks/explain_speed.py (tilt_hexarotor at 200 Hz). *GPy's own fit* is the search that `learn`
makes for the process that it keeps: 3 outputs on 200 points from 3 starts each, by GPy's models and its L-BFGS, and
nothing else: no choice of points, no held-out time, no verdict. Processor time, because the machine may be busy.
"""

import argparse
import json
import os
import re
import tempfile
from pathlib import Path
from time import process_time

import numpy as np
from threadpoolctl import threadpool_limits

from benchmarks.explain_speed import HIDDEN, long_flight
from wrenchgap import flight
from wrenchgap.learn.data.opening import open_flight
from wrenchgap.learn.identify import learning
from wrenchgap.learn.process import by_gpy, likelihood, train
from wrenchgap.plant import model_file

PAGE = Path(__file__).parent.parent / "docs" / "performance.md"
MODEL = "tilt_hexarotor"
STAGES = {
    "alternatives": "other inputs and inference",
    "learn_process": "the process",
    "absorption": "absorbed effects",
}


def timed(module, name, spent, told):
    """Let a function of a module say how long it takes; gives what undoes that."""
    inner = getattr(module, name)

    def outer(*args, **how):
        start = process_time()
        try:
            return inner(*args, **how)
        finally:
            spent[told] = spent.get(told, 0.0) + process_time() - start

    setattr(module, name, outer)
    return lambda: setattr(module, name, inner)


def measured(opened, model):
    """A row: seconds of the stages, of the whole, and of GPy on the searches of the process that was kept."""
    searches, spent = [], {}
    inner = likelihood.maximise

    def noted(x, z, start, bounds, inducing=None):
        begin = process_time()
        found = inner(x, z, start, bounds, inducing)
        searches.append((x, z, start, bounds, inducing, found[0], process_time() - begin))
        return found

    train.SEARCHES["closed-form"] = noted
    undo = [timed(learning, name, spent, told) for name, told in STAGES.items()]
    begin = process_time()
    learning.learn([opened], model)
    whole = process_time() - begin
    for one in undo:
        one()
    train.SEARCHES["closed-form"] = inner
    kept = [s for s in searches if s[4] is None and len(s[0]) == max(len(t[0]) for t in searches if t[4] is None)][-9:]
    with threadpool_limits(1), np.errstate(all="ignore"):
        by_gpy.maximise(*kept[0][:4])
        begin = process_time()
        theirs = [by_gpy.maximise(*search[:4])[0] for search in kept]
        reference = process_time() - begin
    apart = max(abs(value - search[5]) for value, search in zip(theirs, kept, strict=True))
    sizes = {"points": len(kept[0][0]), "searches": len(kept), "searches_of_all": len(searches)}
    return {**sizes, "stages_s": spent, "ours_s": sum(s[6] for s in kept), "gpy_s": reference, "apart": apart} | {
        "whole_s": whole,
        "ratio": whole / reference,
    }


def lines(row, minutes, load):
    """The table in Markdown."""
    head = [
        "minutes",
        *(f"{told}, s" for told in STAGES.values()),
        "learn, whole, s",
        "its fit alone, s",
        "GPy's own fit, s",
        "whole / GPy's fit",
    ]
    times = [f"{row['stages_s'].get(told, 0.0):.2f}" for told in STAGES.values()]
    cells = [f"{minutes:g}", *times, f"{row['whole_s']:.2f}", f"{row['ours_s']:.2f}", f"{row['gpy_s']:.2f}"]
    out = ["| " + " | ".join(head) + " |", "|" + " ---: |" * len(head)]
    out.append("| " + " | ".join([*cells, f"{row['ratio']:.1f}"]) + " |")
    said = f"{row['searches']} searches on {row['points']} points; largest difference of the log likelihoods "
    return "\n".join([*out, "", f"{said}{row['apart']:.1g}. {load}"])


def main():
    """Measure; with --page, renew the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=int, default=10, help="of log")
    parser.add_argument("--json", type=Path, help="write the row")
    parser.add_argument("--page", action="store_true", help="write the table into docs/performance.md")
    asked = parser.parse_args()
    model, before = model_file.load(MODEL), os.getloadavg()[0]
    with tempfile.TemporaryDirectory() as folder:
        opened = open_flight(flight.write(long_flight(asked.minutes, HIDDEN), Path(folder) / "log.mcap"), model)
    row = measured(opened, model)
    load = f"Load while measured: {before:.1f} to {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores."
    text = lines(row, asked.minutes, load)
    print(text)
    if asked.json:
        asked.json.write_text(json.dumps(row, indent=1) + "\n", encoding="utf-8")
    if asked.page:
        page = PAGE.read_text(encoding="utf-8")
        mark = re.compile(r"(<!-- learn -->\n).*?(<!-- /learn -->)", re.DOTALL)
        PAGE.write_text(mark.sub(lambda m: m[1] + text + "\n" + m[2], page), encoding="utf-8")


if __name__ == "__main__":
    main()
