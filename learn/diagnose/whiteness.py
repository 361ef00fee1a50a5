"""Whether a residual is white but for the filter, and which inputs it follows, at which lag.

**Autocorrelation.** White sensor noise that went through the filter H, forward and backward, has the spectrum |H|^4;
in the torque, which is a derivative, |H|^4 (2 pi f)^2. Its autocorrelation rho_0(k) is what the residual of a perfect
model shows. The estimate from N samples is about normal around it with the variance of Bartlett's formula (Bartlett,
J. R. Statist. Soc. Suppl. 1946; Brockwell and Davis, "Time Series: Theory and Methods", 7.2)

    var r(k) = 1/N sum_{j>=1} [rho_0(j + k) + rho_0(j - k) - 2 rho_0(j) rho_0(k)]^2

**Cross-correlation** with an input x. Residual and input are both coloured, so that 1/sqrt(N) would be far too narrow a
band. For independent series (Bartlett 1935; Brockwell and Davis, 11.2)

    cov[r_xz(k), r_xz(k + m)] = c(m) = 1/N sum_j rho_z(j) rho_x(j + m)

with both autocorrelations estimated, tapered by a Tukey window of `WHITENESS.memory` seconds. Without the taper c(0)
would be the very periodogram that is tested. N_eff = 1 / c(0) samples count as independent, and r is judged as a
correlation of so many: t = r sqrt((N_eff - 2) / (1 - r^2)) (Afyouni, Smith and Nichols, NeuroImage 2019).

**The search over lags** is paid for. Over the lags, r is a smooth normal process with covariance c; the chance that its
largest size exceeds u (in standard deviations) anywhere in T seconds is at most

    P <= 2 Q(u) + (T / pi) nu exp(-u^2 / 2),    nu = arccos(c(1) / c(0)) / dt

by Rice's formula for the rate of upcrossings (Davies, Biometrika 1977 and 1987); c(1) is at one sample. And it is never
more than the number of lags times 2 Q(u). The search over pairs of axis and input is paid for by dividing the level by
their number.

Why not prewhiten, as is usual in identification: behind a low-pass filter there is nothing above its corner, and the
inverse of it amplifies rounding. Why not shuffle blocks: lags of a second would straddle the seams of 2 s blocks.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wrenchgap.flight.flight import AXES, Array
from wrenchgap.learn.data.blocks import SIGNIFICANCE
from wrenchgap.learn.data.dataset import Dataset
from wrenchgap.learn.diagnose.quantities import InputGroup, input_groups


@dataclass(frozen=True)
class WhitenessSettings:
    """How the correlation of a residual in time is judged."""

    lags: float = 1.0
    """Largest lag that is looked at [s]."""
    memory: float = 4.0
    """Correlation beyond this time is not believed when bands are made [s]; two blocks of time."""
    fewest: float = 8.0
    """Fewest independent samples from which a correlation is judged."""
    worth: float = 0.1
    """Correlation that is worth a word, however sure: it stands for 1 % of the variance."""


WHITENESS = WhitenessSettings()
INPUTS = ("command", "command_rate", "rates", "velocity", "attitude", "arm_rates")
"""Groups of `learn.diagnose.quantities.input_groups` that are correlated with the residual."""


@dataclass(frozen=True)
class Autocorrelation:
    """Of one axis: `value`, `expected` of filtered noise and half-width of the `band` at `lags` [s], (L,) each.

    `worst` is the lag [s] furthest outside; `p` the chance of that in noise, for all lags together.
    """

    axis: str
    lags: Array
    value: Array
    expected: Array
    band: Array
    worst: float
    p: float

    @property
    def white(self) -> bool:
        """Whether filtered sensor noise would look like it."""
        return self.p >= SIGNIFICANCE.level


@dataclass(frozen=True)
class CrossCorrelation:
    """Of one axis with one input: `value` (L,) at `lags` (L,) [s]; positive where the residual follows the input.

    `band` is the half-width that independent series would leave once in a hundred times anywhere in these lags (for
    as many `pairs` as were looked at); `lag` [s] is where |value| is largest, `peak` the value there.
    """

    axis: str
    input: str
    lags: Array
    value: Array
    band: float
    lag: float
    peak: float
    p: float

    @property
    def outside(self) -> bool:
        """Whether independent series would hardly do it."""
        return abs(self.peak) > self.band


@dataclass(frozen=True)
class Whiteness:
    """Autocorrelation of the measured axes; their cross-correlations with all inputs, the surest first."""

    autocorrelation: tuple[Autocorrelation, ...]
    crosscorrelation: tuple[CrossCorrelation, ...]

    def strongest(self, axis: str) -> CrossCorrelation | None:
        """The largest correlation of this axis with an input among those outside their bands, or else of all.

        None where no input moves enough.
        """
        own = [c for c in self.crosscorrelation if c.axis == axis]
        return max(own, key=lambda c: (c.outside, abs(c.peak)), default=None)


def whiteness(data: Dataset, residual: Array, *, groups: Sequence[InputGroup] | None = None) -> Whiteness:
    """Judge a residual (K, 6) of `data`; lags to `WHITENESS.lags`. Records are correlated one by one and pooled."""
    chosen = [g for g in input_groups(data)[0] if g.name in INPUTS] if groups is None else groups
    first = data.records[0]
    dt = first.dt_kept
    count = max(1, round(WHITENESS.lags / dt))
    pieces = [own - own.mean(axis=0) for own in data.by_record(residual)]
    axes = [(i, axis) for i, axis in enumerate(AXES) if data.measured_axes[i]]
    autos = tuple(
        autocorrelation(
            [p[:, i] for p in pieces], noise_autocorrelation(first.dt, first.cutoff_hz, dt, i >= 3), dt, axis
        )
        for i, axis in axes
    )
    columns = np.column_stack([g.values for g in chosen]) if chosen else np.empty((len(residual), 0))
    labels = [name for g in chosen for name in g.columns]
    inputs = [data.by_record(column) for column in columns.T]
    pairs = len(axes) * len(labels)
    crosses = [
        crosscorrelation(inputs[j], [p[:, i] for p in pieces], dt, count, axis=axis, input=label, pairs=pairs)
        for i, axis in axes
        for j, label in enumerate(labels)
    ]
    found = sorted((c for c in crosses if c is not None), key=lambda c: (c.p, -abs(c.peak)))
    return Whiteness(autos, tuple(found))


def noise_autocorrelation(dt: float, cutoff_hz: float, dt_kept: float, differentiated: bool) -> Array:
    """Autocorrelation of white noise behind the filter of `learn.data.measurement`, at multiples of `dt_kept`."""
    from scipy.signal import butter, sosfreqz  # here: others need not wait for it

    frequency, response = sosfreqz(butter(2, cutoff_hz, fs=1.0 / dt, output="sos"), worN=8192, fs=1.0 / dt)
    power = np.abs(response) ** 4 * ((2 * np.pi * frequency) ** 2 if differentiated else 1.0)
    lags = dt_kept * np.arange(round(WHITENESS.memory / dt_kept) + 1)
    rho = np.cos(2 * np.pi * np.outer(lags, frequency)) @ power
    return np.asarray(rho / rho[0])


def autocorrelation(pieces: Sequence[Array], expected: Array, dt: float, axis: str = "") -> Autocorrelation:
    """Compare the autocorrelation of a signal in `pieces` with `expected` (M,), that of noise, at all lags."""
    count = min(max(1, round(WHITENESS.lags / dt)), len(expected) - 1, min(len(p) for p in pieces) - 2)
    value = _pooled(pieces, pieces, count)[count:]
    total = sum(len(p) for p in pieces)
    lags = np.asarray(dt * np.arange(count + 1), dtype=np.float64)
    spread = np.sqrt(_bartlett(expected, count) / total)
    rest = expected[: count + 1]
    u = np.abs(value - rest)[1:] / np.maximum(spread[1:], 1e-12)
    worst = 1 + int(np.argmax(u))
    nu = float(np.arccos(np.clip(_overlap(expected, 1) / _overlap(expected, 0), -1.0, 1.0))) / dt
    p = _exceeds(float(u.max()), count, nu * count * dt)
    band = _level(SIGNIFICANCE.level, count, nu * count * dt) * spread
    return Autocorrelation(axis, lags, value, rest, band, worst * dt, p)


def crosscorrelation(
    inputs: Sequence[Array],
    outputs: Sequence[Array],
    dt: float,
    count: int,
    *,
    axis: str = "",
    input: str = "",
    pairs: int = 1,
) -> CrossCorrelation | None:
    """Correlation of an output with an input, both in pieces, at lags up to `count` samples either way.

    None where one of them does not move, or is too slow for this length of log to say anything.
    """
    x, z = ([p - p.mean() for p in pieces] for pieces in (inputs, outputs))
    count = min(count, min(len(p) for p in x) // 4)
    memory = min(round(WHITENESS.memory / dt), min(len(p) for p in x) // 3)
    energy = float(np.sqrt(sum(p @ p for p in x) * sum(p @ p for p in z)))
    if energy <= 1e-300 or count < 1:
        return None
    value = _pooled(x, z, count, energy)
    taper = 0.5 * (1.0 + np.cos(np.pi * np.arange(-memory, memory + 1) / memory))
    rho_x, rho_z = (_pooled(p, p, memory) * taper for p in (x, z))
    total = sum(len(p) for p in x)
    c0 = float(rho_x @ rho_z) / total
    c1 = float(rho_x[1:] @ rho_z[:-1]) / total
    joint = np.abs(np.fft.rfft(max(x, key=len))[1:] * np.fft.rfft(max(z, key=len))[1:]) ** 2
    too_slow = float(joint[:2].sum()) > 0.7 * float(joint.sum())  # periods of half the log or more: no band can be had
    if c0 <= 0 or 1.0 / c0 < WHITENESS.fewest or too_slow:
        return None
    freedom = 1.0 / c0 - 2.0
    nu = float(np.arccos(np.clip(c1 / c0, -1.0, 1.0))) / dt
    span = 2 * count * dt
    peak = int(np.argmax(np.abs(value)))
    lags = np.asarray(dt * np.arange(-count, count + 1), dtype=np.float64)
    u = _normal_size(abs(float(value[peak])), freedom)
    limit = _level(SIGNIFICANCE.level / pairs, 2 * count + 1, nu * span)
    return CrossCorrelation(
        axis,
        input,
        lags,
        value,
        _correlation_size(limit, freedom),
        dt * (peak - count),
        float(value[peak]),
        min(1.0, pairs * _exceeds(u, 2 * count + 1, nu * span)),
    )


def _pooled(x: Sequence[Array], z: Sequence[Array], count: int, energy: float | None = None) -> Array:
    """sum_k z(k + lag) x(k) over all pieces at lags -count ... count, over the energy of both."""
    out = np.zeros(2 * count + 1)
    for a, b in zip(x, z, strict=True):
        size = 1 << int(len(a) + count).bit_length()
        product = np.fft.irfft(np.fft.rfft(b, size) * np.conj(np.fft.rfft(a, size)), size)
        out += np.concatenate((product[-count:], product[: count + 1]))
    return np.asarray(out / (out[count] if energy is None else energy))


def _overlap(rho: Array, shift: int) -> float:
    """sum_j rho(j) rho(j + shift) over all j, for an even rho given at j >= 0."""
    both = np.concatenate((rho[:0:-1], rho))
    return float(both[: len(both) - shift] @ both[shift:])


def _bartlett(rho: Array, count: int) -> Array:
    """N times the variance of the estimated autocorrelation at lags 0 ... count."""
    reach = len(rho) - 1
    full = np.concatenate((np.zeros(count), rho[:0:-1], rho, np.zeros(count)))
    middle, k, j = count + reach, np.arange(count + 1)[:, None], np.arange(1, reach + 1)
    terms = full[middle + j + k] + full[middle + j - k] - 2.0 * full[middle + j] * full[middle + k]
    return np.asarray(np.sum(terms**2, axis=1))


def _exceeds(u: float, lags: int, crossings: float) -> float:
    """Chance that the largest of many correlated standard normal values exceeds u in size; at most."""
    from scipy.special import ndtr  # here: others need not wait for it

    tail = 2.0 * float(ndtr(-u))
    return min(1.0, lags * tail, tail + crossings / np.pi * float(np.exp(-0.5 * u * u)))


def _level(p: float, lags: int, crossings: float) -> float:
    """The u that is exceeded with chance p."""
    from scipy.optimize import bisect  # here: others need not wait for it

    return float(bisect(lambda u: _exceeds(u, lags, crossings) - p, 0.0, 12.0, xtol=1e-15))


def _normal_size(r: float, freedom: float) -> float:
    """Size of a standard normal that is as rare as a correlation r of `freedom` + 2 independent samples."""
    from scipy.special import ndtri, stdtr  # here: others need not wait for it

    t = r * np.sqrt(freedom / max(1.0 - r * r, 1e-12))
    tail = float(stdtr(freedom, -t))
    return float(-ndtri(tail)) if tail > 1e-300 else 37.0


def _correlation_size(u: float, freedom: float) -> float:
    """Inverse of `_normal_size`."""
    from scipy.special import ndtr, stdtrit  # here: others need not wait for it

    t = -float(stdtrit(freedom, float(ndtr(-u))))
    return float(t / np.sqrt(freedom + t * t))
