"""A vehicle with effects, a process without a fit, and the exported C compiled and stepped: for tests of the export."""

import os
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest

import wrenchgap as wg
from wrenchgap.compensate.tables import rows_of
from wrenchgap.learn.process.gp import FitSettings, GaussianProcess, Provenance
from wrenchgap.plant.model import make_effect

COMPILER = shutil.which(os.environ.get("CC", "cc")) or shutil.which("gcc") or shutil.which("clang")
needs_compiler = pytest.mark.skipif(COMPILER is None, reason="no C compiler: sudo apt-get install gcc libc6-dev")
STRICT = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic")
SANITISED = ("-O0", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
MODEL = wg.load_model("voliro_x")
TORQUES = ("torque_x", "torque_y", "torque_z")
OFFSET = np.array([0.004, -0.007, 0.005])
DT = 0.005
EFFECTS = {
    "com_offset": OFFSET,
    "tilt_offset": np.linspace(-0.03, 0.04, 6),
    "rotor_interference": [0.2, 1.2],
    "body_drag": [0.3, 0.3, 0.3, 0.05, 0.05, 0.05, 0.0, 0.0, 0.01],
    "servo_lag": [0.06],
}


def with_effects(**effects):
    return MODEL.with_effects([make_effect(MODEL.vehicle, name, values) for name, values in effects.items()])


def process(desired, mean="zero", groups=(), points=60, effects=EFFECTS):
    """A process, on effects where its mean is physics: points are commands, hills a tenth of a Nm high."""
    extra = {"velocity": 3, "rates": 3, "position": 3, "past": 6}
    rng, dims = np.random.default_rng(5), 6 + sum(extra[g] for g in groups)
    scale = np.concatenate((np.std(desired, axis=0) + 0.05, np.ones(dims - 6)))
    rows = rng.integers(0, len(desired), points)
    inputs = np.hstack(((desired[rows] - desired.mean(axis=0)) / scale[:6], rng.normal(size=(points, dims - 6))))
    made = GaussianProcess(
        outputs=TORQUES,
        input_mean=np.concatenate((desired.mean(axis=0), np.zeros(dims - 6))),
        input_scale=scale,
        output_scale=np.full(3, 0.1),
        mean_coefficients=np.zeros((3, 1 + dims)),
        inputs=inputs + 0.1 * rng.normal(size=inputs.shape),
        residuals=np.tanh(rng.normal(size=(points, 3))),
        lengthscales=np.full((3, dims), 1.5),
        signal_variance=np.ones(3),
        noise_variance=np.full(3, 0.05),
        sigma_training=np.full(3, 0.05),
        mismatch_max=np.full(3, 0.1),
        settings=FitSettings(points=points, mean=mean, inputs=groups),
        provenance=Provenance(
            vehicle=MODEL.vehicle.name, physics=", ".join(effects) if mean == "physics" else "nominal"
        ),
    )
    assert made.input_groups == groups
    return made


def built(folder, *flags, name="run"):
    program = folder / name
    sources = [folder / "wrenchgap_compensator.c", folder / "selftest.c"]
    words = [COMPILER, *STRICT, *flags, "-o", program, *sources, "-lm"]
    done = subprocess.run([str(w) for w in words], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return program


def stepped(program, desired, states, feedback=None):
    """What the C program makes of steps (K, 29)."""
    seen = np.zeros_like(desired) if feedback is None else feedback
    rows = np.hstack((desired, seen, rows_of(replace(states, voltage=np.full(len(desired), 15.0)))))
    text = "\n".join(" ".join(repr(float(v)) for v in row) for row in rows)
    done = subprocess.run([str(program), "-"], input=text, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return np.array([[float(v) for v in line.split()] for line in done.stdout.splitlines()])


def selftest(program):
    return subprocess.run([str(program)], capture_output=True, text=True, check=False)
