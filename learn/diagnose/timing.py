"""Offsets between the topics of a flight, of the response behind its commands, and which of them are worth a warning.

Reported before any physics, and never acted on: whether an offset is a clock, a link or an actuator is for the user to
say (`--shift`) or for `explain` to weigh (`command_delay`, `servo_lag`, `motor_lag`).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wrenchgap.flight.checks.motion import rms
from wrenchgap.flight.compared_signals import controller_offset, sensor_offsets, tracking_offsets
from wrenchgap.flight.filters import angular_velocity, smooth
from wrenchgap.flight.flight import AXES, Flight, OdometrySeries
from wrenchgap.flight.offsets import EVERYWHERE, Intervals, Offset, Problem
from wrenchgap.learn.data.dataset import Dataset, dataset
from wrenchgap.learn.data.opening import OpenFlight
from wrenchgap.learn.data.response import Response, responses
from wrenchgap.plant.model import Model


@dataclass(frozen=True)
class TimingThresholds:
    """From when on an offset is worth a warning."""

    matters: float = 0.05
    """Error of an effect that reads the odometry at which an offset is worth a warning: half of the 10 % to which
    parameters are wanted. A velocity that is late by d is off by d times the acceleration, relative to the speed; a
    force that is fixed in E, turned by an attitude that is late, is off by d times the rate."""
    drifts: float = 2e-3
    """Change of an offset over a flight that is worth a warning [s]: one sample at 500 Hz."""
    in_step: float = 0.9
    """Share of the samples of one series that have the stamps of another where both are of one table."""
    idle_speed: float = 0.05
    """Speed [m/s] below which motion drives no effect, and no error of one."""
    idle_rate: float = 0.02
    """Rate [rad/s], likewise."""
    unlike: float = 2e-3
    """Difference between the lags of attitude and velocity beyond which one shift cannot undo both [s]."""
    certain: float = 3.0
    """Standard errors from which on a difference of two times is one, and up to which they agree."""


TIMING = TimingThresholds()
AUTOPILOTS = ("px4", "ardupilot")
"""Whose topics, as readers make them, are stamped by one clock."""


@dataclass(frozen=True)
class OdometryOffset:
    """The odometry lags the IMU by `seconds`, which makes effects that it drives wrong by up to the share `error`."""

    seconds: float
    error: float


@dataclass(frozen=True)
class UnevenOffset:
    """Not all of the odometry is late by as much: an estimator's filter rather than a clock."""

    offsets: tuple[Offset, ...]


@dataclass(frozen=True)
class LateGyroscope:
    """The gyroscope is `seconds` +- `std` later than the accelerometer of its IMU: a low-pass or a clock of its own."""

    seconds: float
    std: float


@dataclass(frozen=True)
class Drift:
    """An offset changes over the flight: two clocks, or, where one clock stamps both, a delay that changes."""

    offset: Offset
    one_clock: bool = False


@dataclass(frozen=True)
class LateResponse:
    """Commands take effect late, certainly and by enough to matter."""

    responses: tuple[Response, ...]


@dataclass(frozen=True)
class FeedbackDominated:
    """On these axes the commands answer the motion: actuator dynamics are not identifiable."""

    axes: tuple[str, ...]


TimingWarning = OdometryOffset | UnevenOffset | LateGyroscope | Drift | LateResponse | FeedbackDominated


@dataclass(frozen=True)
class FlightTiming:
    """Offsets of one flight: `sensors` between IMU and odometry, `responses` of the vehicle behind its commands.

    `tracking` is of the odometry behind the reference, `controller` of the commanded behind the desired wrench.
    `effect_error` (one for each of `sensors`) is the error that the offset makes in an effect driven by the odometry,
    as a share of that effect; None where it is not the odometry that is late. `duration` [s]. Signals whose names
    begin with one of `one_clock` are known to be stamped by one.
    """

    flight: str
    duration: float
    sensors: tuple[Offset, ...]
    effect_error: tuple[float | None, ...]
    tracking: tuple[Offset, ...] = ()
    controller: Offset | None = None
    responses: tuple[Response, ...] = ()
    one_clock: tuple[str, ...] = ()

    @property
    def offsets(self) -> tuple[Offset, ...]:
        """All offsets, responses last."""
        one = () if self.controller is None else (self.controller,)
        return (*self.sensors, *self.tracking, *one, *(r.offset for r in self.responses))

    @property
    def warnings(self) -> tuple[TimingWarning, ...]:
        """What a user should act on."""
        found: list[TimingWarning] = [*self._odometry()]
        found += [] if self.late_gyroscope is None else [self.late_gyroscope]
        for o in (*self.sensors, *(r.offset for r in self.responses)):
            if o.drifts and abs(o.drift or 0.0) * self.duration > TIMING.drifts:
                both = o.first, o.second
                found.append(Drift(o, any(all(name.startswith(one) for name in both) for one in self.one_clock)))
        late = tuple(r for r in self.responses if r.matters)
        feedback = tuple(r.axis for r in self.responses if r.offset.problem is Problem.FEEDBACK)
        found += [LateResponse(late)] if late else []
        return (*found, *([FeedbackDominated(feedback)] if feedback else []))

    @property
    def odometry(self) -> tuple[float, float, float] | None:
        """By how much the odometry lags the IMU [s], its standard deviation, and how much the lags differ.

        It is the mean of those of attitude, rate and velocity; None where none is certain.
        """
        rows = self._certain()
        if not rows:
            return None
        offsets = [o for o, _ in rows]
        return *_mean(offsets), float(np.ptp([o.seconds for o in offsets if o.seconds is not None]))

    @property
    def imu_lateness(self) -> tuple[float, float] | None:
        """How much [s] the IMU lags the odometry, zero or not, and its standard deviation; None where not known."""
        rows = [o for o, e in zip(self.sensors, self.effect_error, strict=True) if e is not None and not o.same]
        known = [o for o in rows if o.seconds is not None]
        if not known:
            return None
        seconds, std = _mean(known)
        return -seconds, std

    @property
    def late_gyroscope(self) -> LateGyroscope | None:
        """Where the attitude leads the gyroscope, and the velocity does not lead the accelerometer by as much.

        Estimators are late, so that an attitude that leads says something of the gyroscope.
        """
        known = {
            o.first: (o.seconds, o.std) for o, e in zip(self.sensors, self.effect_error, strict=True) if e is not None
        }
        (turn, turn_std), (push, push_std) = (known.get(s, (None, None)) for s in ("gyroscope", "accelerometer"))
        if turn is None or push is None:
            return None
        late, std = min(-turn, push - turn), float(np.hypot(turn_std or 0.0, push_std or 0.0))
        return LateGyroscope(late, std) if late > max(TIMING.unlike, TIMING.certain * std) else None

    def _certain(self) -> list[tuple[Offset, float]]:
        return [(o, e) for o, e in zip(self.sensors, self.effect_error, strict=True) if e is not None and o.certain]

    def _odometry(self) -> list[TimingWarning]:
        rows, late = self._certain(), self.odometry
        if late is None or not any(e > TIMING.matters for _, e in rows):
            return []
        found: list[TimingWarning] = [OdometryOffset(late[0], max(e for _, e in rows))]
        if late[2] > TIMING.unlike:
            found.append(UnevenOffset(tuple(o for o, _ in rows)))
        return found


def _mean(offsets: Sequence[Offset]) -> tuple[float, float]:
    """Mean of offsets that are known [s], by their variances, and its standard deviation."""
    weight = np.array([1.0 / max(o.std or 0.0, 1e-6) ** 2 for o in offsets])
    seconds = np.array([o.seconds for o in offsets], dtype=float)
    return float(weight @ seconds / weight.sum()), float(weight.sum() ** -0.5)


def timing(flight: Flight, within: Intervals = EVERYWHERE, answers: tuple[Response, ...] = ()) -> FlightTiming:
    """Offsets between the topics of a flight, without knowing the vehicle."""
    sensors = sensor_offsets(flight, within)
    ends = [(s.time[0], s.time[-1]) for s in flight.series().values()]
    duration = float(max(b for _, b in ends) - min(a for a, _ in ends)) if ends else 0.0
    errors = tuple(_effect_error(o, flight.odometry) if flight.imu is not None else None for o in sensors)
    tracking, controller = tracking_offsets(flight, within), controller_offset(flight, within)
    return FlightTiming(flight.name, duration, sensors, errors, tracking, controller, answers, _one_clock(flight))


def _one_clock(flight: Flight) -> tuple[str, ...]:
    """How names of signals begin that one clock stamped: all of an autopilot's own log, or those of one topic.

    All of a table, too, in which nearly all samples of the slower series bear stamps of the fastest one, to the
    nanosecond.
    """
    every = flight.series().values()
    topics = [topic for s in every for topic in s.topic.split(" + ")]
    longest = max((s.time for s in every), key=len, default=np.zeros(0))
    one_autopilot = any(all(f"/{name}/" in topic for topic in topics) for name in AUTOPILOTS)
    if one_autopilot or all(np.mean(np.isin(s.time, longest)) > TIMING.in_step for s in every):
        return ("",)
    return ("odometry ",) if flight.odometry is not None and " + " not in flight.odometry.topic else ()


def timing_of(opened: OpenFlight, model: Model) -> FlightTiming:
    """Offsets between the topics of a flight while it is in the air, and of the response behind its commands."""
    flown = [(float(r.time[0]), float(r.time[-1])) for r in opened.records]
    return timing(opened.flight, flown, responses(opened.flight, model.vehicle, opened.records))


def dataset_of(flights: Sequence[OpenFlight], model: Model) -> Dataset:
    """Flights stacked (`learn.data.dataset`), with the axes on which their commands answer the motion."""
    return dataset(
        [r for f in flights for r in f.records], model, answering_axes([timing_of(f, model) for f in flights])
    )


def answering_axes(timing: Sequence[FlightTiming]) -> tuple[int, ...]:
    """Axes on which the commands of a flight answer the motion.

    Those on which that is seen, or on which the motion shows nothing of commands that change: a vehicle in turbulent
    air whose commands balance the air. One controller makes all three torques: where an answer is seen of one, the
    others are among them unless the motion plainly follows the command there and on another torque.
    """
    found: set[str] = set()
    for t in timing:
        seen = {r.axis for r in t.responses if r.offset.problem is Problem.FEEDBACK}
        turning = {r.axis for r in t.responses if r.axis in AXES[3:] and not r.plain}
        if seen & turning:
            found |= turning if len(turning) == 1 else {r.axis for r in t.responses if r.axis in AXES[3:]}
        found |= seen | {r.axis for r in t.responses if r.offset.problem is Problem.UNRELATED}
    return tuple(k for k, axis in enumerate(AXES) if axis in found)


def unfollowed_axes(timing: Sequence[FlightTiming]) -> tuple[int, ...]:
    """Axes on which commands change and the motion does not plainly follow: they may answer it, seen or not.

    A vehicle follows its commands unless they balance a disturbance. `calibrate`, `changed` and `trend` therefore take
    no gain from these axes, `explain` none from those of `answering_axes`. An axis on which nothing changes is none of
    them, nor one that was recorded for too few seconds to compare command and motion.
    """
    unasked = (Problem.STILL, Problem.SHORT)
    not_plain = {r.axis for t in timing for r in t.responses if not r.plain and r.offset.problem not in unasked}
    return tuple(k for k, axis in enumerate(AXES) if axis in not_plain)


def following_axes(timing: Sequence[FlightTiming]) -> tuple[int, ...]:
    """Axes that commands change and on which none of the flights says that they may answer the motion.

    On these alone actuator dynamics (lags, delays) are identifiable: elsewhere what is fitted is the controller's own
    phase (`FeedbackDominated`), or nothing that actuators made. One lag that is found on one of them, as in the thrust,
    is that of all axes that the same actuators make.
    """
    changing = {r.axis for t in timing for r in t.responses if r.offset.problem is not Problem.STILL}
    unfollowed = unfollowed_axes(timing)
    return tuple(k for k, axis in enumerate(AXES) if axis in changing and k not in unfollowed)


def _effect_error(offset: Offset, odometry: OdometrySeries | None) -> float | None:
    """What the offset of odometry behind IMU costs an effect that is driven by the odometry."""
    if odometry is None or offset.seconds is None or offset.same:
        return None
    if offset.first == "gyroscope" and offset.second == "odometry attitude":
        rate = rms(angular_velocity(odometry.time, odometry.quat_EB))
        return abs(offset.seconds) * rate if rate > TIMING.idle_rate else 0.0
    if offset.first == "accelerometer" and odometry.velocity_E is not None:
        speed = rms(odometry.velocity_E)
        change = rms(smooth(odometry.time, odometry.velocity_E, derivative=1))
        return abs(offset.seconds) * change / speed if speed > TIMING.idle_speed else 0.0
    return None
