"""Processor time of `replay`, ten minutes read, stepped and written, beside real time and GPy inside nlopt, in one run.

    python -m benchmarks.replay_speed                            # ten minutes, a table; nothing is written
    python -m benchmarks.replay_speed --page                     # and docs/performance.md
    python -m benchmarks.replay_speed --minutes 2 --json rows.json

The log is that of benchmarks/explain_speed.py (tilt_hexarotor at 200 Hz), the process is learnt on its first minute:
200 points, 3 outputs, with sigma and gate. The reference is what the paper's authors ran: GPy's own prediction and
derivative in nlopt's L-BFGS, on the first steps of the same log. Processor time, because the machine may be busy.
"""

import tempfile
from pathlib import Path

import numpy as np

from benchmarks import pages
from benchmarks.explain_speed import HIDDEN, long_flight
from benchmarks.pages import timed
from wrenchgap import flight
from wrenchgap.compensate import Compensator, Settings
from wrenchgap.compensate.fast import warm
from wrenchgap.learn.process.gp import FitSettings
from wrenchgap.plant import model_file
from wrenchgap.replay import api
from wrenchgap.replay.compensation.replay import step_through
from wrenchgap.replay.present.replay import write_log

MODEL = model_file.load("tilt_hexarotor")
POINTS, STEPS = 200, 40
"""Points of the process; steps of the reference."""


class WithGPy:
    """A process that GPy evaluates: a `plant.mismatch.MismatchModel`."""

    def __init__(self, process):
        import GPy

        self.process, self.outputs, self.mismatch_max = process, process.outputs, process.mismatch_max
        self.sigma_training, self.sigma_prior = process.sigma_training, process.sigma_prior
        self.models = []
        for k in range(len(process.outputs)):
            size = process.lengthscales.shape[1]
            variance = process.signal_variance[k]
            kernel = GPy.kern.RBF(size, variance=variance, lengthscale=process.lengthscales[k], ARD=True)
            z = process.residuals[:, k : k + 1]
            self.models.append(GPy.models.GPRegression(process.inputs, z, kernel, noise_var=process.noise_variance[k]))

    def _x(self, wrench):
        return (wrench - self.process.input_mean) / self.process.input_scale

    def mean(self, wrench):
        """Expected mismatch (N, L)."""
        x = self._x(wrench)
        return (
            np.hstack([m.predict_noiseless(x)[0] for m in self.models]) * self.process.gain * self.process.output_scale
        )

    def std(self, wrench):
        """Standard deviation (N, L)."""
        variance = np.hstack([m.predict(self._x(wrench))[1] for m in self.models])
        return np.sqrt(variance) * self.process.output_scale * self.process.sigma_scale

    def jacobian(self, wrench):
        """Derivative of the mean (N, L, 6)."""
        slopes = [m.predictive_gradients(self._x(wrench))[0][:, :, 0] for m in self.models]
        unit = (self.process.gain * self.process.output_scale)[:, None] / self.process.input_scale
        return np.stack(slopes, axis=1) * unit


def rows(folder, minutes):
    """What was measured, as it comes."""
    made, log = long_flight(minutes, HIDDEN), folder / "long.mcap"
    flight.write(made, log)
    opened = api.open_flights([log], MODEL, between=(0.0, 60.0))
    process = api.learn_gp(opened, MODEL, settings=FitSettings(points=POINTS, guarded=False), guard=False).gp
    api.replay_compensation(opened[0], MODEL, process)  # compiles, or loads what is compiled
    reading, (whole,) = timed(lambda: api.open_flights([log], MODEL))
    stepping, found = timed(lambda: api.replay_compensation(whole, MODEL, process))
    writing, _ = timed(lambda: write_log(found, folder / "replayed.mcap", force=True))
    settings = Settings(dt=found.dt)
    again = timed(lambda: Compensator(process, settings))[1]
    alone, _ = timed(lambda: step_through(again, found.wrench, None, np.array([0])))
    plain = Compensator(WithGPy(process), Settings(dt=found.dt, solver="lbfgs"))
    plain.step(found.wrench[0])
    plain.reset()
    reference, theirs = timed(lambda: [plain.step(w).correction for w in found.wrench[:STEPS]])
    yield {
        "minutes": minutes,
        "steps": len(found),
        "points": POINTS,
        "open_s": reading,
        "replay_s": stepping,
        "write_s": writing,
        "written_MB": (folder / "replayed.mcap").stat().st_size / 1e6,
        "step_us": 1e6 * alone / len(found),
        "gpy_step_us": 1e6 * reference / STEPS,
        "apart_Nm": float(np.abs(np.array(theirs) - found.steps.correction[:STEPS]).max()),
    }


def table(found, load):
    """In Markdown."""
    heads = ("steps", "read and open, s", "replay, s", "write, s", "x real time", "one step, us", "GPy in nlopt, us")
    heads = (*heads, "ratio", "apart [Nm]")
    lines = []
    for row in found:
        took = [row[k] for k in ("open_s", "replay_s", "write_s")]
        cells = [f"{row['steps']:,}", *(f"{t:.1f}" for t in took), f"{60.0 * row['minutes'] / sum(took):.0f}"]
        cells += [f"{row['step_us']:.0f}", f"{row['gpy_step_us']:,.0f}", f"{row['gpy_step_us'] / row['step_us']:.0f}"]
        lines.append([*cells, f"{row['apart_Nm']:.0e}"])
    return pages.markdown(heads, lines, load, left=0)


def main():
    """Measure; with --page, renew the page."""
    parser = pages.options(__doc__)
    parser.add_argument("--minutes", type=int, default=10, help="of log")
    asked = parser.parse_args()
    warm()
    with tempfile.TemporaryDirectory() as folder:
        pages.measure(asked, "replay", rows(Path(folder), asked.minutes), table)


if __name__ == "__main__":
    main()
