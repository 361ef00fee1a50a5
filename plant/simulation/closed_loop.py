"""One closed loop: commands from period to period, actuators and effects, disturbance, rigid body.

    command at t_k -> command effects, h(u), thrust and wrench effects, + disturbance -> rigid body -> state at t_k+1

Simulation, inference of a disturbance and re-simulation of a log all step through `fly`; they differ in the stages
(`plant.simulation.loop`) that command and disturb.

Stamps. A command stamped t_k is computed from what is known at t_k, without delay, and held until t_{k+1}: held
signals are piecewise constant, and what a period sees is the value at its beginning. Pose and gyroscope read the state
at their stamp. A force jumps where a command does; the accelerometer reads the mean of the values just before and after
its stamp (`around_stamps`), as an IMU that averages over its sample interval does. So commands and readings are aligned
without a half-sample bias. Conversely, what was read at the stamps acts over the period between two of them as their
mean (`over_periods`).

The wrench is evaluated once per step and held in B over it; the rigid body is integrated by fourth-order Runge-Kutta.
State-dependent effects are therefore first-order accurate in the step.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.errors import UsageError
from wrenchgap.flight.flight import Array
from wrenchgap.plant.rigid_body import NUMBERS, RigidBody, pack, unpack
from wrenchgap.plant.simulation.loop import Loop, Signals, Stage
from wrenchgap.plant.state import Commands, State
from wrenchgap.plant.trace.arrays import Untraceable
from wrenchgap.plant.trace.effects import leaves, rebuilt, written
from wrenchgap.plant.trajectory import Reference
from wrenchgap.plant.vehicle import GRAVITY
from wrenchgap.plant.wrench_model import WrenchModel

LOST_POSITION, LOST_ATTITUDE = 5.0, np.radians(100.0)
"""Errors [m], [rad] beyond which control counts as lost and the flight ends."""
What = Literal["state", "position", "attitude"]
LOST: dict[float, What] = {1.0: "state", 2.0: "position", 3.0: "attitude"}
"""What control is lost in, by its number; 0 where it is not."""
REMEMBERING = 2
"""Steps after which effects remember all that they ever will."""


@dataclass(frozen=True)
class Clock:
    """S steps that begin at `time` (S,), `dt` apart [s]; a new command every `per_command` of them.

    `voltage` (S,) is the battery's [V], None where unknown.
    """

    time: Array
    dt: float
    per_command: int = 1
    voltage: Array | None = None

    @property
    def period(self) -> float:
        """For how long a command is held [s]."""
        return self.dt * self.per_command


@dataclass(frozen=True)
class Lost:
    """When [s] control was lost, and in what: `size` is in m, in rad, or nan."""

    time: float
    what: What
    size: float

    def __str__(self) -> str:
        reason = {
            "position": f"{self.size:.1f} m from the reference",
            "attitude": f"{np.degrees(self.size):.0f} deg from the reference",
            "state": "the state is not finite",
        }[self.what]
        return f"control was lost at {self.time:.2f} s: {reason}"


@dataclass(frozen=True)
class Flown:
    """S steps of a flight: states at their beginning, total wrench (S, 6) and disturbance (S, 6) about O.

    `commands` (K) are those that were held, `lost` says why the flight ended early, `plainly` why it was not compiled
    where it might have been.
    """

    clock: Clock
    state: State
    commands: Commands
    wrench: Array
    disturbance: Array
    lost: Lost | None = None
    plainly: str = ""

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
    plain: bool = False,
    progress: Callable[[float], None] | None = None,
) -> tuple[Flown, Loop]:
    """Fly from `start` (N = 1) until the clock ends, or until a stage says that control was lost.

    stages   what comes before the plant in each step; the one called "command" logs `commanded`, and where there are
             rotors `tilt` and `speed`
    signals  that they make, with their first values; the plant looks at "commanded" (6,), "tilt" (A,) [rad], "speed"
             (R,) [rad/s], "disturbance" (6,), an extra wrench about O in B; "lost" (2,) ends the flight
    memory   of the plant's command effects before the first step
    plain    everything is called in numpy

    The loop has the logs of all stages. Raises UsageError where control is lost at the start.
    """
    rotors = plant.vehicle.has_rotors and "speed" in signals
    actuators = _Actuators(plant, clock, replace(start, voltage=None), memory, rotors)
    body = RigidBody(plant.body, gravity)

    def move(now: Signals, _: Array) -> Signals:
        return {"began": now["state"], "state": body.step(now["state"], now["wrench"], clock.dt)}

    own = {"state": pack(start), "began": np.zeros(NUMBERS), "wrench": np.zeros(6), "effects": np.zeros(actuators.size)}
    rest = {"disturbance": np.zeros(6), "lost": np.zeros(2)}
    moving = Stage("body", move, np.zeros((len(clock.time), 0)), log=("began", "wrench", "disturbance"))
    loop = Loop(own | rest | dict(signals), [*stages, actuators.stage, moving], len(clock.time), "lost", plain)
    count, stopped = loop.run(progress)
    lost = None
    if stopped:
        kind, size = loop.now("lost").tolist()
        lost = Lost(float(clock.time[count]), LOST[kind], size)
        if count == 0:
            raise UsageError(f"{lost}: the flight cannot begin there; start nearer to the reference")
    rows, wrench, disturbance = (loop.logged("body", name, count) for name in moving.log)
    periods = -(-count // clock.per_command)
    names = ("commanded", "tilt", "speed") if rotors else ("commanded",)
    sent = Commands(*(loop.logged("command", name, periods) for name in names))
    state = unpack(clock.time[:count], rows, None if clock.voltage is None else clock.voltage[:count])
    return Flown(clock, state, sent, wrench, disturbance, lost, next(iter(loop.called.values()), "")), loop


def replayed(commands: Commands, every: int = 1) -> tuple[Stage, dict[str, Array]]:
    """The stage that sends commands (K), one at every `every`-th step whatever the state, and its signals."""
    named = {"commanded": commands.wrench_B, "tilt": commands.tilt, "speed": commands.rotor_speed}
    sent = {name: values for name, values in named.items() if values is not None}
    ends = np.cumsum([values.shape[1] for values in sent.values()])[:-1]

    def act(_: Signals, row: Array) -> Signals:
        return dict(zip(sent, np.split(row, ends), strict=True))

    stage = Stage("command", act, np.hstack(list(sent.values())), every, tuple(sent))
    return stage, {name: np.zeros(values.shape[1]) for name, values in sent.items()}


def disturbed(disturbance: Array) -> Stage:
    """The stage that disturbs with extra wrenches (S, 6) about O in B, one at every step."""
    return Stage("disturbance", lambda now, row: {"disturbance": row}, disturbance)


class _Actuators:
    """The stage from commands to the wrench about O, disturbance included: all effects on commands, thrusts, wrench.

    What effects remember has its form after the first steps; until then, and where an effect cannot be written down, it
    is kept here, and else among the signals.
    """

    def __init__(
        self, plant: WrenchModel, clock: Clock, start: State, memory: dict[str, Any] | None, rotors: bool
    ) -> None:
        self.plant, self.dt, self.voltage, self.memory, self.rotors = plant, clock.dt, clock.voltage, memory, rotors
        given = np.column_stack(
            (clock.time, np.full(len(clock.time), np.nan) if self.voltage is None else self.voltage)
        )
        self.form = self._remembered(replace(start, voltage=None if self.voltage is None else self.voltage[:1]))
        self.size = sum(np.size(leaf) for leaf in leaves(self.form))
        self.stage = Stage(
            "actuators",
            self._called,
            given,
            calls=REMEMBERING if self.size else 0,
            written=self._written,
            foreign=True,
        )

    def _remembered(self, state: State) -> dict[str, Any]:
        """What effects remember after some steps; only its form counts, and rotors at rest may divide by zero."""
        arms, rotors = self.plant.vehicle.geometry() if self.rotors else ((), ())
        there = (np.zeros((1, len(arms))), np.zeros((1, len(rotors)))) if self.rotors else ()
        commands = Commands(np.array([[0.0, 0.0, self.plant.body.mass * GRAVITY, 0.0, 0.0, 0.0]]), *there)
        memory = dict(self.memory or {})
        with np.errstate(all="ignore"):
            for _ in range(REMEMBERING):
                _, memory = self.plant.actuate(commands, state, self.dt, memory)
        return memory

    def _wrench(self, plant: WrenchModel, now: Signals, row: Array, memory: Any) -> tuple[Array, dict[str, Any]]:
        state = unpack(row[:1], now["state"][None], None if self.voltage is None else row[1:])
        names = ("commanded", "tilt", "speed") if self.rotors else ("commanded",)
        wrench, after = plant.actuate(Commands(*(now[name][None] for name in names)), state, self.dt, memory)
        return wrench[0] + now["disturbance"], after

    def _called(self, now: Signals, row: Array) -> Signals:
        wrench, self.memory = self._wrench(self.plant, now, row, self.memory)
        numbers = np.concatenate([np.zeros(0), *(np.ravel(leaf) for leaf in leaves(self.memory))])
        whole = [np.shape(one) for one in leaves(self.memory)] == [np.shape(one) for one in leaves(self.form)]
        return {"wrench": wrench} | ({"effects": numbers} if whole else {})

    def _written(self, now: Signals, row: Array) -> Signals:
        place = 0

        def leaf(like: Any) -> Array:
            nonlocal place
            place += np.size(like)
            return now["effects"][place - np.size(like) : place].reshape(np.shape(like))

        wrench, after = self._wrench(written(self.plant), now, row, rebuilt(self.form, leaf))
        if [np.shape(one) for one in leaves(after)] != [np.shape(one) for one in leaves(self.form)]:
            raise Untraceable("effects remember more from step to step")
        parts = [np.asarray(one, dtype=object).ravel() for one in leaves(after)]
        return {"wrench": wrench, "effects": np.concatenate([np.zeros(0, dtype=object), *parts])}


def loss_of_control(state: State, reference: Reference) -> tuple[Array, Array]:
    """In what control counts as lost (N,), a number of `LOST`, and how far off [m, rad], for N samples."""
    offset = state.position_E - reference.position_E
    far = np.sqrt(np.sum(offset * offset, axis=1))
    # |<q, p>| = cos(angle / 2)
    same = np.minimum(np.abs(np.sum(state.quat_EB * reference.quat_ED, axis=1)), 1.0)
    angle = 2.0 * np.arccos(same)
    largest = np.finfo(float).max
    finite = (far <= largest) & (np.sum(np.abs(state.omega_B), axis=1) <= largest)
    turned = np.where(angle > LOST_ATTITUDE, 3.0, 0.0)
    kind = np.where(finite, np.where(far > LOST_POSITION, 2.0, turned), 1.0)
    return kind, np.where(kind < 2.0, np.nan, np.where(kind < 3.0, far, angle))


def watch(reference: Reference, clock: Clock, forgiven: NDArray[np.bool_] | None = None) -> Stage:
    """The stage that ends the flight where control is lost against a reference (K).

    In the periods of `forgiven` (K,) it is lost only where the state is not finite.
    """
    count = len(reference.time)
    excused = np.zeros(count) if forgiven is None else np.asarray(forgiven, dtype=float)

    def act(now: Signals, row: Array) -> Signals:
        rows = row[None]
        asked = replace(reference, position_E=rows[:, :3], quat_ED=rows[:, 3:7])
        kind, size = loss_of_control(unpack(reference.time[:1], now["state"][None]), asked)
        return {"lost": np.concatenate((np.where((kind > 1.0) & (rows[:, 7] > 0.0), 0.0, kind), size))}

    return Stage(
        "watch", act, np.column_stack((reference.position_E, reference.quat_ED, excused)), every=clock.per_command
    )


def around_stamps(held: Array) -> Array:
    """Mean (S, C) of the values just before and after each stamp, of a signal held from stamp to stamp (S, C)."""
    return np.concatenate((held[:1], 0.5 * (held[1:] + held[:-1])))


def over_periods(read: Array) -> Array:
    """Mean (S, C) over the period that begins at each stamp, of a signal read at the stamps (S, C)."""
    return np.concatenate((0.5 * (read[:-1] + read[1:]), read[-1:]))
