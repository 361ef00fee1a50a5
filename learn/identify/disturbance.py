"""What a model does not explain of a recorded flight, as functions of time that are carried into a re-flight.

    d(t)  the disturbance: wrench that the recorded motion needs minus wrench that the model M makes of the recorded
          commands
    e(t)  the pilot's residual: recorded desired wrench minus the control law on the recorded state and reference
    a(t)  the allocation's residual: recorded actuator commands minus the allocation of the recorded commanded wrench

d(t) is held in B over one control period and found in two steps. With H a zero-phase low-pass,

    d_0 = H [wrench needed] - H [wrench of M]              about O in B, one filter on both sides

already explains the motion within H's band; because two integrations forget nothing, M + d_0 is then integrated
through the flight, and a slow and well damped pull (`PULL_HZ`) back to the recorded motion is added to d_0:

    F_pull = m R_BE [w^2 (p_rec - p) + 2 w (v_rec - v)],    M_pull = J [w^2 log(q^-1 q_rec) + 2 w (omega_rec - omega)]

So d is smooth, and the flight of M + d that was integrated is what a re-flight without any change repeats. d is a
body-fixed wrench: right for errors of thrust and mass, an approximation for wind when the attitude of the re-flight
differs.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight import so3
from wrenchgap.learn.data.applicable import check_effects
from wrenchgap.learn.data.measurement import low_pass
from wrenchgap.learn.data.recorded_motion import CUTOFF_HZ, RecordedMotion
from wrenchgap.learn.data.recording import Recording
from wrenchgap.plant.allocation import Allocation
from wrenchgap.plant.closed_loop import Report, integrate
from wrenchgap.plant.controller import evaluate, integrate_error, pushes_along_z_only
from wrenchgap.plant.model import Model
from wrenchgap.plant.state import Commands, State
from wrenchgap.plant.vehicle import Body, Vehicle
from wrenchgap.plant.wrench_model import about_origin, measured_wrench

Array = NDArray[np.float64]

PULL_HZ = 1.0
"""Natural frequency of the pull towards the recorded motion, critically damped [Hz]."""


@dataclass(frozen=True)
class Inference:
    """What is carried into every re-flight, K periods; wrenches in B, force first.

    states        (K) of the model that is pushed along the recorded motion by the disturbance
    disturbance   d (K, 6) about O;  pull (K, 6): the part of it that the integration needed
    offset        e (K, 6) about the believed centre of mass
    correction    (K, 6) recorded commanded minus desired wrench: what a compensator did when the log was made
    tilt_offset, speed_offset   a (K, A) [rad], (K, R) [rad/s]; None without rotors
    integral      (3,) of the control law at the first period [rad s]
    memory        of the model's command effects before the first period
    tilt          (A,) allocated one period before the first, None at the start of a log
    along_z       whether the law is that of a vehicle that pushes along its z axis only
    explained     (6,) share of the desired wrench's variance that the law explains; nan on axes that hardly moved
    """

    recording: Recording
    model: Model
    states: State
    disturbance: Array
    pull: Array
    offset: Array
    correction: Array
    tilt_offset: Array | None
    speed_offset: Array | None
    integral: Array
    memory: dict[str, Any] | None
    tilt: Array | None
    along_z: bool
    explained: Array

    @property
    def statistics(self) -> dict[str, list[float]]:
        """Size of the disturbance per axis: mean, rms, rms above 10 Hz, maximum; rms of the pull."""
        d, dt = self.disturbance, self.recording.dt
        fast = d - low_pass(d, dt, 10.0)

        def rms(x: Array) -> list[float]:
            return [float(v) for v in np.sqrt(np.mean(x**2, axis=0))]

        return {
            "mean": d.mean(axis=0).tolist(),
            "rms": rms(d),
            "rms_above_10_hz": rms(fast),
            "max_abs": np.abs(d).max(axis=0).tolist(),
            "pull_rms": rms(self.pull),
        }


def infer(
    recording: Recording, model: Model, *, cutoff_hz: float = CUTOFF_HZ, progress: Report | None = None
) -> Inference:
    """Disturbance, pilot's and allocation's residual of a recording, as `model` (with its controller) sees it.

    Raises FitError where an effect of the model needs what the log lacks.
    """
    check_effects(model.effects, model, [recording.record])
    r, plant, window = recording, model.wrench_model, recording.window
    state, motion = r.motion.state, r.motion.motion
    ours, tilt_offset, speed_offset = _allocated(r, model.vehicle)
    nominal = with_offsets(model.vehicle, r.commands.wrench_B, ours, tilt_offset, speed_offset)
    memory: dict[str, Any] | None = None
    if r.first:
        before = slice(0, r.first)
        _, memory = plant.command(nominal.take(before), state.take(before), r.dt)

    made, _ = plant.actuate(nominal, state, r.dt)
    needed = about_origin(plant.body, measured_wrench(plant.body, motion))
    over_period = np.concatenate((0.5 * (needed[:-1] + needed[1:]), needed[-1:]))
    base: Array = over_period - low_pass(made, r.dt, min(cutoff_hz, 0.3 / r.dt))

    def disturbance(k: int, now: State) -> Array:
        return np.asarray(base[r.first + k] + _pull(plant.body, r.motion, r.first + k, now))

    def command(k: int, now: State) -> Commands:
        return nominal.take(slice(r.first + k, r.first + k + 1))

    flown = integrate(plant, r, memory, command, disturbance, progress)
    along_z = pushes_along_z_only(model.vehicle) or not np.any(r.desired[:, :2])
    integral, law = _law(model, r, flown.state, along_z)
    offset = r.desired[window] - law
    return Inference(
        recording=r,
        model=model,
        states=flown.state,
        disturbance=flown.disturbance,
        pull=flown.disturbance - base[window],
        offset=offset,
        correction=(r.commanded - r.desired)[window],
        tilt_offset=None if tilt_offset is None else tilt_offset[window],
        speed_offset=None if speed_offset is None else speed_offset[window],
        integral=integral,
        memory=memory,
        tilt=None if ours is None or ours.tilt is None or r.first == 0 else ours.tilt[r.first - 1],
        along_z=along_z,
        explained=_explained(r.desired[window], offset),
    )


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
    return ours, tilt, r.commands.rotor_speed - ours.rotor_speed


def with_offsets(
    vehicle: Vehicle, wrench_B: Array, allocated: Commands | None, tilt: Array | None, speed: Array | None
) -> Commands:
    """Commands (N) as the vehicle's allocation would have sent them: ours plus the recorded offset, within limits."""
    if allocated is None or tilt is None or speed is None:
        return Commands(wrench_B)
    assert allocated.tilt is not None
    assert allocated.rotor_speed is not None
    arms, rotors = vehicle.geometry()
    return Commands(
        wrench_B,
        np.clip(allocated.tilt + tilt, arms.tilt_min, arms.tilt_max),
        np.clip(allocated.rotor_speed + speed, rotors.speed_min, rotors.speed_max),
    )


def _pull(body: Body, recorded: RecordedMotion, k: int, now: State) -> Array:
    """Wrench (6,) towards the recorded motion: the last equations of the module."""
    w, target = 2.0 * np.pi * PULL_HZ, recorded.state
    ahead = w**2 * (target.position_E[k] - now.position_E[0]) + 2.0 * w * (target.velocity_E[k] - now.velocity_E[0])
    turn = so3.log(so3.multiply(so3.conjugate(now.quat_EB[0]), target.quat_EB[k]))
    turning = w**2 * turn + 2.0 * w * (target.omega_B[k] - now.omega_B[0])
    wrench: Array = np.concatenate((body.mass * so3.rotate_inverse(now.quat_EB[0], ahead), body.inertia @ turning))
    return np.asarray(about_origin(body, wrench[None])[0])


def _law(model: Model, r: Recording, states: State, along_z: bool) -> tuple[Array, Array]:
    """The law's integral (3,) at the first period, and its wrench (K, 6) on `states`."""
    gains, body, window = model.controller, model.vehicle.body, r.window

    def at(rows: slice, state: State, integral: Array) -> tuple[Array, Array]:
        return evaluate(gains, body, state, r.reference.take(rows), integral, along_z=along_z)

    integral = np.zeros(3)
    if r.first:
        before = slice(0, r.first + 1)
        error = at(before, r.motion.state.take(before), np.zeros((r.first + 1, 3)))[1]
        integral = integrate_error(gains, error, r.dt)[-1]
    error = at(window, states, np.zeros((r.count, 3)))[1]
    return integral, at(window, states, integrate_error(gains, error, r.dt, integral))[0]
