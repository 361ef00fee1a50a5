"""A process that is believed no further than held-out time and stability allow.

    1. components of the command whose effect the flights do not show: not looked at (`unshown`)
    2. a lag of the vehicle, where held-out time supports one: the commands are lagged (`learn.identify.samples`)
    3. the fit, and a gain for each output from held-out time (`learn.process.held_out_time`)
    4. a stability margin below `GUARD.least_margin` along the commands: 3. again, blind to the outputs' own components

a verdict for each output, and an observer of what the process leaves (`learn.identify.observer`).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import eigh

from wrenchgap.flight.arguments import Progress, silent
from wrenchgap.flight.flight import AXES, Array, Mask
from wrenchgap.learn.data.errors import rms
from wrenchgap.learn.data.measurement import Record
from wrenchgap.learn.identify.observer import choose, longest_lag
from wrenchgap.learn.identify.samples import Samples, lags, samples, shared_lag, stretches
from wrenchgap.learn.process.gp import FitSettings, GaussianProcess, Provenance
from wrenchgap.learn.process.held_out_time import SUPPORT, Decision, HeldOut, Reason, Support, Verdict, support
from wrenchgap.learn.process.train import believed, fit_held_out
from wrenchgap.plant.effects import family
from wrenchgap.plant.effects.effect import CommandEffect
from wrenchgap.plant.mismatch import output_indices
from wrenchgap.plant.model import Model
from wrenchgap.plant.stability import Loop, Margin, margin_of_model


@dataclass(frozen=True)
class GuardThresholds:
    """When a process is kept from doing harm."""

    least_margin: float = 1.0
    """Margin below which small gain does not guarantee a stable loop."""
    above_noise: float = 2.0
    """Ratio of a residual's rms to the sensors' white noise from which on something is missing."""
    periods: float = 1.5
    """Periods of the controller between a reading and the middle of the period in which its command acts."""


GUARD = GuardThresholds()


@dataclass(frozen=True)
class Guarded:
    """A process, the samples that it was fitted to, and its stability margin along their commands."""

    gp: GaussianProcess
    data: Samples
    margin: Margin


def guarded_process(
    records: Sequence[Record],
    base: Model,
    outputs: tuple[str, ...],
    settings: FitSettings,
    provenance: Provenance,
    progress: Progress = silent,
) -> Guarded:
    """Learn what `base` leaves; with `settings.guarded` no more of it than held-out time and stability support."""
    if not settings.guarded:
        data = samples(records, base, settings.inputs)
        gp, held = _fitted(data, outputs, settings, provenance, progress)
        gp = gp if held is None else believed(gp, held, gp.gain, data.inputs)
        return Guarded(gp, data, margin_of_model(gp, data.inputs, loop_of(base)))
    settings = replace(settings, blind=_blind(records, base, outputs))
    late = _lags(records, base, outputs, settings)
    found, supported = _attempt(records, base, outputs, settings, provenance, late, progress)
    if found.margin.least < GUARD.least_margin:
        every = tuple(axis for axis in AXES if axis in (*settings.blind, *outputs))
        settings = replace(settings, blind=every)
        found, supported = _attempt(records, base, outputs, settings, provenance, late, progress)
    rows = output_indices(outputs)
    plain = rms(samples(records, base).outputs[:, rows]) if late.any() else rms(found.data.outputs[:, rows])
    noise = np.mean([r.noise[rows] for r in records], axis=0)
    verdicts = tuple(
        _verdict(axis, k, found, supported, (float(plain[k]), float(noise[k]), float(late[rows[k]])))
        for k, axis in enumerate(outputs)
    )
    said = replace(
        found.gp.provenance,
        verdicts=verdicts,
        lags=tuple(late[rows].tolist()),
        margin=float(min(found.margin.least, 1e6)),
    )
    return replace(found, gp=replace(found.gp, provenance=_observing(said, found, records, base, late)))


def _observing(said: Provenance, found: Guarded, records: Sequence[Record], base: Model, late: Array) -> Provenance:
    """`said` with the observer that the flights and the loop with this process support."""
    gp, loop = found.gp, loop_of(base, float(late.max()))
    rows = output_indices(gp.outputs)
    looks = np.array([axis not in gp.settings.blind for axis in AXES])
    unseen = 0.0 if loop.lag > 0 else longest_lag(stretches(records, base), looks, rows[rows >= 3])
    steepest = found.margin.least * found.margin.peak if (gp.gain > 0).any() else np.inf
    chosen = choose(records, base, late, loop, unseen, steepest)
    return replace(
        said,
        observer_hz=chosen.observer.hz or None,
        observer_lag=chosen.observer.lag,
        observer_peak=chosen.peak if np.isfinite(chosen.peak) else None,
        observer_left=chosen.left,
        loop_lag=chosen.lag,
        loop_delay=loop.delay,
    )


def loop_of(model: Model, lag: float = 0.0) -> Loop:
    """The attitude loop of a vehicle; lags and delays of its effects, and one that was found, are in it."""
    known = {e.name: e.theta for e in model.effects if isinstance(e.effect, CommandEffect)}
    slow = sum(float(np.max(theta)) for name, theta in known.items() if family(name) in ("servo_lag", "motor_lag"))
    delay = sum(float(theta[0]) for name, theta in known.items() if name == "command_delay")
    period = 1.0 / model.controller.rate_hz
    return Loop(model.controller, model.vehicle.body.inertia, slow + lag, delay + GUARD.periods * period, delay)


def _attempt(
    records: Sequence[Record],
    base: Model,
    outputs: tuple[str, ...],
    settings: FitSettings,
    provenance: Provenance,
    late: Array,
    progress: Progress,
) -> tuple[Guarded, Support | None]:
    data = samples(records, base, settings.inputs, late)
    gp, held = _fitted(data, outputs, settings, provenance, progress)
    supported, rows = None if held is None else support(held), output_indices(outputs)
    if held is not None and supported is not None:
        left, plain = rms(data.outputs[:, rows]), rms(samples(records, base).outputs[:, rows])
        little = supported.share * left**2 < SUPPORT.least_share * plain**2  # beside what the lag explains
        supported = replace(supported, gain=np.where(little, 0.0, supported.gain))
        gp = believed(gp, held, supported.gain, data.inputs)
    return Guarded(gp, data, margin_of_model(gp, data.inputs, loop_of(base, float(late.max())))), supported


def _fitted(
    data: Samples, outputs: tuple[str, ...], settings: FitSettings, provenance: Provenance, progress: Progress
) -> tuple[GaussianProcess, HeldOut | None]:
    targets = data.outputs[:, output_indices(outputs)]
    return fit_held_out(data.inputs, targets, outputs, settings, provenance=provenance, progress=progress)


def _blind(records: Sequence[Record], base: Model, outputs: tuple[str, ...]) -> tuple[str, ...]:
    """Components of the command among the outputs that the flights do not show the effect of."""
    rows = output_indices(outputs)
    parts = stretches(records, base)
    command, expected, measured = (
        np.concatenate([getattr(p, name)[:, rows] for p in parts]) for name in ("commanded", "expected", "measured")
    )
    noise = np.mean([r.noise[rows] for r in records], axis=0)
    hidden = unshown(command, expected, measured, noise)
    return tuple(axis for axis, yes in zip(outputs, hidden, strict=True) if yes)


def _lags(records: Sequence[Record], base: Model, outputs: tuple[str, ...], settings: FitSettings) -> Array:
    """Time constants (6,) [s]; none where the process looks at the past of the command, which knows them."""
    if "past" in settings.inputs:
        return np.zeros(len(AXES))
    looks, parts = np.array([axis not in settings.blind for axis in AXES]), stretches(records, base)
    late = np.where(looks, lags(parts, looks), 0.0)
    blind = output_indices(outputs)[~looks[output_indices(outputs)]]
    if len(blind):  # the actuators are shared, and the commands are lagged by the largest
        late[blind] = late.max() if late.any() else shared_lag(parts, looks, blind)
    return late


def _verdict(
    axis: str, k: int, found: Guarded, supported: Support | None, sizes: tuple[float, float, float]
) -> Verdict:
    """`sizes`: rms of the residual without a lag, noise, lag [s]."""
    plain, noise, late = sizes
    if supported is None:
        return Verdict(axis, Decision.NEEDS, Reason.LONGER, 1.0, ())
    gain = float(supported.gain[k])
    fall = tuple(supported.reduction[k].tolist())
    if gain > 0:
        return Verdict(axis, Decision.COMPENSATE, Reason.HELPS, gain, fall)
    least = GUARD.above_noise * noise
    left = float(rms(found.data.outputs[:, [output_indices(found.gp.outputs)[k]]])[0])
    if left <= least or late > 0.0:
        nothing = left <= least and plain <= least
        return Verdict(axis, Decision.DO_NOT, Reason.NOTHING if nothing else Reason.LAG, 0.0, fall)
    reason = Reason.EXCITATION if axis in found.gp.settings.blind else Reason.INPUTS
    return Verdict(axis, Decision.NEEDS, reason, 0.0, fall)


def unshown(
    command: Array,
    expected: Array,
    measured: Array,
    noise: Array,
    *,
    cancelled: float = 0.1,
    above_noise: float = 3.0,
    share: float = 0.2,
) -> Mask:
    """Which components (L,) of the command the flight does not show the effect of.

    Derivation: docs/theory/process.md, What a closed loop hides. With the covariances P of what the physics expects of
    the commands and M of what was measured, less the sensors' noise,

        M v = lambda P v                          (generalised eigenvalues, v^T P v = 1)

    lambda is the share of the expected variance that was measured along v: near 1 where the command turned the vehicle,
    0 where it only cancelled something. Where lambda is small, and where the command hardly exceeds the noise, the
    process does not look at the command (`FitSettings.blind`): the dependence is that of the physics.

    Parameters
    ----------
    command, expected, measured
        Consecutive samples (M, L) of the same components [N, Nm]: the command, the wrench that the physics expects of
        it, and the measured one.
    noise
        Standard deviation (L,) of the measured one's white noise [N, Nm].
    cancelled
        lambda below which the command only cancelled something: a third of the amplitude.
    above_noise
        Standard deviations of the noise that a command must exceed.
    share
        Share of a component's variance along a direction from which on the component is part of it.
    """
    scale = np.sqrt(command.var(axis=0) + noise**2) + 1e-12
    command, expected, measured = ((part - part.mean(axis=0)) / scale for part in (command, expected, measured))
    floor = (noise / scale) ** 2
    P = np.atleast_2d(np.cov(expected.T)) + np.diag(1e-2 * floor + 1e-12)
    M = np.atleast_2d(np.cov(measured.T)) - np.diag(floor)
    shares, directions = eigh(M, P)
    quiet = above_noise**2 * np.einsum("lk,l,lk->k", directions, floor, directions) > 1.0
    along = expected @ directions
    spread = np.maximum(command.std(axis=0), 1e-12)
    part = (command.T @ along / len(command) / (spread[:, None] * np.maximum(along.std(axis=0), 1e-12))) ** 2
    hidden = (part > share) & ((shares < cancelled) | quiet)
    return np.asarray(hidden.any(axis=1) | (command.std(axis=0) ** 2 < above_noise**2 * floor))
