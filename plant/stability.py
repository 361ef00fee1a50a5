"""Stability margin of a compensated attitude loop where the learnt mismatch may be absent.

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

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.flight import AXES, Array
from wrenchgap.flight.formats.rate_loop import RateLoop
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
        """The margin that 99 % of the commands exceed."""
        return float(np.percentile(self.along, 1))


@dataclass(frozen=True)
class Loop:
    """The attitude loop: its gains, the inertia (3, 3) [kg m^2], lag and delay [s] of the actuators.

    `named_delay` [s] is the part of the delay that is in the vehicle's model, and that an observer assumes.
    """

    gains: ControllerGains
    inertia: Array
    lag: float = 0.0
    delay: float = 0.0
    named_delay: float = 0.0


@dataclass(frozen=True)
class Observer:
    """A momentum observer (`compensate.Combined`): bandwidth [Hz], assumed lag and delay [s]."""

    hz: float = 0.0
    lag: float = 0.0
    delay: float = 0.0


NO_OBSERVER = Observer()


def open_loop(loop: Loop, observer: Observer = NO_OBSERVER) -> Array:
    """L(j w) (3, F) of the three attitude loops, broken at the commanded torque.

    With J s^2 theta = H M_asked + d, the controller's torque -J c theta, c = 2 zeta w s + w^2, the actuators
    H = exp(-s T) / (1 + tau s), what the observer takes them for, H_o, and its low-pass Q = k / (s + k),

        d_hat = Q (d + (H - H_o) M_asked),        M_asked = -J c theta - d_hat
        L = H (c / s^2 + Q) / (1 - Q H_o)

    The controller's integral is left out: the observer does its work. 1 - Q H_o has no zero to the right of the
    imaginary axis, since |Q H_o| < 1 there, and one at s = 0.
    """
    s, k = 1j * FREQUENCIES, 2.0 * np.pi * observer.hz
    H = np.exp(-s * loop.delay) / (1.0 + loop.lag * s)
    H_o = np.exp(-s * observer.delay) / (1.0 + observer.lag * s)
    Q = k / (s + k)
    zeta, omega = (np.asarray(v)[:, None] for v in (loop.gains.zeta_attitude, loop.gains.omega_attitude))
    return np.asarray(H * ((2.0 * zeta * omega * s + omega**2) / s**2 + Q) / (1.0 - Q * H_o))


def rate_loop(gains: RateLoop, acceleration: Array, lag: float, delay: float, lead: Array | float = 0.0) -> Array:
    """L(j w) (3, F) of attitude loops around an autopilot's rate loops, broken at the command.

    With the angular `acceleration` (3,) [rad/s^2] of a steady unit of torque, the `lead` (3,) [s] by which rotors that
    speed up turn the body before their drag does, and the letters of `flight.formats.rate_loop`,

        L = acceleration (1 + lead s) H O ((P + I / s) E (A T + s G) + D F s (s G, or E (A T + s G)) + FF A T) / s^2
    """
    s, column = 1j * FREQUENCIES, (slice(None), None)

    def low_pass(cutoff: Array) -> Array:
        return np.asarray(1.0 / (1.0 + s / (2.0 * np.pi * cutoff[column])))

    x = s / (2.0 * np.pi * gains.gyro)
    G = 1.0 / (1.0 + np.sqrt(2.0) * x + x**2)
    for centre, width, depth in 2.0 * np.pi * gains.notches * [1.0, 1.0, 0.5 / np.pi]:
        G = G * (s**2 + depth * width * s + centre**2) / (s**2 + width * s + centre**2)
    target = gains.angle[column] * low_pass(gains.target)
    error = low_pass(gains.error) * (target + s * G)
    turning = low_pass(gains.acceleration) * s * (error if gains.of_error else s * G)
    law = (gains.rate[column] + gains.integral[column] / s) * error + gains.derivative[column] * turning
    law = low_pass(gains.output) * (law + gains.forward[column] * target)
    H = np.exp(-s * delay) / (1.0 + lag * s)
    return np.asarray(acceleration[column] * (1.0 + np.outer(np.broadcast_to(lead, 3), s)) * H * law / s**2)


def growing_modes(L: Array, at_zero: int) -> NDArray[np.int_]:
    """The number of closed-loop poles (R,) are to the right of the imaginary axis, of loops L(j w) (R, F).

    `at_zero` poles of L are at s = 0, none to the right. Nyquist: 1 + L turns by (at_zero / 2 - that number) pi from
    low to high frequencies.
    """
    phase = np.unwrap(np.angle(1.0 + L), axis=1)
    return np.asarray(np.rint(at_zero / 2.0 - (phase[:, -1] - phase[:, 0]) / np.pi), dtype=int)


def _peak(loop: Loop, observer: Observer, of: Callable[[Array], Array]) -> float:
    """Largest size of a closed-loop function of L (3, F); infinite where the loop is unstable."""
    L = open_loop(loop, observer)
    if growing_modes(L, 3 if observer.hz > 0 else 2).any():
        return float("inf")
    return float(np.abs(of(L)).max())


def loop_peak(loop: Loop, observer: Observer = NO_OBSERVER) -> float:
    """Largest |T(j w)|, T = L / (1 + L), of the three attitude loops; infinite where one is unstable."""
    return _peak(loop, observer, lambda L: L / (1.0 + L))


def sensitivity_peak(loop: Loop, observer: Observer = NO_OBSERVER) -> float:
    """Largest |S(j w)|, S = 1 / (1 + L), of the three attitude loops: M_s; infinite where one is unstable.

    1 / M_s is the distance of L from -1: a gain margin of at least M_s / (M_s - 1) and a phase margin of at least
    2 arcsin(1 / (2 M_s)). Between 1.2 and 2 is usual (Astrom and Hagglund, Advanced PID Control, 2006, 4.6; Astrom and
    Murray, Feedback Systems, 2008, 11.3; Skogestad and Postlethwaite, 2.4: below 2).
    """
    return _peak(loop, observer, lambda L: 1.0 / (1.0 + L))


def phase_and_gain_margins(L: Array) -> tuple[Array, Array]:
    """Phase margins [deg] and gain margins [dB] (R,) of loops L(j w) (R, F) that begin as 1 / s^2, or 1 / s^3.

    At the last frequency at which |L| falls through one, and at the first beyond it at which the phase falls through
    -180 deg; infinite where it does not, NaN where |L| never falls through one.
    """
    size, phase, gain = np.abs(L), np.degrees(np.unwrap(np.angle(L), axis=1)), np.full(len(L), np.inf)
    phase -= 360.0 * np.round((phase[:, :1] + 180.0) / 360.0)
    margins = np.full(len(L), np.nan)
    for k in range(len(L)):
        crossings = np.flatnonzero((size[k, :-1] >= 1.0) & (size[k, 1:] < 1.0))
        if not len(crossings):
            continue
        at = int(crossings[-1])
        margins[k] = 180.0 + np.interp(0.0, -np.log(size[k, at : at + 2]), phase[k, at : at + 2])
        turned = np.flatnonzero((phase[k, at:-1] >= -180.0) & (phase[k, at + 1 :] < -180.0))
        if margins[k] > 0.0 and len(turned):
            ends = slice(at + int(turned[0]), at + int(turned[0]) + 2)
            gain[k] = -20.0 * np.interp(180.0, -phase[k, ends], np.log10(size[k, ends]))
        elif margins[k] <= 0.0:
            gain[k] = 0.0
    return margins, gain


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
        peak = loop_peak(loop)
        along = 1.0 / np.maximum(size * peak, 1e-12)
        if past is not None:
            back = inverse @ past[:, :, rows] * weight / weight[:, None]
            along = np.minimum(along, 1.0 / np.maximum(np.linalg.norm(back, 2, axis=(1, 2)), 1e-12))
    singular = np.linalg.svd(A, compute_uv=False)[:, -1]
    return Margin(np.where(singular > 1e-6, along, 0.0), peak, loop.lag, loop.delay)


def margin_of_model(model: MismatchModel, inputs: Array, loop: Loop) -> Margin:
    """The margin of a mismatch model along inputs (N, D) of it: the command first, `past` last where it looks at it."""
    slope, size = model.jacobian(inputs), len(AXES)
    past = slope[:, :, -size:] if "past" in getattr(model, "input_groups", ()) else None
    return margin(slope[:, :, :size], model.outputs, loop, past)
