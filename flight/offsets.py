"""By how much one topic lags another: fractional delays from the phase of what two signals have in common.

Two signals that show one motion, y(t) = x(t - d) + noise, have a cross-spectrum with the phase -2 pi f d. The delay
that fits the phases of all frequencies and axes best maximises

    R(d) = sum_f w(f) Re[ G_xy(f) exp(2 pi i f d) ] / |G_xy(f)|,      w = C^2 / (1 - C^2)

with C^2 the coherence: the maximum-likelihood weight, which listens where the two agree and is deaf where they do not
(Knapp and Carter, "The generalized correlation method for estimation of time delay", IEEE Trans. ASSP 24(4), 1976).
A peak of the correlation, interpolated between samples, would answer too; but it hears all frequencies at their power,
so the slowest and loudest motion decides, and its accuracy is tied to the clock onto which both were interpolated.

Here nothing is interpolated. Each topic keeps its own stamps and rate: the Fourier integral of every block of time is
summed over the samples where they are (trapezoid rule, Hann taper, linear trend removed). Then one topic's stamps are
moved by the delay found, and the integrals are taken again, until nothing is left to move: at that point both see the
same piece of motion through the same window, and leakage and tapering cancel.

Only frequencies whose coherence is beyond chance count, so that signals with nothing in common give no number. The
standard deviation is a sandwich over the blocks (scores' scatter, neighbours that overlap included: Newey and West,
Econometrica 1987), which holds for coloured noise; intervals use Student's t with half as many degrees of freedom as
there are blocks. A slope of the delay over the flight is estimated along with it.
"""

# Long because the estimate of one offset, from blocks to interval, is one argument that is read in one go.

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum

import numpy as np

from wrenchgap.flight.block_integrals import Complex, integrals
from wrenchgap.flight.flight import Array, Gap, Mask
from wrenchgap.flight.row_kernels import varying
from wrenchgap.flight.stamps import nominal_period

Intervals = Sequence[tuple[float, float]]

EVERYWHERE: Intervals = ((-np.inf, np.inf),)


@dataclass(frozen=True)
class OffsetSettings:
    """How an offset between two signals is estimated, and when there is none."""

    lowest_hz: float = 0.5
    """Lowest frequency that is looked at [Hz]: motion of the vehicle, not drift of a bias."""
    highest_hz: float = 20.0
    """Highest frequency that is looked at [Hz]: no vibration."""
    bands_hz: tuple[tuple[float, float], ...] = ((0.5, 2.0), (2.0, 5.0), (5.0, 10.0), (10.0, 20.0))
    """Bands [Hz] in which the delay is told apart: a delay is the same in all of them, a lag shrinks with frequency."""
    of_nyquist: float = 0.8
    """Share of the slower topic's Nyquist frequency up to which its samples show a phase."""
    block: float = 2.0
    """Length of a block [s]."""
    shortest_block: float = 1.0
    """Length [s] down to which blocks are shortened where the log is short."""
    fewest_blocks: int = 7
    """Overlapping blocks below which nothing is said."""
    most_blocks: int = 120
    """Blocks, spread over the log, beyond which no more are taken."""
    fewest_bins: int = 3
    """Frequencies below which a phase is no delay: in one bin whatever delays, lags or answers looks alike."""
    chance: float = 1e-3
    """Probability that noise alone passes for something in common, over all frequencies and axes together."""
    coherence_cap: float = 0.99
    """Coherence beyond which a frequency gets no more weight: what is left there is not noise but systematic."""
    loudest: float = 3.0
    """What is louder than this many times the median over blocks is turned down to it, so that a crash does not
    decide."""
    alike: tuple[float, float] = (0.5, 1.25)
    """Gains between which two sensors of one motion must be. With noise on both, the gain seen from the first, |S_xy| /
    S_xx, is too small, and that seen from the second, S_yy / |S_xy|, too large: the true one is between. Where both are
    beyond, it is no common motion: one sensor's noise has moved the vehicle through the controller."""
    rival: float = 0.9
    """Height of another peak, relative to the highest, at which the delay may not be unique."""
    twin: float = 0.98
    """Height of another peak at which the delay is not unique."""
    widest: float = 0.05
    """Half width of the 95 % interval [s] beyond which a delay is not worth printing."""
    nudge: float = 1e-3
    """By how much stamps are moved to see how the phase of each bin turns [s]."""
    heard: tuple[float, float] = (0.0, 1.5)
    """Bounds on the frequency that a bin is found to listen to, relative to its own."""
    same: float = 1e-6
    """Offset and standard deviation [s] below which two series are copies of each other."""
    certain: float = 3.0
    """Standard deviations beyond which a difference is not chance."""


OFFSETS = OffsetSettings()


class Problem(StrEnum):
    """Why there is no number."""

    STILL = "still"  # one of the signals never changes
    SLOW = "slow"  # one comes too slowly
    SHORT = "short"  # too little time that both have without a gap
    UNRELATED = "unrelated"  # nothing in common beyond chance
    UNMATCHED = "unmatched"  # no offset makes them match
    AMBIGUOUS = "ambiguous"  # several offsets match equally well
    NARROW = "narrow"  # too few frequencies at which the two go together
    VAGUE = "vague"  # the interval is too wide to be worth printing
    FEEDBACK = "feedback"  # the command answers the motion
    UNCLEAR = "unclear"  # the command may answer the motion: gains fit neither throughout


@dataclass(frozen=True)
class Signal:
    """`values` (N, C) at `time` (N,) [s], increasing; nothing is known inside `gaps`. `axes` name the C columns."""

    name: str
    time: Array
    values: Array
    axes: tuple[str, ...] = ("x", "y", "z")
    gaps: tuple[Gap, ...] = ()


@dataclass(frozen=True)
class Part:
    """The delay [s] seen on one axis (`name` x) or in one band (`name` "2-5 Hz"); None where nothing is in common."""

    name: str
    seconds: float | None
    std: float | None


@dataclass(frozen=True)
class Offset:
    """By how much `second` lags `first`: `seconds` +- `std` [s], negative where it leads.

    `interval` is the half width of the 95 % interval, `drift` the slope of the delay over the flight [s/s] (None where
    blocks are too few), `halves` the delays of first and second half of the flight. `coherence` is the mean over the
    frequencies in use, which reach from `lowest_hz` to `highest_hz`; `blocks` is how many were taken. `problem` says
    why there is no number, and `about` what that is about (a signal, a rate, an interval); then `seconds` is None.
    """

    first: str
    second: str
    seconds: float | None = None
    std: float | None = None
    interval: float | None = None
    drift: float | None = None
    drift_std: float | None = None
    halves: tuple[Part, ...] = ()
    axes: tuple[Part, ...] = ()
    bands: tuple[Part, ...] = ()
    coherence: float | None = None
    lowest_hz: float | None = None
    highest_hz: float | None = None
    blocks: int = 0
    problem: Problem | None = None
    about: str = ""
    correlated: Correlated | None = field(default=None, repr=False, compare=False)

    @property
    def same(self) -> bool:
        """Whether the two are copies of one series."""
        return self.seconds is not None and abs(self.seconds) < OFFSETS.same and (self.std or 0.0) < OFFSETS.same

    @property
    def certain(self) -> bool:
        """Whether the offset differs from zero beyond chance."""
        return self.seconds is not None and abs(self.seconds) > self._doubt * (self.std or 0.0) and not self.same

    @property
    def drifts(self) -> bool:
        """Whether the offset changes over the flight beyond chance."""
        return self.drift is not None and abs(self.drift) > self._doubt * (self.drift_std or 0.0) and not self.same

    @property
    def _doubt(self) -> float:
        """Standard deviations that mean with these few blocks what `OFFSETS.certain` means with many."""
        from scipy.special import ndtr, stdtrit  # here: others need not wait for it

        chance = 2.0 * float(ndtr(-OFFSETS.certain))
        return -float(stdtrit(max(2.0, 0.5 * self.blocks), 0.5 * chance))


def offset(
    first: Signal,
    second: Signal,
    *,
    band: tuple[float, float] = (OFFSETS.lowest_hz, OFFSETS.highest_hz),
    within: Intervals = EVERYWHERE,
    gains: tuple[float, float] = (0.0, np.inf),
    coherent: float = 0.0,
) -> Offset:
    """By how much the second signal lags the first, from the frequencies in `band` [Hz] and the times `within` [s].

    Frequencies at which the size of the second relative to the first cannot be within `gains` do not count, nor those
    with a coherence below `coherent`; fewer than `OFFSETS.fewest_bins` of them give no number. Delays up
    to a quarter of a block (0.5 s) are searched, twice that with alignment. Both signals have the same axes.
    """
    none = Offset(first.name, second.name)
    moves = varying(first.values)
    moving = moves & varying(second.values)
    if not moving.any():
        still = second if moves.any() else first
        return replace(none, problem=Problem.STILL, about=still.name)
    if not moving.all():
        first, second = (
            replace(s, values=s.values[:, moving], axes=tuple(np.array(s.axes)[moving])) for s in (first, second)
        )
    period, slower = max(((nominal_period(s.time), s) for s in (first, second)), key=lambda pair: pair[0])
    top = min(band[1], OFFSETS.of_nyquist * 0.5 / period)
    if top < max(2.0, 2.0 * band[0]):
        about = f"{slower.name}, {1.0 / period:.1f} Hz"
        return replace(none, problem=Problem.SLOW, about=about)
    pair = _Pair(first, second, (band[0], top), within, gains, coherent)
    if len(pair.starts) < OFFSETS.fewest_blocks:
        least = 0.5 * (OFFSETS.fewest_blocks + 1) * OFFSETS.shortest_block
        return replace(none, problem=Problem.SHORT, about=f"{least:g} s")
    return pair.estimate(none)


@dataclass(frozen=True)
class Correlated:
    """Weighted cross-spectra after alignment: `u` (B, C, F), their phase that of what is left to move.

    Summed over blocks |u| is the weight w of each axis and frequency. `omega` (F,) [rad/s], `when` (B,) block centres.
    `heard` (C, F) [rad/s] is by how much the phase really turns when the stamps move: in the steep spectrum of a slow
    motion, a bin is filled from the slower ones beside it. `gain` (C, F) is the size of second over first, as far as
    they go together.
    """

    u: Complex
    omega: Array
    heard: Array
    when: Array
    coherence: Array
    gain: Array
    seconds: float

    def curve(self, delays: Array) -> Array:
        """R (D,) at remaining delays (D,) [s]."""
        total = self.u.sum(axis=0)
        used = total != 0
        phase = np.outer(self.heard[used], delays)
        return np.asarray(total[used].real @ np.cos(phase) - total[used].imag @ np.sin(phase))

    def by_block(self, delay: float) -> Array:
        """R (B,) at a remaining delay [s]."""
        return np.asarray(np.sum((self.u * np.exp(1j * self.heard * delay)).real, axis=(1, 2)))

    def newton(self, u: Complex | None = None, rounds: int = 4) -> tuple[float, Array, Array]:
        """Remaining delay (NaN where R has no top), and by block scores (B,) and curvatures (B,) of R at it."""
        chosen = self.u if u is None else u
        total, before, delay = chosen.sum(axis=0), 0.0, 0.0
        for _ in range(rounds):  # on all blocks together, which turn alike
            turned = total * np.exp(1j * self.heard * delay)
            curvature = float(np.sum(turned.real * self.heard**2))
            before = delay
            if not curvature > 0:
                delay = np.nan
                break
            delay -= float(np.sum(turned.imag * self.heard)) / curvature
        turn = np.exp(1j * self.heard * before) * self.heard
        count = len(chosen)
        score = -(chosen.reshape(count, -1) @ turn.reshape(-1)).imag
        curvatures = (chosen.reshape(count, -1) @ (turn * self.heard).reshape(-1)).real
        return delay, score - curvatures * (delay - before) if delay == delay else score, curvatures

    def parts(self, chosen: Iterable[tuple[str, Mask]]) -> tuple[Part, ...]:
        """The delays of some blocks, axes or frequencies alone, by their names and masks on `u`."""
        out = []
        for name, mask in chosen:
            delay, score, curvature = self.newton(np.where(mask, self.u, 0.0))
            told = abs(delay) < 0.25 * OFFSETS.block
            std = scatter(score) / float(curvature.sum()) if told else None
            out.append(Part(name, self.seconds + delay if told else None, std))
        return tuple(out)


def scatter(score: Array) -> float:
    """Standard deviation of a sum of scores (B,) of overlapping blocks (Newey and West, one neighbour)."""
    count = len(score)
    centred = score - score.mean()
    variance = float(centred @ centred + centred[1:] @ centred[:-1])
    return float(np.sqrt(max(variance, float(centred @ centred)) * count / (count - 1)))


class _Pair:
    """Two signals and the blocks of time in which they are compared."""

    def __init__(
        self,
        first: Signal,
        second: Signal,
        band: tuple[float, float],
        within: Intervals,
        gains: tuple[float, float],
        coherent: float,
    ) -> None:
        # Side by side in memory once, and not for every integral: columns of a series lie among others.
        self.first, self.second = (
            replace(s, values=np.ascontiguousarray(s.values, dtype=float)) for s in (first, second)
        )
        self.gains, self.coherent = gains, coherent
        common = [(max(a, c, e), min(b, d, f)) for a, b in _runs(first) for c, d in _runs(second) for e, f in within]
        common = [(a, b) for a, b in common if b - a >= OFFSETS.shortest_block]
        total = sum(b - a for a, b in common)
        self.length = float(np.clip(total / 8.0, OFFSETS.shortest_block, OFFSETS.block))
        self.reach = 0.25 * self.length
        every = np.zeros(0)
        for a, b in common:  # blocks overlap by half and fill the interval
            count = max(int((b - a) / (0.5 * self.length) + 1e-9) - 1, 0)
            every = np.append(every, np.linspace(a, b - self.length, count))
        if len(every) > OFFSETS.most_blocks:  # spread, in pairs of neighbours
            every = every[np.linspace(0, len(every) - 1, OFFSETS.most_blocks).astype(int)]
        self.starts = every
        lowest = max(1, int(np.ceil(band[0] * self.length - 1e-9)))
        self.harmonics = np.arange(lowest, int(np.floor(band[1] * self.length + 1e-9)) + 1)
        self.omega = np.asarray(2.0 * np.pi * self.harmonics / self.length, dtype=np.float64)

    def estimate(self, none: Offset) -> Offset:
        """Search, align, and say how sure."""

        def moved(signal: Signal, time: Array) -> Complex:
            """Fourier integrals (B, C, F) of the tapered blocks, each over the samples that lie in it."""
            count, lowest = len(self.harmonics), int(self.harmonics[0])
            return integrals(time, signal.values, self.starts, self.length, lowest, count)

        x = moved(self.first, self.first.time)
        seconds, slope = 0.0, 0.0
        middle = float(np.mean(self.starts)) + 0.5 * self.length
        grid = np.linspace(-self.reach, self.reach, 1 + 2 * int(np.ceil(self.reach * self.omega[-1] * 2)))
        spread = np.inf
        found: Correlated | None = None
        for round_ in range(12):
            time = self.second.time - seconds - slope * (self.second.time - middle)
            y, nudged = moved(self.second, time), moved(self.second, time - OFFSETS.nudge)
            found = self._correlate(x, y, nudged, seconds)
            if found is None:
                return replace(none, blocks=len(self.starts), problem=Problem.UNRELATED)
            coarse = float(grid[np.argmax(found.curve(grid))])
            if round_ < 2 and coarse != 0.0:
                seconds += coarse
                continue
            step, score, curvature = found.newton()
            if not abs(seconds + step) < 2.0 * self.reach:
                return replace(none, blocks=len(self.starts), problem=Problem.UNMATCHED)
            spread = scatter(score) / float(curvature.sum())
            seconds += step
            turn, turn_std = _slope(found.when, score, curvature)
            drifts = len(self.starts) >= 2 * OFFSETS.fewest_blocks and abs(turn) > OFFSETS.certain * turn_std
            slope += turn if drifts else 0.0
            if abs(step) < max(0.05 * spread, 1e-9) and not (drifts and abs(turn) > 1e-9):
                break
        assert found is not None
        return self._told(none, found, seconds, slope, spread)

    def _told(self, none: Offset, found: Correlated, seconds: float, slope: float, spread: float) -> Offset:
        """The result, or why there is none."""
        none = replace(none, blocks=len(self.starts))
        used = np.abs(found.u).sum(axis=0) > 0
        heard = found.omega[used.any(axis=0)] / (2.0 * np.pi)
        if len(heard) < OFFSETS.fewest_bins:
            return replace(none, problem=Problem.NARROW, about=f"{heard[0]:.1f}-{heard[-1]:.1f} Hz")
        if self._rivalled(found):
            return replace(none, problem=Problem.AMBIGUOUS)
        from scipy.special import stdtrit  # here: others need not wait for it

        interval = float(stdtrit(max(2.0, 0.5 * len(self.starts)), 0.975)) * spread
        if interval > OFFSETS.widest:
            about = f"{1e3 * seconds:+.0f} +- {1e3 * interval:.0f} ms"
            return replace(none, problem=Problem.VAGUE, about=about)
        _, score, curvature = found.newton()
        turn, turn_std = _slope(found.when, score, curvature)
        enough = len(self.starts) >= 2 * OFFSETS.fewest_blocks
        frequency = found.omega / (2.0 * np.pi)
        late = found.when[:, None, None] > np.median(found.when)
        column = np.arange(len(self.first.axes))[:, None]
        halves = (("first half", ~late), ("second half", late)) if enough and not slope else ()
        axes = ((name, column == c) for c, name in enumerate(self.first.axes))
        bands = (
            (f"{low:g}-{high:g} Hz", (frequency >= low) & (frequency < high))
            for low, high in OFFSETS.bands_hz
            if low < frequency[-1]
        )
        return replace(
            none,
            seconds=seconds,
            std=spread,
            interval=interval,
            drift=slope + turn if enough else None,
            drift_std=turn_std if enough else None,
            halves=found.parts(halves),
            axes=found.parts(axes),
            bands=found.parts(bands),
            coherence=float(found.coherence[used].mean()),
            lowest_hz=float(heard[0]),
            highest_hz=float(heard[-1]),
            correlated=found,
        )

    def _rivalled(self, found: Correlated) -> bool:
        """Whether another peak within reach is nearly as high, and not lower beyond chance."""
        delays = np.linspace(-self.reach, self.reach, 801)
        curve = found.curve(delays)
        rising = np.diff(curve, prepend=-np.inf) > 0
        falling = np.diff(curve, append=-np.inf) <= 0
        peaks, middle = np.flatnonzero(rising & falling), len(curve) // 2  # ends included
        others = np.delete(peaks, np.argmin(np.abs(peaks - middle)))
        if not others.size:
            return False
        other = int(others[np.argmax(curve[others])])
        if curve[other] < OFFSETS.rival * curve[middle]:
            return False
        if curve[other] > OFFSETS.twin * curve[middle]:
            return True
        difference = found.by_block(0.0) - found.by_block(float(delays[other]))
        return float(difference.sum()) < OFFSETS.certain * scatter(difference)

    def _correlate(self, x: Complex, y: Complex, nudged: Complex, seconds: float) -> Correlated | None:
        """Weighted cross-spectra, or None where nothing is in common; `nudged` is y, `OFFSETS.nudge` earlier."""
        sizes = [z.real**2 + z.imag**2 for z in (x, y)]
        loud = np.sqrt(sizes[0] * sizes[1])
        usual = np.median(loud, axis=0) * OFFSETS.loudest**2
        down = np.minimum(1.0, np.divide(usual, loud, out=np.ones_like(loud), where=loud > usual))
        weighted = down * np.conj(x)
        cross = weighted * y
        total = cross.sum(axis=0)
        first, second = (np.sum(down * size, axis=0) for size in sizes)
        power = first * second
        coherence: Array = np.divide(np.abs(total) ** 2, power, out=np.zeros_like(power), where=power > 0)
        least = max(_chance(len(x), coherence.size), self.coherent)
        gain: Array = np.divide(np.abs(total), first, out=np.zeros_like(power), where=first > 0)
        alike = (gain < self.gains[1]) & (gain > self.gains[0] * coherence)
        w = np.where(alike & (coherence > least), coherence / (1.0 - np.minimum(coherence, OFFSETS.coherence_cap)), 0.0)
        if not w.any():
            return None
        u = cross * np.divide(w, np.abs(total), out=np.zeros_like(w), where=w > 0)
        turn = np.angle(np.sum(weighted * nudged, axis=0) * np.conj(total)) / OFFSETS.nudge
        heard = np.clip(turn, OFFSETS.heard[0] * self.omega, OFFSETS.heard[1] * self.omega)
        return Correlated(u, self.omega, heard, self.starts + 0.5 * self.length, coherence, gain, seconds)


def _chance(blocks: int, tried: int) -> float:
    """Coherence that noise stays below, with `blocks` Hann blocks that overlap by half, at `tried` places at once.

    For n independent blocks the coherence of noise exceeds c with probability (1 - c)^(n-1) (Carter, "Coherence and
    time delay estimation", Proc. IEEE 75(2), 1987); overlapping Hann blocks count 0.95 each (Welch 1967).
    """
    return float(1.0 - (OFFSETS.chance / tried) ** (1.0 / max(0.95 * blocks - 1.0, 1.0)))


def _slope(when: Array, score: Array, curvature: Array) -> tuple[float, float]:
    """Slope of the delay over time [s/s] and its standard deviation, from scores at the best constant delay."""
    middle = float(when @ curvature / curvature.sum())
    lever = when - middle
    information = float(curvature @ lever**2)
    if information <= 0:
        return 0.0, np.inf
    slope = float(score @ lever) / information
    return slope, scatter((score - slope * curvature * lever) * lever) / information


def _runs(signal: Signal) -> list[tuple[float, float]]:
    """Intervals of a signal between its gaps."""
    edges = [float(signal.time[0])]
    for gap in signal.gaps:
        edges += [gap.start, gap.stop]
    edges.append(float(signal.time[-1]))
    return [(a, b) for a, b in zip(edges[::2], edges[1::2], strict=True) if b > a]
