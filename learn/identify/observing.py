"""The bandwidth of an observer beside a process, from the log that the process was learnt from.

An observer of bandwidth k on a vehicle that follows with the lag tau (delay included) makes, of a disturbance d and of
noise n in the measured rates,

    correction = -k / (tau s^2 + s + k) d,        torque = k J n          above its bandwidth

The first is the observer's low-pass behind the lag, with the loop that it closes: its damping is 1 / (2 sqrt(k tau)),
so k is bounded by k tau <= `MOST`, a damping of 0.41. tau is the lag that held-out time showed (`learn.identify.lag`)
with that of named effects; where there is none it is taken for `UNKNOWN`. Up to that bound k is what would have left
least on the training log, with d the residual that the effects and the lag leave, and n the gyroscope above the
filter's cut-off, noise and vibration alike:

    E(k)^2 = sum over axes of [rms(d - k / (tau s^2 + s + k) d)^2 + (k J rms(n))^2] / J^2

d is all of the residual and not what the process leaves of it: of flights that the process has not seen nobody knows
what it will leave, and where it is distrusted it leaves all.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.signal import bilinear, lfilter

from wrenchgap.flight.flight import Array
from wrenchgap.learn.data.measurement import Record, low_pass
from wrenchgap.learn.identify.lag import lagged
from wrenchgap.learn.identify.samples import stretches
from wrenchgap.plant.model import Model
from wrenchgap.plant.stability import Loop

BANDWIDTHS_HZ = tuple(float(f) for f in np.geomspace(0.2, 12.0, 25))
"""That are tried."""
UNKNOWN = 0.1
"""Lag and delay [s] of a vehicle whose log shows none: tilt servos have 15 to 90 ms."""
MOST = 1.5
"""Largest k tau."""


def observer_hz(records: Sequence[Record], base: Model, late: Array, loop: Loop) -> float:
    """Bandwidth [Hz] of an observer for these flights (`compensate.Combined`), on a vehicle with the lag of `loop`.

    `late` (6,) [s] are the lags of the outputs that `base` does not know.
    """
    tau = loop.lag + loop.delay if loop.lag > 0 else UNKNOWN
    most = min(MOST / tau, base.controller.rate_hz) / (2.0 * np.pi)
    J = np.diag(base.vehicle.body.inertia)
    tried = [*(f for f in BANDWIDTHS_HZ if f < most), most]
    left = residuals(records, base, late)
    noise = np.sqrt(np.mean([fast_rates(r) ** 2 for r in records], axis=0))
    costs = [np.sum((missed(left, f, tau) ** 2 + (2.0 * np.pi * f * J * noise) ** 2) / J**2) for f in tried]
    return float(tried[int(np.argmin(costs))])


def fast_rates(record: Record) -> Array:
    """Rms (3,) of the gyroscope above the filter's cut-off [rad/s]: its noise, and vibration."""
    omega = record.state.omega_B
    return np.asarray(np.std(omega - low_pass(omega, record.dt, record.cutoff_hz), axis=0))


def residuals(records: Sequence[Record], base: Model, late: Array) -> list[tuple[Array, float]]:
    """Torques (K, 3) that model and lags (6,) [s] leave of each record, and the time between them [s]."""
    found = []
    for part in stretches(records, base):
        left = part.measured - lagged(part.expected, late, part.dt)
        found.append((np.nan_to_num(left[:, 3:]), part.dt))
    return found


def missed(parts: Sequence[tuple[Array, float]], hz: float, tau: float) -> Array:
    """Rms (3,) of what an observer of this bandwidth leaves of disturbances (K, 3)."""
    squares, count, k = np.zeros(3), 0, 2.0 * np.pi * hz
    for d, dt in parts:
        b, a = bilinear([k], [tau, 1.0, k], fs=1.0 / dt)
        squares += np.sum((d - lfilter(b, a, d, axis=0)) ** 2, axis=0)
        count += len(d)
    return np.asarray(np.sqrt(squares / max(count, 1)))
