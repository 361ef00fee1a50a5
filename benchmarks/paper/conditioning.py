"""The trap of a regression in closed loop: eigenvalues of I + dmu/dW along flights with more and less excitation.

In slow flight the measured torque is almost zero, whatever is wrong, so the mismatch is minus the command, and a GP can
learn a slope of -1 from it: then no correction exists. A multisine on the reference cures it. Whether wrenchgap says so
is asked of the commands themselves, `wrenchgap learn` and `wrenchgap replay`, on the logs.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.paper.figures import eigenvalue_figure
from benchmarks.paper.flying import fly
from benchmarks.paper.plants import MODEL, vehicle
from benchmarks.paper.running import Output, Report, in_parallel, main, table
from wrenchgap import flight
from wrenchgap.learn.data.opening import open_flight
from wrenchgap.learn.identify.learning import CAUTION
from wrenchgap.learn.process.store import load
from wrenchgap.plant.mismatch import conditioning
from wrenchgap.plant.trajectory import named

EXCITATIONS = (0.0, 0.1, 1.0)
POINTS = 100
VEHICLES = 3


def one(job: tuple[int, float, float]) -> dict[str, Any]:
    """Fly a slow pitch, learn and replay by command line, and look along the flight; (vehicle, excitation, length)."""
    number, excitation, length = job
    plant = vehicle(number)
    flown = fly(plant, named("pitch", length, excitation, number), 400 + number)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        log, gp_file = flight.write(flown.flight, folder / "slow.mcap"), folder / "slow.gp"
        learnt = _command(
            folder,
            "learn",
            str(log),
            "-o",
            str(gp_file),
            "--points",
            str(POINTS),
            "--mean",
            "zero",
            "--no-guard",
            "--as-fitted",
        )
        replayed = _command(folder, "replay", str(log), "--gp", str(gp_file), "-o", str(folder / "replayed.mcap"))
        gp = load(gp_file)
        records = open_flight(log, plant.believed).records
    time = np.concatenate([r.time for r in records])
    real = conditioning(gp, np.concatenate([r.commanded for r in records])).real_min
    return {
        "time": time,
        "real": real,
        "least": real.min(),
        "percentile_1": np.percentile(real, 1),
        "median": np.median(real),
        "below": np.mean(real < CAUTION.nearly_singular),
        "learn_warns": _warns(learnt),
        "replay_warns": _warns(replayed),
    }


def _command(folder: Path, command: str, *arguments: str) -> dict[str, Any]:
    """The JSON result of a command line."""
    result = folder / f"{command}.json"
    line = [sys.executable, "-m", "wrenchgap", command, *arguments, "-m", str(MODEL), "--json", str(result)]
    done = subprocess.run(line, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"{' '.join(line)}: {done.stderr.strip() or done.stdout.strip()}")
    found: dict[str, Any] = json.loads(result.read_text(encoding="utf-8"))
    return found


def _warns(result: dict[str, Any]) -> bool:
    return any("nearly singular" in words for words in result["warnings"])


def run(quick: bool, out: Output, report: Report) -> dict[str, Any]:
    """Eigenvalues and warnings of every excitation, and the figure of the first vehicle."""
    excitations, vehicles, length = ((0.0,), 1, 20.0) if quick else (EXCITATIONS, VEHICLES, 40.0)
    jobs = [(v, e, length) for e in excitations for v in range(vehicles)]
    found = in_parallel(one, jobs, report, "learn and replay")
    first = {f"excitation {e:g}": f for (v, e, _), f in zip(jobs, found, strict=True) if v == 0}
    eigenvalue_figure(
        out.image("conditioning"), {n: (f["time"], f["real"]) for n, f in first.items()}, CAUTION.nearly_singular
    )
    rows = []
    for e in excitations:
        of = [f for (_, x, _), f in zip(jobs, found, strict=True) if x == e]
        rows.append(
            {
                "excitation": e,
                "least": min(f["least"] for f in of),
                **{k: float(np.median([f[k] for f in of])) for k in ("percentile_1", "median", "below")},
                "singular": sum(bool(f["below"] > 0) for f in of),
                **{k: sum(f[k] for f in of) for k in ("learn_warns", "replay_warns")},
            }
        )
    return {"vehicles": vehicles, "limit": CAUTION.nearly_singular, "rows": rows}


def tables(body: dict[str, Any]) -> str:
    """One row per excitation."""
    count, limit = body["vehicles"], body["limit"]
    head = [
        "excitation of the slow pitch flight",
        f"least eigenvalue of {count} flights",
        "1st percentile",
        "median",
        f"flights with any below {limit:g}",
        "`learn` warns",
        "`replay` warns",
    ]
    rows = [
        [
            f"{r['excitation']:g}" + (" (none)" if r["excitation"] == 0 else ""),
            *(f"{r[k]:.2f}" for k in ("least", "percentile_1", "median")),
            *(f"{r[k]} of {count}" for k in ("singular", "learn_warns", "replay_warns")),
        ]
        for r in body["rows"]
    ]
    return table(head, rows)


if __name__ == "__main__":
    main(("conditioning",))
