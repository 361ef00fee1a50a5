"""A reference tried before it is flown: open loop, by a vehicle that tracks perfectly, and on the plant."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from wrenchgap.flight import so3
from wrenchgap.flight.flight import Flight, Samples
from wrenchgap.learn.data.measurement import Record, prepare
from wrenchgap.learn.design.manoeuvres import LARGEST_ERROR, Limits, violations
from wrenchgap.plant.allocation import Allocation
from wrenchgap.plant.controller import evaluate, pushes_along_z_only
from wrenchgap.plant.model import Model
from wrenchgap.plant.sensors import imu_errors
from wrenchgap.plant.state import Commands, State
from wrenchgap.plant.trajectory import Trajectory
from wrenchgap.plant.wrench_model import about_origin

RATE = 100.0
"""Of the open-loop flights [Hz]."""
USE = 0.95
"""Share of the actuators' limits that an open-loop flight may use: the closed loop needs the rest."""


@dataclass(frozen=True)
class Rehearsal:
    """A reference flown open loop: the record, and what goes beyond the limits."""

    record: Record
    violations: tuple[str, ...]


def rehearse(trajectory: Trajectory, model: Model, limits: Limits, *, seed: int = 0) -> Rehearsal:
    """What a vehicle that tracks perfectly commands and measures, with the model's sensor noise.

    Actuators may go to the share `USE` of their limits.
    """
    time = np.arange(round(trajectory.duration * RATE)) / RATE
    r = trajectory.at(time)
    state = State(time, r.position_E, r.quat_ED, r.velocity_E, r.omega_D)
    vehicle, dt = model.vehicle, 1.0 / RATE
    along_z, rest = pushes_along_z_only(vehicle), np.zeros_like(r.omega_D)
    wrench, _ = evaluate(model.controller, vehicle.body, state, r, rest, along_z=along_z)
    commands, beyond = Commands(wrench), []
    if vehicle.has_rotors:
        allocation = Allocation(vehicle)
        about_O = about_origin(vehicle.body, wrench)
        commands = replace(allocation.allocate(about_O, dt=dt)[0], wrench_B=wrench)
        missing = np.linalg.norm((about_O - allocation.achievable(about_O))[:, :3], axis=1).max()
        if missing > 0.02 * np.linalg.norm(about_O[:, :3], axis=1).max():
            beyond.append("asks for a force that the rotors cannot make")
    beyond += violations(vehicle, limits, r.position_E, r.quat_ED, r.velocity_E, commands, dt, USE)
    noise = imu_errors(replace(model.sensors, imu_rate_hz=RATE), len(time), np.random.default_rng(seed))
    motion = model.wrench_model.motion(model.wrench_model.actuate(commands, state, dt)[0], state.omega_B)
    samples = Samples(
        "rehearsal",
        time,
        dt,
        r.omega_D + noise[:, :3],
        motion.specific_force_B + noise[:, 3:],
        wrench_cmd_B=wrench,
        tilt_cmd=commands.tilt,
        rotor_speed_cmd=commands.rotor_speed,
        position_E=r.position_E,
        velocity_E=r.velocity_E,
        quat_EB=r.quat_ED,
        unmeasured=model.unmeasured,
    )
    return Rehearsal(prepare(samples, vehicle), tuple(beyond))


def tracking(flight: Flight, trajectory: Trajectory) -> tuple[float, float]:
    """Largest position error [m] and attitude error [rad] of a flight along a trajectory."""
    assert flight.odometry is not None
    want = trajectory.at(flight.odometry.time)
    off = so3.log(so3.multiply(so3.conjugate(want.quat_ED), flight.odometry.quat_EB))
    position = np.linalg.norm(flight.odometry.position_E - want.position_E, axis=1)
    return float(position.max()), float(np.linalg.norm(off, axis=1).max())


def lost_after(flight: Flight, trajectory: Trajectory) -> float | None:
    """Time [s] at which control was lost: the plant ends a flight there, before its trajectory ends."""
    assert flight.odometry is not None
    last, gap = float(flight.odometry.time[-1]), 2.0 * flight.odometry.period
    return last if last + gap < trajectory.duration else None


def broken(flight: Flight, trajectory: Trajectory, model: Model, limits: Limits, *, believed: bool) -> list[str]:
    """What a flight on the plant did beyond the limits, in words.

    Where the model is `believed` to be the vehicle, also where it was far from the trajectory, and where the actuators
    were at their limits.
    """
    odometry, actuators = flight.odometry, flight.actuators
    assert odometry is not None
    assert odometry.velocity_E is not None
    commands, dt = Commands(np.zeros((0, 6))), 1.0
    if actuators is not None and believed:
        commands, dt = replace(commands, tilt=actuators.tilt, rotor_speed=actuators.rotor_speed), actuators.period
    motion = (odometry.position_E, odometry.quat_EB, odometry.velocity_E)
    found = violations(model.vehicle, limits, *motion, commands, dt)
    position, attitude = tracking(flight, trajectory) if believed else (0.0, 0.0)
    if position > LARGEST_ERROR[0]:
        found.append(f"is {position:.2f} m from the reference, allowed are {LARGEST_ERROR[0]:g} m")
    if attitude > LARGEST_ERROR[1]:
        found.append(
            f"is {np.degrees(attitude):.0f} deg from the reference, allowed are {np.degrees(LARGEST_ERROR[1]):.0f} deg"
        )
    lost = lost_after(flight, trajectory)
    return found if lost is None else [*found, f"loses control after {lost:.1f} s"]


def rotor_use(flight: Flight, model: Model) -> float:
    """Largest share of a rotor's largest speed."""
    if flight.actuators is None or not model.vehicle.has_rotors:
        return 0.0
    _, rotors = model.vehicle.geometry()
    return float((flight.actuators.rotor_speed / rotors.speed_max).max())
