"""A recorded flight, flown again: the control law, what the recording adds to it, and the plant with its disturbance.

    W_des = law(state, reference) + e(t)  ->  compensator  ->  W_cmd  ->  allocation + a(t)  ->  plant + d(t)

with d, e and a of `learn.identify.disturbance`. The reference is the recorded one, feedback is on the re-flown state.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight import so3
from wrenchgap.flight.flight import (
    ActuatorSeries,
    BatterySeries,
    Flight,
    ImuSeries,
    OdometrySeries,
    ReferenceSeries,
    WrenchSeries,
)
from wrenchgap.learn.data.applicable import check_effects
from wrenchgap.learn.identify.disturbance import Inference, with_offsets
from wrenchgap.plant.allocation import Allocation
from wrenchgap.plant.closed_loop import Flown, Report, integrate
from wrenchgap.plant.controller import Controller, ControllerGains
from wrenchgap.plant.model import Model
from wrenchgap.plant.sensors import read_imu
from wrenchgap.plant.state import Commands, State
from wrenchgap.plant.vehicle import Vehicle
from wrenchgap.plant.wrench_model import about_origin

Array = NDArray[np.float64]


class StepResult(Protocol):
    """What is kept of a compensator's step."""

    @property
    def wrench_cmd(self) -> Array: ...  # noqa: D102
    @property
    def correction(self) -> Array: ...  # noqa: D102
    @property
    def sigma(self) -> float: ...  # noqa: D102
    @property
    def beta(self) -> float: ...  # noqa: D102
    @property
    def cost(self) -> float: ...  # noqa: D102
    @property
    def iterations(self) -> int: ...  # noqa: D102


class Compensates(Protocol):
    """`compensate.Compensator`, or anything that steps like it."""

    def step(self, wrench_des: Array, state: State, /) -> StepResult:
        """Command for a desired wrench (6,) in a state (N = 1)."""
        ...


@dataclass(frozen=True)
class Reflight:
    """A flight that was flown again: `flown`, the desired wrench (K, 6), the compensator's steps, what flew."""

    flown: Flown
    desired: Array
    steps: tuple[StepResult, ...]
    model: Model

    @property
    def commanded(self) -> Array:
        """W_cmd (K, 6)."""
        return self.flown.commands.wrench_B


class _Pilot:
    """Control law, compensator and allocation of one re-flight, with what the recording adds to them."""

    def __init__(self, inference: Inference, gains: ControllerGains, believed: Vehicle, helper: Compensates | None):
        self.inference = inference
        self.controller = Controller(gains, believed)
        self.controller.along_z = inference.along_z
        self.controller.reset(inference.integral)
        self.believed = believed
        self.compensator = helper
        rotors = inference.tilt_offset is not None
        self.allocation = Allocation(believed) if rotors else None
        self.tilt = inference.tilt
        self.desired: list[Array] = []
        self.steps: list[StepResult] = []

    def __call__(self, k: int, now: State) -> Commands:
        """Commands for period k."""
        i = self.inference
        r = i.recording
        desired = self.controller.step(now, r.reference.sample(r.first + k), r.dt) + i.offset[k]
        self.desired.append(desired)
        if self.compensator is None:
            commanded = desired + i.correction[k]
        else:
            self.steps.append(self.compensator.step(desired, now))
            commanded = self.steps[-1].wrench_cmd
        if self.allocation is None:
            return Commands(commanded[None])
        assert i.tilt_offset is not None
        assert i.speed_offset is not None
        about_O = about_origin(self.believed.body, commanded[None])
        allocated, _ = self.allocation.allocate(about_O, previous_tilt=self.tilt, dt=r.dt)
        assert allocated.tilt is not None
        self.tilt = allocated.tilt[0]
        one = slice(k, k + 1)
        return with_offsets(self.believed, commanded[None], allocated, i.tilt_offset[one], i.speed_offset[one])


def refly(
    inference: Inference,
    plant: Model | None = None,
    *,
    gains: ControllerGains | None = None,
    believed: Vehicle | None = None,
    compensator: Compensates | None = None,
    progress: Report | None = None,
) -> Reflight:
    """Fly the recorded flight again; with nothing but the inference this is the null run.

    plant        what flies, with the inferred disturbance; the model of the inference by default
    gains        of the control law; the model's by default
    believed     vehicle that controller and allocation assume; the model's by default
    compensator  in the loop instead of the recorded correction

    Raises FitError where an effect of the plant needs what the log lacks.
    """
    model = inference.model if plant is None else plant
    check_effects(model.effects, model, [inference.recording.record])
    pilot = _Pilot(
        inference,
        inference.model.controller if gains is None else gains,
        inference.model.vehicle if believed is None else believed,
        compensator,
    )
    flown = integrate(
        model.wrench_model,
        inference.recording,
        inference.memory,
        pilot,
        lambda k, now: inference.disturbance[k],
        progress,
        watch=True,
    )
    return Reflight(flown, np.array(pilot.desired).reshape(-1, 6), tuple(pilot.steps), model)


def as_flight(inference: Inference, reflight: Reflight) -> Flight:
    """A re-flight as a log: ideal sensors, the recorded reference, times and start of the recorded flight.

    A force jumps where a command does: the accelerometer reads the mean of the values just before and after.
    """
    r, flown = inference.recording, reflight.flown
    state, n = flown.state, len(flown.state.time)
    model = reflight.model.wrench_model
    around = np.concatenate((flown.wrench[:1], 0.5 * (flown.wrench[1:] + flown.wrench[:-1])))
    motion = model.read_imu(model.motion(around, state.omega_B), state)
    gyro, accel = read_imu(motion, reflight.model.vehicle.imu_position_B, np.zeros((n, 6)))
    asked = r.reference.take(slice(r.first, r.first + n))
    sent, time = flown.commands, state.time
    actuators = None
    if sent.tilt is not None and sent.rotor_speed is not None:
        actuators = ActuatorSeries("/command/actuators", time, sent.tilt, sent.rotor_speed)
    return Flight(
        name=f"{r.flight.name} again",
        path=r.flight.path,
        content_hash="",
        start_ns=r.flight.start_ns,
        commanded=WrenchSeries("/command/wrench", time, sent.wrench_B),
        desired=WrenchSeries("/desired/wrench", time, reflight.desired),
        actuators=actuators,
        imu=ImuSeries("/imu", time, gyro, accel),
        odometry=OdometrySeries(
            "/odometry", time, state.position_E, so3.continuous(state.quat_EB), state.velocity_E, state.omega_B
        ),
        reference=ReferenceSeries(
            "/reference",
            time,
            asked.position_E,
            asked.quat_ED,
            asked.velocity_E,
            asked.omega_D,
            asked.acceleration_E,
            asked.omega_dot_D,
        ),
        battery=None if state.voltage is None else BatterySeries("/battery", time, state.voltage),
        notes=(flown.stopped,) if flown.stopped else (),
    )
