"""Time of one solve, beside the same solve with GPy's own predict inside the optimiser; both in one run.

The desired wrenches of a pitch flight, one after the other, through the same `Compensator` with two models: the GP in
closed form of `learn.process.gp`, and GPy regressions with the same points and hyperparameters. The optimiser is the
paper's, L-BFGS on plain models; what is flown by default is measured by `benchmarks.compensation_speed`.
"""

from __future__ import annotations

import platform
from dataclasses import replace
from pathlib import Path
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
RECORDED = ("solve_time", "iterations", "correction")


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
    """Times [ms] (N,), evaluations of the model (N,), corrections (N, 6) of consecutive solves."""
    results = [compensator.step(w, s) for w, s in zip(wrenches, states, strict=True)]
    times, counts, corrections = (np.array([getattr(r, k) for r in results]) for k in RECORDED)
    return 1e3 * times, counts, corrections


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
    times, found = {}, {}
    makers = _makers(known, quick)
    for number, (name, make) in enumerate(makers.items()):
        report(number / len(makers), name)
        ms, evaluations, correction = solve(make(), wrenches, states)
        times[name] = ms
        found[name] = {
            "mean": ms.mean(),
            "percentile_99": np.percentile(ms, 99),
            "maximum": ms.max(),
            "evaluations": evaluations.mean(),
            "correction": correction,
        }
    time_figure(out.image("compute"), times)
    differs = {}
    for points in POINTS[: 1 if quick else 2]:
        both = [found[f"GP, {points} points, {w}"]["correction"] for w in ("wrenchgap", "GPy's predict")]
        differs[str(points)] = float(np.abs(both[0] - both[1]).max())
    for row in found.values():
        del row["correction"]
    return {"solves": len(wrenches), "processor": _processor(), "rows": found, "largest_difference_Nm": differs}


def _makers(known: Knowledge, quick: bool) -> dict[str, Any]:
    makers: dict[str, Any] = {}
    plain = replace(known.settings, solver="lbfgs")
    for points in POINTS[: 1 if quick else 2]:
        gp = known.gp(points=points)
        makers[f"GP, {points} points, wrenchgap"] = lambda gp=gp: Compensator(gp, plain)
        makers[f"GP, {points} points, GPy's predict"] = lambda gp=gp: Compensator(ByGPy(gp), plain)
    for method in (m.LINEAR,) if quick else (m.SPARSE, m.PAST, m.LINEAR, m.PHYSICS, m.BOTH):
        makers[method.name] = lambda method=method: _with(method.build(known), plain)
    return makers


def _with(compensator: Any, settings: Any) -> Compensator:
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
    """Times."""
    head = [f"time of one solve [ms], {body['solves']} solves", "mean", "99th percentile", "maximum", "evaluations"]
    rows = [["paper, GPy, 100 points, NUC i7", f"{PAPER[0]:.1f}", "-", f"{PAPER[1]:.1f}", "-"]]
    for name, row in body["rows"].items():
        cells = [f"{row[k]:.2f}" for k in ("mean", "percentile_99", "maximum")]
        rows.append([name, *cells, f"{row['evaluations']:.1f}"])
    return table(head, rows)


if __name__ == "__main__":
    main(("compute",))
