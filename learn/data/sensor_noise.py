"""How much white noise of gyroscope and accelerometer there is, and what resampling leaves of it at each frequency.

Linear interpolation onto another clock takes a part of a white noise away, a third of its power on average where the
two clocks drift past one another, but hardly any below the cut-off, where it counts. A density that is read above the
cut-off is too small, by a factor that is known exactly: with readings s_i of variance one and autocorrelation rho (a
delta, or that of the anti-alias filter) a sample is x_k = (1 - u_k) s_i + u_k s_i+1, so

    r(m) = <x_k x_k+m> = mean_k sum_ab w_k,a w_k+m,b rho(i_k+m + b - i_k - a),    a, b in {0, 1},  w = (1 - u, u)
    L(f) = dt / dt_imu (r(0) + 2 sum_m r(m) cos(2 pi f m dt))        density in the samples / density in the readings

at the stamps as they are. The density of the readings is the median of S(f) / L(f) over a band in which flight leaves
little but noise, so that single lines of vibration do not count; S is the periodogram of the samples. It is not that
of the readings themselves, which has no place for their stamps: where these jitter, motion would count as noise.

The average of K periodograms is gamma distributed, and its median is below its mean: by 31 % for K = 1, 1 / (3 K) for
many. Sources: Welch, IEEE Trans. Audio Electroacoust. 15 (1967) 70, for periodograms and the K that overlapping
segments are worth; Papoulis and Pillai, Probability, Random Variables and Stochastic Processes, for the rest.
"""

from __future__ import annotations

import numpy as np
from scipy.signal import get_window, sosfreqz, welch
from scipy.special import gammaincinv

from wrenchgap.flight.flight import Array, ImuSeries, Samples
from wrenchgap.flight.resample import anti_alias

SEGMENT = 4.0
"""Length of the segments of a periodogram [s]: lines of vibration stay narrow."""
FEWEST = 32
"""Readings below which nothing is known of their clock."""
FREQUENCIES = 2001
SMALLEST = 1e-6
"""Share of a density that counts as none: half way between readings, half the clock's rate is not seen."""
_LAGS = 40  # of the grid, after which nothing is left of the anti-alias filter's autocorrelation (1e-9)
_INSTANTS = 2000  # at which interpolation is looked at


def white_noise(samples: Samples, imu: ImuSeries | None, cutoff_hz: float) -> tuple[Array, Array]:
    """Frequencies (F,) [Hz] up to Nyquist's, and the one-sided density (F, 6) there of the white noise in `samples`.

    Columns: omega_B [(rad/s)^2/Hz], specific_force_B [(m/s^2)^2/Hz]. `imu` is what the samples were resampled from;
    without it, and where it did not measure (its columns are not numbers), they are readings themselves.
    """
    f = np.linspace(0.0, 0.5 / samples.dt, FREQUENCIES)
    rate, seen, left = 1.0 / samples.dt, np.ones((FREQUENCIES, 6)), np.ones((FREQUENCIES, 6))
    if imu is not None:
        ends = np.searchsorted(imu.time, samples.time[0] - samples.dt), samples.time[-1] + samples.dt
        near = slice(int(ends[0]), int(np.searchsorted(imu.time, ends[1], side="right")))
        stamps = imu.time[near]
        if len(stamps) >= FEWEST:
            rate = min(rate, (len(stamps) - 1) / float(stamps[-1] - stamps[0]))
            readings = (*imu.omega_B[near].T, *imu.specific_force_B[near].T)
            own = np.array([bool(np.isfinite(column).all()) for column in readings])
            left[:, own] = left_by_resampling(samples.time, stamps, f)[:, None]
            seen[:, own] = left_by_resampling(samples.time, stamps, f, _looked_at(len(samples), samples.dt))[:, None]
    upper = 0.4 * rate
    band = (min(2.5 * cutoff_hz, 0.5 * upper), upper)
    return f, left * _density(np.vstack((samples.omega_B.T, samples.specific_force_B.T)), samples.dt, band, f, seen)


def _segments(count: int, dt: float) -> tuple[int, int]:
    """Length of a periodogram's segments and how many there are, each begun in the middle of the one before."""
    length = min(count, int(SEGMENT / dt))
    return length, 1 + (count - length) // (length - length // 2)


def _looked_at(count: int, dt: float) -> Array:
    """How much each instant (N,) counts in the periodogram: slowly drifting clocks are not alike in all segments."""
    length, segments = _segments(count, dt)
    out = np.zeros(count)
    for k in range(segments):
        start = k * (length - length // 2)
        out[start : start + length] += get_window("hann", length) ** 2
    return out


def _density(values: Array, dt: float, band: tuple[float, float], f: Array, seen: Array) -> Array:
    """Density (C,) of white readings of which the shares `seen` (F, C) at `f` (F,) are found in values (C, N)."""
    length, segments = _segments(values.shape[1], dt)
    frequency, power = welch(values, 1.0 / dt, nperseg=length)
    inside = (frequency > band[0]) & (frequency < band[1])
    share = np.array([np.interp(frequency[inside], f, column) for column in seen.T])
    worth = segments / (1.0 + (segments - 1) / segments / 18.0)  # neighbours share 1/36 of their power
    return np.asarray(np.median(power[:, inside] / share, axis=1) * worth / gammaincinv(worth, 0.5))


def left_by_resampling(time: Array, stamps: Array, frequency: Array, weight: Array | None = None) -> Array:
    """Density (F,) at `frequency` [Hz] that white readings of density one at `stamps` (K,) have on the clock `time`.

    As `flight.resample` does it: an anti-alias filter where the readings are faster, then linear interpolation. The
    mean over the clock's instants, with a `weight` (N,) where they do not count alike.
    """
    dt = float(time[1] - time[0])
    rate = (len(stamps) - 1) / float(stamps[-1] - stamps[0])
    most = min(_LAGS + int(np.ceil(2.0 / (rate * dt))), len(time) // 2)
    # Spread by the golden ratio: every n-th instant could be in step with the beat of the two clocks.
    at = ((len(time) - most) * np.modf(np.arange(_INSTANTS) * (np.sqrt(5.0) - 1.0) / 2.0)[0]).astype(int)
    before = np.clip(np.searchsorted(stamps, time, side="right") - 1, 0, len(stamps) - 2)
    u = np.clip((time - stamps[before]) / (stamps[before + 1] - stamps[before]), 0.0, 1.0)
    taken = np.stack((1.0 - u, u))
    later = at[:, None] + np.arange(most)
    apart = before[later] - before[at][:, None]
    rho = _autocorrelation(stamps, 1.0 / dt, int(apart.max()) + 2)
    r = np.zeros(most)
    for a in (0, 1):
        for b in (0, 1):
            product = taken[a, at][:, None] * taken[b, later] * rho[np.abs(apart + b - a)]
            r += np.average(product, axis=0, weights=None if weight is None else weight[at])
    waves = np.cos(2.0 * np.pi * dt * np.outer(frequency, np.arange(1, most)))
    return np.asarray(np.maximum(rate * dt * (r[0] + 2.0 * waves @ r[1:]), SMALLEST))


def _autocorrelation(stamps: Array, grid: float, lags: int) -> Array:
    """Of white readings of variance one (lags,), after the filter that resampling puts them through."""
    sections = anti_alias(stamps, grid)
    if sections is None:
        return np.asarray(np.arange(lags) == 0, dtype=float)
    circle = 1 << max(int(np.ceil(np.log2(8 * lags))), 10)
    _, response = sosfreqz(sections, worN=np.arange(circle // 2 + 1) * 2.0 * np.pi / circle)
    return np.asarray(np.fft.irfft(np.abs(response) ** 4)[:lags])  # forward and backward
