"""Closed-loop simulation: a true vehicle, flown by a controller with a believed model, as a flight.

    reference -> controller (believed) -> W_des -> [compensator] -> W_cmd -> allocation (believed) -> u
              -> truth: command effects, h(u), thrust and wrench effects, + disturbance -> rigid body -> sensors

Instants are t_k = k / rate, exact; `plant.simulation.closed_loop` says how long each signal is held and what a reading
sees. `as_flight` makes a log of what was flown.
"""

import hashlib
import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np

from wrenchgap.flight import flight as series
from wrenchgap.flight import so3
from wrenchgap.flight.errors import UsageError
from wrenchgap.flight.flight import Array, Flight, ImuSeries
from wrenchgap.plant.model import Model
from wrenchgap.plant.rigid_body import NUMBERS, unpack
from wrenchgap.plant.sensors import SensorNoise, imu_errors, pose_errors, read_imu, read_pose
from wrenchgap.plant.simulation.closed_loop import (
    Clock,
    LoopFlight,
    accelerometer_stage,
    disturbance_stage,
    fly,
    loss_of_control_stage,
    mean_around_stamps,
)
from wrenchgap.plant.simulation.flight_computer import Compensating, FlightComputer
from wrenchgap.plant.simulation.loop import Loop, Signals, Stage
from wrenchgap.plant.state import Motion, State
from wrenchgap.plant.trace.arrays import traced_model
from wrenchgap.plant.trajectory import Reference, Trajectory
from wrenchgap.plant.vehicle import GRAVITY, Vehicle
from wrenchgap.plant.wrench_model import WrenchModel

Feedback = Literal["measured", "true"]


class _Sensors:
    """Pose sensor and gyroscope as stages of a loop, with the errors that they will have."""

    def __init__(
        self, truth: WrenchModel, noise: SensorNoise, clock: Clock, physics_rate: float, rng: np.random.Generator
    ) -> None:
        self.noise, self.voltage = noise, clock.voltage is not None
        steps = len(clock.time)
        self.per_imu = _divide(physics_rate, noise.imu_rate_hz, "sensors.imu_rate_hz")
        self.per_pose = _divide(physics_rate, noise.pose_rate_hz, "sensors.pose_rate_hz")
        self.imu_errors = imu_errors(noise, -(-steps // self.per_imu), rng)
        self._rng, self._before = rng, rng.bit_generator.state
        volts = np.full(steps, np.nan) if clock.voltage is None else clock.voltage
        imu = np.column_stack((clock.time, volts))[:: self.per_imu]
        self.signals = {"pose": np.zeros(NUMBERS), "gyro": np.zeros(3)}
        pose = pose_errors(noise, -(-steps // self.per_pose), rng)
        self.stages = [
            Stage("pose", self._pose, pose, self.per_pose, ("pose",)),
            Stage(
                "gyroscope", partial(self._gyroscope, truth), np.hstack((imu, self.imu_errors[:, :3])), self.per_imu,
                traced=lambda now, row: self._gyroscope(traced_model(truth), now, row), user_code=True,
            ),
        ]  # fmt: skip

    def accelerometer(self, truth: WrenchModel, clock: Clock) -> Stage:
        """The accelerometer as a stage, for a compensator that looks at it."""
        return accelerometer_stage(truth, clock, self.per_imu, self.imu_errors[:, 3:])

    def poses(self, flown: LoopFlight, loop: Loop) -> State:
        """The readings of the pose sensor; the generator is set to its state after this number of readings."""
        steps = len(flown.wrench) + (flown.lost is not None)  # they were read once more before control was lost
        count, clock = -(-steps // self.per_pose), flown.clock
        self._rng.bit_generator.state = self._before
        pose_errors(self.noise, count, self._rng)
        read = slice(None, steps, self.per_pose)
        voltage = None if clock.voltage is None else clock.voltage[read]
        return unpack(clock.time[read], loop.logged("pose", "pose", count), voltage)

    def _pose(self, now: Signals, row: Array) -> Signals:
        read = read_pose(unpack(np.zeros(1), now["state"][None]), row[None])
        return {"pose": np.hstack((read.position_E, read.quat_EB, read.velocity_E, read.omega_B))[0]}

    def _gyroscope(self, truth: WrenchModel, now: Signals, row: Array) -> Signals:
        state = unpack(row[:1], now["state"][None], row[1:2] if self.voltage else None)
        still = Motion(state.omega_B, np.zeros((1, 3)), np.zeros((1, 3)))
        return {"gyro": truth.read_imu(still, state).omega_B[0] + row[2:]}


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
    compiled: bool = True,
) -> Flight:
    """Fly `truth` along `trajectory` for `duration` [s] (by default its own) with a controller that assumes `believed`.

    The simulation ends where control is lost. `Flight.notes` says so, and where user code could not be compiled.

    Parameters
    ----------
    believed
        Model of controller and allocation; by default the vehicle of the truth without effects.
    compensator
        From W_des to W_cmd; without one they are equal.
    disturbance
        Extra wrench (6,) about O in B [N, Nm] as a function of time [s].
    initial
        State (N = 1) at time 0; by default on the reference.
    integral : (3,)
        Of the controller at time 0 [rad s].
    feedback
        "measured": pose and velocity from the last pose reading, rate from the gyroscope; "true": the state.
    sensors
        Noise and rates; by default those of the truth.
    physics_rate
        [Hz], a whole multiple of the rates of controller, IMU and pose sensor.
    voltage
        Of the battery [V] as a function of time [s]; logged at 10 Hz at most.
    compiled
        False calls everything in numpy.

    Raises
    ------
    UsageError
        For rates that do not divide, or vehicles that do not match.
    """
    # Long because every argument has its lines in the docstring.
    believed = truth.nominal if believed is None else believed
    length = trajectory.duration if duration is None else duration
    _check(truth.vehicle, believed.vehicle, length, 2.0 / believed.controller.rate_hz, physics_rate)
    per_control = _divide(physics_rate, believed.controller.rate_hz, "controller.rate_hz")
    time = np.arange(max(round(length * physics_rate), 1)) / physics_rate
    volts = None if voltage is None else np.array([voltage(t) for t in time.tolist()])
    clock = Clock(time, 1.0 / physics_rate, per_control, volts)
    reference = trajectory.at(clock.time[:: clock.per_command])
    computer = FlightComputer(
        believed.controller, believed.vehicle, reference, clock,
        compensator=compensator, integral=integral, measured=feedback == "measured",
    )  # fmt: skip
    avionics = _Sensors(truth.wrench_model, sensors or truth.sensors, clock, physics_rate, rng)
    pushes = [] if disturbance is None else [disturbance_stage(np.array([disturbance(t) for t in clock.time.tolist()]))]
    felt = [] if compensator is None else [avionics.accelerometer(truth.wrench_model, clock)]
    stages = [*avionics.stages, *felt, loss_of_control_stage(reference, clock), *computer.stages, *pushes]
    r = reference.sample(0)
    start = State(r.time, r.position_E, r.quat_ED, r.velocity_E, r.omega_D) if initial is None else initial
    flown, loop = fly(
        truth.wrench_model, start, clock, stages, avionics.signals | computer.signals,
        gravity=gravity, compiled=compiled, progress=progress,
    )  # fmt: skip
    periods = len(flown.command_time)
    limits = [
        f"{what.replace('_', ' ')} was limited in {number} of {periods} commands"
        for what, number in computer.limited(loop).items()
        if number
    ]
    lost = [] if flown.lost is None else [f"{flown.lost}; the flight ends there"]
    slow = f"flown in plain numpy, which takes a hundred times as long as compiled: {flown.not_compiled}"
    notes = (*lost, *limits, *([slow] if flown.not_compiled else []))
    logged = as_flight(
        name, flown, truth, loop.logged("law", "desired", periods), reference,
        start_ns=1_700_000_000_000_000_000,  # an arbitrary day of 2023
        pose=avionics.poses(flown, loop), imu_every=avionics.per_imu, imu_errors=avionics.imu_errors,
        battery_every=max(round(0.1 / clock.period), 1), notes=notes,
    )  # fmt: skip
    return replace(logged, content_hash=_digest(logged))


def as_flight(
    name: str,
    flown: LoopFlight,
    model: Model,
    desired: Array,
    reference: Reference,
    *,
    start_ns: int,
    path: Path | None = None,
    pose: State | None = None,
    imu_every: int = 1,
    imu_errors: Array | None = None,
    battery_every: int = 1,
    notes: tuple[str, ...] = (),
) -> Flight:
    """The log of K periods that `model` flew: desired wrench (K, 6), reference (K or more), readings.

    Sensors are ideal but for what is given: `pose` readings, and `imu_errors` (N, 6) of the IMU, which reads at every
    `imu_every`th step. The battery is logged with every `battery_every`th command.
    """
    time, sent, count = flown.command_time, flown.commands, len(desired)
    pose = flown.state if pose is None else pose
    actuators = battery = None
    if sent.tilt is not None and sent.rotor_speed is not None:
        actuators = series.ActuatorSeries("/command/actuators", time, sent.tilt, sent.rotor_speed)
    if flown.state.voltage is not None:
        voltage = flown.state.voltage[:: flown.clock.per_command]
        battery = series.BatterySeries("/battery", time[::battery_every], voltage[::battery_every])
    return Flight(
        name=name,
        path=Path(name) if path is None else path,
        content_hash="",
        start_ns=start_ns,
        commanded=series.WrenchSeries("/command/wrench", time, sent.wrench_B),
        desired=series.WrenchSeries("/desired/wrench", time, desired),
        actuators=actuators,
        imu=_imu(flown, model, imu_every, imu_errors),
        odometry=series.OdometrySeries(
            "/odometry", pose.time, pose.position_E, so3.continuous(pose.quat_EB), pose.velocity_E, pose.omega_B
        ),
        reference=series.ReferenceSeries("/reference", **(vars(reference.take(slice(0, count))) | {"time": time})),
        battery=battery,
        notes=notes,
    )


def _imu(flown: LoopFlight, model: Model, every: int, errors: Array | None) -> ImuSeries:
    """Gyroscope and accelerometer at every so many steps."""
    at = slice(None, None, every)
    state, wrench, plant = flown.state.take(at), mean_around_stamps(flown.wrench)[at], model.wrench_model
    motion = plant.read_imu(plant.motion(wrench, state.omega_B), state)
    errors = np.zeros((len(wrench), 6)) if errors is None else errors[: len(wrench)]
    return ImuSeries("/imu", state.time, *read_imu(motion, model.vehicle.imu_position_B, errors))


def physics_rate(model: Model, least: int = 400) -> float:
    """The smallest multiple [Hz] of all rates of the model that is not below `least` [Hz]."""
    rates = (model.controller.rate_hz, model.sensors.imu_rate_hz, model.sensors.pose_rate_hz)
    if any(rate != round(rate) for rate in rates):
        raise UsageError(f"rates of controller and sensors are {rates} Hz; the simulation needs whole numbers")
    common = math.lcm(*(round(rate) for rate in rates))
    return float(common * math.ceil(least / common))


def _divide(physics_rate: float, rate: float, what: str) -> int:
    ratio = physics_rate / rate
    if ratio < 1 or abs(ratio - round(ratio)) > 1e-9:
        raise UsageError(
            f"simulate: physics_rate {physics_rate:g} Hz is not a whole multiple of {what} {rate:g} Hz; "
            "change one of them"
        )
    return round(ratio)


def _check(
    truth: Vehicle, believed: Vehicle, length: float, least: float, physics_rate: float, most: int = 1_500_000
) -> None:
    """Raise UsageError for what cannot be simulated; a step takes 1 to 3 kB, `most` are an hour at 400 Hz."""
    if not (np.isfinite(length) and length >= least):
        raise UsageError(f"simulate: got a duration of {length} s, expected two control periods, {least:g} s, at least")
    if length * physics_rate > most:
        raise UsageError(
            f"simulate: {length:g} s at {physics_rate:g} Hz, a multiple of all rates of controller and sensors, are "
            f"more than {most:,} steps; fly a shorter time, or choose rates that are multiples of one another"
        )
    shapes = [
        (0 if v.arms is None else len(v.arms), 0 if v.rotors is None else len(v.rotors)) for v in (truth, believed)
    ]
    if shapes[0] != shapes[1]:
        raise UsageError(
            f"simulate: the controller's vehicle '{believed.name}' has {shapes[1]} arms and rotors, the true one "
            f"'{truth.name}' {shapes[0]}; they must agree"
        )


def _digest(flight: Flight) -> str:
    """A hash of the flight, which has no file."""
    digest = hashlib.sha256()
    readings = [("imu", "omega_B"), ("imu", "specific_force_B"), ("odometry", "position_E"), ("odometry", "quat_EB")]
    for role, name in [("desired", "wrench_B"), ("commanded", "wrench_B"), *readings]:
        digest.update(np.ascontiguousarray(getattr(getattr(flight, role), name)).tobytes())
    return digest.hexdigest()
