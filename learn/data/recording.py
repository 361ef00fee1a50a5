"""A contiguous stretch of a log on its control clock, ready to be re-simulated.

The motion that it recorded is made one smooth and consistent trajectory. The IMU knows the shape of a motion, the
odometry where it is. Gyroscope and accelerometer, low-passed without phase, are integrated; what then differs from the
odometry is the slowly growing effect of their biases, and is taken out by a cubic spline c(t) fitted to that
difference:

    q_EB = exp(c_q) q_int,    omega_B = omega_int + R_int^T J_r(c_q) c_q',    J_r(c) ~ I - hat(c)/2
    p_E  = p_int + c_p,       v_E = v_int + c_p',       a_E = a_int + c_p''

so that rate and attitude, acceleration, velocity and position belong together exactly. With knots every quarter second
the odometry decides below about 2 Hz, the IMU above; the white noise of the odometry is averaged over a knot.

Only position and attitude of the odometry are used: they are what the flight must reproduce, the derivative of the
spline is as good as the logged velocity (with 0.3 mm and 5 mm/s of white noise per sample, better), and in some logs
the two disagree.

Held commands (zero-order hold): a measurement at an instant sees the command on average *around* it
(`flight.resample`); a plant that is stepped from instant to instant holds what was sent on average *over* the period
that begins there.
"""

from dataclasses import dataclass, replace

import numpy as np

from wrenchgap.flight import so3
from wrenchgap.flight.compared_signals import GRAVITY_E
from wrenchgap.flight.errors import LogError, UsageError
from wrenchgap.flight.flight import Array, Flight, OdometrySeries, ReferenceSeries, Samples, Series, WrenchSeries
from wrenchgap.flight.resample import held_mean
from wrenchgap.flight.stamps import interpolated
from wrenchgap.learn.data.measurement import Record, commands_of, derivative, felt_at_origin, low_pass
from wrenchgap.learn.data.opening import OpenFlight
from wrenchgap.plant.simulation.closed_loop import Clock
from wrenchgap.plant.simulation.tracking import Tracking, TrackingErrors, during, tracking_errors
from wrenchgap.plant.state import Commands, Motion, State
from wrenchgap.plant.trajectory import Recorded, Reference
from wrenchgap.plant.vehicle import Vehicle
from wrenchgap.plant.wrench_model import cross

CUTOFF_HZ = 25.0
"""Corner of the filter on gyroscope and accelerometer, and so of the disturbance that is inferred [Hz].

On the multibody logs 8 Hz is not enough: 4 times as much torque is then left to the pull of the inference as at 25 Hz
(4.8 against 1.1 mNm rms). Wider adds noise and nothing else: from 25 to 60 Hz the disturbance's rms changes by its part
above 10 Hz, which grows as white noise does (25 to 50 mNm), and the null run stays as it is (0.14 deg, 1.5 mm).
"""


@dataclass(frozen=True)
class RecordedMotion:
    """`state` (N samples), and `motion` of O (rate, angular acceleration, specific force) that belongs to it."""

    state: State
    motion: Motion


def recorded_motion(
    samples: Samples, odometry: OdometrySeries, imu_position_B: Array, *, cutoff_hz: float = CUTOFF_HZ
) -> RecordedMotion:
    """The motion of O on the clock of `samples`, from its IMU at `imu_position_B` (3,) and the odometry of its flight.

    Raises LogError where the odometry does not have enough samples in the stretch.
    """
    time, dt = samples.time, samples.dt
    inside = (odometry.time >= time[0] - 1e-6) & (odometry.time <= time[-1] + 1e-6)
    if inside.sum() < 10:
        raise LogError(
            f"{samples.flight}: {odometry.topic} has {inside.sum()} samples between {time[0]:.2f} and {time[-1]:.2f} s;"
            " at least 10 are needed to follow the flight"
        )
    stamps, quat = odometry.time[inside], so3.continuous(odometry.quat_EB[inside])
    gyro = low_pass(samples.omega_B, dt, cutoff_hz)
    gyro = gyro - _gyro_bias(time, integrate_rate(quat[0], gyro, dt), stamps, quat)
    turned = integrate_rate(quat[0], gyro, dt)
    behind = so3.log(so3.multiply(quat, so3.conjugate(so3.interpolate(stamps, time, turned))))
    c, dc, _ = _spline(time, stamps, behind)
    attitude = so3.multiply(so3.exp(c), turned)
    omega = gyro + so3.rotate_inverse(turned, dc - 0.5 * cross(c, dc))
    omega_dot = derivative(omega, dt)

    felt = felt_at_origin(low_pass(samples.specific_force_B, dt, cutoff_hz), omega, omega_dot, imu_position_B)
    acceleration = so3.rotate(attitude, felt) - GRAVITY_E
    # Exact where the acceleration is linear between samples: p += v dt + (2 a_k + a_k+1) dt^2 / 6
    now, then = acceleration[:-1], acceleration[1:]
    velocity = _cumulated(0.5 * dt * (now + then))
    position = _cumulated(dt * velocity[:-1] + dt**2 / 6.0 * (2.0 * now + then))
    at_stamps = interpolated(stamps, time, position)
    p, dp, ddp = _spline(time, stamps, odometry.position_E[inside] - at_stamps)
    specific_force = so3.rotate_inverse(attitude, acceleration + ddp + GRAVITY_E)
    return RecordedMotion(
        State(time, position + p, attitude, velocity + dp, omega, samples.voltage),
        Motion(omega, omega_dot, specific_force),
    )


def integrate_rate(start: Array, omega_B: Array, dt: float) -> Array:
    """Attitudes (N, 4) that begin at `start` (4,) and turn with rates (N, 3): q <- q exp(dt (w_k + w_k+1)/2)."""
    steps = so3.exp(0.5 * dt * (omega_B[1:] + omega_B[:-1]))
    quat = np.empty((len(omega_B), 4))
    quat[0] = start
    for k, step in enumerate(steps):
        quat[k + 1] = so3.multiply(quat[k], step)
    return so3.normalise(quat)


def _cumulated(steps: Array) -> Array:
    """Sums (N, 3) of N - 1 steps, from zero."""
    return np.concatenate((np.zeros((1, 3)), np.cumsum(steps, axis=0)))


def _gyro_bias(time: Array, turned: Array, stamps: Array, quat: Array, window: float = 1.0) -> Array:
    """Mean rate (3,) by which a gyroscope turns faster than the odometry, from turns over `window` [s].

    Keeps the difference that is left small enough to be a rotation vector however long the flight.
    """
    stride = min(max(round(window / float(np.median(np.diff(stamps)))), 1), len(stamps) - 1)
    at_stamps = so3.interpolate(stamps, time, turned)
    by_gyro, by_odometry = (so3.multiply(so3.conjugate(q[:-stride]), q[stride:]) for q in (at_stamps, quat))
    faster = so3.log(so3.multiply(so3.conjugate(by_odometry), by_gyro))
    return np.asarray(np.mean(faster, axis=0) / np.mean(stamps[stride:] - stamps[:-stride]))


def _spline(time: Array, stamps: Array, values: Array, knot_spacing: float = 0.25) -> tuple[Array, Array, Array]:
    """Least-squares cubic spline through `values` (K, 3) at `stamps` (K,): value, slope, curvature (N, 3) at `time`.

    Knots are `knot_spacing` [s] apart. Half a second leaves 0.60 deg of null run on the liveliest crazyflie log, a
    quarter 0.43 deg, and nothing shorter helps much. The odometry's noise enters the disturbance with the 2.5th power
    of the rate of knots: on the multibody logs it is still lost in the IMU's at a quarter of a second (0.058 N rms), at
    a tenth it is three times that.
    """
    from scipy.interpolate import make_lsq_spline  # here: others need not wait for it

    span = stamps[-1] - stamps[0]
    spacing = max(knot_spacing, 6.0 * float(np.max(np.diff(stamps))))
    inner = np.linspace(stamps[0], stamps[-1], max(round(span / spacing), 1) + 1)
    knots = np.concatenate((np.repeat(inner[0], 3), inner, np.repeat(inner[-1], 3)))
    spline = make_lsq_spline(stamps, values, knots, k=3)
    return spline(time), spline.derivative(1)(time), spline.derivative(2)(time)


@dataclass(frozen=True)
class Recording:
    """One contiguous stretch of a flight on its control clock: N periods of `dt` [s] that begin at `time` (N,).

    Commands are what was held over each period: `desired`, `commanded` (N, 6), and `commands` with the actuators;
    `record` is the same stretch as models are compared on it.
    `first` and `count` say which periods are to be re-simulated; those before warm up what has memory.
    """

    flight: Flight
    odometry: OdometrySeries
    reference: Reference
    motion: RecordedMotion
    record: Record
    time: Array
    dt: float
    desired: Array
    commanded: Array
    commands: Commands
    first: int
    count: int
    notes: tuple[object, ...]

    @property
    def window(self) -> slice:
        """The periods that are re-simulated."""
        return slice(self.first, self.first + self.count)

    @property
    def clock(self) -> Clock:
        """That of the window: one step a period."""
        voltage = self.motion.state.voltage
        return Clock(self.time[self.window], self.dt, voltage=None if voltage is None else voltage[self.window])

    @property
    def start(self) -> State:
        """The recorded state (N = 1) at the beginning of the window."""
        return self.motion.state.take(slice(self.first, self.first + 1))

    @property
    def reference_covers(self) -> bool:
        """Whether the log has a reference throughout the window; where not, its ends are held."""
        assert self.flight.reference is not None
        known, asked = self.flight.reference.time, self.time[self.window]
        return bool(asked[0] >= known[0] and asked[-1] <= known[-1] + 1.0)

    @property
    def tracking_errors(self) -> TrackingErrors:
        """Errors of the recorded flight within the window, by its odometry."""
        assert self.flight.reference is not None
        flown = during(self.odometry, self.time[self.window])
        asked = Recorded(self.flight.reference, start=0.0).at(flown.time)
        return tracking_errors(flown.time, flown.position_E, flown.quat_EB, asked)

    @property
    def tracking(self) -> Tracking:
        """Their averages."""
        return Tracking.of(self.tracking_errors)


def read_recording(
    opened: OpenFlight, vehicle: Vehicle, *, start: float = 0.0, duration: float | None = None
) -> Recording:
    """The part of a flight in which `start` [s] lies, or the longest that flew, ready for inference.

    Raises LogError where odometry or reference are missing, UsageError for times outside the flight.
    """
    log = opened.flight
    odometry, reference = _roles(log)
    index, first, count = _window(log.name, opened.flown, start, duration)
    if opened.flown[index].quat_EB is None:
        raise LogError(
            f"{log.path}: {odometry.topic} covers less than half of the flight, and a counterfactual starts from the "
            "recorded state; cut the log to where both are, or map another topic with --topic odometry=/your/topic"
        )
    samples = samples_over_periods(opened.flown[index], log)
    commands, _ = commands_of(samples, vehicle)
    return Recording(
        flight=log,
        odometry=odometry,
        reference=Recorded(reference, start=0.0).at(samples.time),
        motion=recorded_motion(samples, odometry, vehicle.imu_position_B, cutoff_hz=min(CUTOFF_HZ, 0.3 / samples.dt)),
        record=opened.records[index],
        time=samples.time,
        dt=samples.dt,
        desired=commands.wrench_B if samples.wrench_des_B is None else samples.wrench_des_B,
        commanded=commands.wrench_B,
        commands=commands,
        first=first,
        count=count,
        notes=opened.notes,
    )


def _roles(log: Flight) -> tuple[OdometrySeries, ReferenceSeries]:
    """The series without which there is nothing to re-simulate."""
    if log.odometry is not None and log.reference is not None:
        return log.odometry, log.reference
    lacks, needs = "reference", "flies along the recorded reference"
    if log.odometry is None:
        lacks, needs = "odometry", "starts from the recorded state"
    raise LogError(
        f"{log.path}: a counterfactual {needs}, and no topic plays the role '{lacks}' (played: "
        f"{', '.join(log.series()) or 'none'}); map one with --topic {lacks}=/your/topic"
    )


def _window(name: str, stretches: tuple[Samples, ...], start: float, duration: float | None) -> tuple[int, int, int]:
    """Which stretch, and the first and number of its samples to re-simulate."""
    if not (np.isfinite(start) and start >= 0.0):
        raise UsageError(f"--start {start:g}: expected seconds since the log's first sample")
    if duration is not None and not (np.isfinite(duration) and duration > 0.0):
        raise UsageError(f"--duration {duration:g}: expected a positive number of seconds")
    containing = [i for i, s in enumerate(stretches) if s.time[0] - 0.5 <= start <= s.time[-1] - 1.0]
    if not containing and start > 0.0:
        spans = ", ".join(f"{s.time[0]:.2f} to {s.time[-1] - 1.0:.2f} s" for s in stretches)
        raise UsageError(f"--start {start:g}: {name} can be re-simulated within {spans}; choose a time in there")
    index = containing[0] if start > 0.0 else max(range(len(stretches)), key=lambda i: len(stretches[i]))
    chosen = stretches[index]
    first = int(np.searchsorted(chosen.time, start - 1e-9))
    available = len(chosen) - first
    count = available if duration is None else max(round(min(duration / chosen.dt, available)), min(2, available))
    return index, first, count


def _near(series: Series, values: Array, time: Array, middle: Array, window: float) -> Array:
    """Means over `window` [s] around each `middle` (N,), from the part of a series that lies about `time` (N,)."""
    run = (series.time >= time[0] - 1.0) & (series.time <= time[-1] + 1.0)
    return held_mean(middle, series.time[run], values[run], series.period, window)


def samples_over_periods(samples: Samples, log: Flight) -> Samples:
    """The samples of a log, with commands over the period that begins at each instant instead of around it."""

    def mean(series: Series, values: Array) -> Array:
        return _near(series, values, samples.time, samples.time + 0.5 * samples.dt, samples.dt)

    used: dict[str, Array] = {}
    if samples.wrench_cmd_B is not None and log.commanded is not None:
        used["wrench_cmd_B"] = mean(log.commanded, log.commanded.wrench_B)
    if samples.wrench_des_B is not None and log.desired is not None:
        used["wrench_des_B"] = mean(log.desired, log.desired.wrench_B)
    if samples.rotor_speed_cmd is not None and log.actuators is not None:
        used["tilt_cmd"] = mean(log.actuators, log.actuators.tilt)
        used["rotor_speed_cmd"] = mean(log.actuators, log.actuators.rotor_speed)
    return replace(samples, **used)  # type: ignore[arg-type]


def commanded_otherwise(record: Record, samples: Samples, command: WrenchSeries, vehicle: Vehicle) -> Record:
    """The record of `samples` as if another wrench had been commanded, in the motion that was flown."""
    wrench = _near(command, command.wrench_B, samples.time, samples.time, max(samples.dt, command.period))
    other = replace(samples, wrench_cmd_B=wrench, tilt_cmd=None, rotor_speed_cmd=None)
    commands, source = commands_of(other, vehicle)
    filtered = low_pass(wrench, record.dt, record.cutoff_hz)[record.keep]
    return replace(record, commands=commands, commanded=filtered, source=source)
