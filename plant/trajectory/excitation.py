"""Excitation on top of a trajectory: a multisine on all six axes."""

from dataclasses import dataclass, field

import numpy as np

from wrenchgap.flight.errors import UsageError
from wrenchgap.flight.flight import Array
from wrenchgap.plant.trajectory.reference import Profile, Reference, Trajectory, bump, composed, euler_attitude, product


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

    def at(self, time: Array) -> Profile:
        """Deflection, rate and acceleration (N, 6) at `time` (N,): x, y, z [m], roll, pitch, yaw [rad]."""
        amplitude, omega, phase = self._terms
        angle = omega * time[:, None, None] + phase
        e = np.sum(amplitude * np.cos(angle), axis=-1)
        de = np.sum(-amplitude * omega * np.sin(angle), axis=-1)
        dde = np.sum(-amplitude * omega**2 * np.cos(angle), axis=-1)
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
