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

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.fft import rfft, rfftfreq
from numpy.lib.stride_tricks import sliding_window_view

from wrenchgap.flight.filters import hann
from wrenchgap.flight.flight import Array, ImuSeries, Indices, Samples
from wrenchgap.flight.resample import anti_alias
from wrenchgap.flight.stamps import interpolated


@dataclass(frozen=True)
class SpectrumSettings:
    """How the density of a sensor's noise is estimated."""

    segment: float = 4.0
    """Length of the segments of a periodogram [s]: lines of vibration stay narrow."""
    fewest: int = 32
    """Readings below which nothing is known of their clock."""
    at_once: int = 32
    """Segments that are transformed together: some 200 kB of them, which stay in the second cache."""
    frequencies: int = 2001
    """Frequencies at which it is known, up to half of the clock's rate."""
    smallest: float = 1e-6
    """Share of a density that counts as none: half way between readings, half the clock's rate is not seen."""
    lags: int = 40
    """Of the grid, after which nothing is left of the anti-alias filter's autocorrelation (1e-9)."""
    instants: int = 2000
    """Instants at which interpolation is looked at."""


SPECTRUM = SpectrumSettings()


def white_noise(samples: Samples, imu: ImuSeries | None, cutoff_hz: float) -> tuple[Array, Array]:
    """Frequencies (F,) [Hz] up to Nyquist's, and the one-sided density (F, 6) there of the white noise in `samples`.

    Columns: omega_B [(rad/s)^2/Hz], specific_force_B [(m/s^2)^2/Hz]. `imu` is what the samples were resampled from;
    without it, and where it did not measure (its columns are not numbers), they are readings themselves.
    """
    f = np.linspace(0.0, 0.5 / samples.dt, SPECTRUM.frequencies)
    rate, seen, left = 1.0 / samples.dt, np.ones((SPECTRUM.frequencies, 6)), np.ones((SPECTRUM.frequencies, 6))
    if imu is not None:
        ends = np.searchsorted(imu.time, samples.time[0] - samples.dt), samples.time[-1] + samples.dt
        near = slice(int(ends[0]), int(np.searchsorted(imu.time, ends[1], side="right")))
        stamps = imu.time[near]
        if len(stamps) >= SPECTRUM.fewest:
            rate = min(rate, (len(stamps) - 1) / float(stamps[-1] - stamps[0]))
            readings = (*imu.omega_B[near].T, *imu.specific_force_B[near].T)
            own = np.array([bool(np.isfinite(column).all()) for column in readings])
            left[:, own] = left_by_resampling(samples.time, stamps, f)[:, None]
            seen[:, own] = left_by_resampling(samples.time, stamps, f, _looked_at(len(samples), samples.dt))[:, None]
    upper = 0.4 * rate
    band = (min(2.5 * cutoff_hz, 0.5 * upper), upper)
    frequency, power = periodogram((*samples.omega_B.T, *samples.specific_force_B.T), samples.dt)
    return f, left * _density(frequency, power, len(samples), samples.dt, band, f, seen)


def _segments(count: int, dt: float) -> tuple[int, int]:
    """Length of a periodogram's segments and how many there are, each begun in the middle of the one before."""
    length = min(count, int(SPECTRUM.segment / dt))
    return length, 1 + (count - length) // (length - length // 2)


def _looked_at(count: int, dt: float) -> Array:
    """How much each instant (N,) counts in the periodogram: slowly drifting clocks are not alike in all segments."""
    length, segments = _segments(count, dt)
    window = hann(length) ** 2
    out = np.zeros(count)
    for k in range(segments):
        start = k * (length - length // 2)
        out[start : start + length] += window
    return out


def periodogram(columns: Sequence[Array], dt: float) -> tuple[Array, Array]:
    """Frequencies (K,) [Hz] and one-sided densities (K, C) of columns (N,): scipy.signal.welch, all columns at once."""
    length, segments = _segments(len(columns[0]), dt)
    window = hann(length)
    power = np.zeros((length // 2 + 1, len(columns)))
    for k, column in enumerate(columns):
        rows = sliding_window_view(column, length)[:: length - length // 2]
        for start in range(0, segments, SPECTRUM.at_once):
            part = rows[start : start + SPECTRUM.at_once]
            turned = rfft((part - part.mean(axis=1, keepdims=True)) * window, axis=1)
            power[:, k] += np.sum(turned.real**2 + turned.imag**2, axis=0)
    power *= dt / (segments * float(window @ window))
    power[1 : (length + 1) // 2] *= 2.0  # but for zero and Nyquist's frequency, which are their own mirrors
    return np.asarray(rfftfreq(length, dt), dtype=np.float64), power


def _density(
    frequency: Array, power: Array, count: int, dt: float, band: tuple[float, float], f: Array, seen: Array
) -> Array:
    """Densities (C,) of white readings of which the share `seen` (F, C) at `f` (F,) is found in a `power` (K, C) at
    `frequency` (K,), the mean over the segments of `count` samples.
    """  # noqa: D205
    from scipy.special import gammaincinv  # here: others need not wait for it

    _, segments = _segments(count, dt)
    inside = (frequency > band[0]) & (frequency < band[1])
    share = interpolated(frequency[inside], f, seen)
    worth = segments / (1.0 + (segments - 1) / segments / 18.0)  # neighbours share 1/36 of their power
    return np.asarray(np.median(power[inside] / share, axis=0) * worth / gammaincinv(worth, 0.5))


def left_by_resampling(time: Array, stamps: Array, frequency: Array, weight: Array | None = None) -> Array:
    """Density (F,) at `frequency` [Hz] that white readings of density one at `stamps` (K,) have on the clock `time`.

    As `flight.resample` does it: an anti-alias filter where the readings are faster, then linear interpolation. The
    mean over the clock's instants, with a `weight` (N,) where they do not count alike.
    """
    dt = float(time[1] - time[0])
    rate = (len(stamps) - 1) / float(stamps[-1] - stamps[0])
    most = min(SPECTRUM.lags + int(np.ceil(2.0 / (rate * dt))), len(time) // 2)
    # Spread by the golden ratio: every n-th instant could be in step with the beat of the two clocks.
    at = ((len(time) - most) * np.modf(np.arange(SPECTRUM.instants) * (np.sqrt(5.0) - 1.0) / 2.0)[0]).astype(int)
    before = np.clip(np.searchsorted(stamps, time, side="right") - 1, 0, len(stamps) - 2)
    u = np.clip((time - stamps[before]) / (stamps[before + 1] - stamps[before]), 0.0, 1.0)
    later = at[:, None] + np.arange(most)
    apart = before[later] - before[at][:, None]
    rho = _autocorrelation(stamps, 1.0 / dt, int(apart.max()) + 2)
    share = np.full(len(at), 1.0 / len(at)) if weight is None else weight[at] / weight[at].sum()
    left, right = share * (1.0 - u[at]), share * u[at]  # of the two readings between which an instant lies
    after = u[later]
    r = np.zeros(most)
    for own, other, step in ((left, 1.0 - after, 0), (left, after, 1), (right, 1.0 - after, -1), (right, after, 0)):
        r += own @ (other * rho[np.abs(apart + step)])
    waves = np.cos(2.0 * np.pi * dt * np.outer(frequency, np.arange(1, most)))
    return np.asarray(np.maximum(rate * dt * (r[0] + 2.0 * waves @ r[1:]), SPECTRUM.smallest))


def _autocorrelation(stamps: Array, grid: float, lags: int) -> Array:
    """Of white readings of variance one (lags,), after the filter that resampling puts them through."""
    sections = anti_alias(stamps, grid)
    if sections is None:
        return np.asarray(np.arange(lags) == 0, dtype=float)
    from scipy.signal import sosfreqz  # here: others need not wait for it

    circle = 1 << max(int(np.ceil(np.log2(8 * lags))), 10)
    _, response = sosfreqz(sections, worN=np.arange(circle // 2 + 1) * 2.0 * np.pi / circle)
    return np.asarray(np.fft.irfft(np.abs(response) ** 4)[:lags])  # forward and backward


def noise_shapes(hertz: Array, cutoff_hz: float) -> Array:
    """Shapes (K, 2) of filtered white noise in forces and, differentiated, in torques, at frequencies (K,) [Hz]."""
    low_pass = (1.0 + (hertz / cutoff_hz) ** 4) ** -2.0
    return np.stack((low_pass, low_pass * hertz**2), axis=1)


def coefficient_shapes(hertz: Array, band: Indices, cutoff_hz: float) -> Array:
    """`noise_shapes` (K, 2) of the cosine coefficients of blocks of time, each in a band of frequencies (K,).

    What is differentiated has no power at zero frequency, but no mean over a block is of that alone. In a band with
    nothing but means, those of short blocks, they count as the coefficients next to them.
    """
    means = np.bincount(band, weights=hertz) == 0.0
    return noise_shapes(np.where(means[band], np.min(hertz, where=hertz > 0.0, initial=np.inf), hertz), cutoff_hz)
