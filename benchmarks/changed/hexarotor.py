"""The tilting hexarotor's flights: what each differs by from the others, and one servo whose zero has moved."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.changed.fleet import Hidden as There
from benchmarks.hidden_effects.airframe import ARM_LENGTH, ARMS, MASS, Airframe
from benchmarks.hidden_effects.hidden import TiltOffset, _drag
from benchmarks.hidden_effects.world import Engine, Hidden
from wrenchgap.flight.flight import Array

AREAS = (0.03, 0.03, 0.05)
"""m^2, drag areas of the hull: what the wind acts on."""


class Usual(Hidden):
    """Everything that all flights have, and what this one differs by; comes after what is hidden."""

    def __init__(self, differs: dict[str, Any], thrust: float, place: float) -> None:
        self._gains = thrust * differs["gains"]
        self._place = ARM_LENGTH * (np.array((place, 0.0, 0.0)) + differs["place"])
        self._mount, self._wind = differs["mount"], differs["wind"]

    def build(self, airframe: Airframe) -> None:
        """Centre of mass, and mounting of the IMU."""
        airframe.hull_shift = airframe.hull_shift + self._place * MASS / airframe.hull()[0]
        airframe.imu_rotvec = airframe.imu_rotvec + self._mount

    def thrust(self, world: Engine, thrust: Array) -> Array:
        """Battery, air, and each rotor by itself."""
        return np.asarray(thrust * self._gains)

    def push(self, world: Engine) -> None:
        """Wind."""
        _drag(world, AREAS, world.velocity_E - self._wind)


def servo_zero(degrees: float, seed: int) -> tuple[Hidden, There]:
    """One arm's servo stands off by `degrees`, to either side."""
    rng = np.random.default_rng([seed, 31])
    arm, sign = int(rng.integers(ARMS)), 1.0 if rng.random() < 0.5 else -1.0
    angle = sign * float(np.radians(degrees))
    turned = TiltOffset(tuple(angle if k == arm else 0.0 for k in range(ARMS)))
    return turned, There(("tilt_offset",), "tilt_offset", {f"arm_{arm}": angle})


def added(effect: str, values: dict[str, Any], answers: tuple[str, ...]) -> There:
    """What the engine says that it hid, as parameters of the catalogue."""
    if effect == "weak_rotor":
        return There(answers, "rotor_thrust", {f"rotor_{int(values['rotor'])}": -float(values["loss"])})
    if effect == "mass":
        return There(answers, "mass", {"added": MASS * float(values["relative"])})
    if effect in ("com_offset", "imu_turned"):
        name = "com_offset" if effect == "com_offset" else "imu_misalignment"
        return There(answers, name, {a: float(values[a]) for a in "xyz"})
    return There(answers, answers[0], {})
