"""Fly a `Truth` in RotorPy under its controller, and record what the vehicle would record.

Timing, as in `hidden_effects`: at tick t_k the controller reads the true state and issues a command stamped t_k, held
until t_k+1. The gyroscope is read at t_k; the accelerometer is the mean of just before and just after t_k, as one whose
sample ends half a period later: where rotors follow at once, the mean of two commands. Poses at half the rate.

The controller believes what the model file says. It gets the state of O, so a centre of mass elsewhere is news to it.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.field.craft import Craft, start
from benchmarks.field.flying import RATE, Plan, gusts, plan
from benchmarks.field.pilot import Pilot
from benchmarks.field.truth import Truth
from benchmarks.field.vehicles import GRAVITY, Vehicle
from benchmarks.hidden_effects.recording import Tracks, to_flight
from wrenchgap.flight.errors import UsageError
from wrenchgap.flight.flight import Array, Flight

GUST_SECONDS, GUST_TORQUE_SECONDS = 1.0, 0.25
GUST_TORQUE = 0.006
"""Rms of the torque of turbulence per m/s of gusts, over m g arm: our estimate."""
VOLTAGE = 25.2
BATTERY_EVERY = 20  # ticks
LOST = 4.0  # m from the reference


@dataclass(frozen=True)
class Flown:
    """What happened at the ticks, free of noise. `position_E`, `velocity_E` of O, `omega_B` (N, 3), `quat_EB` (N, 4).

    `gusts_E`, `gust_torque_B` (N, 3); `speed` (N, R) commanded [rad/s]; `imu` (N, 9) rate, specific force, angular
    acceleration; `charge` (N,); `desired`, `commanded` (N, 6) wrenches about O.
    """

    plan: Plan
    position_E: Array
    velocity_E: Array
    quat_EB: Array
    omega_B: Array
    speed: Array
    imu: Array
    gusts_E: Array
    gust_torque_B: Array
    charge: Array
    desired: Array
    commanded: Array


def fly(truth: Truth, kind: str, seconds: float, seed: int) -> Flown:
    """Fly; raises UsageError where the vehicle was lost. Deterministic for equal arguments."""
    # Long because a tick reads as one paragraph: what is seen, what is asked for, what happens.
    vehicle = truth.vehicle
    course = plan(kind, vehicle, seconds, seed)
    N, dt, time = len(course.time), 1.0 / RATE, course.time
    rng = np.random.default_rng([seed, 43])
    blown = gusts(time, truth.gusts, GUST_SECONDS, rng) * np.array((1.0, 1.0, 0.5))
    twist = GUST_TORQUE * truth.gusts * vehicle.mass * GRAVITY * vehicle.arm
    stir = gusts(time, twist, GUST_TORQUE_SECONDS, rng)
    craft, pilot = Craft(truth), Pilot(truth, dt, course.integral)
    state = start(truth, course.position[0], float(course.yaw[0]))
    attached = None if truth.attached is None else truth.attached()
    queue: deque[Array] = deque(maxlen=truth.delay + 1)
    position, velocity, omega = np.empty((N, 3)), np.empty((N, 3)), np.empty((N, 3))
    quat, speed, imu = np.empty((N, 4)), np.empty((N, vehicle.rotors)), np.empty((N, 9))
    desired, commanded, charge = np.zeros((N, 6)), np.zeros((N, 6)), np.ones(N)
    mix = vehicle.allocation()
    unmix = np.linalg.pinv(mix)
    for k in range(N):
        state["wind"], craft.gust_torque_B = truth.wind_E + blown[k], stir[k]
        position[k], velocity[k] = craft.of_origin(state)
        quat[k], omega[k], charge[k] = state["q"], state["w"], craft.charge
        if k % 50 == 0 and not np.linalg.norm(position[k] - course.position[k]) < LOST:  # nan too
            raise UsageError(f"{vehicle.name}, {kind}: the flight was lost after {time[k]:.1f} s")
        wanted = pilot.wrench(time[k], {**state, "x": position[k], "v": velocity[k]}, _flat(course, k))
        wanted = wanted + course.added[k]
        thrust = np.clip(unmix @ wanted, 0.0, vehicle.k_eta * vehicle.speed_max**2)
        speed[k] = np.sqrt(thrust / vehicle.k_eta)
        desired[k, 2:], commanded[k, 2:] = wanted, mix @ thrust
        queue.append(speed[k])
        imu[k] = craft.imu({**state, "rotor_speeds": around(truth, state["rotor_speeds"], queue[0])})
        if attached is not None:
            craft.held = (attached.step(dt, position[k], velocity[k], state, imu[k]),)
        craft.charge -= dt / 60.0 * float((thrust**1.5).sum()) / vehicle.rotors / _hover_thrust(vehicle) ** 1.5
        state = craft.step(state, {"cmd_motor_speeds": queue[0]}, dt)
    quat = Rotation.from_quat(quat).as_quat(scalar_first=True, canonical=True)
    return Flown(course, position, velocity, quat, omega, speed, imu, blown, stir, charge, desired, commanded)


def around(truth: Truth, before: Array, after: Array) -> Array:
    """Speeds (..., R) with the mean thrust of before and after a tick; those before where rotors cannot jump."""
    return before if any(truth.tau) else np.sqrt((before**2 + after**2) / 2.0)


def _hover_thrust(vehicle: Vehicle) -> float:
    return vehicle.mass * GRAVITY / vehicle.rotors


def _flat(course: Plan, k: int) -> dict[str, Array | float]:
    """RotorPy's flat outputs at tick k."""
    return {
        "x": course.position[k],
        "x_dot": course.velocity[k],
        "x_ddot": course.acceleration[k],
        "x_dddot": np.zeros(3),
        "x_ddddot": np.zeros(3),
        "yaw": float(course.yaw[k]),
        "yaw_dot": float(course.yaw_rate[k]),
    }


def recorded(flown: Flown, truth: Truth, name: str) -> Flight:
    """The flight as a reader of its log would return it, with perfect sensors (`sensors.measured` makes real ones).

    A vehicle that does not show its rotors has no actuator channel; a voltage is recorded where there is a battery.
    """
    course = flown.plan
    ns = np.round(course.time * 1e9).astype(np.int64)
    R_EB = Rotation.from_quat(flown.quat_EB, scalar_first=True)
    moving = R_EB.apply(flown.velocity_E, inverse=True)
    yaw = Rotation.from_rotvec(np.column_stack((np.zeros((len(ns), 2)), course.yaw)))
    to_D = yaw.apply(course.velocity, inverse=True)
    rate_D = np.column_stack((np.zeros((len(ns), 2)), course.yaw_rate))
    every = slice(0, len(ns), BATTERY_EVERY) if truth.drop and truth.shows_voltage else slice(0, 0)
    tracks = Tracks(
        command_ns=ns,
        desired=flown.desired,
        commanded=flown.commanded,
        tilt=np.empty((len(ns), 0)),
        speed=flown.speed,
        imu_ns=ns[1:],
        imu=flown.imu[1:, :6],
        odometry_ns=ns[::2],
        odometry=np.hstack((flown.position_E, flown.quat_EB, moving, flown.omega_B))[::2],
        reference=np.hstack((course.position, yaw.as_quat(scalar_first=True), to_D, rate_D)),
        voltage_ns=ns[every],
        voltage=VOLTAGE * (1.0 - truth.drop * (1.0 - flown.charge[every])),
    )
    flight = to_flight(tracks, name, ("RotorPy, benchmarks/field",))
    return flight if truth.vehicle.shows_rotors else replace(flight, actuators=None)
