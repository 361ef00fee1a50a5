"""Processor time of one compensation step: Newton on compiled models beside L-BFGS on plain ones, in one run.

    python -m benchmarks.compensation_speed                     # a table; nothing is written
    python -m benchmarks.compensation_speed --page              # and docs/performance.md
    python -m benchmarks.compensation_speed --json rows.json    # rows as they come

A tilt-arm hexarotor with twelve rotors, a process with 100 points and 3 outputs, 4 effects; 200 Hz along a smooth
flight about all axes. Processor time of the thread that steps, not the clock on the wall, because the machine may be
busy; but a busy core that two share is slower in processor time too. So the ratio of two rows of one run is what
counts; the load is stated.
"""

from time import thread_time_ns

import numpy as np

from benchmarks import pages
from wrenchgap.compensate import Compensator, PhysicsMismatch, Settings
from wrenchgap.compensate.fast import warm
from wrenchgap.compensate.run import run
from wrenchgap.flight import so3
from wrenchgap.learn.process.gp import GaussianProcess
from wrenchgap.plant import model_file
from wrenchgap.plant.model import make_effect
from wrenchgap.plant.state import State

DT, TORQUES, POINTS = 0.005, ("torque_x", "torque_y", "torque_z"), 100
MODEL = model_file.load("voliro_x")
HOVER = np.array([0.0, 0.0, MODEL.vehicle.body.mass * 9.80665, 0.0, 0.0, 0.0])
EFFECTS = {
    "com_offset": [0.0, 0.007, -0.006],
    "tilt_offset": np.linspace(-0.03, 0.04, 6),
    "rotor_interference": [0.2, 1.2],
    "rotor_thrust": np.linspace(-0.03, 0.03, 12),
}
MANY, FEW = 800, 80
"""Steps of Newton, and of the reference."""


def flight(count):
    """Desired wrenches (K, 6) and states that turn slowly about all axes."""
    t = np.arange(count) * DT
    phase = np.random.default_rng(1).uniform(0, 6, (6, 3))
    waves = np.array([sum(np.sin((0.5 + k) * t + p) for k, p in enumerate(row)) for row in phase]).T
    motion = np.array([np.sin(0.7 * t), np.cos(0.9 * t), np.sin(1.1 * t)]).T
    wrenches = HOVER + waves * np.array([8.0, 8.0, 4.0, 0.25, 0.25, 0.15])
    return wrenches, State(t, motion, so3.exp(0.7 * motion), 2.0 * motion, motion)


def process():
    """Hills of a third of a newton metre over what the flight goes through."""
    rng = np.random.default_rng(0)
    return GaussianProcess(
        outputs=TORQUES,
        input_mean=HOVER,
        input_scale=np.array([10.0, 10.0, 5.0, 0.4, 0.4, 0.3]),
        output_scale=np.full(3, 0.3),
        mean_coefficients=np.zeros((3, 7)),
        inputs=rng.normal(size=(POINTS, 6)),
        residuals=np.tanh(rng.normal(size=(POINTS, 3))),
        lengthscales=np.full((3, 6), 2.5),
        signal_variance=np.ones(3),
        noise_variance=np.full(3, 0.05),
        sigma_training=np.full(3, 0.15),
        mismatch_max=np.full(3, 0.3),
    )


def measured(compensator, count):
    """Processor times [ms] (K,), evaluations (K,) and corrections (K, 6) of steps."""
    wrenches, every = flight(count)
    states = [every.take(slice(k, k + 1)) for k in range(count)]
    compensator.step(wrenches[0], states[0])
    compensator.reset()
    times, results = [], []
    for wrench, state in zip(wrenches, states, strict=True):
        started = thread_time_ns()
        results.append(compensator.step(wrench, state))
        times.append(1e-6 * (thread_time_ns() - started))
    return np.array(times), [r.iterations for r in results], np.array([r.correction for r in results])


def in_blocks(compensator):
    """Mean processor time [ms] of a step in blocks, as `replay` takes them, expected mismatches included."""
    wrenches, every = flight(MANY)
    run(compensator, wrenches[:20], every.take(slice(0, 20)))
    started = thread_time_ns()
    run(compensator, wrenches, every)
    return 1e-6 * (thread_time_ns() - started) / MANY


def rows():
    """Lines of the table, as they are measured."""
    named = PhysicsMismatch(
        MODEL.with_effects([make_effect(MODEL.vehicle, n, v) for n, v in EFFECTS.items()]).wrench_model, TORQUES
    )
    cases = {"GP": (process(), None), "physics": (named, None), "physics + GP": (process(), named)}
    for name, (model, physics) in cases.items():
        fast = Compensator(model, Settings(dt=DT), physics=physics)
        plain = Compensator(model, Settings(dt=DT, solver="lbfgs", good_enough=1e-14), physics=physics)
        usual = Compensator(model, Settings(dt=DT, solver="lbfgs"), physics=physics)
        ms, evaluations, found = measured(fast, MANY)
        slow, many, _ = measured(usual, FEW)
        apart = np.abs(measured(plain, FEW)[2] - found[:FEW]).max()
        yield [
            name,
            *(f"{v:.3f}" for v in (ms.mean(), np.percentile(ms, 99), in_blocks(fast))),
            f"{slow.mean():.2f}",
            f"{slow.mean() / ms.mean():.0f}",
            f"{np.mean(evaluations):.1f} / {np.mean(many):.1f}",
            f"{apart:.0e}",
        ]


HEADS = ("step of 5 ms", "Newton, mean", "99th percentile", "in blocks", "L-BFGS, mean", "ratio", "evaluations")
HEADS = (*HEADS, "apart [Nm]")


def table(found, load):
    """In Markdown."""
    lines = ["| " + " | ".join(HEADS) + " |", "| --- |" + " ---: |" * (len(HEADS) - 1)]
    return "\n".join([*lines, *("| " + " | ".join(row.values()) + " |" for row in found), "", load])


def main():
    """Measure; with --page, renew the page."""
    asked = pages.options(__doc__).parse_args()
    warm()
    pages.measure(asked, "speed", (dict(zip(HEADS, row, strict=True)) for row in rows()), table)


if __name__ == "__main__":
    main()
