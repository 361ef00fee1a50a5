"""What a model does not explain of a recorded flight, as functions of time that are carried into a re-simulation.

    d(t)  the disturbance: wrench that the recorded motion needs minus wrench that the model M makes of the recorded
          commands
    e(t)  the pilot's residual: recorded desired wrench minus the control law on the recorded state and reference
    a(t)  the allocation's residual: recorded actuator commands minus the allocation of the recorded commanded wrench

d(t) is held in B over one control period and found in two steps. With H a zero-phase low-pass,

    d_0 = H [wrench needed] - H [wrench of M]              about O in B, one filter on both sides

already explains the motion within H's band; because two integrations forget nothing, M + d_0 is then integrated
through the flight, and a slow and well damped pull (`pull_hz`) back to the recorded motion is added to d_0:

    F_pull = m R_BE [w^2 (p_rec - p) + 2 w (v_rec - v)],    M_pull = J [w^2 log(q^-1 q_rec) + 2 w (omega_rec - omega)]

So d is smooth, and the flight of M + d that was integrated is what a re-simulation without any change repeats. d is a
body-fixed wrench: right for errors of thrust and mass, an approximation for wind when the attitude of the re-simulation
differs.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from wrenchgap.flight import so3
from wrenchgap.flight.flight import Array
from wrenchgap.learn.data.candidates import check_effects
from wrenchgap.learn.data.errors import rms
from wrenchgap.learn.data.measurement import low_pass
from wrenchgap.learn.data.recording import CUTOFF_HZ, Recording
from wrenchgap.plant.allocation import Allocation
from wrenchgap.plant.controller import control_law, integral_series, pushes_along_z_only
from wrenchgap.plant.model import Model
from wrenchgap.plant.rigid_body import unpack
from wrenchgap.plant.simulation.closed_loop import command_stage, fly, mean_over_periods
from wrenchgap.plant.simulation.flight_computer import RecordedPilot, beyond_allocation
from wrenchgap.plant.simulation.loop import Signals, Stage
from wrenchgap.plant.state import Commands, State
from wrenchgap.plant.vehicle import Body, Vehicle
from wrenchgap.plant.wrench_model import about_com, about_origin, measured_wrench


@dataclass(frozen=True)
class DisturbanceSize:
    """Of a disturbance, per axis (6,) [N, Nm]: mean, rms, rms above `fast_hz`, largest; rms of the pull.

    Above `fast_hz` [Hz] a disturbance is noise rather than motion.
    """

    mean: Array
    rms: Array
    rms_fast: Array
    largest: Array
    rms_pull: Array
    fast_hz: ClassVar[float] = 10.0


@dataclass(frozen=True)
class Inference:
    """What is carried into every re-simulation, K periods; wrenches in B, force first.

    disturbance  d (K, 6) about O;  pull (K, 6): the part of it that the integration needed
    pilot        e and a, and how the recorded flight computer began
    memory       of the model's command effects before the first period
    explained    (6,) share of the desired wrench's variance that the law explains; nan on axes that hardly moved
    """

    recording: Recording
    model: Model
    disturbance: Array
    pull: Array
    pilot: RecordedPilot
    memory: dict[str, Any] | None
    explained: Array

    @property
    def size(self) -> DisturbanceSize:
        """How large the disturbance is."""
        d = np.where(self.recording.record.measured_axes, self.disturbance, np.nan)
        fast = d - low_pass(d, self.recording.dt, DisturbanceSize.fast_hz)
        return DisturbanceSize(d.mean(axis=0), rms(d), rms(fast), np.abs(d).max(axis=0), rms(self.pull))


def infer(recording: Recording, model: Model, *, progress: Callable[[float], None] | None = None) -> Inference:
    """Disturbance, pilot's and allocation's residual of a recording, as `model` (with its controller) sees it.

    Raises FitError where an effect of the model needs what the log lacks.
    """
    check_effects(model.effects, model, [recording.record])
    r, plant, window = recording, model.wrench_model, recording.window
    state, motion = r.motion.state, r.motion.motion
    ours, tilt, speed = _allocated(r, model.vehicle)
    nominal = Commands(r.commands.wrench_B)
    if ours is not None and tilt is not None and speed is not None:
        nominal = beyond_allocation(model.vehicle, ours, tilt, speed)
    memory: dict[str, Any] | None = None
    if r.first:
        before = slice(0, r.first)
        _, memory = plant.command(nominal.take(before), state.take(before), r.dt)

    made, _ = plant.actuate(nominal, state, r.dt)
    needed = about_origin(plant.body, measured_wrench(plant.body, motion))
    base: Array = _measured(plant.body, r, mean_over_periods(needed) - low_pass(made, r.dt, min(CUTOFF_HZ, 0.3 / r.dt)))
    command, signals = command_stage(nominal.take(window))
    towards = np.hstack((base, state.position_E, state.quat_EB, state.velocity_E, state.omega_B))[window]

    def disturb(now: Signals, row: Array) -> Signals:
        target = unpack(np.zeros(1), row[None, 6:])
        return {"disturbance": row[:6] + _pull(plant.body, target, unpack(np.zeros(1), now["state"][None]))[0]}

    stages = [command, Stage("disturbance", disturb, towards)]
    flown, _ = fly(plant, r.start, r.clock, stages, signals, memory=memory, progress=progress)
    along_z = pushes_along_z_only(model.vehicle) or not np.any(r.desired[:, :2])
    integral, law = _law(model, r, flown.state, along_z)
    pilot = RecordedPilot(
        offset=r.desired[window] - law,
        correction=(r.commanded - r.desired)[window],
        tilt=None if tilt is None else tilt[window],
        rotor_speed=None if speed is None else speed[window],
        integral=integral,
        previous_tilt=None if ours is None or ours.tilt is None or r.first == 0 else ours.tilt[r.first - 1],
        along_z=along_z,
    )
    explained = _explained(r.desired[window], pilot.offset)
    pull = flown.disturbance - base[window]
    return Inference(r, model, flown.disturbance, pull, pilot, memory, explained)


def _measured(body: Body, r: Recording, disturbance: Array) -> Array:
    """A disturbance (K, 6) about O with zero about the centre of mass on the axes that the log did not measure."""
    known = r.record.measured_axes
    if known.all():
        return disturbance
    return about_origin(body, np.where(known, about_com(body, disturbance), 0.0))


def _explained(desired: Array, offset: Array) -> Array:
    """1 - var(e) / var(W_des) per axis (6,); nan where W_des moves less than 1 % of the liveliest axis of its kind."""
    moved, left = np.std(desired, axis=0), np.std(offset, axis=0)
    used = np.concatenate([part > 0.01 * part.max() for part in (moved[:3], moved[3:])])
    return np.where(used, 1.0 - (left / np.where(used, moved, 1.0)) ** 2, np.nan)


def _allocated(r: Recording, vehicle: Vehicle) -> tuple[Commands | None, Array | None, Array | None]:
    """Our allocation of the recorded commanded wrench, and what the recorded tilts and rotor speeds are beyond it.

    Offsets of tilts are taken modulo one turn, so that a log that wraps its angles does not make the arms spin.
    """
    if not vehicle.has_rotors or r.commands.rotor_speed is None or r.commands.tilt is None:
        return None, None, None
    ours, _ = Allocation(vehicle).allocate(about_origin(vehicle.body, r.commanded), dt=r.dt)
    assert ours.tilt is not None
    assert ours.rotor_speed is not None
    tilt = (r.commands.tilt - ours.tilt + np.pi) % (2.0 * np.pi) - np.pi
    speed = r.commands.rotor_speed - ours.rotor_speed
    return Commands(r.commands.wrench_B, ours.tilt, ours.rotor_speed), tilt, speed


def _pull(body: Body, target: State, now: State, pull_hz: float = 1.0) -> Array:
    """Wrenches (N, 6) towards the recorded motion `target`: the last equations of the module.

    `pull_hz` [Hz] is the natural frequency, critically damped.
    """
    w = 2.0 * np.pi * pull_hz
    ahead = w**2 * (target.position_E - now.position_E) + 2.0 * w * (target.velocity_E - now.velocity_E)
    turn = so3.log(so3.multiply(so3.conjugate(now.quat_EB), target.quat_EB))
    turning = w**2 * turn + 2.0 * w * (target.omega_B - now.omega_B)
    force = body.mass * so3.rotate_inverse(now.quat_EB, ahead)
    return about_origin(body, np.concatenate((force, turning @ body.inertia.T), axis=-1))


def _law(model: Model, r: Recording, states: State, along_z: bool) -> tuple[Array, Array]:
    """The law's integral (3,) at the first period, and its wrench (K, 6) on `states`."""
    gains, body, window = model.controller, model.vehicle.body, r.window

    def at(rows: slice, state: State, integral: Array) -> tuple[Array, Array]:
        return control_law(gains, body, state, r.reference.take(rows), integral, along_z=along_z)

    integral = np.zeros(3)
    if r.first:
        before = slice(0, r.first + 1)
        error = at(before, r.motion.state.take(before), np.zeros((r.first + 1, 3)))[1]
        integral = integral_series(gains, error, r.dt)[-1]
    error = at(window, states, np.zeros((r.count, 3)))[1]
    return integral, at(window, states, integral_series(gains, error, r.dt, integral))[0]
