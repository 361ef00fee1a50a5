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

from wrenchgap.compensate.combined import Combined
from wrenchgap.flight.errors import UsageError
from wrenchgap.plant.vehicle import Vehicle


class DisturbanceObserver(Combined):
    """`Combined` without a feed-forward and without an assumed lag: steps like `Compensator`, and corrects the torques.

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
        super().__init__(vehicle, dt, bandwidth_hz)
