"""The bandwidth of an observer of what a process leaves, from the log that it was learnt from.

With the residual d (K, 3) that process, effects and lag leave of the training log, an observer of bandwidth k would
have corrected H Q_k d of it, H being lag and delay of the vehicle and Q_k a first-order low-pass. And it would have
added what it makes of the gyroscope's noise and of vibration, k J n with n the rates above the filter's cut-off. k is
what leaves least

    E(k)^2 = sum over axes of [rms(d - H Q_k d)^2 + (k J rms(n))^2] / J^2

up to a bound. The part of the lag that nobody knows closes a loop around the observer (`compensate.combined`), whose
gain stays below one for k dT < 1: half of a lag that was found is taken for unknown, and `UNKNOWN` where none was.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from wrenchgap.flight.flight import Array
from wrenchgap.learn.data.inputs import process_inputs
from wrenchgap.learn.data.measurement import Record, low_pass
from wrenchgap.learn.identify.lag import lagged
from wrenchgap.learn.identify.samples import stretches
from wrenchgap.learn.process.gp import GaussianProcess
from wrenchgap.plant.effects.lag import delay as delayed
from wrenchgap.plant.mismatch import output_indices
from wrenchgap.plant.model import Model
from wrenchgap.plant.stability import Loop

BANDWIDTHS_HZ = tuple(float(f) for f in np.geomspace(0.2, 12.0, 25))
"""That are tried; a vehicle whose lag is known well has the best beyond neither end."""
UNKNOWN = 0.08
"""Lag and delay [s] that are taken for unknown where the log shows no lag: servos have 15 to 90 ms."""
UNSURE = 0.5
"""Share of a lag and delay that was found which is taken for unknown."""


def observer_hz(records: Sequence[Record], base: Model, gp: GaussianProcess, loop: Loop) -> float:
    """Bandwidth [Hz] for `compensate.Combined`, for these flights, with the lag and delay of `loop`.

    The process's torques count; where it has no torque among its outputs, what `base` leaves.
    """
    unsure = UNSURE * (loop.lag + loop.delay) if loop.lag > 0 else UNKNOWN
    period = 1.0 / base.controller.rate_hz
    most = min(1.0 / unsure, 1.0 / period) / (2.0 * np.pi)
    J = np.diag(base.vehicle.body.inertia)
    tried = [f for f in BANDWIDTHS_HZ if f < most] + [most]
    left = [(part, dt) for part, dt in _residuals(records, base, gp, loop) if len(part) > 1]
    noise = np.sqrt(np.mean([fast_rates(r) ** 2 for r in records], axis=0))
    costs = [np.sum((_missed(left, f, loop) ** 2 + (2.0 * np.pi * f * J * noise) ** 2) / J**2) for f in tried]
    return float(tried[int(np.argmin(costs))])


def fast_rates(record: Record) -> Array:
    """Rms (3,) of the gyroscope above the filter's cut-off [rad/s]: its noise, and vibration."""
    omega = record.state.omega_B
    return np.asarray(np.std(omega - low_pass(omega, record.dt, record.cutoff_hz), axis=0))


def _residuals(records: Sequence[Record], base: Model, gp: GaussianProcess, loop: Loop) -> list[tuple[Array, float]]:
    """Torques (K, 3) that are left on each record, and the time between them [s]."""
    found = []
    late = np.zeros(6)
    rows = output_indices(gp.outputs)
    late[rows] = gp.provenance.lags or np.zeros(len(rows))
    for record, part in zip(records, stretches(records, base), strict=True):
        expected = part.expected.copy()
        expected[:, rows] += gp.mean(process_inputs(gp.settings.inputs, record))
        left = np.nan_to_num((part.measured - lagged(expected, late, part.dt))[:, 3:])
        found.append((left, part.dt))
    return found


def _missed(parts: Sequence[tuple[Array, float]], hz: float, loop: Loop) -> Array:
    """Rms (3,) of d - H Q d."""
    squares, count = np.zeros(3), 0
    for d, dt in parts:
        seen = lagged(lagged(d, 1.0 / (2.0 * np.pi * hz), dt), loop.lag, dt)
        late, _ = delayed(seen, loop.delay, dt, None)
        squares += np.sum((d - late) ** 2, axis=0)
        count += len(d)
    return np.sqrt(squares / max(count, 1))
