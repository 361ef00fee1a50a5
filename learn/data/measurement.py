"""From an IMU to a measured wrench, and from commands to what a model says that wrench should have been.

    F_meas = m [f_O + domega x c + omega x (omega x c)],    M_meas = J domega + omega x J omega
    f_O    = f_imu - domega x r - omega x (omega x r)                                   r: place of the IMU

One zero-phase filter acts on both sides: on gyroscope and accelerometer, and on the wrench that the model makes of the
commands. Filtering the measurement alone would leave (H - 1) W_cmd, a lag that is not there. Products such as
omega x J omega are formed after filtering. Source: Newton and Euler, docs/notation.md.

Where a sensor did not measure all of its own axes, with d = c - r the accelerometer's x takes out F_x and nothing else:
no torque reads a specific force. The gyroscope's x takes out M_x; M_y and M_z where omega_x enters them, by a product
of inertia or by (J_x - J_z) omega_x omega_z and its like; and the forces that it reaches over the lever arm d. Nobody
has to work that out: two motions that differ only in what was not measured are put through `measured_wrench` itself,
and an axis that comes out the same was measured (`measured_axes`). This mask decides. `Record.noise` is not a number on
the other axes, `Record.measured` neither, and everything else asks those (`Record.measured_axes`).
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, TypeVar

import numpy as np

from wrenchgap.flight.errors import FitError
from wrenchgap.flight.filters import forward_backward, low_pass_section, response
from wrenchgap.flight.flight import AXES, Array, ImuSeries, Mask, Samples
from wrenchgap.flight.memory import give_back, on_disk
from wrenchgap.flight.stamps import PIECE, pieces
from wrenchgap.learn.data.sensor_noise import white_noise
from wrenchgap.plant.actuation import nominal_wrench
from wrenchgap.plant.allocation import allocation_of
from wrenchgap.plant.state import Commands, Motion, State
from wrenchgap.plant.vehicle import Vehicle
from wrenchgap.plant.wrench_model import about_com, about_origin, cross, measured_wrench

T = TypeVar("T")
P = TypeVar("P", State, Commands)

CUTOFF_HZ = 8.0
"""Default corner of the filter on both sides [Hz]."""


@dataclass(frozen=True)
class Record:
    """One contiguous stretch of a flight, ready to be compared with models.

    The raw side has N samples `dt` apart: `commands`, `state`. The compared side has K filtered, trimmed and thinned
    samples: `time` (K,), `measured` (K, 6), `commanded` (K, 6) (the logged command, about the nominal centre of mass),
    `state_kept` (filtered rates). `step` is the thinning. `noise` (6,) is the standard deviation of the white sensor
    noise that is left in `measured`. Both are not a number on axes that were not measured (`learn.data.measurement`).

    `source` says where the rotor commands come from: "logged", "allocated" (from the commanded wrench, by the
    nominal allocation) or "none". `input_error` (bands, 6) is the share of error in what they nominally make
    (`learn.data.input_errors`), None where they are taken as exact. `command_period` [s] is the time between what the
    log says of commands where that is longer than between their stamps (`flight.checks.command_rate`), else zero.
    """

    flight: str
    dt: float
    cutoff_hz: float
    commands: Commands
    state: State
    keep: slice
    time: Array
    measured: Array
    commanded: Array
    desired: Array | None
    state_kept: State
    noise: Array
    source: str
    has_pose: bool
    has_voltage: bool
    has_imu: bool = True
    input_error: Array | None = None
    command_period: float = 0.0

    def __len__(self) -> int:
        return len(self.time)

    @property
    def measured_axes(self) -> Mask:
        """Which axes (6,) were measured: those that have a noise."""
        return np.asarray(np.isfinite(self.noise))

    @property
    def timing_error(self) -> float:
        """Rms [s] of when a command was sent against its stamp: within a sample, and since the command before."""
        return float(np.hypot(self.dt / np.sqrt(12.0), self.command_period / np.sqrt(3.0)))

    @property
    def dt_kept(self) -> float:
        """Between compared samples [s]."""
        return self.dt * (self.keep.step or 1)


def low_pass(signal: Array, dt: float, cutoff_hz: float) -> Array:
    """Second-order Butterworth, forward and backward: no phase, -6 dB at the cut-off. Along axis 0.

    Raises FitError for no samples, which compiled code would not see.
    """
    if len(signal) == 0:
        raise FitError(f"nothing to filter at {cutoff_hz:g} Hz: no samples; see `wrenchgap inspect`")
    section, start = low_pass_section(dt, cutoff_hz)
    padding = min(len(signal) - 1, int(3.0 / (cutoff_hz * dt)))
    flat = np.asarray(signal, dtype=float).reshape(len(signal), -1)
    if len(flat) > PIECE:  # hours: one column after the other, for memory
        out = np.empty(flat.shape)
        for k in range(flat.shape[1]):
            out[:, [k]] = forward_backward(section, start, np.ascontiguousarray(flat[:, [k]]), padding)
        return out.reshape(np.shape(signal))
    return np.asarray(forward_backward(section, start, np.ascontiguousarray(flat), padding)).reshape(np.shape(signal))


def thinned(signal: Array, dt: float, cutoff_hz: float, keep: slice) -> Array:
    """The samples `keep` of `low_pass`; of hours, without ever holding all of it."""
    if len(signal) <= PIECE or signal.ndim == 1:
        return np.asarray(low_pass(signal, dt, cutoff_hz)[keep].copy())
    return np.stack([low_pass(column, dt, cutoff_hz)[keep] for column in signal.T], axis=1)


def _turning(omega: Array, dt: float, cutoff_hz: float, keep: slice) -> tuple[Array, Array]:
    """The samples `keep` of body rates (N, 3) through the filter, and of their derivative."""
    columns = [low_pass(column, dt, cutoff_hz) for column in omega.T]
    kept = np.stack([column[keep] for column in columns], axis=1)
    return kept, np.stack([derivative(column, dt)[keep] for column in columns], axis=1)


def derivative(signal: Array, dt: float) -> Array:
    """Fourth-order central differences along axis 0, second order in the two samples at either end."""
    if signal.ndim > 1 and len(signal) > PIECE:
        return np.stack([derivative(column, dt) for column in np.moveaxis(signal, 1, 0)], axis=1)
    out = np.gradient(signal, dt, axis=0)
    out[2:-2] = (8.0 * (signal[3:-1] - signal[1:-3]) - (signal[4:] - signal[:-4])) / (12.0 * dt)
    return np.asarray(out)


def prepare(
    samples: Samples,
    vehicle: Vehicle,
    *,
    cutoff_hz: float = CUTOFF_HZ,
    rate_hz: float | None = None,
    commands: tuple[Commands, str] | None = None,
    imu: ImuSeries | None = None,
) -> Record:
    """A stretch of flight with its measured wrench; thinned to about `rate_hz` [Hz] (default five times the cut-off).

    `commands` are those of `commands_of`, where they are at hand; `imu` is what `samples` were resampled from, which
    the noise has to know (without it they count as readings). Three cut-off periods are trimmed at either end. Raises
    FitError for a stretch that is too short or without any command.
    """
    dt = samples.dt
    if not 0 < cutoff_hz * dt < 0.4:
        raise FitError(f"{samples.flight}: cut-off {cutoff_hz:g} Hz, expected between 0 and {0.4 / dt:g} Hz")
    trim = int(np.ceil(min(3.0 / (cutoff_hz * dt), len(samples))))
    if len(samples) < 4 * trim:
        raise FitError(
            f"{samples.flight}: a stretch of {len(samples) * dt:.2f} s is too short for a {cutoff_hz:g} Hz filter; "
            f"needs {12.0 / cutoff_hz:.4g} s"
        )
    sent, source = commands or commands_of(samples, vehicle)
    state, has_pose = _state(samples)
    step = max(1, round(1.0 / (dt * (rate_hz or 5.0 * cutoff_hz))))
    keep = slice(trim, len(samples) - trim, step)
    omega, omega_dot = _turning(samples.omega_B, dt, cutoff_hz, keep)
    force = thinned(samples.specific_force_B, dt, cutoff_hz, keep)
    give_back(len(samples))
    felt = felt_at_origin(force, omega, omega_dot, vehicle.imu_position_B)
    known = measured_axes(vehicle, samples.unmeasured)
    measured = measured_wrench(vehicle.body, Motion(omega, omega_dot, felt))
    return Record(
        flight=samples.flight,
        dt=dt,
        cutoff_hz=cutoff_hz,
        commands=sent,
        state=state,
        keep=keep,
        time=samples.time[keep],
        measured=on_disk(np.where(known, measured, np.nan)),
        commanded=on_disk(thinned(sent.wrench_B, dt, cutoff_hz, keep)),
        desired=None if samples.wrench_des_B is None else thinned(samples.wrench_des_B, dt, cutoff_hz, keep),
        state_kept=_on_disk(replace(state.take(keep), omega_B=omega)),
        noise=np.where(known, _noise(samples, vehicle, cutoff_hz, imu), np.nan),
        source=source,
        has_pose=has_pose,
        has_voltage=samples.voltage is not None,
    )


def _on_disk(part: P) -> P:
    """The same with its arrays on disk, where the flight is one of hours."""
    held: dict[str, Any] = {item.name: getattr(part, item.name) for item in fields(part)}
    kept: dict[str, Any] = {name: value if value is None else on_disk(value) for name, value in held.items()}
    return replace(part, **kept)


def window(record: Record, first: int, last: int) -> Record:
    """The compared samples `first` to `last` of a record with the raw samples that they need, as a record of its own.

    Cut so that the filter sees as much before and after as `prepare` trims; a lag's memory starts anew.
    """
    step, trim = record.keep.step or 1, record.keep.start
    raw, kept = slice(step * first, step * (last - 1) + 2 * trim + 1), slice(first, last)
    return replace(
        record,
        commands=record.commands.take(raw),
        state=record.state.take(raw),
        keep=slice(trim, trim + step * (last - first - 1) + 1, step),
        time=record.time[kept],
        measured=record.measured[kept],
        commanded=record.commanded[kept],
        desired=None if record.desired is None else record.desired[kept],
        state_kept=record.state_kept.take(kept),
    )


def from_actuators(name: str, vehicle: Vehicle, tilt: Array | None, rotor_speed: Array) -> Commands:
    """Commands that logged tilt angles (N, .) [rad] and rotor speeds (N, .) [rad/s] amount to for this vehicle.

    The wrench is what they nominally make, about the centre of mass. Angles of fixed arms may be left out. Raises
    FitError where the columns are not those of the vehicle; `name` is the flight's, for the message.
    """
    full, speed = _of_vehicle(name, vehicle, tilt, rotor_speed)
    logged = Commands(np.zeros((len(speed), 6)), full, speed)
    return Commands(on_disk(about_com(vehicle.body, nominal_wrench(vehicle, logged))), full, speed)


def _of_vehicle(name: str, vehicle: Vehicle, tilt: Array | None, rotor_speed: Array) -> tuple[Array, Array]:
    """Tilt angles (N, A) of all arms, and speeds (N, R) without signs; arguments and errors as of `from_actuators`."""
    arms, rotors = vehicle.geometry()
    if rotor_speed.shape[1] != len(rotors):
        raise FitError(
            f"{name}: the log has {rotor_speed.shape[1]} rotor speeds, {vehicle.name} has {len(rotors)}; "
            "map the columns with --topic rotor_speed=/topic[...] or use another model"
        )
    full = np.zeros((len(rotor_speed), len(arms)))
    tilting = np.flatnonzero(arms.tilts)
    if tilting.size:
        if tilt is None or tilt.shape[1] not in (len(tilting), len(arms)):
            have = 0 if tilt is None else tilt.shape[1]
            raise FitError(
                f"{name}: the log has {have} tilt angles, {vehicle.name} tilts {len(tilting)} arms; "
                "map the columns with --topic tilt=/topic[...] or use another model"
            )
        full[:, tilting] = tilt if tilt.shape[1] == len(tilting) else tilt[:, tilting]
    speed = np.abs(rotor_speed)  # some logs sign speeds by the direction of turning; no rotor here reverses
    return on_disk(full), on_disk(speed)


def commands_of(samples: Samples, vehicle: Vehicle) -> tuple[Commands, str]:
    """Commands with rotor speeds where they are logged or can be allocated, and `Record.source`: where from.

    The wrench is computed where only the actuators are logged. Raises FitError for samples without any command.
    """
    wrench, speed = samples.wrench_cmd_B, samples.rotor_speed_cmd
    if vehicle.has_rotors and speed is not None and speed.shape[1]:
        if wrench is None:
            return from_actuators(samples.flight, vehicle, samples.tilt_cmd, speed), "logged"
        return Commands(wrench, *_of_vehicle(samples.flight, vehicle, samples.tilt_cmd, speed)), "logged"
    if wrench is None:
        raise FitError(
            f"{samples.flight}: neither a commanded wrench nor actuator commands that fit {vehicle.name}; "
            "map one with --topic commanded=/your/topic"
        )
    if not vehicle.has_rotors:
        return Commands(wrench), "none"
    asked = np.concatenate([about_origin(vehicle.body, wrench[piece]) for piece in pieces(len(wrench))])
    allocated, _ = allocation_of(vehicle).allocate(asked, dt=samples.dt)
    return _on_disk(Commands(wrench, allocated.tilt, allocated.rotor_speed)), "allocated"


def _state(samples: Samples) -> tuple[State, bool]:
    """State of the samples; at rest at the origin where the log has no pose (no effect may then use it)."""
    rest, level = np.zeros((len(samples), 3)), np.tile([1.0, 0.0, 0.0, 0.0], (len(samples), 1))
    logged = (samples.position_E, samples.quat_EB, samples.velocity_E)
    position, attitude, velocity = (
        still if known is None else known for known, still in zip(logged, (rest, level, rest), strict=True)
    )
    state = State(samples.time, position, attitude, velocity, samples.omega_B, samples.voltage)
    return state, all(known is not None for known in logged)


def _noise(samples: Samples, vehicle: Vehicle, cutoff_hz: float, imu: ImuSeries | None) -> Array:
    """Standard deviation (6,) that white noise of gyroscope and accelerometer has in the measured wrench.

    Their densities (`learn.data.sensor_noise`) are integrated through the filter, and the derivative for the torque and
    for what the gyroscope adds to the force over the lever arm from the IMU to the centre of mass.
    """
    f, density = white_noise(samples, imu, cutoff_hz)
    passed = np.abs(response(low_pass_section(samples.dt, cutoff_hz)[0], f, 1.0 / samples.dt))
    left = passed[:, None] ** 4 * density  # power, filtered twice
    turn = 2.0 * np.pi * samples.dt * f
    slope = (8.0 * np.sin(turn) - np.sin(2.0 * turn)) / (6.0 * samples.dt)  # the gain of `derivative`
    rate_dot = np.trapezoid(left[:, :3] * slope[:, None] ** 2, f, axis=0)
    specific = np.trapezoid(left[:, 3:], f, axis=0)
    arm = cross(vehicle.body.com_B - vehicle.imu_position_B, np.eye(3))
    variance = (vehicle.body.mass**2 * (specific + rate_dot @ arm**2), vehicle.body.inertia**2 @ rate_dot)
    return np.sqrt(np.concatenate(variance))


def measured_axes(vehicle: Vehicle, unmeasured: Sequence[str], rounding: float = 1e-9) -> Mask:
    """The axes (6,) of the measured wrench that depend on no sensor axis in `unmeasured` (`flight.unmeasured`).

    A change of an axis, relative to its size, is `rounding` up to this.
    """
    if not unmeasured:
        return np.ones(6, dtype=bool)
    rng = np.random.default_rng(0)
    force, omega, omega_dot = (rng.uniform(1.0, 2.0, (8, 3)) for _ in range(3))
    plain = _wrench(vehicle, force, omega, omega_dot)
    gone = np.isin(AXES, list(unmeasured))
    moved = _wrench(
        vehicle,
        np.where(gone[:3], 3.0 * force, force),
        np.where(gone[3:], 3.0 * omega, omega),
        np.where(gone[3:], -2.0 * omega_dot, omega_dot),
    )
    size = np.maximum(np.abs(plain), np.abs(moved)).max(axis=0)
    return np.asarray((np.abs(moved - plain).max(axis=0) <= rounding * size) & ~gone)


def _wrench(vehicle: Vehicle, force: Array, omega: Array, omega_dot: Array) -> Array:
    """Measured wrench (N, 6) of readings (N, 3) each, as `learn.data.measurement.prepare` makes it."""
    r = vehicle.imu_position_B
    return measured_wrench(vehicle.body, Motion(omega, omega_dot, felt_at_origin(force, omega, omega_dot, r)))


def felt_at_origin(force: Array, omega: Array, omega_dot: Array, imu_position_B: Array) -> Array:
    """Specific force (N, 3) at O of an IMU that is at `imu_position_B` (3,): f - domega x r - omega x (omega x r)."""
    r, out = imu_position_B, np.empty(np.shape(force))
    for k in pieces(len(force)):
        out[k] = force[k] - cross(omega_dot[k], r) - cross(omega[k], cross(omega[k], r))
    return out


def names_of(mask: Mask) -> tuple[str, ...]:
    """Names of the axes that a mask (6,) leaves out."""
    return tuple(axis for axis, known in zip(AXES, mask, strict=True) if not known)
