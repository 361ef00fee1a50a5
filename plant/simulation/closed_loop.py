"""One closed loop: commands from period to period, actuators and effects, disturbance, rigid body.

    command at t_k -> command effects, h(u), thrust and wrench effects, + disturbance -> rigid body -> state at t_k+1

Simulation, inference of a disturbance and re-simulation of a log all step through `fly`; they differ in the stages
(`plant.simulation.loop`) that command and disturb.

Stamps. A command stamped t_k is computed from what is known at t_k, without delay, and held until t_{k+1}: held
signals are piecewise constant, and what a period sees is the value at its beginning. Pose and gyroscope read the state
at their stamp. A force jumps where a command does; the accelerometer reads the mean of the values just before and after
its stamp (`mean_around_stamps`), as an IMU that averages over its sample interval does. So commands and readings are
aligned without a half-sample bias. Conversely, a signal that was read at the stamps acts over the period between two of
them as their mean (`mean_over_periods`).

The wrench is evaluated once per step and held in B over it; the rigid body is integrated by fourth-order Runge-Kutta.
State-dependent effects are therefore first-order accurate in the step.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal

import numpy as np

from wrenchgap.flight.errors import UsageError
from wrenchgap.flight.flight import Array, Mask
from wrenchgap.plant.rigid_body import NUMBERS, RigidBody, pack, unpack
from wrenchgap.plant.simulation.loop import Loop, Signals, Stage
from wrenchgap.plant.state import Commands, State
from wrenchgap.plant.trace.arrays import Untraceable, memory_arrays, memory_of_arrays, traced_model
from wrenchgap.plant.trajectory import Reference
from wrenchgap.plant.vehicle import GRAVITY
from wrenchgap.plant.wrench_model import WrenchModel

LostIn = Literal["state", "position", "attitude"]
LOST: dict[float, LostIn] = {1.0: "state", 2.0: "position", 3.0: "attitude"}
"""What diverged when control was lost, by the number in the signal "lost"; 0 while control is not lost."""


@dataclass(frozen=True)
class Clock:
    """S steps that begin at `time` (S,) [s], `dt` [s] apart; a new command every `per_command` steps.

    `voltage` (S,) [V] is that of the battery, None where it is unknown.
    """

    time: Array
    dt: float
    per_command: int = 1
    voltage: Array | None = None

    @property
    def period(self) -> float:
        """The period [s] for which a command is held."""
        return self.dt * self.per_command


@dataclass(frozen=True)
class Lost:
    """The time [s] at which control was lost, what diverged, and its error [m] or [rad], nan for a state."""

    time: float
    what: LostIn
    size: float

    def __str__(self) -> str:
        reason = {
            "position": f"{self.size:.1f} m from the reference",
            "attitude": f"{np.degrees(self.size):.0f} deg from the reference",
            "state": "the state is not finite",
        }[self.what]
        return f"control was lost at {self.time:.2f} s: {reason}"


@dataclass(frozen=True)
class LoopFlight:
    """S steps of a flight: states at their beginning, total wrench (S, 6) and disturbance (S, 6) about O.

    `commands` (K) were held for a period each. `lost` says why the flight ended early, `not_compiled` why a stage with
    user code was called in numpy.
    """

    clock: Clock
    state: State
    commands: Commands
    wrench: Array
    disturbance: Array
    lost: Lost | None = None
    not_compiled: str = ""

    @property
    def command_time(self) -> Array:
        """Stamps (K,) of the commands [s]."""
        return self.state.time[:: self.clock.per_command]


def fly(
    plant: WrenchModel,
    start: State,
    clock: Clock,
    stages: Sequence[Stage],
    signals: Signals,
    *,
    memory: dict[str, Any] | None = None,
    gravity: float = GRAVITY,
    compiled: bool = True,
    progress: Callable[[float], None] | None = None,
) -> tuple[LoopFlight, Loop]:
    """Fly from `start` (N = 1) until the clock ends, or until a stage reports that control was lost.

    Parameters
    ----------
    stages
        What acts before the plant in each step. The one named "command" logs "commanded", and where there are rotors
        "tilt" and "speed".
    signals
        Those that the stages set, with their first values. The plant reads "commanded" (6,) [N, Nm], "tilt" (A,) [rad],
        "speed" (R,) [rad/s] and "disturbance" (6,), an extra wrench about O in B; "lost" (2,) ends the flight.
    memory
        Of the plant's command effects before the first step.
    compiled
        False: every stage is called in numpy.

    Returns
    -------
    tuple[LoopFlight, Loop]
        The flight, and the loop with the logs of all stages.

    Raises
    ------
    UsageError
        Where control is lost at the start.
    """
    rotors = plant.vehicle.has_rotors and "speed" in signals
    actuators = _Actuators(plant, clock, replace(start, voltage=None), memory, rotors)
    body = RigidBody(plant.body, gravity)

    def move(now: Signals, _: Array) -> Signals:
        return {"began": now["state"], "state": body.step(now["state"], now["wrench"], clock.dt)}

    own = {"state": pack(start), "began": np.zeros(NUMBERS), "wrench": np.zeros(6), "effects": np.zeros(actuators.size)}
    others = {"disturbance": np.zeros(6), "lost": np.zeros(2)}
    moving = Stage("body", move, np.zeros((len(clock.time), 0)), log=("began", "wrench", "disturbance"))
    loop = Loop(own | others | dict(signals), [*stages, actuators.stage, moving], len(clock.time), "lost", compiled)
    count, stopped = loop.run(progress)
    kind, size = loop.now("lost").tolist()
    lost = Lost(float(clock.time[count]), LOST[kind], size) if stopped else None
    if lost is not None and count == 0:
        raise UsageError(f"{lost}: the flight cannot begin there; start nearer to the reference")
    rows, wrench, disturbance = (loop.logged("body", name, count) for name in moving.log)
    periods = -(-count // clock.per_command)
    names = ("commanded", "tilt", "speed") if rotors else ("commanded",)
    sent = Commands(*(loop.logged("command", name, periods) for name in names))
    state = unpack(clock.time[:count], rows, None if clock.voltage is None else clock.voltage[:count])
    return LoopFlight(clock, state, sent, wrench, disturbance, lost, next(iter(loop.not_compiled.values()), "")), loop


def command_stage(commands: Commands, every: int = 1) -> tuple[Stage, dict[str, Array]]:
    """The stage that sends commands (K), one at every `every`-th step, and its signals with their first values."""
    named = {"commanded": commands.wrench_B, "tilt": commands.tilt, "speed": commands.rotor_speed}
    sent = {name: values for name, values in named.items() if values is not None}
    ends = np.cumsum([values.shape[1] for values in sent.values()])[:-1]

    def act(_: Signals, row: Array) -> Signals:
        return dict(zip(sent, np.split(row, ends), strict=True))

    stage = Stage("command", act, np.hstack(list(sent.values())), every, tuple(sent))
    return stage, {name: np.zeros(values.shape[1]) for name, values in sent.items()}


def disturbance_stage(disturbance: Array) -> Stage:
    """The stage that adds wrenches (S, 6) about O in B, one at every step."""
    return Stage("disturbance", lambda now, row: {"disturbance": row}, disturbance)


def accelerometer_stage(plant: WrenchModel, clock: Clock, every: int = 1, errors: Array | None = None) -> Stage:
    """The stage that reads the specific force of O (3,) at every `every`-th step, with `errors` (N, 3) if any.

    It is that of the step before, which is the last that a flight computer can know of.
    """
    voltage = np.full(len(clock.time), np.nan) if clock.voltage is None else clock.voltage
    rows = np.column_stack((clock.time, voltage))[::every]
    errors = np.zeros((len(rows), 3)) if errors is None else errors

    def read(model: WrenchModel, now: Signals, row: Array) -> Signals:
        state = unpack(row[:1], now["state"][None], None if clock.voltage is None else row[1:2])
        motion = model.read_imu(model.motion(now["wrench"][None], state.omega_B), state)
        return {"accelerometer": motion.specific_force_B[0] + row[2:]}

    return Stage(
        "accelerometer", partial(read, plant), np.hstack((rows, errors)), every,
        traced=lambda now, row: read(traced_model(plant), now, row), user_code=True,
    )  # fmt: skip


class _Actuators:
    """The stage from commands to the wrench about O, disturbance included: all effects on commands, thrusts, wrench.

    The memory of the effects has its final shapes after `settling` steps. Until then, and where an effect cannot be
    traced, it is an attribute; afterwards it is the signal "effects".
    """

    settling = 2

    def __init__(
        self, plant: WrenchModel, clock: Clock, start: State, memory: dict[str, Any] | None, rotors: bool
    ) -> None:
        self.plant, self.dt, self.voltage, self.memory, self.rotors = plant, clock.dt, clock.voltage, memory, rotors
        voltage = np.full(len(clock.time), np.nan) if self.voltage is None else self.voltage
        self.form = self._memory_after_steps(replace(start, voltage=None if self.voltage is None else self.voltage[:1]))
        self.size = sum(np.size(array) for array in memory_arrays(self.form))
        self.stage = Stage(
            "actuators", self._numpy_step, np.column_stack((clock.time, voltage)),
            numpy_steps=self.settling if self.size else 0, traced=self._traced_step, user_code=True,
        )  # fmt: skip

    def _memory_after_steps(self, state: State) -> dict[str, Any]:
        """Memory of the effects after `settling` steps, for its shapes alone: rotors at rest may divide by zero."""
        arms, rotors = self.plant.vehicle.geometry() if self.rotors else ((), ())
        there = (np.zeros((1, len(arms))), np.zeros((1, len(rotors)))) if self.rotors else ()
        commands = Commands(np.array([[0.0, 0.0, self.plant.body.mass * GRAVITY, 0.0, 0.0, 0.0]]), *there)
        memory = dict(self.memory or {})
        with np.errstate(all="ignore"):
            for _ in range(self.settling):
                _, memory = self.plant.actuate(commands, state, self.dt, memory)
        return memory

    def _wrench(self, plant: WrenchModel, now: Signals, row: Array, memory: Any) -> tuple[Array, dict[str, Any]]:
        state = unpack(row[:1], now["state"][None], None if self.voltage is None else row[1:])
        names = ("commanded", "tilt", "speed") if self.rotors else ("commanded",)
        wrench, after = plant.actuate(Commands(*(now[name][None] for name in names)), state, self.dt, memory)
        return wrench[0] + now["disturbance"], after

    def _numpy_step(self, now: Signals, row: Array) -> Signals:
        wrench, self.memory = self._wrench(self.plant, now, row, self.memory)
        if _shapes(self.memory) != _shapes(self.form):
            return {"wrench": wrench}
        values = [np.zeros(0), *(np.ravel(array) for array in memory_arrays(self.memory))]
        return {"wrench": wrench, "effects": np.concatenate(values)}

    def _traced_step(self, now: Signals, row: Array) -> Signals:
        ends = np.cumsum([np.size(array) for array in memory_arrays(self.form)], dtype=int)
        parts = iter(np.split(now["effects"], ends[:-1]))
        memory = memory_of_arrays(self.form, lambda like: next(parts).reshape(np.shape(like)))
        wrench, after = self._wrench(traced_model(self.plant), now, row, memory)
        if _shapes(after) != _shapes(self.form):
            raise Untraceable("the memory of effects changes its shape from step to step")
        values = [np.asarray(one, dtype=object).ravel() for one in memory_arrays(after)]
        return {"wrench": wrench, "effects": np.concatenate([np.zeros(0, dtype=object), *values])}


def _shapes(memory: Any) -> list[tuple[int, ...]]:
    return [np.shape(array) for array in memory_arrays(memory)]


def loss_of_control(
    state: State, reference: Reference, position_limit: float = 5.0, attitude_limit: float = float(np.radians(100.0))
) -> tuple[Array, Array]:
    """What diverged (N,), a number of `LOST`, and the size of its error [m, rad], for N samples.

    `position_limit` [m] and `attitude_limit` [rad] are far beyond any error from which a flight recovers.
    """
    offset = state.position_E - reference.position_E
    far = np.sqrt(np.sum(offset * offset, axis=1))
    same = np.abs(np.sum(state.quat_EB * reference.quat_ED, axis=1))  # cos(angle / 2)
    angle = 2.0 * np.arccos(np.minimum(same, 1.0))
    largest = np.finfo(float).max
    finite = (far <= largest) & (np.sum(np.abs(state.omega_B), axis=1) <= largest)
    turned = np.where(angle > attitude_limit, 3.0, 0.0)
    kind = np.where(finite, np.where(far > position_limit, 2.0, turned), 1.0)
    return kind, np.where(kind < 2.0, np.nan, np.where(kind < 3.0, far, angle))


def loss_of_control_stage(reference: Reference, clock: Clock, forgiven: Mask | None = None) -> Stage:
    """The stage that ends the flight where control is lost against a reference (K).

    In the periods of `forgiven` (K,) control is lost only where the state is not finite.
    """
    excused = np.zeros(len(reference.time)) if forgiven is None else np.asarray(forgiven, dtype=float)

    def act(now: Signals, row: Array) -> Signals:
        rows = row[None]
        target = replace(reference, position_E=rows[:, :3], quat_ED=rows[:, 3:7])
        kind, size = loss_of_control(unpack(reference.time[:1], now["state"][None]), target)
        return {"lost": np.concatenate((np.where((kind > 1.0) & (rows[:, 7] > 0.0), 0.0, kind), size))}

    rows = np.column_stack((reference.position_E, reference.quat_ED, excused))
    return Stage("watch", act, rows, every=clock.per_command)


def mean_around_stamps(held: Array) -> Array:
    """Mean (S, C) of the values just before and after each stamp, of a signal held from stamp to stamp (S, C)."""
    return np.concatenate((held[:1], 0.5 * (held[1:] + held[:-1])))


def mean_over_periods(read: Array) -> Array:
    """Mean (S, C) over the period that begins at each stamp, of a signal read at the stamps (S, C)."""
    return np.concatenate((0.5 * (read[:-1] + read[1:]), read[-1:]))
