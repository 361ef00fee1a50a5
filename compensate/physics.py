"""Named effects as a mismatch model: what the model of the vehicle says that a command will make, less the command.

    mu(W) = W_model(n(W), state, actuators as they are now) - W

with the allocation n. The wrench is the one that the nominal processing of an IMU reports (`plant.wrench_model`), since
it is accelerations that the controller asks for; effects on the sensors themselves are left out, for what a skewed IMU
reads is not what the vehicle does.

Lags. A command that is held reaches its wrench only after a while. Without `lead` the mismatch is the one in the end,
and lags are not compensated. With a `lead` h [s] it is the one at t + h, with servos and motors starting from where the
commands that were sent have brought them: the solution W then pushes ahead, the more the shorter h. Deadbeat over a
horizon; e.g. Astrom and Wittenmark, "Computer-Controlled Systems", 3rd ed., 4.3. A first-order lag tau is led by
1 / (1 - exp(-h / tau)).

`trace` makes two programs of it: the mismatch of a command, and where a command brings the actuators. Nothing is
written twice: `plant.wrench_model` and the effects' own `apply` run once on arrays that record what is done with them
(`plant.trace.arrays`). Inputs, in this order: the command (6,) [N, Nm]; the state (15,) of `compensate.tables.STATE`;
whether nothing was sent yet (1 or 0); the tilts sent last (A,) [rad]; what follows late remembers (M,), with a `lead`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from wrenchgap.compensate.lbfgs import linearisation
from wrenchgap.compensate.reach import check_hover
from wrenchgap.compensate.tables import STATE
from wrenchgap.flight.errors import UsageError
from wrenchgap.flight.flight import AXES, Array
from wrenchgap.plant.allocation import Allocation
from wrenchgap.plant.effects.effect import CommandEffect, SensorEffect
from wrenchgap.plant.mismatch import MismatchModel, output_indices
from wrenchgap.plant.state import Commands, State, concatenated
from wrenchgap.plant.trace.arrays import Node, Traced, Untraceable, memory_arrays, memory_of_arrays, traced_effect
from wrenchgap.plant.trace.tape import Program, Tape, program
from wrenchgap.plant.vehicle import GRAVITY
from wrenchgap.plant.wrench_model import WrenchModel, about_origin, measured_wrench

STEPS = np.array([1e-3, 1e-3, 1e-3, 1e-4, 1e-4, 1e-4])
"""Steps of numerical derivatives, relative to the weight [N] and the weight times a metre [Nm]."""
HORIZON_MAX = 10.0
"""Longest lead, and delay of commands [s]: each period of it is one step of the model, or is remembered."""


class PhysicsMismatch:
    """The effects of a wrench model on some components of the wrench; a `plant.mismatch.Follows`.

    outputs  names out of `flight.flight.AXES`
    lead     horizon over which lags are led [s]; None: they are not
    """

    needs_state = True

    def __init__(self, model: WrenchModel, outputs: tuple[str, ...], lead: float | None = None) -> None:
        if lead is not None and not 0 < lead <= HORIZON_MAX:
            raise UsageError(f"compensate: lead is {lead} s, expected a positive number of {HORIZON_MAX:g} at most")
        kept = tuple(e for e in model.effects if not isinstance(e.effect, SensorEffect))
        for delay in (one.theta[0] for one in kept if one.name == "command_delay"):
            if not delay <= HORIZON_MAX:
                words = f"command_delay is {delay:g} s, expected {HORIZON_MAX:g} at most"
                raise UsageError(f"compensate: {words}; remove it")
        self.model = WrenchModel(model.vehicle, kept)
        self.outputs, self.lead = outputs, lead
        self.late = any(isinstance(one.effect, CommandEffect) for one in kept)
        output_indices(outputs)
        check_hover(self.model)

    def periods_ahead(self, dt: float) -> float:
        """Periods of `dt` [s] after which the mismatch of a command counts: those of the lead, or one."""
        return 1.0 if self.lead is None else max(1.0, self.lead / dt + 0.5)

    def follow(self, dt: float) -> PhysicsFollower:
        """See `plant.mismatch.Follows`."""
        return PhysicsFollower(self, dt)


class PhysicsFollower:
    """Knows where the actuators are after the commands that were sent."""

    def __init__(self, physics: PhysicsMismatch, dt: float) -> None:
        vehicle = physics.model.vehicle
        self._physics, self._dt = physics, dt
        self._allocation = Allocation(vehicle) if vehicle.has_rotors else None
        self._tilt: Array | None = None
        self._memory: dict[str, Any] | None = None
        self._here: PhysicsHere | None = None

    def model_at(self, state: State | None, /) -> PhysicsHere:
        """See `plant.mismatch.Follower`."""
        if state is None:
            raise UsageError("physics in the compensation needs the state: call Compensator.step(wrench_des, state)")
        self._here = PhysicsHere(self._physics, self._allocation, self._dt, state, self._tilt, self._memory)
        return self._here

    def record(self, wrench_cmd: Array, /) -> None:
        """See `plant.mismatch.Follower`."""
        assert self._here is not None
        commands = self._here.allocated(wrench_cmd[None])
        self._tilt = None if commands.tilt is None else commands.tilt[0]
        if self._physics.lead is not None:
            _, self._memory = self._physics.model.command(commands, self._here.state, self._dt, self._memory)


@dataclass(frozen=True)
class PhysicsHere:
    """The mismatch at one instant; a `plant.mismatch.MismatchModel`.

    `tilt` (A,) and `memory` are where the commands sent so far have brought the arms and what follows late.
    """

    physics: PhysicsMismatch
    allocation: Allocation | None
    dt: float
    state: State
    tilt: Array | None
    memory: dict[str, Any] | None

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the components."""
        return self.physics.outputs

    def mean(self, wrench_cmd: Array, /) -> Array:
        """Expected mismatch (N, L)."""
        return np.concatenate([self._near(row[None]) for row in wrench_cmd])

    def _near(self, wrench_cmd: Array) -> Array:
        """Expected mismatch (N, L) of commands that lie so near each other that their tilt angles do not wrap."""
        model = self.physics.model
        commands = self._effective(self.allocated(wrench_cmd))
        state = self.state.take(np.zeros(len(wrench_cmd), dtype=np.intp))
        predicted = measured_wrench(model.vehicle.body, model.motion(model.wrench(commands, state), state.omega_B))
        return np.asarray((predicted - wrench_cmd)[:, output_indices(self.outputs)])

    def std(self, wrench_cmd: Array, /) -> Array:
        """Zero (N, L): what is uncertain about the effects is left to the process that learns their remainder."""
        return np.zeros((len(wrench_cmd), len(self.outputs)))

    def jacobian(self, wrench_cmd: Array, /) -> Array:
        """Derivative of `mean` (N, L, 6), by forward differences; zero with respect to components not corrected."""
        return np.concatenate([self.mean_and_jacobian(row[None])[1] for row in wrench_cmd])

    def mean_and_jacobian(self, wrench_cmd: Array, /) -> tuple[Array, Array]:
        """Both, for one command (1, 6), in one evaluation of the model."""
        rows = output_indices(self.outputs)
        steps = STEPS[rows] * self.physics.model.vehicle.body.mass * GRAVITY
        candidates = np.repeat(wrench_cmd, 1 + len(rows), axis=0)
        candidates[1 + np.arange(len(rows)), rows] += steps
        values = self._near(candidates)
        jacobian = np.zeros((1, len(rows), len(AXES)))
        jacobian[0][:, rows] = (values[1:] - values[0]).T / steps
        return values[:1], jacobian

    def allocated(self, wrench_cmd: Array) -> Commands:
        """Commands of the actuators for candidates (N, 6), each next after what was sent last."""
        if self.allocation is None:
            return Commands(wrench_cmd)
        about_O = about_origin(self.physics.model.vehicle.body, wrench_cmd)
        return self.allocation.allocate(about_O, previous_tilt=self.tilt)[0]

    def _effective(self, commands: Commands) -> Commands:
        """Candidates as they will have taken effect when held through the lead, or in the end.

        Effects on commands take samples for a signal that is linear in between (`plant.effects.lag`), which a held
        command runs ahead of by half a period.
        """
        model, physics = self.physics.model, self.physics
        if not physics.late:
            return commands
        ahead = physics.periods_ahead(self.dt)
        count = math.ceil(ahead)
        state = self.state.take(np.zeros(count, dtype=np.intp))
        found = []
        for k in range(len(commands.wrench_B)):
            held, _ = model.command(commands.take(np.full(count, k)), state, self.dt, self.memory)
            last, before = held.take(slice(-1, None)), held.take(slice(-2, -1))
            found.append(between(last, before, count - ahead) if count > ahead else last)
        return concatenated(found)


def between(last: Commands, before: Commands, back: float) -> Commands:
    """Commands `back` (0 to 1) samples before the last."""

    def mixed(name: str) -> Any:
        newer, older = getattr(last, name), getattr(before, name)
        return None if newer is None else back * older + (1.0 - back) * newer

    return Commands(*map(mixed, ("wrench_B", "tilt", "rotor_speed")))


@dataclass(frozen=True)
class Fixed:
    """A model that depends on the command alone, as a `Follower`."""

    model: MismatchModel

    def model_at(self, state: State | None, /) -> MismatchModel:
        """See `plant.mismatch.Follower`."""
        return self.model

    def record(self, wrench_cmd: Array, /) -> None:
        """See `plant.mismatch.Follower`."""


@dataclass(frozen=True)
class Sum:
    """Two mismatch models on top of each other; only the second is uncertain."""

    physics: MismatchModel
    process: MismatchModel

    @property
    def outputs(self) -> tuple[str, ...]:
        """Those of both."""
        return self.process.outputs

    def mean(self, wrench_cmd: Array, /) -> Array:
        """See `plant.mismatch.MismatchModel`."""
        return self.physics.mean(wrench_cmd) + self.process.mean(wrench_cmd)

    def std(self, wrench_cmd: Array, /) -> Array:
        """Of the process alone."""
        return self.process.std(wrench_cmd)

    def jacobian(self, wrench_cmd: Array, /) -> Array:
        """See `plant.mismatch.MismatchModel`."""
        return self.physics.jacobian(wrench_cmd) + self.process.jacobian(wrench_cmd)

    def mean_and_jacobian(self, wrench_cmd: Array, /) -> tuple[Array, Array]:
        """See `plant.mismatch.Linearises`."""
        (mean, slope), (more, steeper) = (linearisation(m)(wrench_cmd) for m in (self.physics, self.process))
        return mean + more, slope + steeper


# -- the same as programs --


@dataclass(frozen=True, eq=False)
class PhysicsPrograms:
    """What the physics makes of a command: `mismatch` (L,) with derivatives, and `sent`: new tilts (A,), memory (M,).

    `memory` is M, `arms` A. `needs_voltage` says that an effect asks for it.
    """

    mismatch: Program
    sent: Program
    arms: int
    memory: int
    needs_voltage: bool


def trace(physics: PhysicsMismatch, dt: float) -> PhysicsPrograms:
    """The programs of `physics` stepped every `dt` [s]; raises Untraceable, naming an effect that is no program."""
    tracer = _Tracer(physics, dt)
    mean, after = tracer.run()
    free = [tracer.inputs[k] for k in output_indices(physics.outputs)]
    return PhysicsPrograms(
        mismatch=program(tracer.tape, tracer.inputs, free, mean),
        sent=program(tracer.tape, tracer.inputs, [], after),
        arms=tracer.arms,
        memory=tracer.memory,
        needs_voltage=any(item.effect.needs_voltage for item in physics.model.effects),
    )


def untraceable(physics: PhysicsMismatch, dt: float) -> dict[str, str]:
    """Effects that cannot be written down, and why; each tried on its own."""
    found = {}
    for item in physics.model.effects:
        alone = PhysicsMismatch(WrenchModel(physics.model.vehicle, (item,)), physics.outputs, physics.lead)
        try:
            trace(alone, dt)
        except Untraceable as error:
            found[item.name] = str(error)
    return found


class _Tracer:
    """Writes one step of the physics down."""

    def __init__(self, physics: PhysicsMismatch, dt: float) -> None:
        model = WrenchModel(physics.model.vehicle, tuple(traced_effect(item) for item in physics.model.effects))
        self.physics, self.model, self.dt = physics, model, dt
        self.allocation = Allocation(model.vehicle) if model.vehicle.has_rotors else None
        self.tape, self.inputs = Tape(), list[int]()
        self.arms, self.memory = 0, 0

    def run(self) -> tuple[list[int], list[int]]:
        """The lines of the mismatch, and those of what is kept after a command was sent."""
        wrench, numbers = self._inputs("wrench", AXES), self._inputs("state", STATE)
        fresh = self._inputs("fresh", ("",))
        p, q, v, w, t, u = np.split(numbers, [3, 7, 10, 13, 14])
        state = State(t, p[None], q[None], v[None], w[None], u)
        commands = self._allocated(Traced.of(wrench[None]))
        tilt = [] if commands.tilt is None else self._lines(commands.tilt)
        memory = self._memory(commands, state, fresh[0])
        self.tape.section = "effects on commands"
        held, memories = [commands], []  # as `PhysicsHere._effective`, sample by sample
        ahead = self.physics.periods_ahead(self.dt)
        for _ in range(math.ceil(ahead) if self.physics.late else 0):
            now, memory = self.model.command(commands, state, self.dt, memory)
            held.append(now)
            memories.append(memory)
        back = len(memories) - ahead
        effective = between(held[-1], held[-2], back) if back > 0.0 else held[-1]
        self.tape.section = "rotors"
        motion = self.model.motion(Traced.of(self.model.wrench(effective, state)), state.omega_B)
        self.tape.section = "measured wrench"
        mean = Traced.of(measured_wrench(self.model.vehicle.body, motion))[0] - wrench
        kept = memories[0] if memories and self.physics.lead is not None else None
        after = [line for leaf in memory_arrays(kept) for line in self._lines(leaf)]
        return self._lines(mean[output_indices(self.physics.outputs)]), tilt + after

    def _inputs(self, kind: str, names: Sequence[str]) -> Traced:
        lines = [self.tape.input(f"{kind} {name}".strip()) for name in names]
        self.inputs += lines
        return Traced.of([Node(self.tape, line) for line in lines])

    def _lines(self, values: Any) -> list[int]:
        return [n.line if isinstance(n, Node) else self.tape.constant(float(n)) for n in values.flat]

    def _allocated(self, wrench: Traced) -> Commands:
        """`plant.allocation.Allocation.allocate` for one sample next to the angles sent last; no limits of rate."""
        self.tape.section = "allocation"
        if self.allocation is None:
            return Commands(wrench)
        vehicle = self.model.vehicle
        self.arms = len(vehicle.geometry()[0])
        before = self._inputs("tilt", [f"arm_{k}" for k in range(self.arms)])
        tilt, speed, _ = self.allocation.step(Traced.of(about_origin(vehicle.body, wrench))[0], before)
        return Commands(wrench, tilt[None], speed[None])

    def _memory(self, commands: Commands, state: State, fresh: Node) -> Any:
        """What effects remember of the commands sent: inputs, or before the first, the equilibrium at this command."""
        if self.physics.lead is None or not self.physics.late:
            return None
        _, equilibrium = self.model.command(commands, state, self.dt, None)

        def leaf(array: Any) -> Traced:
            given = self._inputs("memory", [f"{self.memory + k}" for k in range(np.size(array))])
            self.memory += np.size(array)
            is_fresh = Traced.of(np.full(np.shape(array), fresh))
            return Traced.of(np.where(is_fresh, array, given.reshape(np.shape(array))))

        return memory_of_arrays(equilibrium, leaf)
