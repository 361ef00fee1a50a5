"""The observer beside a process, from the log that the process was learnt from and a margin of the whole loop.

Equations and sources: docs/theory/compensation.md, The observer and Stability. A vehicle follows with the lag tau
(delay included). An observer of bandwidth k that takes it to follow with tau_o makes, of a disturbance d and of noise n
in the measured rates,

    correction = -H Q / (1 + Q (H - H_o)) d,        torque = k J n          above its bandwidth
    Q = k / (s + k),        H = 1 / (1 + tau s),        H_o = 1 / (1 + tau_o s)

**The loop.** Told nothing, the observer works against the lag, and with the attitude controller around it rings at a
third of the bandwidth that this loop by itself bears. So k is bounded by all of it, controller, lag, delay and
observer: M_s <= `OBSERVER.most_sensitive` (`plant.stability.sensitivity_peak`).

**What it is told.** Behind a lag that held-out time shows (`learn.identify.samples`), or that has a name, an observer
that does not know it is left with a third of a hertz. So it is told. A lag that nobody has seen is not told, but may be
there: the loop is judged with the longest that held-out time does not rule out (`longest_lag`), or with
`OBSERVER.unknown`.

**The log.** Of the k that leave within a tenth of the least on the training log, the one of the least M_s is chosen:
what is left is flat about its least, and there the margin is worth more. Where the best leaves more than
`OBSERVER.worth` of what no observer leaves (a lag alone, or nothing missing), there is none: it would pass noise and
the error of the lag on, and remove nothing. d is all of the residual and not what the process leaves of it: of flights
that the process has not seen nobody knows what it will leave, and where it is distrusted it leaves all.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from wrenchgap.flight.filters import filtered
from wrenchgap.flight.flight import Array, Indices, Mask
from wrenchgap.learn.data.blocks import by_block, paired_t, significant
from wrenchgap.learn.data.measurement import Record, low_pass
from wrenchgap.learn.identify.samples import LAG, Stretch, held_out, lagged, stretches
from wrenchgap.learn.process.held_out_time import CALIBRATION
from wrenchgap.plant.model import Model
from wrenchgap.plant.stability import Loop, Observer, loop_peak, sensitivity_peak

BANDWIDTHS_HZ = tuple(float(f) for f in np.geomspace(0.05, 12.0, 34))
"""That are tried."""


@dataclass(frozen=True)
class ObserverSettings:
    """How the observer's bandwidth is chosen."""

    unknown: float = 0.1
    """Lag and delay [s] of a vehicle whose log rules out none: tilt servos have 15 to 90 ms."""
    most_sensitive: float = 2.0
    """Largest M_s, the peak of the loop's sensitivity."""
    enough: float = 1.1
    """Ratio of what is left to the least that any bandwidth leaves, within which the least M_s is taken."""
    worth: float = 0.75
    """Share of what is left without an observer that the best one may leave; one that removes less is useless."""


OBSERVER = ObserverSettings()


@dataclass(frozen=True)
class Choice:
    """The observer, of 0 Hz where there is none, because no bandwidth keeps the margins, or none is worth it.

    Also the lag [s] of the loop that it was chosen for, M_s of that loop with it (`peak`), and the share that the best
    within the margins leaves of what is left without one (None where there is none).
    """

    observer: Observer
    lag: float
    peak: float
    left: float | None


def choose(records: Sequence[Record], base: Model, late: Array, loop: Loop, unseen: float, steepest: float) -> Choice:
    """The observer for these flights (`compensate.Combined`), on a vehicle with the lag of `loop`.

    `late` (6,) [s] are the lags of the outputs that `base` does not know, `unseen` [s] is the lag that may be there
    where `loop` has none, `steepest` the largest |T| that the feed-forward bears (infinite without one).
    """
    told = loop.lag
    loop = loop if told > 0 else replace(loop, lag=unseen)
    tau, told_tau = loop.lag + loop.delay, told + loop.named_delay
    J, rate = np.diag(base.vehicle.body.inertia), base.controller.rate_hz
    noise = np.sqrt(np.mean([fast_rates(r) ** 2 for r in records], axis=0))
    left: list[tuple[Array, float]] = []  # torques (K, 3) that model and lags leave of each record, and their period
    for part in stretches(records, base):
        torque = (part.measured - lagged(part.expected, late, part.dt))[:, 3:]
        left.append((np.nan_to_num(torque), part.dt))
    none = Observer(0.0, told, loop.named_delay)
    costs: dict[Observer, float] = {}
    for hz in (f for f in BANDWIDTHS_HZ if 2.0 * np.pi * f <= rate):
        tried = replace(none, hz=hz)
        if sensitivity_peak(loop, tried) <= OBSERVER.most_sensitive and loop_peak(loop, tried) <= steepest:
            torque = missed(left, hz, tau, told_tau) ** 2 + (2.0 * np.pi * hz * J * noise) ** 2
            costs[tried] = float(np.sqrt(np.sum(torque / J**2)))
    if not costs:
        return Choice(none, loop.lag, sensitivity_peak(loop, none), None)
    least = min(costs.values())
    alone = np.concatenate([d for d, _ in left])
    share = least / max(float(np.sqrt(np.sum(np.mean(alone**2, axis=0) / J**2))), 1e-300)
    good = {o: sensitivity_peak(loop, o) for o, cost in costs.items() if cost <= OBSERVER.enough * least}
    best = min(good, key=lambda o: good[o]) if share <= OBSERVER.worth else none
    return Choice(best, loop.lag, sensitivity_peak(loop, best), share)


def longest_lag(parts: Sequence[Stretch], looks: Mask, outputs: Indices) -> float:
    """The longest lag [s] that held-out time does not rule out on every one of `outputs` (places in a wrench).

    Ruled out is what predicts held-out blocks worse than no lag, beyond chance. `looks` (6,) as in
    `learn.identify.samples`; an output to which they are blind rules out nothing. At most `OBSERVER.unknown`.
    """
    if not len(outputs) or not looks[outputs].all():
        return OBSERVER.unknown
    squares = held_out(parts, looks, 0.0)[:, outputs] ** 2
    block = CALIBRATION.block(len(squares))
    for tau in (t for t in LAG.taus if 0.0 < t < OBSERVER.unknown):
        worse = held_out(parts, looks, tau)[:, outputs] ** 2 - squares
        large = worse.mean(axis=0) > squares.mean(axis=0)
        t = [float(paired_t(by_block(block, w))) for w in worse.T]
        if all(significant(t_k, large=bool(large_k)) for t_k, large_k in zip(t, large, strict=True)):
            return tau
    return OBSERVER.unknown


def fast_rates(record: Record) -> Array:
    """Rms (3,) of the gyroscope above the filter's cut-off [rad/s]: its noise, and vibration."""
    omega = record.state.omega_B
    return np.asarray(np.std(omega - low_pass(omega, record.dt, record.cutoff_hz), axis=0))


def missed(parts: Sequence[tuple[Array, float]], hz: float, tau: float, told: float = 0.0) -> Array:
    """Rms (3,) of what an observer of this bandwidth leaves of disturbances (K, 3), told the lag `told` [s]."""
    from scipy.signal import bilinear  # here: others need not wait for it

    squares, count, k = np.zeros(3), 0, 2.0 * np.pi * hz
    top = np.array([k * told, k])
    bottom = np.polyadd(
        np.polymul([1.0, k], np.polymul([tau, 1.0], [told, 1.0])), k * np.polysub([told, 1.0], [tau, 1.0])
    )
    for d, dt in parts:
        b, a = bilinear(np.trim_zeros(top, "f"), np.trim_zeros(bottom, "f"), 1.0 / dt)
        squares += np.sum((d - filtered(b, a, d)) ** 2, axis=0)
        count += len(d)
    return np.asarray(np.sqrt(squares / max(count, 1)))
