"""Closed-loop simulation: a vehicle as it is, flown by a controller that believes something else, written as a flight.

    reference -> controller (believed) -> W_des -> [compensator] -> W_cmd -> allocation (believed) -> u
              -> truth: command effects, h(u), thrust and wrench effects, + disturbance -> rigid body -> sensors

Instants are t_k = k / rate, exact; `plant.closed_loop` says what is held from when to when and what a reading sees.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from wrenchgap.flight.errors import UsageError
from wrenchgap.flight.flight import Array, Flight
from wrenchgap.plant.closed_loop import Clock, fly, watch
from wrenchgap.plant.flight_computer import Compensating, FlightComputer
from wrenchgap.plant.flight_log import as_flight
from wrenchgap.plant.loop import Loop, Result
from wrenchgap.plant.model import Model
from wrenchgap.plant.sensors import SensorNoise, imu_errors, read_pose
from wrenchgap.plant.state import Commands, Motion, State, joined
from wrenchgap.plant.trajectory import Reference, Trajectory
from wrenchgap.plant.vehicle import GRAVITY, Vehicle
from wrenchgap.plant.wrench_model import WrenchModel

Feedback = Literal["measured", "true"]

START_NS = 1_700_000_000_000_000_000
"""Stamp of the first sample of simulated flights [ns since 1970]."""

PHYSICS_RATE = 400
"""Least rate of the simulation that `physics_rate` gives [Hz]."""


@dataclass(frozen=True)
class _Sensing:
    """When and how wrongly sensors read: every so many steps, with the IMU's `errors` (N, 6)."""

    noise: SensorNoise
    per_imu: int
    per_pose: int
    period: float
    errors: Array
    rng: np.random.Generator


class _Avionics:
    """Pose sensor, gyroscope and flight computer, stepped as the flight goes by; `poses` are the readings so far."""

    def __init__(
        self, truth: WrenchModel, computer: FlightComputer, reference: Reference, sensing: _Sensing, feedback: Feedback
    ) -> None:
        self.truth, self.computer, self.reference, self.sensing = truth, computer, reference, sensing
        self.feedback = feedback
        self.poses: list[State] = []

    def observe(self, n: int, state: State) -> None:
        """Read what is due at step `n`."""
        s = self.sensing
        if n % s.per_pose == 0:
            self.poses.append(read_pose(state, s.noise, s.rng))
        if n % s.per_imu == 0:
            k = n // s.per_imu
            still = Motion(state.omega_B, np.zeros((1, 3)), np.zeros((1, 3)))
            self.gyro = self.truth.read_imu(still, state).omega_B + s.errors[k : k + 1, :3]

    def command(self, k: int, now: State) -> Commands:
        """Commands of period `k`, from the last readings or from the true state."""
        if self.feedback == "measured":
            pose = self.poses[-1]
            now = State(now.time, pose.position_E, pose.quat_EB, pose.velocity_E, self.gyro, now.voltage)
        return self.computer.step(k, now, self.reference.sample(k), self.sensing.period)


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
    compiled     False flies in plain numpy, which is also what flies where an effect of the truth cannot be compiled

    The simulation stops where control is lost and says so in `Flight.notes`, as where it could not be compiled.
    Raises UsageError for rates that do not divide, or vehicles that do not match.
    """
    believed = truth.nominal if believed is None else believed
    noise = truth.sensors if sensors is None else sensors
    length = trajectory.duration if duration is None else duration
    _check(truth.vehicle, believed.vehicle, length)
    clock = _clock(length, physics_rate, believed.controller.rate_hz, voltage)
    sensing = _sensing(noise, clock, physics_rate, rng)
    reference = trajectory.at(clock.time[:: clock.per_command])
    r = reference.sample(0)
    start = State(r.time, r.position_E, r.quat_ED, r.velocity_E, r.omega_D) if initial is None else initial
    asked = _Asked(truth, believed, reference, clock, sensing, feedback, compensator, integral, gravity, disturbance)
    from wrenchgap.plant.tracing import Untraceable

    if compiled:
        try:
            return _logged(name, asked, _compiled(asked, start, progress))
        except Untraceable as error:
            slow = f"flown in plain numpy, which takes a hundred times as long as compiled: {error}"
            return _logged(name, asked, _plain(asked, start, progress), slow)
    return _logged(name, asked, _plain(asked, start, progress))


@dataclass(frozen=True)
class _Asked:
    """What flies, as in `simulate`."""

    truth: Model
    believed: Model
    reference: Reference
    clock: Clock
    sensing: _Sensing
    feedback: Feedback
    compensator: Compensating | None
    integral: Array | None
    gravity: float
    disturbance: Callable[[float], Array] | None


def _plain(asked: _Asked, start: State, progress: Callable[[float], None] | None) -> Result:
    """The flight in plain numpy: the specification."""
    a, shake = asked, asked.disturbance
    computer = FlightComputer(a.believed.controller, a.believed.vehicle, a.compensator, integral=a.integral)
    avionics = _Avionics(a.truth.wrench_model, computer, a.reference, a.sensing, a.feedback)
    flown = fly(
        a.truth.wrench_model,
        start,
        a.clock,
        avionics.command,
        disturbance=None if shake is None else lambda n, now: shake(float(now.time[0])),
        observe=avionics.observe,
        lost=watch(a.reference),
        gravity=a.gravity,
        progress=progress,
    )
    return Result(flown, joined(avionics.poses), np.array(computer.desired), computer.limited)


def _compiled(asked: _Asked, start: State, progress: Callable[[float], None] | None) -> Result:
    """The same in compiled code. Raises Untraceable where an effect cannot be compiled."""
    a, s = asked, asked.sensing
    own = a.believed
    shake = None if a.disturbance is None else np.array([a.disturbance(t) for t in a.clock.time.tolist()])
    loop = Loop(
        a.clock, own.controller, own.vehicle, a.reference, s.noise, s.per_imu, s.per_pose, s.errors,
        a.feedback == "measured", a.integral, a.compensator, a.gravity, shake,
    )  # fmt: skip
    from wrenchgap.plant import compiled_loop

    return compiled_loop.fly(a.truth.wrench_model, start, loop, s.rng, progress)


def _clock(length: float, physics_rate: float, control_rate: float, voltage: Callable[[float], float] | None) -> Clock:
    """Steps of the physics through `length` [s]."""
    per_control = _divide(physics_rate, control_rate, "controller.rate_hz")
    time = np.arange(max(round(length * physics_rate), 1)) / physics_rate
    volts = None if voltage is None else np.array([voltage(t) for t in time.tolist()])
    return Clock(time, 1.0 / physics_rate, per_control, volts)


def _sensing(noise: SensorNoise, clock: Clock, physics_rate: float, rng: np.random.Generator) -> _Sensing:
    per_imu = _divide(physics_rate, noise.imu_rate_hz, "sensors.imu_rate_hz")
    per_pose = _divide(physics_rate, noise.pose_rate_hz, "sensors.pose_rate_hz")
    errors = imu_errors(noise, -(-len(clock.time) // per_imu), rng)
    return _Sensing(noise, per_imu, per_pose, clock.period, errors, rng)


def _logged(name: str, asked: _Asked, result: Result, *slow: str) -> Flight:
    sensing, flown = asked.sensing, result.flown
    lost = [] if flown.lost is None else [f"{flown.lost}; the flight ends there"]
    limits = [
        f"{what.replace('_', ' ')} was limited in {number} of {len(result.desired)} commands"
        for what, number in result.limited.items()
        if number
    ]
    logged = as_flight(
        name,
        flown,
        asked.truth,
        result.desired,
        asked.reference,
        start_ns=START_NS,
        pose=result.poses,
        imu_every=sensing.per_imu,
        imu_errors=sensing.errors,
        battery_every=max(round(0.1 / sensing.period), 1),
        notes=(*lost, *limits, *slow),
    )
    return replace(logged, content_hash=_digest(logged))


def physics_rate(model: Model) -> float:
    """The smallest multiple of all rates of the model that is not below `PHYSICS_RATE` [Hz]."""
    rates = (model.controller.rate_hz, model.sensors.imu_rate_hz, model.sensors.pose_rate_hz)
    if any(rate != round(rate) for rate in rates):
        raise UsageError(f"rates of controller and sensors are {rates} Hz; the simulation needs whole numbers")
    common = math.lcm(*(round(rate) for rate in rates))
    return float(common * math.ceil(PHYSICS_RATE / common))


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


def _digest(flight: Flight) -> str:
    """A hash of what was flown, for a flight that has no file."""
    digest = hashlib.sha256()
    readings = [("imu", "omega_B"), ("imu", "specific_force_B"), ("odometry", "position_E"), ("odometry", "quat_EB")]
    for role, name in [("desired", "wrench_B"), ("commanded", "wrench_B"), *readings]:
        digest.update(np.ascontiguousarray(getattr(getattr(flight, role), name)).tobytes())
    return digest.hexdigest()
