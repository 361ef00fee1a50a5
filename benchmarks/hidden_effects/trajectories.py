"""References to fly: position, attitude and their first two derivatives at every control tick.

A trajectory is a function `(time (N,), rng) -> (position_E (N, 3) [m], rotation_vector_ED (N, 3) [rad])` of smooth
functions of time, registered by name; `reference` differentiates it on a fine grid. Seeds change phases, directions
and step sizes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from wrenchgap.flight.flight import Array

Trajectory = Callable[[Array, np.random.Generator], tuple[Array, Array]]

TRAJECTORIES: dict[str, tuple[Trajectory, float]] = {}
"""Name to (function, usual duration [s])."""


@dataclass(frozen=True)
class Reference:
    """What the controller follows, sampled at its ticks; D is the reference's body frame.

    `time` (N,), `position_E`, `velocity_E`, `acceleration_E` (N, 3), `R_ED` (N, 3, 3), `omega_D`, `omega_dot_D` (N, 3).
    """

    time: Array
    position_E: Array
    velocity_E: Array
    acceleration_E: Array
    R_ED: Array
    omega_D: Array
    omega_dot_D: Array


def trajectory(name: str, seconds: float) -> Callable[[Trajectory], Trajectory]:
    """Register a trajectory under `name` with its usual duration."""

    def register(function: Trajectory) -> Trajectory:
        TRAJECTORIES[name] = (function, seconds)
        return function

    return register


def reference(name: str, seconds: float, rate: float, seed: int) -> Reference:
    """Sample trajectory `name` at `rate` [Hz]; derivatives are central differences over +-1 ms."""
    function = TRAJECTORIES[name][0]
    time = np.arange(round(seconds * rate)) / rate
    eps = 1e-3
    stencil = (time[:, None] + np.array([-eps, 0.0, eps])).ravel()
    position, rotvec = function(stencil, np.random.default_rng([seed, 7]))
    p = position.reshape(-1, 3, 3)
    R = Rotation.from_rotvec(rotvec).as_matrix().reshape(-1, 3, 3, 3)
    forward = Rotation.from_matrix(np.swapaxes(R[:, 1], 1, 2) @ R[:, 2]).as_rotvec()
    backward = Rotation.from_matrix(np.swapaxes(R[:, 0], 1, 2) @ R[:, 1]).as_rotvec()
    return Reference(
        time=time,
        position_E=p[:, 1],
        velocity_E=(p[:, 2] - p[:, 0]) / (2 * eps),
        acceleration_E=(p[:, 2] - 2 * p[:, 1] + p[:, 0]) / eps**2,
        R_ED=R[:, 1],
        omega_D=(forward + backward) / (2 * eps),
        omega_dot_D=(forward - backward) / eps**2,
    )


def quintic(s: Array) -> Array:
    """0 to 1 with zero first and second derivatives at both ends, for s in 0..1 (clamped outside)."""
    s = np.clip(s, 0.0, 1.0)
    return np.asarray(s**3 * (10 - 15 * s + 6 * s**2))


def multisine(time: Array, rng: np.random.Generator, low: float, high: float, fall: float = 1.0) -> Array:
    """Six tones between `low` and `high` [Hz], unit rms, random phases, amplitude falling as f^-fall."""
    tones = 6
    f = low * (high / low) ** ((np.arange(tones) + rng.uniform(0.1, 0.9, tones)) / tones)
    a = f**-fall
    phase = rng.uniform(0, 2 * np.pi, tones)
    return np.asarray((a * np.sin(2 * np.pi * np.outer(time, f) + phase)).sum(1) / np.sqrt((a**2).sum() / 2))


def limited(vector: Array, limit: float) -> Array:
    """Shorten vectors (N, k) smoothly so that their length stays below `limit`."""
    length = np.linalg.norm(vector, axis=1, keepdims=True)
    return np.asarray(vector / (1 + (length / limit) ** 6) ** (1 / 6))


def level(time: Array, height: float = 1.6) -> tuple[Array, Array]:
    """Stand still at `height` [m]."""
    return np.tile([0.0, 0.0, height], (len(time), 1)), np.zeros((len(time), 3))


@trajectory("train", 40.0)
def train(time: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Multi-axis excitation: multisines on position and attitude, tilt to 70 deg, faded in over 3 s."""
    position, rotvec = level(time)
    fade = quintic(time / 3.0)
    for axis, rms in enumerate((0.45, 0.45, 0.12)):
        position[:, axis] += fade * rms * multisine(time, rng, 0.07, 0.45)
    slow = np.stack([np.deg2rad(rms) * multisine(time, rng, 0.06, 0.40, 0.2) for rms in (36.0, 36.0, 20.0)], 1)
    fast = np.stack([np.deg2rad(rms) * multisine(time, rng, 0.5, 2.0) for rms in (1.8, 1.8, 1.2)], 1)
    rotvec = fade[:, None] * (slow + fast)
    rotvec[:, :2] = limited(rotvec[:, :2], np.deg2rad(70.0))
    return position, rotvec


@trajectory("pitch", 24.0)
def pitch(time: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Pitch 0-60-0 deg on the spot: quintics of 5.3 s, held 1.4 s, repeated every 12 s."""
    position, rotvec = level(time)
    phase = np.mod(time, 12.0)
    rotvec[:, 1] = np.deg2rad(60.0) * (quintic(phase / 5.3) - quintic((phase - 6.7) / 5.3))
    return position, rotvec


@trajectory("figure8", 30.0)
def figure8(time: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Fly A (sin wt, sin(2wt)/2, 0), A = 1 m, period 10 s, with roll and pitch sinusoids up to a tilt of 63 deg."""
    position, rotvec = level(time)
    fade = quintic(time / 4.0)
    w, start = 2 * np.pi / 10.0, rng.uniform(0, 2 * np.pi)
    position[:, 0] += fade * np.sin(w * time + start)
    position[:, 1] += fade * 0.5 * np.sin(2 * (w * time + start))
    rotvec[:, 0] = fade * np.sin(0.7 * w * time + start)
    rotvec[:, 1] = fade * np.sin(w * time + 0.5 * np.pi + start)
    tilt = np.linalg.norm(rotvec[:, :2], axis=1, keepdims=True)
    rotvec[:, :2] *= np.deg2rad(63.0) / max(float(tilt.max()), 1e-9)
    return position, rotvec


def _steps(time: Array, rng: np.random.Generator, size: float, rise: float, every: float) -> Array:
    """Random levels of at most `size`, changed every `every` seconds by a quintic of `rise` seconds; starts at 0."""
    levels = np.concatenate(([0.0], rng.uniform(-size, size, 200)))
    k = np.clip(np.floor(time / every).astype(int), 0, 198)
    return np.asarray(levels[k] + (levels[k + 1] - levels[k]) * quintic((time - k * every) / rise))


@trajectory("steps", 30.0)
def steps(time: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Hover with steps of up to 0.4 m and 30 deg on all axes, each taken in 0.6-1 s, at different times."""
    position, rotvec = level(time)
    for axis, (metres, degrees) in enumerate(((0.2, 15.0), (0.2, 15.0), (0.1, 15.0))):
        position[:, axis] += _steps(time, rng, metres, 1.0, 2.1 + 0.3 * axis)
        rotvec[:, axis] = _steps(time, rng, np.deg2rad(degrees), 0.6, 1.7 + 0.2 * axis)
    return position, rotvec


@trajectory("hover", 20.0)
def hover(time: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Stand still."""
    return level(time)


@trajectory("fast", 40.0)
def fast(time: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Nearly level flight at up to 5 m/s (multisine on x and y), small attitude excitation."""
    position, _ = level(time, 3.0)
    fade = quintic(time / 4.0)
    for axis, rms in enumerate((4.0, 4.0, 0.4)):
        position[:, axis] += fade * rms * multisine(time, rng, 0.05, 0.20)
    wobble = np.stack([np.deg2rad(8.0) * multisine(time, rng, 0.15, 1.0) for _ in range(3)], 1)
    return position, fade[:, None] * wobble


@trajectory("low", 40.0)
def low(time: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Height scan between 0.15 m and 1.2 m with moderate tilt: what shows a ground effect."""
    position, _ = level(time, 0.0)
    fade = quintic(time / 3.0)
    position[:, 2] = 0.675 + 0.525 * np.cos(2 * np.pi * time / 13.0 + 0.3)
    wobble = np.stack([np.deg2rad(6.0) * multisine(time, rng, 0.1, 0.6) for _ in range(3)], 1)
    return position, fade[:, None] * wobble


@trajectory("turn", 40.0)
def turn(time: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Two slow full turns of yaw while tilting to 35 deg: separates what is fixed in E from what is fixed in B."""
    position, _ = level(time)
    fade = quintic(time / 3.0)
    yaw = 4 * np.pi * quintic(time / max(float(time[-1]), 1.0))
    tilt = limited(
        np.stack([np.deg2rad(22.0) * multisine(time, rng, 0.07, 0.4) for _ in range(2)], 1), np.deg2rad(35.0)
    )
    lean = Rotation.from_rotvec(np.column_stack((fade[:, None] * tilt, np.zeros(len(time)))))
    turned = Rotation.from_rotvec(np.column_stack((np.zeros((len(time), 2)), yaw))) * lean
    return position, turned.as_rotvec()


@trajectory("mission", 28.0)
def mission(time: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Hovers of 1.5 s, level lines of 2.5 s through random points in a box of 4 m, a turn of heading with each."""
    position, rotvec = level(time)
    points = np.vstack(([0.0, 0.0, 0.0], rng.uniform((-2, -2, -0.6), (2, 2, 0.9), (60, 3))))
    headings = np.concatenate(([0.0], np.cumsum(rng.uniform(-1.2, 1.2, 60))))
    leg = np.clip(np.floor(time / 4.0).astype(int), 0, 59)
    done = quintic((time - 4.0 * leg - 1.5) / 2.5)
    position += points[leg] + (points[leg + 1] - points[leg]) * done[:, None]
    rotvec[:, 2] = headings[leg] + (headings[leg + 1] - headings[leg]) * done
    return position, rotvec
