"""One closed loop: commands from period to period, actuators and effects, disturbance, rigid body.

    command at t_k -> command effects, h(u), thrust and wrench effects, + disturbance -> rigid body -> state at t_k+1

Simulation, inference of a disturbance and re-simulation of a log all step through `fly`; they differ in who commands
and what disturbs.

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

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.errors import UsageError
from wrenchgap.flight.flight import Array
from wrenchgap.plant.rigid_body import RigidBody, pack, unpack
from wrenchgap.plant.state import Commands, State, joined
from wrenchgap.plant.trajectory import Reference
from wrenchgap.plant.vehicle import GRAVITY
from wrenchgap.plant.wrench_model import WrenchModel

LOST_POSITION, LOST_ATTITUDE = 5.0, np.radians(100.0)
"""Errors [m], [rad] beyond which control counts as lost and the flight ends."""


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
    what: Literal["position", "attitude", "state"]
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

    `commands` (K) are those that were held, `lost` says why the flight ended early.
    """

    clock: Clock
    state: State
    commands: Commands
    wrench: Array
    disturbance: Array
    lost: Lost | None = None

    @property
    def command_time(self) -> Array:
        """Stamps (K,) of the commands [s]."""
        return self.state.time[:: self.clock.per_command]


def fly(
    plant: WrenchModel,
    start: State,
    clock: Clock,
    command: Callable[[int, State], Commands],
    *,
    disturbance: Callable[[int, State], Array] | None = None,
    memory: dict[str, Any] | None = None,
    observe: Callable[[int, State], None] | None = None,
    lost: Callable[[int, State], Lost | None] | None = None,
    gravity: float = GRAVITY,
    progress: Callable[[float], None] | None = None,
) -> Flown:
    """Fly from `start` (N = 1) until the clock ends, or until `lost` says that control was lost.

    command      of period k in a state (N = 1)
    disturbance  extra wrench (6,) about O over step n, in B
    memory       of the plant's command effects before the first step
    observe      is shown every state, before its command
    """
    body, y = RigidBody(plant.body, gravity), pack(start)
    count, sent, over = len(clock.time), list[Commands](), None
    rows, wrenches, disturbances = np.zeros((count, 13)), np.zeros((count, 6)), np.zeros((count, 6))
    voltage = clock.voltage
    for n, time in enumerate(clock.time.tolist()):
        now = unpack(time, y, None if voltage is None else voltage[n : n + 1])
        if observe is not None:
            observe(n, now)
        k, inside = divmod(n, clock.per_command)
        if not inside:
            over = None if lost is None else lost(k, now)
            if over is not None:
                count = n
                break
            sent.append(command(k, now))
        made, memory = plant.actuate(sent[-1], now, clock.dt, memory)
        if disturbance is not None:
            disturbances[n] = disturbance(n, now)
        wrenches[n] = made[0] + disturbances[n]
        rows[n] = y
        y = body.step(y, wrenches[n], clock.dt)
        if progress is not None and n % 200 == 0:
            progress(n / count)
    if not sent:
        raise UsageError(f"{over}: the flight cannot begin there; start nearer to the reference")
    if progress is not None:
        progress(1.0)
    table = rows[:count]
    known = None if voltage is None else voltage[:count]
    state = State(clock.time[:count], table[:, :3], table[:, 3:7], table[:, 7:10], table[:, 10:], known)
    return Flown(clock, state, joined(sent), wrenches[:count], disturbances[:count], over)


def loss_of_control(state: State, reference: Reference) -> Lost | None:
    """Whether control counts as lost in a state (N = 1) that was to follow the reference (N = 1)."""
    time = float(state.time[0])
    position = float(np.linalg.norm(state.position_E - reference.position_E))
    if not np.isfinite(position) or not np.all(np.isfinite(state.omega_B)):
        return Lost(time, "state", np.nan)
    if position > LOST_POSITION:
        return Lost(time, "position", position)
    # |<q, p>| = cos(angle / 2)
    angle = 2.0 * float(np.arccos(min(1.0, abs(float(np.sum(state.quat_EB * reference.quat_ED))))))
    return Lost(time, "attitude", angle) if angle > LOST_ATTITUDE else None


def losses(state: State, reference: Reference) -> NDArray[np.bool_]:
    """Where `loss_of_control` finds any, in K states beside K samples of the reference."""
    far = np.linalg.norm(state.position_E - reference.position_E, axis=1)
    finite = np.isfinite(far) & np.isfinite(state.omega_B).all(axis=1)
    same = np.minimum(1.0, np.abs(np.sum(state.quat_EB * reference.quat_ED, axis=1)))
    return np.asarray(~finite | (far > LOST_POSITION) | (2.0 * np.arccos(same) > LOST_ATTITUDE))


def watch(reference: Reference, recorded: State | None = None) -> Callable[[int, State], Lost | None]:
    """For `fly`: the flight ends where control is lost against a reference (K).

    Where a `recorded` flight (K) had lost control, so may this one.
    """

    def lost(k: int, now: State) -> Lost | None:
        asked = reference.sample(k)
        found = loss_of_control(now, asked)
        if found is None or found.what == "state" or recorded is None:
            return found
        return None if loss_of_control(recorded.take(slice(k, k + 1)), asked) else found

    return lost


def around_stamps(held: Array) -> Array:
    """Mean (S, C) of the values just before and after each stamp, of a signal held from stamp to stamp (S, C)."""
    return np.concatenate((held[:1], 0.5 * (held[1:] + held[:-1])))


def over_periods(read: Array) -> Array:
    """Mean (S, C) over the period that begins at each stamp, of a signal read at the stamps (S, C)."""
    return np.concatenate((0.5 * (read[:-1] + read[1:]), read[-1:]))
