"""A disturbance observer: the alternative that needs no model of the mismatch, because it looks at what happens.

With angular momentum L = J omega and Euler's equation L' + omega x L = M_cmd + d, the estimate

    d_hat = k [L - integral (M_cmd - omega x L + d_hat) dt],        d_hat' = k (d - d_hat)

follows the disturbance d as a first-order low-pass of bandwidth k, without differentiating the gyro (momentum
observer: De Luca and Mattone, ICRA 2003; on multirotors Tomic, Ott and Haddadin, RA-L 2017). The command is the
desired torque less d_hat. It lags behind whatever changes faster than k, and raising k feeds back noise and the delay
of the actuators.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from wrenchgap.compensate.compensator import Result
from wrenchgap.flight.errors import UsageError
from wrenchgap.flight.flight import Array
from wrenchgap.plant.state import State
from wrenchgap.plant.vehicle import Vehicle


class DisturbanceObserver:
    """Steps like `Compensator`, and corrects the torques by what it has seen.

    dt            period at which `step` is called [s]
    bandwidth_hz  k / (2 pi), at most 1 / (2 pi dt): beyond that the discrete estimate overshoots by itself
    """

    def __init__(self, vehicle: Vehicle, dt: float, bandwidth_hz: float = 1.0) -> None:
        if not (math.isfinite(dt) and dt > 0 and math.isfinite(bandwidth_hz) and bandwidth_hz > 0):
            raise UsageError(f"observer: dt {dt} s and bandwidth {bandwidth_hz} Hz must be positive")
        if 2.0 * math.pi * bandwidth_hz * dt > 1.0:
            raise UsageError(
                f"observer: bandwidth {bandwidth_hz:g} Hz is too much for steps of {dt:g} s; expected at most "
                f"{1.0 / (2.0 * math.pi * dt):.3g} Hz"
            )
        self.inertia = vehicle.body.inertia
        self.dt, self.gain = dt, 2.0 * math.pi * bandwidth_hz
        self.reset()

    def reset(self) -> None:
        """Forget the past."""
        self._integral: Array | None = None
        self._estimate = np.zeros(3)
        self._torque = np.zeros(3)

    def step(self, wrench_des: ArrayLike, state: State | None = None) -> Result:
        """Command for the desired wrench (6,) in this state (N = 1). Raises UsageError without a state."""
        if state is None:
            raise UsageError("a disturbance observer needs the state: step(wrench_des, state)")
        omega = state.omega_B[0]
        momentum = self.inertia @ omega
        if self._integral is None:
            self._integral = momentum.copy()
        else:
            self._integral += self.dt * (self._torque - np.cross(omega, momentum) + self._estimate)
        self._estimate = self.gain * (momentum - self._integral)
        correction = np.concatenate((np.zeros(3), -self._estimate))
        command = np.array(wrench_des, dtype=float) + correction
        self._torque = command[3:]
        return Result(command, correction, correction, sigma=0.0, beta=0.0, cost=0.0, iterations=0, accepted=True)
