"""How far a compensated attitude loop is from instability, whether the mismatch that was learnt is there or not.

A compensation that expects the slope dmu/dW commands dW_cmd = A^-1 dW_des with A = I + dmu/dW. If the slope is there,
the vehicle answers as its controller believes. If it is not, the loop's torque is multiplied by A^-1. With the loop of
one axis, actuators of lag tau and delay T between the command and the torque,

    L(s) = (2 zeta w s + w^2) / s^2 exp(-s T) / (1 + tau s),        T(s) = L / (1 + L)

the multiplicative change D = J^-1 (A^-1 - I) J leaves the loop stable as long as |D| |T| < 1 at all frequencies (small
gain; Zames, IEEE Trans. Automatic Control 11, 1966; Skogestad and Postlethwaite, Multivariable Feedback Control, 7.5).
The margin is how many times larger D might be:

    margin = 1 / (sigma_max(D) max_w |T(j w)|)          infinite for no slope, below 1: not guaranteed

A process that also looks at past commands feeds its own corrections back. At frequencies above its 50 ms lag `past` is
the last command itself, so that |A^-1 dmu/dpast| < 1 is wanted as well; its inverse is a margin of the same kind.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wrenchgap.flight.flight import AXES, Array
from wrenchgap.plant.controller import ControllerGains
from wrenchgap.plant.mismatch import MismatchModel, output_indices

FREQUENCIES = np.logspace(-2, 3, 2000)
"""[rad/s] at which the loop is looked at."""


@dataclass(frozen=True)
class Margin:
    """Stability margins (N,) along N commands, the peak of |T|, and the lag and delay [s] that it was found with."""

    along: Array
    peak: float
    lag: float
    delay: float

    @property
    def least(self) -> float:
        """Of 99 % of the commands."""
        return float(np.percentile(self.along, 1))


def loop_peak(gains: ControllerGains, lag: float = 0.0, delay: float = 0.0) -> float:
    """Largest |T(j w)| of the three attitude loops, with actuators of this lag and delay [s]."""
    s = 1j * FREQUENCIES
    peaks = []
    for zeta, omega in zip(gains.zeta_attitude, gains.omega_attitude, strict=True):
        L = (2.0 * zeta * omega * s + omega**2) / s**2 * np.exp(-s * delay) / (1.0 + lag * s)
        peaks.append(float(np.abs(L / (1.0 + L)).max()))
    return max(peaks)


def sensitivity_peak(loop: Loop, observer_hz: float = 0.0) -> float:
    """Largest |S(j w)| of the three attitude loops with a momentum observer (`compensate.Combined`) inside.

    The observer, k = 2 pi observer_hz, adds its estimate to the controller's torque: J s omega = H(M_c - d_hat) + d and
    d_hat = k/s (J s omega - M_c), with H of lag and delay, make the loop

        L(s) = H/s [(1 + k/s) (2 zeta w s + w^2)/s + k],        S = 1 / (1 + L)

    and without lag and delay S is that of the controller times s / (s + k). A peak below 2 is usual (Astrom and Murray,
    Feedback Systems, 2008, 11.3), infinite peaks belong to loops at the edge of stability; beyond it the number means
    nothing.
    """
    s, k = 1j * FREQUENCIES, 2.0 * np.pi * observer_hz
    H = np.exp(-s * loop.delay) / (1.0 + loop.lag * s)
    peaks = []
    for zeta, omega in zip(loop.gains.zeta_attitude, loop.gains.omega_attitude, strict=True):
        L = H / s * ((1.0 + k / s) * (2.0 * zeta * omega * s + omega**2) / s + k)
        peaks.append(float(np.abs(1.0 / (1.0 + L)).max()))
    return max(peaks)


@dataclass(frozen=True)
class Loop:
    """The attitude loop: its gains, the inertia (3, 3) [kg m^2], lag and delay [s] of the actuators."""

    gains: ControllerGains
    inertia: Array
    lag: float = 0.0
    delay: float = 0.0


def margin(slope: Array, outputs: tuple[str, ...], loop: Loop, past: Array | None = None) -> Margin:
    """Margin of slopes dmu/dW (N, L, 6), and those with respect to `past` (N, L, 6) where the model looks at it.

    `outputs` names the L rows. Forces have no attitude loop and count by the same peak.
    """
    rows = output_indices(outputs)
    A = np.eye(len(rows)) + slope[:, :, rows]
    weight = np.array([1.0 if row < 3 else float(loop.inertia[row - 3, row - 3]) for row in rows])
    with np.errstate(all="ignore"):
        inverse = np.linalg.pinv(A)
        change = (inverse - np.eye(len(rows))) * weight / weight[:, None]
        size = np.linalg.norm(change, 2, axis=(1, 2))
        peak = loop_peak(loop.gains, loop.lag, loop.delay)
        along = 1.0 / np.maximum(size * peak, 1e-12)
        if past is not None:
            back = inverse @ past[:, :, rows] * weight / weight[:, None]
            along = np.minimum(along, 1.0 / np.maximum(np.linalg.norm(back, 2, axis=(1, 2)), 1e-12))
    singular = np.linalg.svd(A, compute_uv=False)[:, -1]
    return Margin(np.where(singular > 1e-6, along, 0.0), peak, loop.lag, loop.delay)


def of_model(model: MismatchModel, inputs: Array, loop: Loop) -> Margin:
    """The margin of a mismatch model along inputs (N, D) of it: the command first, `past` last where it looks at it."""
    slope, size = model.jacobian(inputs), len(AXES)
    past = slope[:, :, -size:] if "past" in getattr(model, "input_groups", ()) else None
    return margin(slope[:, :, :size], model.outputs, loop, past)
