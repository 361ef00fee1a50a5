# Long because filter, record and prediction are one chain, told in its order.
"""From an IMU to a measured wrench, and from commands to what a model says that wrench should have been.

    F_meas = m [f_O + domega x c + omega x (omega x c)],    M_meas = J domega + omega x J omega
    f_O    = f_imu - domega x r - omega x (omega x r)                                   r: place of the IMU

One zero-phase filter acts on both sides: on gyroscope and accelerometer, and on the wrench that the model makes of the
commands. Filtering the measurement alone would leave (H - 1) W_cmd, a lag that is not there. Products such as
omega x J omega are formed after filtering. Source: Newton and Euler, docs/notation.md.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.errors import FitError
from wrenchgap.flight.filters import forward_backward, low_pass_section, response
from wrenchgap.flight.flight import Array, ImuSeries, Samples
from wrenchgap.flight.memory import HOURS, give_back, on_disk
from wrenchgap.flight.stamps import PIECE, pieces
from wrenchgap.learn.data.measured_axes import felt_at_origin, measured_axes
from wrenchgap.learn.data.sensor_noise import white_noise
from wrenchgap.plant.actuation import actuation, nominal_wrench
from wrenchgap.plant.allocation import allocation_of
from wrenchgap.plant.state import Actuation, Commands, Motion, Posture, State
from wrenchgap.plant.vehicle import Body, Vehicle
from wrenchgap.plant.wrench_model import ModelEffect, WrenchModel, about_com, about_origin, cross, measured_wrench

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
    noise that is left in `measured`. Both are not a number on axes that were not measured
    (`learn.data.measured_axes`).

    `source` says where the rotor commands come from: "logged", "allocated" (from the commanded wrench, by the
    nominal allocation) or "none". `input_error` (bands, 6) is the share of error in what they nominally make
    (`learn.data.input_errors`), None where they are taken as exact.
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

    def __len__(self) -> int:
        return len(self.time)

    @property
    def measured_axes(self) -> NDArray[np.bool_]:
        """Which axes (6,) were measured: those that have a noise."""
        return np.asarray(np.isfinite(self.noise))

    @property
    def dt_kept(self) -> float:
        """Between compared samples [s]."""
        return self.dt * (self.keep.step or 1)


def low_pass(signal: Array, dt: float, cutoff_hz: float) -> Array:
    """Second-order Butterworth, forward and backward: no phase, -6 dB at the cut-off. Along axis 0. Raises FitError for
    no samples, which compiled code would not see.
    """  # noqa: D205
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
    if len(omega) <= PIECE:
        slow = low_pass(omega, dt, cutoff_hz)
        return slow[keep].copy(), derivative(slow, dt)[keep].copy()
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


def predict(record: Record, model: WrenchModel, body: Body | None = None) -> Array:
    """The measured wrench (K, 6) that the model predicts, through the same filter as the measurement.

    `body` is that of the nominal processing, where the measurement was made with another than the model's vehicle has.
    """
    return Evaluator(record)(model, body)


Key = tuple[object, ...]


class Evaluator:
    """Predictions of one record by models that differ in little from one another: what they share is computed once.

    A search changes one parameter at a time. The effective commands depend on the effects on commands alone, the
    rotors' wrench on those, the effects on thrusts and the air, and what is geometry in it on the tilt angles; since
    the filter is linear, each added wrench is filtered on its own.
    """

    def __init__(self, record: Record) -> None:
        self.record = record
        self._commands: OrderedDict[Key, Commands] = OrderedDict()
        self._rotors: OrderedDict[Key, tuple[Actuation | None, Array, Array]] = OrderedDict()
        self._added: OrderedDict[Key, Array] = OrderedDict()
        self._postures: list[Posture] = []
        self._nominal: list[tuple[Commands, Actuation]] = []

    def forget(self) -> None:
        """Free the memory; what is asked for again is worked out again."""
        for memory in (self._commands, self._rotors, self._added, self._postures, self._nominal):
            memory.clear()

    def __call__(self, model: WrenchModel, body: Body | None = None) -> Array:
        """The measured wrench (K, 6) that the model predicts; see `predict`."""
        record = self.record
        model = model.acting
        sent = (record.commands, record.state, record.dt)
        on_commands = _key(model, "commands")
        commands = _kept(self._commands, on_commands, 2, lambda: model.command(*sent)[0])
        air, on_thrusts = _key(model, "air"), _key(model, "thrusts")
        key = (
            on_commands,
            on_thrusts,
            air if on_thrusts else (),
            any(item.effect.needs_rates for item in model.effects),
        )
        act, rotors, total = _kept(self._rotors, key, 2, lambda: self._rotor_part(model, commands))
        for item in model.added:
            own = (key, air, item.name, item.theta.tobytes())
            made = partial(self._addition, model, item, act, rotors)
            total = total + _kept(self._added, own, 16, made)
        return model.report(total, record.state_kept, body)

    def _rotor_part(self, model: WrenchModel, commands: Commands) -> tuple[Actuation | None, Array, Array]:
        rates, _ = model.rates(commands, self.record.dt)
        act, rotors = model.rotors(commands, self.record.state, rates, self._nominally(model, commands))
        act, rotors = act and act.with_thrust(on_disk(act.thrust)), on_disk(rotors)
        give_back(len(rotors))
        return act, rotors, self._filter(lambda: rotors)

    def _addition(self, model: WrenchModel, item: ModelEffect, act: Actuation | None, rotors: Array) -> Array:
        if act is not None:
            self._posture(act.posture)
        return self._filter(model.addition, item, act, rotors, self.record.state)

    def _nominally(self, model: WrenchModel, commands: Commands) -> Actuation | None:
        """What the rotors nominally do at these commands, of which the last two are kept; None where not known."""
        if commands.tilt is None or not model.vehicle.has_rotors:
            return None
        same = [a for sent, a in self._nominal if sent is commands and a.vehicle is model.vehicle]
        posture = self._posture(same[0].posture if same else Posture(model.vehicle, commands.tilt))
        found = same[0] if same else actuation(model.vehicle, commands, posture)
        if len(found.thrust) < HOURS:
            self._nominal = [(commands, found), *(pair for pair in self._nominal if pair[1] is not found)][:2]
        return found

    def _posture(self, asked: Posture) -> Posture:
        """That of these tilt angles: one of the last two if they are the same. Only the last has its arrays."""
        if self._postures and self._postures[0] is asked:
            return asked
        same = [p for p in self._postures if p is asked or _same_angles(p, asked)]
        found = same[0] if same else asked
        others = [p for p in self._postures if p is not found]
        for other in others:
            other.forget()
        self._postures = [found, *others[:1]]
        return found

    def _filter(self, make: Callable[..., Array], *arguments: Any) -> Array:
        record = self.record
        return thinned(make(*arguments), record.dt, record.cutoff_hz, record.keep)


def _same_angles(one: Posture, other: Posture) -> bool:
    same = one.tilt is other.tilt or np.array_equal(one.tilt, other.tilt)
    return one.vehicle is other.vehicle and same


def _key(model: WrenchModel, place: str) -> Key:
    return tuple((item.name, item.theta.tobytes()) for item in model.effects if item.effect.place == place)


def _kept(memory: OrderedDict[Key, T], key: Key, most: int, make: Callable[[], T]) -> T:
    """The remembered value, or a new one; the `most` recently used stay."""
    if key in memory:
        memory.move_to_end(key)
        return memory[key]
    value = memory[key] = make()
    if len(memory) > most:
        memory.popitem(last=False)
    return value


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
