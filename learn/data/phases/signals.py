"""Commanded and felt force of a stretch side by side, as far as phases need them.

On the ground the accelerometer reads g whatever the rotors do; in the air it reads what they push, over the mass. With
the mass of the model, |m f| / (m g) = |f| / g: a wrong mass does not matter, and what the commands are off by
throughout is measured (`command_scale`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.flight import Array, Samples
from wrenchgap.flight.memory import give_back, on_disk
from wrenchgap.flight.row_kernels import lengths
from wrenchgap.flight.stamps import pieces
from wrenchgap.learn.data.measured_axes import felt_at_origin
from wrenchgap.learn.data.measurement import derivative, low_pass
from wrenchgap.plant.state import Commands
from wrenchgap.plant.vehicle import GRAVITY, Vehicle

Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class SignalSettings:
    """How the signals are made of which phases are found."""

    slow_hz: float = 1.0
    """Low-pass of forces, of which phases are made [Hz]."""
    rates_hz: float = 8.0
    """Low-pass of the rates of which a lever arm's acceleration is made [Hz]."""
    of_nyquist: float = 0.3
    """Largest cut-off, over the clock's rate."""
    pushing: float = 0.6
    """Share of the large commands (90th percentile) from which on one of them carries the vehicle."""
    scales: tuple[float, float] = (0.5, 2.0)
    """Between these commands may be off throughout; beyond, the check `force-unit` speaks."""
    fewest: int = 16
    """Samples of a stretch below which nothing is said of it."""


SIGNALS = SignalSettings()


@dataclass(frozen=True)
class Signals:
    """One stretch of N samples, forces in shares of the weight, in B: `pushed` (N, 3) commanded, `felt` (N, 3) m f.

    `slow_pushed`, `slow_felt` (N, 3) are low-passed, `turning` (N,) [rad/s] is the size of the low-passed rate.
    Of force axes that were not measured, `felt` says what was commanded. `height` (N,) [m] and `speed` (N,) [m/s] are
    None where no pose is logged; `vertical` says whether the accelerometer's z was measured.
    """

    time: Array
    dt: float
    pushed: Array
    felt: Array
    slow_pushed: Array
    slow_felt: Array
    turning: Array
    height: Array | None
    speed: Array | None
    vertical: bool

    def samples(self, seconds: float) -> int:
        """So many samples, one at least."""
        return max(1, round(seconds / self.dt))


def signals(samples: Samples, commands: Commands, vehicle: Vehicle) -> Signals | None:
    """What phases are made of; None for a stretch that is too short for a filter."""
    if len(samples) < SIGNALS.fewest:
        return None
    dt = samples.dt
    slow, quick = (min(hz, SIGNALS.of_nyquist / dt) for hz in (SIGNALS.slow_hz, SIGNALS.rates_hz))
    weight = vehicle.body.mass * GRAVITY
    pushed = on_disk(commands.wrench_B[:, :3] / weight)
    force = samples.specific_force_B
    known: Flags = np.asarray(np.isfinite(force).all(axis=0))
    omega = low_pass(np.nan_to_num(samples.omega_B), dt, quick)
    felt = felt_at_origin(np.nan_to_num(force), omega, derivative(omega, dt), vehicle.imu_position_B) / GRAVITY
    felt = on_disk(np.where(known, felt, pushed))
    give_back(len(felt))
    return Signals(
        time=samples.time,
        dt=dt,
        pushed=pushed,
        felt=felt,
        slow_pushed=on_disk(low_pass(pushed, dt, slow)),
        slow_felt=on_disk(low_pass(felt, dt, slow)),
        turning=sizes(low_pass(omega, dt, slow)),
        height=None if samples.position_E is None else samples.position_E[:, 2],
        speed=None if samples.velocity_E is None else sizes(samples.velocity_E),
        vertical=bool(known[2]),
    )


def command_scale(parts: Sequence[Signals]) -> float:
    """Felt over commanded force while the commands are large: what they are off by throughout; 1 where none is.

    Large is held against the median of what is no idling, or against the 90th percentile where most of the log is
    rotors that turn on the ground; after a loss of control that one is off, and what is nearer to 1 counts.
    """
    pushed, felt = (
        np.concatenate([sizes(getattr(part, name)) for part in parts]) for name in ("slow_pushed", "slow_felt")
    )
    busy = pushed > SIGNALS.scales[0] * SIGNALS.pushing
    if not busy.any():
        return 1.0
    larges = (pushed > SIGNALS.pushing * high for high in np.percentile(pushed[busy], (50.0, 90.0)))
    found = [float(np.clip(np.median(felt[large] / pushed[large]), *SIGNALS.scales)) for large in larges]
    return min(found, key=lambda scale: abs(np.log(scale)))


def contradiction(part: Signals, scale: float) -> Array:
    """Size (N,) of the slow difference between felt and commanded force, in shares of the weight."""
    return by_rows(lambda felt, pushed: lengths(felt - scale * pushed), part.slow_felt, part.slow_pushed)


def carried(part: Signals, scale: float) -> Array:
    """Share (N,) of the felt force that the rotors do not make: what the ground, or a hand, carries."""

    def beyond(felt: Array, pushed: Array) -> Array:
        return np.asarray(lengths(felt) - scale * lengths(pushed))

    return by_rows(beyond, part.slow_felt, part.slow_pushed)


def sizes(vectors: Array) -> Array:
    """Lengths (N,) of vectors (N, C)."""
    return by_rows(lengths, vectors)


def by_rows(make: Callable[..., Array], *signals: Array) -> Array:
    """What `make` gives of the rows of signals (N, C), (N,); of hours, piece by piece."""
    out = np.empty(len(signals[0]))
    for rows in pieces(len(out)):
        out[rows] = make(*(signal[rows] for signal in signals))
    return out
