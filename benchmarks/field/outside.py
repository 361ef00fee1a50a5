"""What no catalogue of one rigid body has: a load on a rope, a sloshing tank, a magnet, a rotor that comes and goes.

What is `attached` has a motion of its own: `step` advances it by a control tick, from position and velocity of O in E,
RotorPy's state and the true IMU reading (9,) of `Craft.imu`, and returns the force at O and the torque, both in B, that
it holds for that tick. A push without a memory is a `truth.Push`.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.field.truth import Push
from benchmarks.field.vehicles import GRAVITY
from benchmarks.hidden_effects.autopilot import cross
from wrenchgap.flight.flight import Array

SUBSTEPS = 20


@dataclass
class SlungLoad:
    """A point mass [kg] on a rope of `length` [m] from O; the rope is a damped spring that does not push.

    Its stiffness gives the load 8 Hz along the rope: a rope of a light vehicle, and steady at these steps.
    """

    mass: float
    length: float
    _at: Array | None = None
    _velocity: Array = field(default_factory=lambda: np.zeros(3))

    def step(
        self, dt: float, position: Array, velocity: Array, state: dict[str, Array], _: Array
    ) -> tuple[Array, Array]:
        """Symplectic Euler in fine steps, O on a straight line meanwhile."""
        w = 2 * np.pi * 8.0
        if self._at is None:
            self._at = position - np.array((0.0, 0.0, self.length + GRAVITY / w**2))
        total, h = np.zeros(3), dt / SUBSTEPS
        for k in range(SUBSTEPS):
            rope = position + velocity * (k * h) - self._at
            length = float(np.linalg.norm(rope))
            along = rope / length
            rate = float((velocity - self._velocity) @ along)
            tension = max(0.0, self.mass * (w**2 * (length - self.length) + 0.2 * w * rate))
            self._velocity = self._velocity + h * (tension / self.mass * along - np.array((0.0, 0.0, GRAVITY)))
            self._at = self._at + h * self._velocity
            total -= tension * along / SUBSTEPS
        R = Rotation.from_quat(state["q"]).as_matrix()
        return R.T @ total, np.zeros(3)


@dataclass
class Slosh:
    """A share `mass` [kg] of the vehicle moves on springs in a plane `below` O [m]: x'' = -w^2 x - 2 z w x' - f.

    f is the specific force in the tank, level part; the hull feels -mass x'' there. 10 % damped. A vehicle whose rotors
    all push along z has no level specific force in its middle, so a tank there would never slosh.
    """

    mass: float
    frequency: float  # Hz
    below: float
    _x: Array = field(default_factory=lambda: np.zeros(2))
    _v: Array = field(default_factory=lambda: np.zeros(2))

    def step(self, dt: float, _p: Array, _v: Array, _s: dict[str, Array], reading: Array) -> tuple[Array, Array]:
        """Symplectic Euler; its weight's lever turns the hull."""
        w, place = 2 * np.pi * self.frequency, np.array((0.0, 0.0, -self.below))
        rate, felt, turning = np.split(reading, 3)
        felt = felt + cross(turning, place) + cross(rate, cross(rate, place))
        total, h = np.zeros(2), dt / SUBSTEPS
        for _ in range(SUBSTEPS):
            a = -(w**2) * self._x - 0.2 * w * self._v - felt[:2]
            self._v = self._v + h * a
            self._x = self._x + h * self._v
            total -= self.mass * a / SUBSTEPS
        force, down = np.array((*total, 0.0)), self.mass * felt[2]
        return force, cross(place, force) + np.array((-self._x[1] * down, self._x[0] * down, 0.0))


def magnet(torque: float, heading: float) -> Push:
    """A magnet along body x in a level field: torque m x R^T b, largest `torque` [Nm]."""
    field_E = np.array((np.cos(heading), np.sin(heading), 0.0))

    def push(_time: float, _place: Array, R: Array) -> tuple[Array, Array]:
        return np.zeros(3), torque * np.cross((1.0, 0.0, 0.0), R.T @ field_E)

    return push


def intermittent(loss: float, place_B: Array, seed: int) -> Push:
    """A rotor at `place_B` that loses `loss` [N] for 0.4 to 1.5 s at a time, about half of the time."""
    edges = np.cumsum(np.random.default_rng(seed).uniform(0.4, 1.5, 400))
    force = np.array((0.0, 0.0, -loss))
    weak = force, np.cross(place_B, force)

    def push(time: float, _place: Array, _R: Array) -> tuple[Array, Array]:
        return weak if int(np.searchsorted(edges, time)) % 2 else (np.zeros(3), np.zeros(3))

    return push
