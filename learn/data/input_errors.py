"""What a sampled command does not say of the command that was sent.

A logged command is a snapshot, taken at the rate of the log, of a loop that may be faster. A regression on it
attenuates, and every parameter that shrinks the prediction (a lag, a lost torque) seems to explain what is left:
docs/theory/likelihood.md, Commands that err, with the source. The spectrum S_e of the error is bounded. S is that of
the wrench that the commands nominally make, S_m that of the measured wrench, S_n that of the sensors' noise, all
one-sided [N^2/Hz, (Nm)^2/Hz]:

    S_e <= L                 L the level of S just below half the rate of the log, which goes on beyond it
    S_e <= S - (S_m - S_n)   of what was really sent the vehicle made a wrench
    S_e <= S_r               S_r of what the nominal model leaves: the error is in it

The least of these over S is the share of error, by band of frequency and axis. In a band in which it exceeds
`INPUT_ERRORS.share` an axis says nothing of the vehicle; where the slowest band is such, it keeps the mean of a flight.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from wrenchgap.flight.flight import AXES, ActuatorSeries, Array, Flight, Mask
from wrenchgap.learn.data.measurement import Record, from_actuators
from wrenchgap.learn.data.sensor_noise import noise_shapes
from wrenchgap.plant.vehicle import Vehicle


@dataclass(frozen=True)
class InputErrorSettings:
    """How the error of sampled commands is bounded, and from when on it matters."""

    edges: tuple[float, ...] = (0.3, 0.7, 1.2, 2.0, 3.0, 4.5, 6.5, 9.0, 12.0, 16.0)
    """Bounds of bands [Hz] in which spectra are taken to be level: wider where those of vehicles are smoother."""
    share: float = 0.1
    """Share of error in a band from which on it is not used: gains are wanted to 10 %, and attenuate by as much."""
    segment: float = 10.0
    """Length [s] of the pieces whose spectra are averaged: three periods of the slowest band, a third of a flight."""
    fewest_commands: int = 32
    """Commands below which nothing is said of their spectrum."""
    tail: float = 0.7
    """Share of half the log's rate from which on the spectrum is that of what is folded."""


INPUT_ERRORS = InputErrorSettings()
EDGES = INPUT_ERRORS.edges
"""As others ask for them [Hz]."""


def density(signal: Array, dt: float) -> tuple[Array, Array]:
    """Frequencies (F,) [Hz] and one-sided densities (F, C) of signals (N, C), without their mean."""
    from scipy.signal import welch  # here: others need not wait for it

    pieces = max(8, min(len(signal) // 3, round(INPUT_ERRORS.segment / dt)))
    f, power = welch(signal, 1.0 / dt, nperseg=pieces, axis=0)
    return f, np.asarray(power)


def by_band(f: Array, power: Array) -> Array:
    """Means (bands, C) of densities (F, C), the mean over all time left out; NaN for a band beyond the last frequency.

    A band that is too narrow or too slow to be seen has the density of the next frequency.
    """
    band = np.digitize(f[1:], EDGES)
    out = np.full((len(EDGES) + 1, power.shape[1]), np.nan)
    for k in range(band[-1] + 1):
        rows = band == k if np.any(band == k) else [np.argmax(band > k)]
        out[k] = power[1:][rows].mean(axis=0)
    return out


@dataclass(frozen=True)
class Measurement:
    """How a wrench was measured: samples `dt` [s] apart, behind a filter, with sensor `noise` (6,)."""

    dt: float
    cutoff_hz: float
    noise: Array


def share_of_error(sent: Array, period: float, measured: Array, left: Array, seen: Measurement) -> Array:
    """Share of error (bands, 6), zero to one, of commands that make a wrench `sent` (N, 6), `period` [s] apart.

    `measured` and `left` (K, 6) are the measured wrench and what the nominal model leaves of it. A band above half the
    rate of the log has no command: all of it is error.
    """
    f, power = density(sent, period)
    level = np.median(power[f > INPUT_ERRORS.tail * 0.5 / period], axis=0)
    behind_filter = noise_shapes(f, seen.cutoff_hz)[:, :1]
    commanded, folded = by_band(f, power * behind_filter), by_band(f, level * behind_filter)
    f, response = density(measured, seen.dt)
    real = np.maximum(by_band(f, response) - noise_by_band(f, seen), 0.0)
    bounds = np.stack((folded, np.maximum(commanded - real, 0.0), by_band(*density(left, seen.dt))))
    share = np.min(np.where(np.isfinite(bounds), bounds, np.inf), axis=0) / np.maximum(commanded, 1e-300)
    return np.asarray(np.where(np.isfinite(commanded), np.clip(share, 0.0, 1.0), 1.0))


def noise_by_band(f: Array, seen: Measurement) -> Array:
    """Mean densities (bands, 6) of the sensors' noise at these frequencies (F,)."""
    shapes = np.repeat(noise_shapes(f, seen.cutoff_hz), 3, axis=1)
    return by_band(f, shapes * seen.noise**2 / np.trapezoid(shapes, f, axis=0))


def sensors_by_band(record: Record) -> Array:
    """The same of a record, at the frequencies of `density`."""
    f, _ = density(record.commanded, record.dt_kept)
    return noise_by_band(f, Measurement(record.dt_kept, record.cutoff_hz, record.noise))


def with_input_error(record: Record, played: Flight, vehicle: Vehicle) -> Record:
    """The record with the share of error (bands, 6) in what its commands make; as exact where they are too few."""
    series = played.actuators if record.source == "logged" else played.commanded
    if series is None:
        return record
    rows = (series.time >= record.time[0]) & (series.time <= record.time[-1])
    if rows.sum() < INPUT_ERRORS.fewest_commands:
        return record
    if isinstance(series, ActuatorSeries):
        sent = from_actuators(played.name, vehicle, series.tilt[rows], series.rotor_speed[rows]).wrench_B
    else:
        sent = series.wrench_B[rows]
    left = record.measured - record.commanded
    seen = Measurement(record.dt_kept, record.cutoff_hz, record.noise)
    return replace(record, input_error=share_of_error(sent, series.period, record.measured, left, seen))


def untrusted(records: Sequence[Record]) -> Mask:
    """Bands and axes (bands, 6) in which the commands of any of these records say nothing."""
    shares = [r.input_error for r in records if r.input_error is not None]
    nothing = np.zeros((len(EDGES) + 1, 6), dtype=bool)
    return np.asarray(np.any([nothing, *(share > INPUT_ERRORS.share for share in shares)], axis=0))


def input_error_notes(name: str, records: Sequence[Record]) -> list[str]:
    """A sentence on the axes of a flight of which commands say its mean alone, or less than half of the bands."""
    if not records:
        return []
    lost = untrusted(records) & np.all([r.measured_axes for r in records], axis=0)
    below = np.array((0.0, *EDGES)) < records[0].cutoff_hz
    means = [axis for k, axis in enumerate(AXES) if lost[0, k]]
    rest = [axis for k, axis in enumerate(AXES) if not lost[0, k] and lost[below, k].mean() > 0.5]
    parts = [f"of {', '.join(means)} nothing but the mean is used"] if means else []
    parts += [f"of {', '.join(rest)} less than half of the frequencies"] if rest else []
    if not parts:
        return []
    why = "there the motion does not follow the logged commands, as where they are snapshots of faster ones"
    return [f"{name}: {' and '.join(parts)}: {why}; if they are, log them at the rate of the loop."]
