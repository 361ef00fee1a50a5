"""Processor time of `learn` with all its guards, stage by stage, beside GPy's own fit of the same process, in one run.

    python -m benchmarks.learn_speed                     # ten minutes, a table; nothing is written
    python -m benchmarks.learn_speed --minutes 2 --page  # and docs/performance.md

The log is that of benchmarks/explain_speed.py (tilt_hexarotor at 200 Hz). *GPy's own fit* is the search that `learn`
makes for the process that it keeps: 3 outputs on 200 points from 3 starts each, by GPy's models and its L-BFGS, and
nothing else: no choice of points, no held-out time, no verdict. Processor time, because the machine may be busy.
"""

import tempfile
from pathlib import Path
from time import process_time

import numpy as np
from threadpoolctl import threadpool_limits

from benchmarks import pages
from benchmarks.explain_speed import HIDDEN, long_flight
from wrenchgap import flight
from wrenchgap.learn.data.opening import open_flight
from wrenchgap.learn.identify import learning
from wrenchgap.learn.process import likelihood, train
from wrenchgap.plant import model_file

MODEL = "tilt_hexarotor"
STAGES = {
    "alternatives": "other inputs and inference",
    "learn_process": "the process",
    "absorption": "absorbed effects",
}


def noting(module, name, spent, told):
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
    undo = [noting(learning, name, spent, told) for name, told in STAGES.items()]
    begin = process_time()
    learning.learn([opened], model)
    whole = process_time() - begin
    for one in undo:
        one()
    train.SEARCHES["closed-form"] = inner
    kept = [s for s in searches if s[4] is None and len(s[0]) == max(len(t[0]) for t in searches if t[4] is None)][-9:]
    with threadpool_limits(1), np.errstate(all="ignore"):
        likelihood.maximise_by_gpy(*kept[0][:4])
        begin = process_time()
        theirs = [likelihood.maximise_by_gpy(*search[:4])[0] for search in kept]
        reference = process_time() - begin
    apart = max(abs(value - search[5]) for value, search in zip(theirs, kept, strict=True))
    sizes = {"points": len(kept[0][0]), "searches": len(kept), "searches_of_all": len(searches)}
    return {**sizes, "stages_s": spent, "ours_s": sum(s[6] for s in kept), "gpy_s": reference, "apart": apart} | {
        "whole_s": whole,
        "ratio": whole / reference,
    }


def rows(minutes):
    """The row of a log of so many minutes."""
    model = model_file.load(MODEL)
    with tempfile.TemporaryDirectory() as folder:
        opened = open_flight(flight.write(long_flight(minutes, HIDDEN), Path(folder) / "log.mcap"), model)
    yield {"minutes": minutes, **measured(opened, model)}


def table(found, load):
    """In Markdown."""
    stages = [f"{told}, s" for told in STAGES.values()]
    heads = ["minutes", *stages, "learn, whole, s", "its fit alone, s", "GPy's own fit, s", "whole / GPy's fit"]
    lines, said = [], []
    for row in found:
        times = [f"{row['stages_s'].get(told, 0.0):.2f}" for told in STAGES.values()]
        cells = [f"{row['minutes']:g}", *times, f"{row['whole_s']:.2f}", f"{row['ours_s']:.2f}", f"{row['gpy_s']:.2f}"]
        lines.append([*cells, f"{row['ratio']:.1f}"])
        apart = f"largest difference of the log likelihoods {row['apart']:.1g}"
        said.append(f"{row['searches']} searches on {row['points']} points; {apart}.")
    return pages.markdown(heads, lines, " ".join([*said, load]), left=0)


def main():
    """Measure; with --page, renew the page."""
    parser = pages.options(__doc__)
    parser.add_argument("--minutes", type=int, default=10, help="of log")
    asked = parser.parse_args()
    pages.measure(asked, "learn", rows(asked.minutes), table)


if __name__ == "__main__":
    main()
