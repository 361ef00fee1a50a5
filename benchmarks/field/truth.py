"""What really flies: the vehicle as it was built, and the air around it. Effects change it; the engine flies it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from benchmarks.field.vehicles import Vehicle
from wrenchgap.flight.flight import Array

ZERO = np.zeros(3)
Push = Callable[[float, Array, Array], tuple[Array, Array]]
"""(time, position of O in E, R_EB) to a force at O and a torque, both (3,) in B."""


@dataclass(frozen=True)
class Truth:
    """Everything that may differ from `vehicle`; the defaults differ in nothing.

    `params` are changes of RotorPy's dictionary (mass, inertia, k_m, and the air: c_Dx, k_d, k_z, k_h). `com_B`,
    `imu_B` (3,) [m] from O, `imu_rotvec` (3,) [rad]. `gains` (R,) multiply thrust and drag torque. `tau` (up, down) [s]
    of the rotors, `delay` in control ticks. `curve` (u_0, n): thrust goes with ((s - u_0) / (1 - u_0))^n, s the speed
    command over hover's. `coaxial`: share of a lower rotor's thrust lost at equal speeds; `ground`: factor of
    Cheeseman's and Bennett's gain. `drop`: relative voltage lost per minute of hover, `shows_voltage` whether the log
    has it. `wind_E` (3,) [m/s]; `gusts` is the rms of turbulence [m/s]. `pushes` are forces of other things.
    `attached` makes something with a motion of its own (`outside.py`).
    """

    vehicle: Vehicle
    params: dict[str, Any] = field(default_factory=dict)
    com_B: Array = field(default_factory=ZERO.copy)
    imu_B: Array = field(default_factory=ZERO.copy)
    imu_rotvec: Array = field(default_factory=ZERO.copy)
    gains: Array | None = None
    tau: tuple[float, float] = (0.0, 0.0)
    delay: int = 0
    curve: tuple[float, float] = (0.0, 2.0)
    coaxial: float = 0.0
    ground: float = 0.0
    drop: float = 0.0
    shows_voltage: bool = True
    wind_E: Array = field(default_factory=ZERO.copy)
    gusts: float = 0.0
    pushes: tuple[Push, ...] = ()
    attached: Callable[[], Any] | None = None

    def but(self, **changes: Any) -> Truth:
        """With something else."""
        return replace(self, **changes)

    def param(self, name: str) -> Any:
        """As RotorPy has it."""
        return self.params.get(name, self.vehicle.params()[name])

    def with_params(self, **changes: Any) -> Truth:
        """With other parameters of RotorPy."""
        return replace(self, params={**self.params, **changes})

    @cached_property
    def changes_thrust(self) -> bool:
        """Whether any rotor gives other than k_eta Omega^2."""
        return self.gains is not None or self.curve != (0.0, 2.0) or any((self.coaxial, self.ground, self.drop))

    @property
    def thrust_gains(self) -> Array:
        """(R,)."""
        return np.ones(self.vehicle.rotors) if self.gains is None else self.gains


def thrust_factor(truth: Truth, speed: Array, height: float, charge: float) -> Array:
    """Thrust of each rotor (R,) over k_eta Omega^2, at speeds (R,) [rad/s], a height [m] and a charge (1: full).

    Laws that are not the catalogue's: the lower rotor of a pair loses coaxial * 2 r / (1 + r), r = T_up / T_low (as in
    `hidden_effects`); near the ground 1 / (1 - ground (R / 4z)^2), one height for all rotors (Cheeseman and Bennett
    1955), z at least 0.6 R; a battery takes (1 - drop (1 - charge))^1.5.
    """
    factor = truth.thrust_gains.copy()
    dead, power = truth.curve
    if (dead, power) != (0.0, 2.0):
        s = np.maximum(speed / truth.vehicle.hover_speed, 1e-3)
        factor *= (np.maximum(s - dead, 0.0) / (1.0 - dead)) ** power / s**2
    if truth.coaxial:
        up, low = speed[0::2] ** 2, speed[1::2] ** 2
        factor[1::2] *= 1.0 - truth.coaxial * 2.0 * up / (up + low + 1e-9)
    if truth.ground:
        radius = truth.vehicle.radius
        factor /= 1.0 - truth.ground * (radius / (4.0 * max(height, 0.6 * radius))) ** 2
    return np.asarray(factor * (1.0 - truth.drop * (1.0 - charge)) ** 1.5)
