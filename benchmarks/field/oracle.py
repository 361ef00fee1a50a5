"""Could a regression with the true laws tell? The size of each hidden effect over its standard deviation.

The wrench that a model's user measures from the flight, m f and J omega_dot + omega x J omega from the IMU, is computed
along the flown states once with everything that was hidden and once without each effect in turn. The differences are
the columns of a linear regression with true amplitudes of 1. Its noise is the sensors' below `BAND` (white in force,
differentiated in torque) and the turbulence's; the IMU's biases are unknowns with the rms of `sensors`. An effect could
be told where its amplitude is known to 1 / `judge.TELL` with all others free.

It says nothing of names that act alike: those are among an effect's `answers`.
"""

from __future__ import annotations

import numpy as np

from benchmarks.field.craft import Craft, State
from benchmarks.field.engine import GUST_SECONDS, Flown, around
from benchmarks.field.flying import RATE
from benchmarks.field.hidden import build
from benchmarks.field.sensors import IMUS
from benchmarks.field.truth import Truth
from wrenchgap.flight.flight import Array

BAND = 8.0
"""Hz, of the low-pass that the tool compares behind."""
EVERY = 5
"""Ticks from one sample of the regression to the next: 40 Hz, enough for `BAND`."""


def amplitudes(
    bare: Truth, names: tuple[str, ...], scales: tuple[float, ...], seed: int, flown: Flown, imu: str
) -> list[float]:
    """1 / standard deviation of the amplitude of each of `names`; `bare` is the vehicle in its air, nothing hidden."""
    whole = build(bare, names, scales, seed)
    full = wrenches(whole, flown)
    columns = []
    for k in range(len(names)):
        rest = [i for i in range(len(names)) if i != k]
        less = build(bare, tuple(names[i] for i in rest), tuple(scales[i] for i in rest), seed)
        columns.append(full - wrenches(less, flown))
    sigma = _noise(bare, imu)
    if bare.gusts:
        calm = full - wrenches(whole, flown, calm=True)
        sigma = np.sqrt(sigma**2 + (calm**2).mean(0) * 2 * BAND * GUST_SECONDS)
    worth = np.sqrt(2 * BAND * EVERY / RATE)  # independent samples below BAND per sample taken
    X = np.stack([(c / sigma * worth).ravel() for c in columns], 1)
    bias = np.zeros((len(full), 6, 3))
    bias[:, range(3), range(3)] = bare.vehicle.mass * IMUS[imu].accelerometer_bias
    B = (bias / sigma[None, :, None] * worth).reshape(-1, 3)
    both = np.hstack((X, B))
    prior = np.diag([0.0] * len(names) + [1.0] * 3)
    covariance = np.linalg.pinv(both.T @ both + prior)
    sizes = np.diag(covariance)[: len(names)]
    seen = np.linalg.norm(X, axis=0) > 1e-9  # pinv knows nothing of what is not there
    return [float(1.0 / np.sqrt(s)) if there and s > 0 else 0.0 for s, there in zip(sizes, seen, strict=True)]


def wrenches(truth: Truth, flown: Flown, calm: bool = False) -> Array:
    """(N, 6) wrench measured at every `EVERY`th tick, had `truth` been in the recorded states under the same commands.

    `calm` takes the turbulence away. What is attached has no part in it.
    """
    craft, vehicle = Craft(truth.but(attached=None)), truth.vehicle
    speeds, J = rotor_speeds(truth, flown.speed), np.array(vehicle.inertia)
    rows = []
    for k in range(EVERY, len(speeds), EVERY):
        quat = np.roll(flown.quat_EB[k], -1)
        state: State = {"q": quat, "w": flown.omega_B[k], "rotor_speeds": speeds[k]}
        state["wind"] = truth.wind_E if calm else truth.wind_E + flown.gusts_E[k]
        craft.placed(state, flown.position_E[k], flown.velocity_E[k])
        craft.charge, craft.time = flown.charge[k], float(flown.plan.time[k])
        craft.gust_torque_B = np.zeros(3) if calm else flown.gust_torque_B[k]
        reading = craft.imu(state)
        w, force = reading[:3], vehicle.mass * reading[3:6]
        rows.append(np.concatenate((force, J * reading[6:] + np.cross(w, J * w))))
    return np.array(rows)


def rotor_speeds(truth: Truth, commanded: Array) -> Array:
    """(N, R) speed of the rotors around tick k, had they received `commanded` (N, R)."""
    first = np.full(commanded.shape[1], truth.vehicle.hover_speed)
    held = np.vstack((first, commanded))[:-1]
    if truth.delay:
        held = np.vstack((np.repeat(held[1:2], truth.delay, 0), held))[: len(held)]
    if not any(truth.tau):
        return around(truth, held, np.vstack((held[1:], held[-1:])))
    out, speed = np.empty_like(held), first
    up, down = 1.0 - np.exp(-1.0 / RATE / np.array(truth.tau))
    for k, command in enumerate(held):
        if k:  # the first tick begins as the flight does
            speed = speed + np.where(command > speed, up, down) * (command - speed)
        out[k] = speed
    return out


def _noise(truth: Truth, imu: str) -> Array:
    """(6,) rms of the sensors' noise below `BAND` in force and torque."""
    gyro, accelerometer = IMUS[imu].per_sample(RATE)
    nyquist = RATE / 2.0
    force = truth.vehicle.mass * accelerometer * np.sqrt(BAND / nyquist)
    torque = np.array(truth.vehicle.inertia) * gyro * 2 * np.pi * np.sqrt(BAND**3 / 3.0 / nyquist)
    return np.concatenate((np.full(3, force), torque))
