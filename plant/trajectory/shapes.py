"""Trajectories: hover, tilts, figure-8, circle, step, the reference of a log; on top a multisine or a flat attitude."""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from wrenchgap.flight import so3
from wrenchgap.flight.errors import LogError, UsageError
from wrenchgap.flight.flight import GRAVITY, Array, ReferenceSeries
from wrenchgap.flight.stamps import interpolated
from wrenchgap.plant.trajectory.reference import (
    E_Z,
    Profile,
    Reference,
    Trajectory,
    attitude_of_thrust,
    bump,
    composed,
    cosine,
    euler_attitude,
    product,
    quintic,
    ramped_phase,
    sine,
    yaw_of,
)

QUINTIC_PEAK = 10.0 / np.sqrt(3.0)
"""Largest second derivative of the unit quintic 10 s^3 - 15 s^4 + 6 s^5."""
AT_ONCE = 500_000
"""Cosines whose arrays are in memory at once: 20 MB."""


def _at_rest(time: Array, position: tuple[float, float, float]) -> Reference:
    zeros = np.zeros((len(time), 3))
    level = np.tile([1.0, 0.0, 0.0, 0.0], (len(time), 1))
    return Reference(time, zeros + np.array(position), zeros, zeros, level, zeros, zeros)


@dataclass(frozen=True)
class Hover(Trajectory):
    """Level at one place."""

    duration: float
    position: tuple[float, float, float] = (0.0, 0.0, 1.6)

    def at(self, time: Array) -> Reference:
        """The same at all times."""
        return _at_rest(time, self.position)


@dataclass(frozen=True)
class Tilts(Trajectory):
    """One tilt after another, each about its own fixed axis: up to `angle` [rad], hold, back, hold.

    `axes` (K, 3) unit vectors, used in turn every `period` [s]. Quintic slopes whose peak angular acceleration is
    `acceleration` [rad/s^2], so each takes sqrt(10 angle / (sqrt(3) acceleration)): 2.46 s for 60 deg at 1 rad/s^2.
    """

    duration: float
    axes: Array
    angle: float
    acceleration: float = 1.0
    period: float = 10.0
    position: tuple[float, float, float] = (0.0, 0.0, 1.6)

    def __post_init__(self) -> None:
        if 2.0 * self.rise > self.period:
            raise UsageError(
                f"trajectory: a tilt of {np.degrees(self.angle):.0f} deg at {self.acceleration} rad/s^2 takes "
                f"2 x {self.rise:.2f} s, longer than its period of {self.period} s; raise period or acceleration"
            )

    @property
    def rise(self) -> float:
        """Time of one slope [s]."""
        return float(np.sqrt(QUINTIC_PEAK * self.angle / self.acceleration))

    def at(self, time: Array) -> Reference:
        """Rotation by s(t) about a fixed axis a: omega = s' a, omega_dot = s'' a."""
        rest = _at_rest(time, self.position)
        number = np.floor(time / self.period)
        complete = (number + 1.0) * self.period <= self.duration + 1e-9  # an incomplete last tilt is not begun
        phase = time - number * self.period
        up = quintic(phase, 0.0, self.rise)
        down = quintic(phase, self.period / 2.0, self.rise)
        s, ds, dds = ((self.angle * complete * (a - b))[:, None] for a, b in zip(up, down, strict=True))
        axis = self.axes[number.astype(int) % len(self.axes)]
        return replace(rest, quat_ED=so3.exp(s * axis), omega_D=ds * axis, omega_dot_D=dds * axis)


@dataclass(frozen=True)
class FigureEight(Trajectory):
    """p = (A sin f, A/2 sin 2f, 0), roll = c sin 2f, pitch = c sin f, with c such that the largest tilt is `tilt`.

    `size` A [m], `period` [s] of one round at full speed, `tilt` [rad] (0: level). The phase f is ramped in and out
    within `ramp` [s], so that the flight starts and ends at rest.
    """

    duration: float
    size: float = 1.0
    period: float = 10.0
    tilt: float = float(np.radians(63.0))
    ramp: float = 3.0
    position: tuple[float, float, float] = (0.0, 0.0, 1.6)

    @cached_property
    def amplitude(self) -> float:
        """The angle c [rad]: cos(tilt) = min over f of cos(roll) cos(pitch), solved by bisection."""
        f = np.linspace(0.0, 2.0 * np.pi, 3601)
        low, high = 0.0, min(self.tilt, np.radians(89.0))
        for _ in range(60):
            c = 0.5 * (low + high)
            largest = np.arccos(np.min(np.cos(c * np.sin(2.0 * f)) * np.cos(c * np.sin(f))))
            low, high = (c, high) if largest < self.tilt else (low, c)
        return float(0.5 * (low + high))

    def at(self, time: Array) -> Reference:
        """Sinusoids of the ramped phase."""
        phase = ramped_phase(time, 2.0 * np.pi / self.period, self.ramp, self.duration)
        zeros = np.zeros_like(time)
        pairs = list(zip(sine(phase, 1.0), sine(phase, 2.0), strict=True))
        p, v, a = (self.size * np.stack((one, 0.5 * two, zeros), axis=-1) for one, two in pairs)
        angles = (self.amplitude * np.stack((two, one, zeros), axis=-1) for one, two in pairs)
        return Reference(time, p + np.array(self.position), v, a, *euler_attitude(*angles))


@dataclass(frozen=True)
class Circle(Trajectory):
    """p = (r sin f, r (1 - cos f), 0), level. `radius` r [m], `period` [s] of one round, ramped in and out."""

    duration: float
    radius: float = 1.0
    period: float = 6.0
    ramp: float = 3.0
    position: tuple[float, float, float] = (0.0, 0.0, 1.6)

    def at(self, time: Array) -> Reference:
        """Sinusoids of the ramped phase."""
        phase = ramped_phase(time, 2.0 * np.pi / self.period, self.ramp, self.duration)
        rest = _at_rest(time, self.position)
        x, y = sine(phase, 1.0), cosine(phase, 1.0)
        p, v, a = (self.radius * np.stack((s, -c, np.zeros_like(s)), axis=-1) for s, c in zip(x, y, strict=True))
        centre = np.array(self.position) + np.array([0.0, self.radius, 0.0])
        return replace(rest, position_E=p + centre, velocity_E=v, acceleration_E=a)


@dataclass(frozen=True)
class Step(Trajectory):
    """Level, and from `moment` [s] on tilted by `angle` [rad] about `axis`, without a feedforward."""

    duration: float
    angle: float = np.radians(40.0)
    axis: tuple[float, float, float] = (1.0, 0.0, 0.0)
    moment: float = 1.0
    position: tuple[float, float, float] = (0.0, 0.0, 1.6)

    def at(self, time: Array) -> Reference:
        """A jump of the attitude; its rate stays zero."""
        rest = _at_rest(time, self.position)
        quat = so3.exp(np.where(time >= self.moment, self.angle, 0.0)[:, None] * np.array(self.axis))
        return replace(rest, quat_ED=quat)


@dataclass(frozen=True)
class Flat(Trajectory):
    """`base` with the attitude that a vehicle pushing along its z axis needs: z_D along a + g e_z, yaw kept.

    The rates are fourth-order central differences of that attitude with the step `h` [s], good to about 1e-8.
    """

    base: Trajectory
    h: float = 2e-3

    @property
    def duration(self) -> float:  # type: ignore[override]
        """That of the base [s]."""
        return self.base.duration

    def _attitude(self, time: Array) -> Array:
        base = self.base.at(time)
        return attitude_of_thrust(base.acceleration_E + GRAVITY * E_Z, yaw_of(base.quat_ED))

    def at(self, time: Array) -> Reference:
        """Base position, flat attitude."""
        base, quat = self.base.at(time), self._attitude(time)
        # Rotation vectors r(s) from now to now + s obey r(0) = 0, r'(0) = omega, r''(0) = omega_dot.
        before2, before1, after1, after2 = (
            so3.log(so3.multiply(so3.conjugate(quat), self._attitude(time + s * self.h))) for s in (-2, -1, 1, 2)
        )
        omega = (8.0 * (after1 - before1) - (after2 - before2)) / (12.0 * self.h)
        omega_dot = (16.0 * (after1 + before1) - (after2 + before2)) / (12.0 * self.h**2)
        return replace(base, quat_ED=quat, omega_D=omega, omega_dot_D=omega_dot)


@dataclass(frozen=True)
class Multisine:
    """An excitation of all six axes: sums of harmonics of 1/`base_period`, no harmonic shared by two axes.

        e_k(t) = c_k w(t) sum_h (1/f_h) cos(2 pi f_h t + phase_kh)

    with c_k such that |e_k| peaks at `position_peak` [m] (k = x, y, z) or `attitude_peak` [rad] (roll, pitch, yaw);
    flat in velocity. Phases are the best of `draws` seeded random sets, by crest factor (peak over rms; low is good:
    much excitation within a given deflection). w is a quintic window of `fade` [s] at both ends.
    """

    duration: float
    position_peak: float = 0.1
    attitude_peak: float = np.radians(7.0)
    band: tuple[float, float] = (0.1, 1.4)  # Hz
    base_period: float = 20.0
    fade: float = 2.0
    seed: int = 0
    draws: int = 200
    _terms: tuple[Array, Array, Array] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        harmonics = np.arange(np.ceil(self.band[0] * self.base_period), self.band[1] * self.base_period + 1e-9)
        harmonics = harmonics[: 6 * (len(harmonics) // 6)]
        if len(harmonics) == 0:
            raise UsageError(
                f"excitation: the band {self.band} Hz holds fewer than 6 harmonics of {1.0 / self.base_period} Hz; "
                "widen it or lengthen base_period"
            )
        frequency = harmonics.reshape(-1, 6).T / self.base_period  # (6, H), interleaved
        rng = np.random.default_rng(self.seed)
        grid = np.linspace(0.0, self.base_period, 600, endpoint=False)
        peaks = np.array([self.position_peak] * 3 + [self.attitude_peak] * 3)
        phases = rng.uniform(0.0, 2.0 * np.pi, size=(self.draws, *frequency.shape))
        # Peak of every draw; the rms does not depend on the phases, so the least peak is the least crest factor.
        cosines = np.exp(2j * np.pi * frequency[:, :, None] * grid) / frequency[:, :, None]  # (6, H, T)
        peak = np.stack(
            [np.abs((np.exp(1j * phases[:, k]) @ cosines[k]).real).max(axis=1) for k in range(6)], axis=1
        )  # (draws, 6)
        best = np.argmin(peak, axis=0)
        chosen = phases[best, np.arange(6)]
        scale = peaks / peak[best, np.arange(6)]
        object.__setattr__(self, "_terms", (scale[:, None] / frequency, 2.0 * np.pi * frequency, chosen))

    @property
    def harmonics(self) -> int:
        """How many there are, of all axes."""
        return int(self._terms[0].size)

    def at(self, time: Array) -> Profile:
        """Deflection, rate and acceleration (N, 6) at `time` (N,): x, y, z [m], roll, pitch, yaw [rad]."""
        amplitude, omega, phase = self._terms
        e, de, dde = (np.empty((len(time), len(amplitude))) for _ in range(3))
        some = max(1, AT_ONCE // self.harmonics)
        for part in (slice(k, k + some) for k in range(0, len(time), some)):
            angle = omega * time[part, None, None] + phase
            e[part] = np.sum(amplitude * np.cos(angle), axis=-1)
            de[part] = np.sum(-amplitude * omega * np.sin(angle), axis=-1)
            dde[part] = np.sum(-amplitude * omega**2 * np.cos(angle), axis=-1)
        w, dw, ddw = (part[:, None] for part in bump(time, 0.0, self.duration, self.fade))
        return product((w, dw, ddw), (e, de, dde))


@dataclass(frozen=True)
class Excited(Trajectory):
    """`base` with a multisine on top: positions add, the attitude deflection is applied in the reference's body axes.

    R_ED = R_base R_e;  omega = R_e^T omega_base + omega_e;
    omega_dot = R_e^T omega_dot_base - omega_e x (R_e^T omega_base) + omega_dot_e.
    """

    base: Trajectory
    excitation: Multisine

    @property
    def duration(self) -> float:  # type: ignore[override]
        """That of the base [s]."""
        return self.base.duration

    def at(self, time: Array) -> Reference:
        """Base and excitation together."""
        base = self.base.at(time)
        e, de, dde = self.excitation.at(time)
        deflection = euler_attitude(e[:, 3:], de[:, 3:], dde[:, 3:])
        attitude = composed((base.quat_ED, base.omega_D, base.omega_dot_D), deflection)
        p, v, a = base.position_E + e[:, :3], base.velocity_E + de[:, :3], base.acceleration_E + dde[:, :3]
        return Reference(time, p, v, a, *attitude)


@dataclass(frozen=True)
class Recorded(Trajectory):
    """The reference of a log, linear between its samples (attitude: constant rate), from its first sample on.

    What the log lacks is differentiated: velocity from position, rate from attitude, accelerations from those.
    `start` [s] shifts time zero to that time of the series; the first sample by default.
    """

    series: ReferenceSeries
    start: float | None = None

    @property
    def duration(self) -> float:  # type: ignore[override]
        """From the start to the last sample [s]."""
        return float(self.series.time[-1] - self._zero)

    @property
    def _zero(self) -> float:
        return float(self.series.time[0]) if self.start is None else self.start

    @cached_property
    def _columns(self) -> tuple[Array, ...]:
        s = self.series
        if len(s.time) < 3:
            raise LogError(f"{s.topic}: got {len(s.time)} reference samples, at least 3 are needed to fly along them")
        omega = _rate_of(s.time, s.quat_ED) if s.omega_D is None else s.omega_D
        velocity = _slope(s.time, s.position_E) if s.velocity_E is None else s.velocity_E
        acceleration = _slope(s.time, velocity) if s.acceleration_E is None else s.acceleration_E
        omega_dot = _slope(s.time, omega) if s.omega_dot_D is None else s.omega_dot_D
        return s.position_E, velocity, acceleration, omega, omega_dot

    def at(self, time: Array) -> Reference:
        """Interpolated; before the first and after the last sample their values are held."""
        knots, t = self.series.time, time + self._zero
        position, velocity, acceleration, omega, omega_dot = (interpolated(t, knots, c) for c in self._columns)
        quat = so3.interpolate(t, knots, self.series.quat_ED)
        return Reference(time, position, velocity, acceleration, quat, omega, omega_dot)


def _slope(time: Array, values: Array) -> Array:
    """Derivative (N, 3): the mean of the slopes on both sides, leaving out a side on which the value jumps.

    A jump (a slope 5 times beyond the 98th percentile) is a corner of the recorded reference, not an acceleration.
    """
    slopes = np.diff(values, axis=0) / np.diff(time)[:, None]
    size = np.linalg.norm(slopes, axis=-1)
    smooth = size <= 5.0 * np.quantile(size, 0.98)
    weight = np.concatenate(([0.0], smooth, [0.0]))
    padded = np.concatenate((np.zeros((1, 3)), slopes, np.zeros((1, 3)))) * weight[:, None]
    count = np.maximum(weight[:-1] + weight[1:], 1.0)
    return np.asarray((padded[:-1] + padded[1:]) / count[:, None])


def _rate_of(time: Array, quat: Array) -> Array:
    """Rate (N, 3) in the turning frame: the mean of the steps on both sides of each sample."""
    step = so3.log(so3.multiply(so3.conjugate(quat[:-1]), quat[1:])) / np.diff(time)[:, None]
    return np.concatenate((step[:1], 0.5 * (step[1:] + step[:-1]), step[-1:]))
