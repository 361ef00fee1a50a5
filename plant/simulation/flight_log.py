"""A simulated closed loop as a flight: its log. `plant.simulation.closed_loop` says what the stamps mean."""

from pathlib import Path

import numpy as np

from wrenchgap.flight import so3
from wrenchgap.flight.flight import (
    ActuatorSeries,
    Array,
    BatterySeries,
    Flight,
    ImuSeries,
    OdometrySeries,
    ReferenceSeries,
    WrenchSeries,
)
from wrenchgap.plant.model import Model
from wrenchgap.plant.sensors import read_imu
from wrenchgap.plant.simulation.closed_loop import LoopFlight, mean_around_stamps
from wrenchgap.plant.state import State
from wrenchgap.plant.trajectory import Reference


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
        actuators = ActuatorSeries("/command/actuators", time, sent.tilt, sent.rotor_speed)
    if flown.state.voltage is not None:
        voltage = flown.state.voltage[:: flown.clock.per_command]
        battery = BatterySeries("/battery", time[::battery_every], voltage[::battery_every])
    return Flight(
        name=name,
        path=Path(name) if path is None else path,
        content_hash="",
        start_ns=start_ns,
        commanded=WrenchSeries("/command/wrench", time, sent.wrench_B),
        desired=WrenchSeries("/desired/wrench", time, desired),
        actuators=actuators,
        imu=_imu(flown, model, imu_every, imu_errors),
        odometry=OdometrySeries(
            "/odometry", pose.time, pose.position_E, so3.continuous(pose.quat_EB), pose.velocity_E, pose.omega_B
        ),
        reference=ReferenceSeries("/reference", **(vars(reference.take(slice(0, count))) | {"time": time})),
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
