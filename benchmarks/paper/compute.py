"""Time of one solve: Newton on compiled models, L-BFGS on plain ones, and L-BFGS with GPy's own predict; in one run.

The desired wrenches of a pitch flight, one after the other, through the same `Compensator`: as it is by default, with
the paper's optimiser, and with GPy regressions of the same points and hyperparameters inside that optimiser. Processor
time of the step, since the machine may be busy with others; how busy it was is noted.
"""

from __future__ import annotations

import os
import platform
from dataclasses import replace
from pathlib import Path
from time import process_time_ns
from typing import Any

import GPy
import numpy as np

from benchmarks.paper import methods as m
from benchmarks.paper.figures import time_figure
from benchmarks.paper.flying import fly
from benchmarks.paper.methods import Knowledge
from benchmarks.paper.plants import vehicle
from benchmarks.paper.prediction import TRAINING, knowledge
from benchmarks.paper.running import Output, Report, main, table
from wrenchgap.compensate import Compensator
from wrenchgap.flight.flight import Array
from wrenchgap.learn.process.gp import GaussianProcess
from wrenchgap.plant.state import State
from wrenchgap.plant.trajectory import named

PAPER = (7.5, 24.0)
POINTS = (100, 200)
RECORDED = ("iterations", "correction")
LBFGS, BY_GPY, TIGHT = "L-BFGS", "L-BFGS, GPy's predict", "L-BFGS stopped late"
SLOW = 600
"""Solves with the search that stops late, which only serves to compare corrections."""


class ByGPy:
    """A GP as GPy evaluates it: `predict` and `predictive_gradients` of one regression per output."""

    def __init__(self, gp: GaussianProcess) -> None:
        self.gp, self.outputs = gp, gp.outputs
        self.sigma_training, self.sigma_prior, self.mismatch_max = gp.sigma_training, gp.sigma_prior, gp.mismatch_max
        self.regressions = []
        for k in range(len(gp.outputs)):
            kernel = GPy.kern.RBF(
                gp.inputs.shape[1], variance=gp.signal_variance[k], lengthscale=gp.lengthscales[k], ARD=True
            )
            noise = float(gp.noise_variance[k])
            self.regressions.append(GPy.models.GPRegression(gp.inputs, gp.residuals[:, [k]], kernel, noise_var=noise))

    def _standardised(self, wrench: Array) -> Array:
        return np.asarray((wrench - self.gp.input_mean) / self.gp.input_scale)

    def mean(self, wrench: Array, /) -> Array:
        """Expected mismatch (N, L)."""
        x = self._standardised(wrench)
        return np.asarray(np.hstack([r.predict(x)[0] for r in self.regressions]) * self.gp.output_scale)

    def std(self, wrench: Array, /) -> Array:
        """Standard deviation (N, L)."""
        x, scale = self._standardised(wrench), self.gp.output_scale * self.gp.sigma_scale
        return np.asarray(np.sqrt(np.hstack([r.predict(x)[1] for r in self.regressions])) * scale)

    def jacobian(self, wrench: Array, /) -> Array:
        """Derivative of the mean (N, L, 6)."""
        x = self._standardised(wrench)
        slopes = np.stack([r.predictive_gradients(x)[0][:, :, 0] for r in self.regressions], axis=1)
        return np.asarray(slopes * self.gp.output_scale[:, None] / self.gp.input_scale)


def solve(compensator: Any, wrenches: Array, states: list[State]) -> tuple[Array, Array, Array]:
    """Processor times [ms] (N,), evaluations of the model (N,), corrections (N, 6) of consecutive solves."""
    compensator.step(wrenches[0], states[0])  # what is compiled is loaded
    compensator.reset()
    times, results = [], []
    for wrench, state in zip(wrenches, states, strict=True):
        started = process_time_ns()
        results.append(compensator.step(wrench, state))
        times.append(process_time_ns() - started)
    counts, corrections = (np.array([getattr(r, k) for r in results]) for k in RECORDED)
    return 1e-6 * np.array(times), counts, corrections


def run(quick: bool, out: Output, report: Report) -> dict[str, Any]:
    """Times of all implementations, and the figure."""
    report(0.0, "training")
    known = knowledge(0, seconds=30.0 if quick else TRAINING)
    flown = fly(vehicle(), named("pitch", 10.0), 70)
    desired, pose = flown.flight.desired, flown.flight.odometry
    assert desired is not None
    assert pose is not None
    rows = slice(None, 100) if quick else slice(None)
    wrenches = desired.wrench_B[rows]
    states = [_state(pose, t) for t in desired.time[rows]]
    times, found, load = {}, {}, [os.getloadavg()[0]]
    makers = _makers(known, quick)
    for number, (name, make) in enumerate(makers.items()):
        report(number / len(makers), name)
        some = slice(None, SLOW) if name.endswith(TIGHT) else slice(None)
        ms, evaluations, correction = solve(make(), wrenches[some], states[some])
        load.append(os.getloadavg()[0])
        if not name.endswith(TIGHT):
            times[name] = ms
        found[name] = {
            "mean": ms.mean(),
            "percentile_99": np.percentile(ms, 99),
            "maximum": ms.max(),
            "evaluations": evaluations.mean(),
            "correction": correction,
        }
    time_figure(out.image("compute"), times)
    differs = {name: _apart(found, name) for name in makers if f"{name}, {TIGHT}" in found}
    differs |= {f"{name}, GPy": _apart(found, f"{name}, {LBFGS}", f"{name}, {BY_GPY}") for name in _by_points(quick)}
    kept = {name: {k: v for k, v in row.items() if k != "correction"} for name, row in found.items()}
    rows_found = {name: row for name, row in kept.items() if not name.endswith(TIGHT)}
    said = {"solves": len(wrenches), "processor": _processor(), "load": [min(load), max(load)]}
    return {**said, "rows": rows_found, "largest_difference_Nm": differs}


def _apart(found: dict[str, Any], one: str, other: str = "") -> float:
    """Largest difference of the corrections of two rows over the steps that both have [Nm]."""
    pair = [found[name]["correction"] for name in (one, other or f"{one}, {TIGHT}")]
    count = min(map(len, pair))
    return float(np.abs(pair[0][:count] - pair[1][:count]).max())


def _by_points(quick: bool) -> list[str]:
    return [f"GP, {points} points" for points in (POINTS[:1] if quick else POINTS)]


def _makers(known: Knowledge, quick: bool) -> dict[str, Any]:
    """Every row: as it is by default, with L-BFGS on plain models, with L-BFGS that stops late, with GPy."""
    plain, tight = replace(known.settings, solver="lbfgs"), replace(known.settings, solver="lbfgs", good_enough=1e-14)
    makers: dict[str, Any] = {}
    for name, points in zip(_by_points(quick), POINTS, strict=False):
        gp = known.gp(points=points)
        makers[name] = lambda gp=gp: Compensator(gp, known.settings)
        makers[f"{name}, {LBFGS}"] = lambda gp=gp: Compensator(gp, plain)
        makers[f"{name}, {BY_GPY}"] = lambda gp=gp: Compensator(ByGPy(gp), plain)
        makers[f"{name}, {TIGHT}"] = lambda gp=gp: Compensator(gp, tight)
    for method in (m.LINEAR,) if quick else (m.SPARSE, m.PAST, m.LINEAR, m.PHYSICS, m.BOTH):
        makers[method.name] = lambda method=method: method.build(known)
        for words, settings in ((LBFGS, plain), (TIGHT, tight)):
            if method in (m.PHYSICS, m.BOTH):
                makers[f"{method.name}, {words}"] = lambda method=method, settings=settings: _otherwise(
                    method.build(known), settings
                )
    return makers


def _otherwise(compensator: Any, settings: Any) -> Compensator:
    """The same compensation with other settings."""
    return Compensator(compensator.model, settings, physics=compensator.physics)


def _state(pose: Any, time: float) -> State:
    """The last reading of the pose at a time."""
    k = max(int(np.searchsorted(pose.time, time, side="right")) - 1, 0)
    one = slice(k, k + 1)
    return State(np.array([time]), pose.position_E[one], pose.quat_EB[one], pose.velocity_E[one], pose.omega_B[one])


def _processor() -> str:
    file = Path("/proc/cpuinfo")
    lines = file.read_text(encoding="utf-8").splitlines() if file.exists() else []
    return next((x.split(":", 1)[1].strip() for x in lines if x.startswith("model name")), platform.processor())


def tables(body: dict[str, Any]) -> str:
    """Times, and the largest difference from a search that stops late."""
    head = [f"processor time of one solve [ms], {body['solves']} solves", "mean", "99th percentile", "maximum"]
    rows = [["paper, GPy, 100 points, NUC i7", f"{PAPER[0]:.1f}", "-", f"{PAPER[1]:.1f}", "-", "-"]]
    for name, row in body["rows"].items():
        cells = [f"{row[k]:.3f}" for k in ("mean", "percentile_99", "maximum")]
        apart = body["largest_difference_Nm"].get(name)
        rows.append([name, *cells, f"{row['evaluations']:.1f}", "-" if apart is None else f"{apart:.1e}"])
    low, high = body["load"]
    noted = f"Two cores, {body['processor']}; other work on the machine: load {low:.1f} to {high:.1f}."
    return table([*head, "evaluations", "from L-BFGS, stopped late [Nm]"], rows) + f"\n{noted}\n"


if __name__ == "__main__":
    main(("compute",))
