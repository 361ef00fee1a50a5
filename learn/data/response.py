"""By how much the vehicle's response lags its commands, axis by axis, and what that looks like.

Commanded and measured wrench are compared as `flight.offsets` compares any two topics. A command is held until the next
one, so what was commanded is stamped at the middle of its hold: that half period belongs to every digital controller,
and is not counted. The rest is an *apparent* delay. Three things make it, and one log cannot tell a part of each from
the same amount of another:

    the actuators lag           phase -atan(omega tau), attenuated       servo_lag, motor_lag
    the command travels         phase -omega d                           command_delay
    the clocks are apart        phase -omega d                           the stamps of commands or IMU

The first bends: at omega tau beyond one its delay shrinks like a quarter period. Where the flight reaches that far,
`shape` says which of the two forms fits the phases better on blocks of time (paired t over blocks, as everywhere).

In a closed loop the command also answers to the motion, and response over command is -1 / controller (docs/timing.md,
Feedback-dominated flights; Ljung, "System Identification", 2nd ed., 13.4). It gives itself away by its gain: what a
command achieves is about what it asked for, less what a lag takes off. Where phases or gains fit neither a delay nor a
lag, no number is given, nor where the gains fit only at the frequencies at which commands and motion are loudest. A
response before its command is none. Where its phases are those of a pure delay of the wrong sign and its gains are
those of a motion that follows, at every frequency, it is no answer of a controller either: the stamps are apart.

Nothing is removed here. What a user reads is what `explain` will be offered.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from wrenchgap.flight.compared_signals import differences, odometry_motion
from wrenchgap.flight.flight import AXES, Array, Flight, Series
from wrenchgap.flight.offsets import Correlated, Intervals, Offset, Problem, Signal, offset, scatter
from wrenchgap.flight.stamps import interpolated, pieces
from wrenchgap.learn.data.blocks import SIGNIFICANCE
from wrenchgap.learn.data.measurement import Record, felt_at_origin, from_actuators
from wrenchgap.plant.state import Motion
from wrenchgap.plant.vehicle import Vehicle
from wrenchgap.plant.wrench_model import measured_wrench

Shape = Literal["delay", "lag", "either"]


@dataclass(frozen=True)
class ResponseThresholds:
    """How the response to commands is compared with a lag or a delay."""

    band_hz: tuple[float, float] = (0.5, 10.0)
    """Frequencies at which commands and response are compared: beyond, vibration; below, trim and battery."""
    longest_lag: float = 0.5
    """Longest time constant that is tried [s]."""
    fits: float = 0.93
    """Mean cosine of the phase misfit at which a form fits: 21 deg rms."""
    gain_fits: float = 1.5
    """Factor (rms) between measured gain and a form's within which it fits: more than plausible effects make."""
    noticeable: float = 3.0
    """How many times the sensor noise a delay must leave in the residual to be worth attention."""
    least_share: float = 0.1
    """Share of the residual that a delay must make up to be worth attention."""


RESPONSE = ResponseThresholds()


@dataclass(frozen=True)
class Response:
    """How one `axis` of the measured wrench follows its command.

    `offset` is the apparent delay. `shape` says whether the phases look like a delay or a first-order lag of `lag`
    [s], or like either (None where there is no number). `leaves` is the rms that a model without it is
    left with, delay times rms rate of change of the filtered command, to be held against the rms `residual` of
    measured less commanded and the sensor `noise` (N or Nm). `plain` says that the gains fit at every frequency, not
    only where commands and motion are loudest: that the motion follows the command. `early` [s] is by how much it comes
    before the command, where it follows in everything else.
    """

    axis: str
    offset: Offset
    shape: Shape | None = None
    lag: float | None = None
    leaves: float | None = None
    residual: float | None = None
    noise: float | None = None
    plain: bool = False
    early: float | None = None

    @property
    def matters(self) -> bool:
        """Whether the delay is certain, above the noise, and no small part of what the model misses."""
        if not self.offset.certain or self.leaves is None or self.noise is None or self.residual is None:
            return False
        return self.leaves > max(RESPONSE.noticeable * self.noise, RESPONSE.least_share * self.residual)


def responses(flight: Flight, vehicle: Vehicle, records: Sequence[Record]) -> tuple[Response, ...]:
    """The apparent delay of each measured axis while `records` are in the air; empty without motion or commands."""
    commanded = _commanded(flight, vehicle)
    if commanded is None or not records or (flight.imu is None and flight.odometry is None):
        return ()
    measured = _measured(flight, vehicle)
    flown = [(float(r.time[0]), float(r.time[-1])) for r in records]
    known = np.all([r.measured_axes for r in records], axis=0)
    return tuple(_response(int(axis), commanded, measured, flown, records) for axis in np.flatnonzero(known))


def _response(axis: int, commanded: Signal, measured: Signal, flown: Intervals, records: Sequence[Record]) -> Response:
    name = AXES[axis]
    found = offset(_axis(commanded, axis), _axis(measured, axis), band=RESPONSE.band_hz, within=flown)
    if found.seconds is None or found.correlated is None:
        return Response(name, found)
    shape, lag, plain = _shape(found.correlated)
    acausal = found.certain and found.seconds < 0.0
    if shape is None or acausal or not plain:
        problem = Problem.FEEDBACK if shape is None or acausal else Problem.UNCLEAR
        early = -found.seconds if acausal and plain and shape in ("delay", "either") else None
        none = replace(found, seconds=None, std=None, interval=None, problem=problem)
        return Response(name, none, early=early)

    def rms(square: Callable[[Record], np.floating[Any]]) -> float:
        """Of all samples, from the mean square of each record."""
        return float(np.sqrt(np.average([square(r) for r in records], weights=[len(r) for r in records])))

    changing = rms(lambda r: np.mean(np.gradient(r.commanded[:, axis], r.dt_kept) ** 2))
    residual = rms(lambda r: np.var(r.measured[:, axis] - r.commanded[:, axis]))
    noise = rms(lambda r: r.noise[axis] ** 2)
    return Response(name, found, shape, lag, abs(found.seconds) * changing, residual, noise, plain)


def _axis(signal: Signal, axis: int) -> Signal:
    return replace(signal, name=f"{signal.name} {AXES[axis]}", values=signal.values[:, [axis]], axes=(AXES[axis],))


def _commanded(flight: Flight, vehicle: Vehicle) -> Signal | None:
    """Commanded wrenches at the middles of their holds; of the actuators where no wrench is logged."""
    if flight.commanded is not None:
        series: Series = flight.commanded
        wrench_B = flight.commanded.wrench_B
    elif flight.actuators is not None and vehicle.has_rotors:
        series, logged = flight.actuators, flight.actuators
        wrench_B = from_actuators(flight.name, vehicle, logged.tilt, logged.rotor_speed).wrench_B
    else:
        return None
    hold = np.append(np.diff(series.time), series.period)
    hold = np.where(hold > 2.5 * series.period, series.period, hold)  # nobody knows what was held over a gap
    return Signal("commanded", series.time + 0.5 * hold, wrench_B, AXES, series.gaps)


def _measured(flight: Flight, vehicle: Vehicle) -> Signal:
    """Measured wrenches (N, 6) half-way between samples, where a difference of rates is an angular acceleration."""
    rate, felt = _motion(flight)
    accelerating = differences("measured", rate.time, np.diff(rate.values, axis=0), rate.gaps)
    out = np.empty((len(accelerating.time), 6))
    for piece in pieces(len(out)):
        at, a = accelerating.time[piece], accelerating.values[piece]
        w, f = (_between(at, s) for s in (rate, felt))
        if flight.imu is not None:
            f = felt_at_origin(f, w, a, vehicle.imu_position_B)
        out[piece] = measured_wrench(vehicle.body, Motion(w, a, f))
    return replace(accelerating, values=out, axes=AXES)


def _between(at: Array, signal: Signal) -> Array:
    """A signal (N, C) at times (K,), increasing, straight between its samples."""
    near = slice(max(np.searchsorted(signal.time, at[0]) - 1, 0), np.searchsorted(signal.time, at[-1]) + 1)
    return interpolated(at, signal.time[near], signal.values[near])


def _motion(flight: Flight) -> tuple[Signal, Signal]:
    """Rates and specific force of the IMU, or else of the odometry."""
    imu = flight.imu
    if imu is None:
        assert flight.odometry is not None
        return odometry_motion(flight.odometry)
    # What was not measured is in no axis that anybody asks for; a number keeps it from spreading.
    rate, force = (np.nan_to_num(values) for values in (imu.omega_B, imu.specific_force_B))
    return Signal("rate", imu.time, rate, gaps=imu.gaps), Signal("force", imu.time, force, gaps=imu.gaps)


def _shape(found: Correlated) -> tuple[Shape | None, float, bool]:
    """Which form phases and gains have (None: neither), time constant [s] of the lag that fits best, and `plain`."""
    from scipy.optimize import minimize_scalar  # here: others need not wait for it

    u, omega = found.u, found.heard
    seen = omega * found.seconds  # the phase that alignment has taken out

    def by_block(phase: Array) -> Array:
        return np.asarray(np.sum((u * np.exp(1j * (phase - seen))).real, axis=(1, 2)))

    def lagging(tau: float) -> Array:
        return by_block(np.arctan(omega * tau))

    best = minimize_scalar(lambda tau: -float(lagging(tau).sum()), bounds=(0.0, RESPONSE.longest_lag), method="bounded")
    lag = float(best.x)
    remaining, _, _ = found.newton()
    late, slow = by_block(seen + omega * np.nan_to_num(remaining)), lagging(lag)
    weight = np.abs(u.sum(axis=0))
    used = weight > 0

    def gain_fits(model: Array, weight: Array) -> bool:
        off = np.log(found.gain[used] / model[used]) ** 2
        return bool(np.sqrt(np.average(off, weights=weight[used])) < np.log(RESPONSE.gain_fits))

    models = np.ones_like(omega), 1.0 / np.sqrt(1.0 + (omega * lag) ** 2)
    fits = [
        part.sum() > RESPONSE.fits * weight.sum() and gain_fits(model, weight)
        for part, model in zip((late, slow), models, strict=True)
    ]
    plain = any(gain_fits(model, np.ones_like(weight)) for model in models)
    if not all(fits):
        return ("delay" if fits[0] else "lag" if fits[1] else None), lag, plain
    difference = late - slow
    t = float(difference.sum()) / max(scatter(difference), 1e-300)
    return ("delay" if t > SIGNIFICANCE.alone else "lag" if t < -SIGNIFICANCE.alone else "either"), lag, plain
