"""Closed-loop simulation: a vehicle as it is, flown by a controller that believes something else, written as a flight.

    reference -> controller (believed) -> W_des -> [compensator] -> W_cmd -> allocation (believed) -> u
              -> truth: command effects, h(u), thrust and wrench effects, + disturbance -> rigid body -> sensors

Stamps. Instants are t_k = k / rate, exact. A command stamped t_k is computed from the state (or the last sensor
readings) at t_k, without delay, and held until t_{k+1}. Pose and gyroscope read the state at their stamp. A force
jumps where a command does; the accelerometer reads the mean of the values just before and after its stamp, as an IMU
that averages over its sample interval does. So commands and readings are aligned without a half-sample bias.

The wrench of the truth is evaluated once per physics step and held in B over it; the rigid body is integrated by
fourth-order Runge-Kutta. State-dependent effects are therefore first-order accurate in the physics step.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight import so3
from wrenchgap.flight.errors import UsageError
from wrenchgap.flight.flight import (
    ActuatorSeries,
    BatterySeries,
    Flight,
    ImuSeries,
    OdometrySeries,
    ReferenceSeries,
    WrenchSeries,
)
from wrenchgap.plant.allocation import Allocation
from wrenchgap.plant.controller import Controller
from wrenchgap.plant.model import Model
from wrenchgap.plant.rigid_body import RigidBody, pack, unpack
from wrenchgap.plant.sensors import SensorNoise, imu_errors, read_imu, read_pose
from wrenchgap.plant.state import Commands, Motion, State
from wrenchgap.plant.trajectory import Reference, Trajectory
from wrenchgap.plant.vehicle import GRAVITY, Vehicle
from wrenchgap.plant.wrench_model import about_origin

Array = NDArray[np.float64]
Feedback = Literal["measured", "true"]

START_NS = 1_700_000_000_000_000_000
"""Stamp of the first sample of simulated flights [ns since 1970]."""

PHYSICS_RATE = 400
"""Least rate of the simulation that `physics_rate` gives [Hz]."""

LOST_POSITION, LOST_ATTITUDE = 5.0, np.radians(100.0)
"""Errors [m], [rad] beyond which control counts as lost and the simulation stops."""


class Correction(Protocol):
    """What a compensator's step returns; only the corrected command matters here."""

    @property
    def wrench_cmd(self) -> Array:
        """W_cmd (6,)."""
        ...


class Compensating(Protocol):
    """Anything that turns the desired wrench into the one to command, once per control period."""

    def step(self, wrench_des: Array, state: State, /) -> Correction:
        """From W_des (6,) to a result with `wrench_cmd` (6,), both in B about the believed centre of mass.

        `state` (N = 1) is what the controller knows.
        """
        ...


@dataclass
class _Record:
    """What is kept of a run, row by row."""

    desired: list[Array] = field(default_factory=list)
    commanded: list[Array] = field(default_factory=list)
    tilt: list[Array] = field(default_factory=list)
    rotor_speed: list[Array] = field(default_factory=list)
    omega: list[Array] = field(default_factory=list)
    wrench: list[Array] = field(default_factory=list)  # true, about O, at IMU instants
    imu_state: list[State] = field(default_factory=list)
    pose: list[State] = field(default_factory=list)
    limited: dict[str, int] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)


class _Pilot:
    """The flight computer: controller, compensator and allocation of the believed vehicle."""

    def __init__(self, believed: Model, compensator: Compensating | None, integral: Array | None) -> None:
        self.controller = Controller(believed.controller, believed.vehicle)
        self.controller.reset(integral)
        self.vehicle = believed.vehicle
        self.compensator = compensator
        self.allocation = Allocation(believed.vehicle) if believed.vehicle.has_rotors else None
        self.tilt: Array | None = None

    def step(self, state: State, reference: Reference, dt: float, record: _Record) -> Commands:
        """Commands to hold for the next `dt` [s]."""
        desired = self.controller.step(state, reference, dt)
        commanded = desired if self.compensator is None else self.compensator.step(desired, state).wrench_cmd
        record.desired.append(desired)
        record.commanded.append(commanded)
        if self.allocation is None:
            return Commands(commanded[None, :])
        about_O = about_origin(self.vehicle.body, commanded[None, :])
        allocated, saturation = self.allocation.allocate(about_O, previous_tilt=self.tilt, dt=dt)
        assert allocated.tilt is not None
        assert allocated.rotor_speed is not None
        self.tilt = allocated.tilt[0]
        record.tilt.append(allocated.tilt[0])
        record.rotor_speed.append(allocated.rotor_speed[0])
        for name in ("rotor_speed", "tilt_rate", "tilt_range"):
            record.limited[name] = record.limited.get(name, 0) + getattr(saturation, name)
        return Commands(commanded[None, :], allocated.tilt, allocated.rotor_speed)


def simulate(
    truth: Model,
    believed: Model | None,
    trajectory: Trajectory,
    duration: float | None = None,
    *,
    rng: np.random.Generator,
    compensator: Compensating | None = None,
    disturbance: Callable[[float], Array] | None = None,
    initial: State | None = None,
    integral: Array | None = None,
    feedback: Feedback = "measured",
    sensors: SensorNoise | None = None,
    physics_rate: float = 400.0,
    gravity: float = GRAVITY,
    voltage: Callable[[float], float] | None = None,
    progress: Callable[[float], None] | None = None,
    name: str = "simulation",
) -> Flight:
    """Fly `truth` along `trajectory` for `duration` [s] (its own by default) with a controller that knows `believed`.

    believed     what controller and allocation assume; the truth's vehicle without effects by default
    compensator  turns W_des into W_cmd; none: they are equal
    disturbance  extra wrench (6,) about O in B as a function of time [s]
    initial      state (N = 1) at time 0; on the reference by default
    integral     the controller's integral (3,) [rad s] at time 0; give none when a compensator takes over its job
    feedback     "measured": pose and velocity from the last pose reading, rate from the gyroscope; "true": the state
    sensors      noise and rates; the truth's by default
    physics_rate [Hz], a whole multiple of the controller's, IMU's and pose sensor's rates
    voltage      of the battery [V] as a function of time [s], logged at 10 Hz at most

    The simulation stops where control is lost and says so in `Flight.notes`. Raises UsageError for rates that do not
    divide, or vehicles that do not match.
    """
    believed = truth.nominal if believed is None else believed
    noise = truth.sensors if sensors is None else sensors
    length = trajectory.duration if duration is None else duration
    _check(truth.vehicle, believed.vehicle, length)
    every = {
        role: _divide(physics_rate, rate, role)
        for role, rate in (
            ("controller.rate_hz", believed.controller.rate_hz),
            ("sensors.imu_rate_hz", noise.imu_rate_hz),
            ("sensors.pose_rate_hz", noise.pose_rate_hz),
        )
    }
    per_control, per_imu, per_pose = every.values()
    steps = max(round(length * physics_rate), 1)
    time = np.arange(steps) / physics_rate
    reference = trajectory.at(time[::per_control])
    errors = imu_errors(noise, -(-steps // per_imu), rng)
    model, pilot, record = truth.wrench_model, _Pilot(believed, compensator, integral), _Record()
    body = RigidBody(model.body, gravity)
    dt = 1.0 / physics_rate
    y = pack(_on(reference.sample(0)) if initial is None else initial)
    measured = gyro = None
    wrench: Array | None = None
    memory: dict[str, Any] | None = None
    commands: Commands
    for n in range(steps):
        t = float(time[n])
        state = unpack(t, y, None if voltage is None else np.array([voltage(t)]))
        if n % per_pose == 0:
            measured = read_pose(state, noise, rng)
            record.pose.append(measured)
        if n % per_imu == 0:
            k = n // per_imu
            still = Motion(state.omega_B, np.zeros((1, 3)), np.zeros((1, 3)))
            gyro = model.read_imu(still, state).omega_B + errors[k : k + 1, :3]
        if n % per_control == 0:
            assert measured is not None
            assert gyro is not None
            known = state if feedback == "true" else _known(state, measured, gyro)
            ask = reference.sample(n // per_control)
            commands = pilot.step(known, ask, dt * per_control, record)
            lost = loss_of_control(state, ask)
            if lost:
                record.notes.append(f"control was lost at {t:.2f} s: {lost}; the flight ends there")
                break
        before = wrench
        wrench, memory = model.actuate(commands, state, dt, memory)
        if disturbance is not None:
            wrench = wrench + disturbance(t)
        if n % per_imu == 0:
            record.imu_state.append(state)
            record.wrench.append(wrench[0] if before is None else 0.5 * (before[0] + wrench[0]))
        y = body.step(y, wrench[0], dt)
        if progress is not None and n % 200 == 0:
            progress(n / steps)
    if progress is not None:
        progress(1.0)
    return _flight(name, truth, record, reference, noise, errors, voltage)


def physics_rate(model: Model) -> float:
    """The smallest multiple of all rates of the model that is not below `PHYSICS_RATE` [Hz]."""
    rates = (model.controller.rate_hz, model.sensors.imu_rate_hz, model.sensors.pose_rate_hz)
    if any(rate != round(rate) for rate in rates):
        raise UsageError(f"rates of controller and sensors are {rates} Hz; the simulation needs whole numbers")
    common = math.lcm(*(round(rate) for rate in rates))
    return float(common * math.ceil(PHYSICS_RATE / common))


def _known(state: State, measured: State, gyro: Array) -> State:
    return State(state.time, measured.position_E, measured.quat_EB, measured.velocity_E, gyro, state.voltage)


def _on(reference: Reference) -> State:
    """The state (N = 1) that follows a reference exactly."""
    return State(reference.time, reference.position_E, reference.quat_ED, reference.velocity_E, reference.omega_D)


def loss_of_control(state: State, reference: Reference) -> str:
    """Why control counts as lost, or nothing."""
    position = float(np.linalg.norm(state.position_E - reference.position_E))
    if not np.isfinite(position) or not np.all(np.isfinite(state.omega_B)):
        return "the state is not finite"
    if position > LOST_POSITION:
        return f"{position:.1f} m from the reference"
    # |<q, p>| = cos(angle / 2)
    angle = 2.0 * float(np.arccos(min(1.0, abs(float(np.sum(state.quat_EB * reference.quat_ED))))))
    return f"{np.degrees(angle):.0f} deg from the reference" if angle > LOST_ATTITUDE else ""


def _divide(physics_rate: float, rate: float, what: str) -> int:
    ratio = physics_rate / rate
    if ratio < 1 or abs(ratio - round(ratio)) > 1e-9:
        raise UsageError(
            f"simulate: physics_rate {physics_rate:g} Hz is not a whole multiple of {what} {rate:g} Hz; "
            "change one of them"
        )
    return round(ratio)


def _check(truth: Vehicle, believed: Vehicle, length: float) -> None:
    if not (np.isfinite(length) and length > 0):
        raise UsageError(f"simulate: got a duration of {length} s, expected a positive number")
    shapes = [
        (0 if v.arms is None else len(v.arms), 0 if v.rotors is None else len(v.rotors)) for v in (truth, believed)
    ]
    if shapes[0] != shapes[1]:
        raise UsageError(
            f"simulate: the controller's vehicle '{believed.name}' has {shapes[1]} arms and rotors, the true one "
            f"'{truth.name}' {shapes[0]}; they must agree"
        )


def _stack(states: list[State]) -> State:
    """N states of one sample each as one state of N samples; the voltage is not needed any more."""

    def joined(part: str) -> Array:
        return np.concatenate([getattr(s, part) for s in states])

    return State(joined("time"), joined("position_E"), joined("quat_EB"), joined("velocity_E"), joined("omega_B"))


def _flight(
    name: str,
    truth: Model,
    record: _Record,
    reference: Reference,
    noise: SensorNoise,
    errors: Array,
    voltage: Callable[[float], float] | None,
) -> Flight:
    """The record as series on one time base."""
    model = truth.wrench_model
    at_imu, pose = _stack(record.imu_state), _stack(record.pose)
    motion = model.read_imu(model.motion(np.array(record.wrench), at_imu.omega_B), at_imu)
    gyro, accel = read_imu(motion, truth.vehicle.imu_position_B, errors[: len(at_imu.time)])
    count = len(record.desired)
    time = reference.time[:count]
    desired, commanded = np.array(record.desired), np.array(record.commanded)
    actuators = None
    if record.tilt:
        actuators = ActuatorSeries("/command/actuators", time, np.array(record.tilt), np.array(record.rotor_speed))
    battery = None
    if voltage is not None:
        stride = max(round(0.1 / (time[1] - time[0])), 1) if count > 1 else 1
        battery = BatterySeries("/battery", time[::stride], np.array([voltage(float(t)) for t in time[::stride]]))
    digest = hashlib.sha256()
    for array in (desired, commanded, gyro, accel, pose.position_E, pose.quat_EB):
        digest.update(np.ascontiguousarray(array).tobytes())
    limited = tuple(
        f"{what.replace('_', ' ')} was limited in {number} of {count} commands"
        for what, number in record.limited.items()
        if number
    )
    return Flight(
        name=name,
        path=Path(name),
        content_hash=digest.hexdigest(),
        start_ns=START_NS,
        commanded=WrenchSeries("/command/wrench", time, commanded),
        desired=WrenchSeries("/desired/wrench", time, desired),
        actuators=actuators,
        imu=ImuSeries("/imu", at_imu.time, gyro, accel),
        odometry=OdometrySeries(
            "/odometry", pose.time, pose.position_E, so3.continuous(pose.quat_EB), pose.velocity_E, pose.omega_B
        ),
        reference=ReferenceSeries(
            "/reference",
            time,
            reference.position_E[:count],
            reference.quat_ED[:count],
            reference.velocity_E[:count],
            reference.omega_D[:count],
            reference.acceleration_E[:count],
            reference.omega_dot_D[:count],
        ),
        battery=battery,
        notes=(*record.notes, *limited),
    )
