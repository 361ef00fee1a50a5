"""The counterfactual: a recorded flight, flown again with something changed.

What the model M does not explain is inferred from the log and carried into the re-flight as functions of time:

    d(t)  the disturbance: wrench that the recorded motion needs minus wrench that M makes of the recorded commands
    e(t)  the pilot's residual: recorded desired wrench minus the control law on the recorded state and reference
    a(t)  the allocation's residual: recorded actuator commands minus the allocation of the recorded commanded wrench

    W_des = law(state, reference) + e(t)  ->  compensator  ->  W_cmd  ->  allocation + a(t)  ->  plant + d(t)

The reference is the recorded one, feedback is on the re-flown state. As long as nothing is changed, the state is the
recorded one, the law plus e(t) gives the recorded command, and the plant plus d(t) gives the recorded motion.

d(t) is held in B over one control period and found in two steps. With H a zero-phase low-pass,

    d_0 = H [wrench needed] - H [wrench of M]              about O in B, one filter on both sides

already explains the motion within H's band; because two integrations forget nothing, M + d_0 is then integrated
through the flight, and a slow and well damped pull (`PULL_HZ`) back to the recorded motion is added to d_0:

    F_pull = m R_BE [w^2 (p_rec - p) + 2 w (v_rec - v)],    M_pull = J [w^2 log(q^-1 q_rec) + 2 w (omega_rec - omega)]

So d is smooth, and the flight of M + d that was integrated is what a re-flight without any change repeats: the error
of this null run against the recorded *odometry* tells how well the flight was understood, not how well a loop can
hide it. d is a body-fixed wrench: right for errors of thrust and mass, an approximation for wind when the attitude of
the re-flight differs.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

import flight
from flight import so3
from flight.errors import LogError, UsageError
from flight.flight import (
    AXES,
    ActuatorSeries,
    BatterySeries,
    Flight,
    ImuSeries,
    OdometrySeries,
    ReferenceSeries,
    Samples,
    Series,
    WrenchSeries,
)
from flight.resample import held_mean
from learn.measurement import low_pass, prepare
from plant.allocation import Allocation
from plant.controller import (
    Controller,
    ControllerGains,
    attitude_error,
    evaluate,
    integrate_error,
    pushes_along_z_only,
)
from plant.model import Model
from plant.rigid_body import RigidBody, pack, unpack
from plant.sensors import read_imu
from plant.simulate import loss_of_control
from plant.state import Commands, State
from plant.trajectory import Recorded, Reference
from plant.vehicle import Body, Vehicle
from plant.wrench_model import WrenchModel, about_origin, measured_wrench
from replay.recorded_motion import CUTOFF_HZ, RecordedMotion, recorded_motion

Array = NDArray[np.float64]
Report = Callable[[float, str], None]

PULL_HZ = 1.0
"""Natural frequency of the pull towards the recorded motion, critically damped [Hz]."""

ATTITUDE_GOAL_DEG, POSITION_GOAL_M = 0.5, 0.02
"""Largest error of a null run with which a counterfactual can be believed."""

EXPLAINED_GOAL = 0.5
"""Share of the command's variance below which the control law is called a guess."""


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


# --- what was recorded ------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Recording:
    """One contiguous stretch of a flight on its control clock: N periods of `dt` [s] that begin at `time` (N,).

    Commands are what was held over each period: `desired`, `commanded` (N, 6), and `commands` with the actuators.
    `first` and `count` say which periods are to be flown again; those before warm up what has memory.
    """

    flight: Flight
    odometry: OdometrySeries
    reference: Reference
    motion: RecordedMotion
    time: Array
    dt: float
    desired: Array
    commanded: Array
    commands: Commands
    first: int
    count: int
    notes: tuple[str, ...]

    @property
    def window(self) -> slice:
        """The periods that are flown again."""
        return slice(self.first, self.first + self.count)


def read_recording(
    log: Flight,
    vehicle: Vehicle,
    *,
    start: float = 0.0,
    duration: float | None = None,
    cutoff_hz: float = CUTOFF_HZ,
) -> Recording:
    """The stretch of a log in which `start` [s] lies, or the longest, ready for inference.

    Raises LogError where commands, odometry or reference are missing, UsageError for times outside the flight.
    """
    odometry, reference = _roles(log)
    leader = log.commanded if log.commanded is not None else log.actuators
    assert leader is not None
    held = ("commanded",) if log.commanded is not None else ("actuators",)
    imu = ("imu",) if log.imu is not None else ()
    resampled = flight.resample(log, require=(*held, "odometry", *imu))
    samples, first, count = _window(log, resampled.samples, start, duration)
    samples = _held(samples, log)
    record = prepare(samples, vehicle)
    knots = Recorded(reference, start=0.0)
    notes = [*log.notes, *resampled.notes]
    uncovered = samples.time[first] < reference.time[0] or samples.time[first + count - 1] > reference.time[-1] + 1.0
    if uncovered:
        notes.append(f"{log.name}: the reference covers only a part of the re-flight; its ends are held.")
    commanded = record.commands.wrench_B
    return Recording(
        flight=log,
        odometry=odometry,
        reference=knots.at(samples.time),
        motion=recorded_motion(samples, odometry, vehicle.imu_position_B, cutoff_hz=min(cutoff_hz, 0.3 / samples.dt)),
        time=samples.time,
        dt=samples.dt,
        desired=commanded if samples.wrench_des_B is None else samples.wrench_des_B,
        commanded=commanded,
        commands=record.commands,
        first=first,
        count=count,
        notes=tuple(notes),
    )


def _roles(log: Flight) -> tuple[OdometrySeries, ReferenceSeries]:
    """The series without which there is nothing to fly again."""
    played = ", ".join(log.series()) or "none"
    if log.odometry is None:
        raise LogError(
            f"{log.path}: a counterfactual starts from the recorded state, and no topic plays the role 'odometry' "
            f"(played: {played}); map one with --topic odometry=/your/topic"
        )
    if log.reference is None:
        raise LogError(
            f"{log.path}: a counterfactual flies along the recorded reference, and no topic plays the role 'reference' "
            f"(played: {played}); map one with --topic reference=/your/topic"
        )
    if log.commanded is None and log.actuators is None:
        raise LogError(
            f"{log.path}: no topic plays the role 'commanded' or 'actuators' (played: {played}); "
            "map one with --topic commanded=/your/topic"
        )
    return log.odometry, log.reference


def _window(
    log: Flight, stretches: tuple[Samples, ...], start: float, duration: float | None
) -> tuple[Samples, int, int]:
    """The stretch, and the first and number of its samples to fly again."""
    if not (np.isfinite(start) and start >= 0.0):
        raise UsageError(f"--start {start:g}: expected seconds since the log's first sample")
    if duration is not None and not (np.isfinite(duration) and duration > 0.0):
        raise UsageError(f"--duration {duration:g}: expected a positive number of seconds")
    containing = [s for s in stretches if start <= s.time[-1] - 1.0]
    if start == 0.0:
        chosen = max(stretches, key=len)
    elif containing and start >= containing[0].time[0] - 0.5:
        chosen = containing[0]
    else:
        spans = ", ".join(f"{s.time[0]:.2f} to {s.time[-1] - 1.0:.2f} s" for s in stretches)
        raise UsageError(f"--start {start:g}: {log.name} can be flown again within {spans}; choose a time in there")
    first = int(np.searchsorted(chosen.time, start - 1e-9))
    available = len(chosen) - first
    count = available if duration is None else min(available, max(round(duration / chosen.dt), 2))
    return chosen, first, count


def _held(samples: Samples, log: Flight) -> Samples:
    """The samples with commands averaged over the period that begins at each instant, as the plant holds them.

    (`flight.resample` averages *around* each instant, half a period earlier, which is what a measurement sees.)
    """

    def mean(series: Series, values: Array) -> Array:
        run = (series.time >= samples.time[0] - 1.0) & (series.time <= samples.time[-1] + 1.0)
        middle = samples.time + 0.5 * samples.dt
        return held_mean(middle, series.time[run], values[run], series.period, samples.dt)

    used: dict[str, Array] = {}
    if samples.wrench_cmd_B is not None and log.commanded is not None:
        used["wrench_cmd_B"] = mean(log.commanded, log.commanded.wrench_B)
    if samples.wrench_des_B is not None and log.desired is not None:
        used["wrench_des_B"] = mean(log.desired, log.desired.wrench_B)
    if samples.rotor_speed_cmd is not None and log.actuators is not None:
        used["tilt_cmd"] = mean(log.actuators, log.actuators.tilt)
        used["rotor_speed_cmd"] = mean(log.actuators, log.actuators.rotor_speed)
    return replace(samples, **used)  # type: ignore[arg-type]


# --- what the model does not explain ----------------------------------------------------------------------------------


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
    """Disturbance, pilot's and allocation's residual of a recording, as `model` (with its controller) sees it."""
    r, plant, window = recording, model.wrench_model, recording.window
    state, motion = r.motion.state, r.motion.motion
    ours, tilt_offset, speed_offset = _allocated(r, model.vehicle)
    nominal = _with_offsets(model.vehicle, r.commands.wrench_B, ours, tilt_offset, speed_offset)
    _, memory = _part(plant, nominal, state, r.dt, slice(0, r.first)) if r.first else (None, None)

    made, _ = plant.actuate(nominal, state, r.dt)
    needed = about_origin(plant.body, measured_wrench(plant.body, motion))
    over_period = np.concatenate((0.5 * (needed[:-1] + needed[1:]), needed[-1:]))
    base: Array = over_period - low_pass(made, r.dt, min(cutoff_hz, 0.3 / r.dt))

    def disturbance(k: int, now: State) -> Array:
        return np.asarray(base[r.first + k] + _pull(plant.body, r.motion, r.first + k, now))

    def command(k: int, now: State) -> Commands:
        return _rows(nominal, slice(r.first + k, r.first + k + 1))

    flown = _integrate(plant, r, memory, command, disturbance, progress)
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


def _with_offsets(
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


def _rows(commands: Commands, rows: slice) -> Commands:
    return Commands(
        commands.wrench_B[rows],
        None if commands.tilt is None else commands.tilt[rows],
        None if commands.rotor_speed is None else commands.rotor_speed[rows],
    )


def _part(
    plant: WrenchModel, commands: Commands, state: State, dt: float, rows: slice
) -> tuple[Commands, dict[str, Any]]:
    """Effective commands of some periods, and the memory after them."""
    some = State(
        state.time[rows],
        state.position_E[rows],
        state.quat_EB[rows],
        state.velocity_E[rows],
        state.omega_B[rows],
        None if state.voltage is None else state.voltage[rows],
    )
    return plant.command(_rows(commands, rows), some, dt)


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
        return evaluate(gains, body, state, _reference_rows(r.reference, rows), integral, along_z=along_z)

    integral = np.zeros(3)
    if r.first:
        before = slice(0, r.first + 1)
        error = at(before, _state_rows(r.motion.state, before), np.zeros((r.first + 1, 3)))[1]
        integral = integrate_error(gains, error, r.dt)[-1]
    error = at(window, states, np.zeros((r.count, 3)))[1]
    return integral, at(window, states, integrate_error(gains, error, r.dt, integral))[0]


def _reference_rows(reference: Reference, rows: slice) -> Reference:
    return Reference(
        reference.time[rows],
        reference.position_E[rows],
        reference.velocity_E[rows],
        reference.acceleration_E[rows],
        reference.quat_ED[rows],
        reference.omega_D[rows],
        reference.omega_dot_D[rows],
    )


def _state_rows(state: State, rows: slice) -> State:
    return State(
        state.time[rows], state.position_E[rows], state.quat_EB[rows], state.velocity_E[rows], state.omega_B[rows]
    )


# --- flying -----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Flown:
    """K periods of a flight: states at their beginning, what was sent, total wrench (K, 6) and disturbance about O.

    `stopped` says why the flight ended early, empty where it did not.
    """

    state: State
    commands: Commands
    wrench: Array
    disturbance: Array
    stopped: str = ""


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


def _integrate(
    plant: WrenchModel,
    r: Recording,
    memory: dict[str, Any] | None,
    command: Callable[[int, State], Commands],
    disturbance: Callable[[int, State], Array],
    progress: Report | None,
    watch: bool = False,
) -> Flown:
    """Fly the window of a recording from its initial state.

    With `watch` the flight ends where control is lost, unless it was lost there in the recorded flight too.
    """
    start, dt, first = r.motion.state, r.dt, r.first
    body = RigidBody(plant.body)
    y = pack(_state_rows(start, slice(first, first + 1)))
    rows: list[tuple[float, ...]] = []
    sent: list[Commands] = []
    wrenches, disturbances = np.zeros((r.count, 6)), np.zeros((r.count, 6))
    stopped = ""
    for k in range(r.count):
        time = float(r.time[first + k])
        now = unpack(time, y, None if start.voltage is None else start.voltage[first + k : first + k + 1])
        if watch:
            stopped = _lost(r, first + k, now)
            if stopped:
                break
        u = command(k, now)
        made, memory = plant.actuate(u, now, dt, memory)
        disturbances[k] = disturbance(k, now)
        wrenches[k] = made[0] + disturbances[k]
        rows.append(y)
        sent.append(u)
        y = body.step(y, wrenches[k], dt)
        if progress is not None and k % 200 == 0:
            progress(k / r.count, "")
    table, n = np.array(rows).reshape(-1, 13), len(rows)
    voltage = None if start.voltage is None else start.voltage[first : first + n]
    state = State(r.time[first : first + n], table[:, :3], table[:, 3:7], table[:, 7:10], table[:, 10:], voltage)
    return Flown(state, _stacked(sent), wrenches[:n], disturbances[:n], stopped)


def _lost(r: Recording, k: int, now: State) -> str:
    """Why the re-flight ends here, or nothing. Where the recorded flight had lost control, so may this one."""
    asked = r.reference.sample(k)
    reason = loss_of_control(now, asked)
    finite = bool(np.all(np.isfinite(now.position_E)) and np.all(np.isfinite(now.omega_B)))
    if not reason or (finite and loss_of_control(_state_rows(r.motion.state, slice(k, k + 1)), asked)):
        return ""
    return f"control was lost at {float(now.time[0]):.2f} s: {reason}; the re-flight ends there"


def _stacked(sent: list[Commands]) -> Commands:
    tilts = [u.tilt for u in sent if u.tilt is not None]
    speeds = [u.rotor_speed for u in sent if u.rotor_speed is not None]
    return Commands(
        np.concatenate([u.wrench_B for u in sent]),
        np.concatenate(tilts) if tilts else None,
        np.concatenate(speeds) if speeds else None,
    )


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
        return _with_offsets(self.believed, commanded[None], allocated, i.tilt_offset[one], i.speed_offset[one])


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
    """
    model = inference.model if plant is None else plant
    pilot = _Pilot(
        inference,
        inference.model.controller if gains is None else gains,
        inference.model.vehicle if believed is None else believed,
        compensator,
    )
    flown = _integrate(
        model.wrench_model,
        inference.recording,
        inference.memory,
        pilot,
        lambda k, now: inference.disturbance[k],
        progress,
        watch=True,
    )
    return Reflight(flown, np.array(pilot.desired).reshape(-1, 6), tuple(pilot.steps), model)


# --- how good it is ---------------------------------------------------------------------------------------------------


def null_error(inference: Inference, null: Reflight) -> dict[str, float]:
    """How far the null run is from the recorded odometry: attitude [deg] and position [m], largest and rms."""
    odometry, state = inference.recording.odometry, null.flown.state
    inside = (odometry.time >= state.time[0] - 1e-6) & (odometry.time <= state.time[-1] + 1e-6)
    stamps = odometry.time[inside]
    position = np.stack([np.interp(stamps, state.time, c) for c in state.position_E.T], axis=-1)
    quat = so3.interpolate(stamps, state.time, state.quat_EB)
    angle = np.degrees(np.linalg.norm(so3.log(so3.multiply(so3.conjugate(odometry.quat_EB[inside]), quat)), axis=-1))
    distance = np.linalg.norm(position - odometry.position_E[inside], axis=-1)
    return {
        "attitude_deg_max": float(angle.max()),
        "attitude_deg_rms": float(np.sqrt(np.mean(angle**2))),
        "position_m_max": float(distance.max()),
        "position_m_rms": float(np.sqrt(np.mean(distance**2))),
        "duration_s": len(state.time) * inference.recording.dt,
    }


def tracking(time: Array, position_E: Array, quat_EB: Array, reference: Reference) -> dict[str, Any]:
    """Tracking errors of N samples: e_R per axis (see `plant.controller`) and distance from the reference."""
    e = np.abs(attitude_error(so3.matrix(quat_EB), so3.matrix(reference.quat_ED)))
    distance = np.linalg.norm(position_E - reference.position_E, axis=-1)
    return {
        "attitude_error": {
            "mean_abs": e.mean(axis=0).tolist(),
            "median_abs": np.median(e, axis=0).tolist(),
            "rms": np.sqrt(np.mean(e**2, axis=0)).tolist(),
        },
        "position_error_m": {
            "mean": float(distance.mean()),
            "median": float(np.median(distance)),
            "rms": float(np.sqrt(np.mean(distance**2))),
            "max": float(distance.max()),
        },
        "duration_s": float(time[-1] - time[0]),
    }


def tracking_of(inference: Inference, flown: Reflight | None = None) -> dict[str, Any]:
    """Tracking errors of a re-flight, or of the recorded flight by its odometry."""
    r = inference.recording
    if flown is not None:
        state, rows = flown.flown.state, slice(r.first, r.first + len(flown.flown.state.time))
        return tracking(state.time, state.position_E, state.quat_EB, _reference_rows(r.reference, rows))
    times, odometry = r.time[r.window], r.odometry
    inside = (odometry.time >= times[0] - 1e-6) & (odometry.time <= times[-1] + 1e-6)
    stamps = odometry.time[inside]
    assert r.flight.reference is not None
    asked = Recorded(r.flight.reference, start=0.0).at(stamps)
    return tracking(stamps, odometry.position_E[inside], odometry.quat_EB[inside], asked)


# --- the whole --------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Change:
    """What is different in the re-flight; nothing by default.

    plant        effects and vehicle that fly
    gains        of the control law
    believed     vehicle that controller and allocation assume
    compensator  in the loop
    words        the same for tables and provenance
    """

    plant: Model | None = None
    gains: ControllerGains | None = None
    believed: Vehicle | None = None
    compensator: Compensates | None = None
    words: tuple[str, ...] = ()


@dataclass(frozen=True)
class Counterfactual:
    """An inference, its null run, and the re-flight with the change (the null run itself where nothing changed).

    `uncompensated` is the re-flight with all of the change but its compensator: what the compensated one is to be
    compared with. It is the null run where nothing else was changed, None where no compensator flew.
    """

    inference: Inference
    null: Reflight
    changed: Reflight
    change: Change
    uncompensated: Reflight | None = None

    @cached_property
    def null_run(self) -> dict[str, float]:
        """Errors of the null run, see `null_error`."""
        return null_error(self.inference, self.null)

    @cached_property
    def tracking(self) -> dict[str, dict[str, Any]]:
        """Tracking errors of the recorded flight, the null run, the uncompensated one if any, the counterfactual."""
        flown = {"null_run": self.null, "uncompensated": self.uncompensated, "counterfactual": self.changed}
        of = {name: tracking_of(self.inference, one) for name, one in flown.items() if one is not None}
        return {"recorded": tracking_of(self.inference), **of}

    @cached_property
    def content(self) -> dict[str, Any]:
        """The result as it goes into JSON (docs/json.md, wrenchgap.counterfactual/1)."""
        r = self.inference.recording
        return {
            "flight": r.flight.name,
            "model": self.inference.model.name,
            "changes": list(self.change.words),
            "start_s": float(r.time[r.first]),
            "null_run": self.null_run,
            "tracking": self.tracking,
            "axes": list(AXES),
            "disturbance": self.inference.statistics,
            "controller_explained": self.inference.explained.tolist(),
            "lost": self.changed.flown.stopped or None,
            "notes": list(self.notes),
        }

    @property
    def notes(self) -> tuple[str, ...]:
        """What a reader must know before believing the numbers."""
        r, found = self.inference.recording, [*self.inference.recording.notes]
        null, explained = self.null_run, self.inference.explained
        if self.null.flown.stopped:
            found.append(f"{r.flight.name}: in the null run {self.null.flown.stopped}")
        if null["attitude_deg_max"] > ATTITUDE_GOAL_DEG or null["position_m_max"] > POSITION_GOAL_M:
            found.append(
                f"{r.flight.name}: the null run is {null['attitude_deg_max']:.2f} deg and "
                f"{100 * null['position_m_max']:.1f} cm off the recorded flight at most (goal {ATTITUDE_GOAL_DEG} deg, "
                f"{100 * POSITION_GOAL_M:.0f} cm): IMU and odometry disagree, or the log is too coarse"
            )
        weak = [axis for axis, share in zip(AXES, explained, strict=True) if share < EXPLAINED_GOAL]
        if weak:
            found.append(
                f"{r.flight.name}: the control law of {self.inference.model.name} explains less than "
                f"{100 * EXPLAINED_GOAL:.0f} % of the recorded {', '.join(weak)}: there the re-flight's feedback is a "
                "guess; set [controller] to the gains that flew"
            )
        if self.changed.flown.stopped and self.changed is not self.null:
            found.append(f"{r.flight.name}: {self.changed.flown.stopped}")
        return tuple(dict.fromkeys(found))

    @property
    def log(self) -> Flight:
        """The re-flight as a flight on the recorded time base."""
        return as_flight(self.inference, self.changed)

    @property
    def series(self) -> tuple[flight.Named, ...]:
        """What is written beside the flight: disturbance, and what a compensator did."""
        time, steps = self.changed.flown.state.time, self.changed.steps
        named = [
            flight.Named("/disturbance", time, self.changed.flown.disturbance),
            flight.Named("/correction", time, self.changed.commanded - self.changed.desired),
        ]
        for what in ("sigma", "beta", "cost", "iterations") if steps else ():
            values = np.array([float(getattr(step, what)) for step in steps])
            named.append(flight.Named(f"/{what}", time, values))
        return tuple(named)


def counterfactual(
    recording: Recording,
    model: Model,
    change: Change | None = None,
    *,
    cutoff_hz: float = CUTOFF_HZ,
    progress: Report | None = None,
) -> Counterfactual:
    """Infer, fly the null run, and fly again with the change."""
    change = change or Change()
    report = progress or (lambda fraction, words: None)

    def stage(begin: float, end: float, words: str) -> Report:
        return lambda fraction, _: report(begin + (end - begin) * fraction, words)

    inference = infer(recording, model, cutoff_hz=cutoff_hz, progress=stage(0.0, 0.3, "inferring the disturbance"))
    null = refly(inference, progress=stage(0.3, 0.5, "null run"))

    def fly(compensator: Compensates | None, begin: float, end: float) -> Reflight:
        return refly(
            inference,
            change.plant,
            gains=change.gains,
            believed=change.believed,
            compensator=compensator,
            progress=stage(begin, end, "counterfactual"),
        )

    others = any(item is not None for item in (change.plant, change.gains, change.believed))
    plain = fly(None, 0.5, 0.7) if others else null
    if change.compensator is None:
        return Counterfactual(inference, null, plain, change)
    return Counterfactual(inference, null, fly(change.compensator, 0.7, 1.0), change, uncompensated=plain)


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
    asked = _reference_rows(r.reference, slice(r.first, r.first + n))
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
