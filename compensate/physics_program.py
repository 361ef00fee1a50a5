"""The physics of a compensation as programs: the mismatch of a command, and where a command brings the actuators.

Nothing is written twice: `plant.wrench_model` and the effects' own `apply` run once on arrays that write down what is
done with them (`plant.trace.arrays`).

Inputs, in this order (`Inputs`): the command (6,) [N, Nm]; the state (15,): position in E [m], quaternion B to E (w, x,
y, z), velocity in E [m/s], body rates [rad/s], time [s], voltage [V]; whether nothing was sent yet (1 or 0); the tilt
angles sent last (A,) [rad]; what follows late remembers (M,), with a `lead` only.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from wrenchgap.compensate.physics import PhysicsMismatch, between
from wrenchgap.compensate.tables import STATE
from wrenchgap.flight.flight import AXES
from wrenchgap.plant.allocation import Allocation
from wrenchgap.plant.effects.effect import CommandEffect
from wrenchgap.plant.mismatch import output_indices
from wrenchgap.plant.state import Commands, State
from wrenchgap.plant.trace.arrays import Node, Traced, Untraceable, memory_arrays, memory_of_arrays, traced_effect
from wrenchgap.plant.trace.tape import Program, Tape, program
from wrenchgap.plant.wrench_model import WrenchModel, about_origin, measured_wrench


@dataclass(frozen=True, eq=False)
class PhysicsPrograms:
    """What the physics makes of a command: `mismatch` (L,) with derivatives, and `sent`: new tilts (A,), memory (M,).

    `memory` is M, `arms` A. `needs_voltage` says that an effect asks for it.
    """

    outputs: tuple[str, ...]
    mismatch: Program
    sent: Program
    arms: int
    memory: int
    needs_voltage: bool


def trace(physics: PhysicsMismatch, dt: float) -> PhysicsPrograms:
    """The programs of `physics` stepped every `dt` [s].

    Raises Untraceable, naming the effect, where one cannot be written down.
    """
    tracer = _Tracer(physics, dt)
    mean, after = tracer.run()
    inputs = tracer.inputs
    free = [inputs[k] for k in output_indices(physics.outputs)]
    return PhysicsPrograms(
        outputs=physics.outputs,
        mismatch=program(tracer.tape, inputs, free, mean),
        sent=program(tracer.tape, inputs, [], after),
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
        self.late = any(isinstance(item.effect, CommandEffect) for item in model.effects)
        self.tape, self.inputs = Tape(), list[int]()
        self.arms, self.memory = 0, 0

    def run(self) -> tuple[list[int], list[int]]:
        """The lines of the mismatch, and those of what is kept after a command was sent."""
        wrench, numbers = self._inputs("wrench", AXES), self._inputs("state", STATE)
        fresh = self._inputs("fresh", ("",))
        p, q, v, w, t, u = np.split(numbers, [3, 7, 10, 13, 14])
        state = State(t, p[None], q[None], v[None], w[None], u)
        commands = self._allocated(Traced.of(wrench[None]))
        tilt = [] if commands.tilt is None else [node.line for node in self._nodes(commands.tilt)]
        memory = self._memory(commands, state, fresh[0])
        self.tape.section = "effects on commands"
        effective, kept = self._effective(commands, state, memory)
        self.tape.section = "rotors"
        motion = self.model.motion(Traced.of(self.model.wrench(effective, state)), state.omega_B)
        self.tape.section = "measured wrench"
        mean = Traced.of(measured_wrench(self.model.vehicle.body, motion))[0] - wrench
        rows = output_indices(self.physics.outputs)
        after = [node.line for leaf in memory_arrays(kept) for node in self._nodes(leaf)]
        return [node.line for node in self._nodes(mean[rows])], tilt + after

    def _inputs(self, kind: str, names: Sequence[str]) -> Traced:
        lines = [self.tape.input(f"{kind} {name}".strip()) for name in names]
        self.inputs += lines
        return Traced.of([Node(self.tape, line) for line in lines])

    def _nodes(self, values: Any) -> list[Node]:
        return [n if isinstance(n, Node) else Node(self.tape, self.tape.constant(float(n))) for n in values.flat]

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
        if self.physics.lead is None or not self.late:
            return None
        _, equilibrium = self.model.command(commands, state, self.dt, None)

        def leaf(array: Any) -> Traced:
            given = self._inputs("memory", [f"{self.memory + k}" for k in range(np.size(array))])
            self.memory += np.size(array)
            is_fresh = Traced.of(np.full(np.shape(array), fresh))
            return Traced.of(np.where(is_fresh, array, given.reshape(np.shape(array))))

        return memory_of_arrays(equilibrium, leaf)

    def _effective(self, commands: Commands, state: State, memory: Any) -> tuple[Commands, Any]:
        """As `PhysicsHere._effective`, sample by sample; and what is remembered after the first."""
        if not self.late:
            return commands, None
        lead = self.physics.lead
        ahead = 1.0 if lead is None else max(1.0, lead / self.dt + 0.5)
        count = math.ceil(ahead)
        found, kept = [], None
        for k in range(count):
            held, memory = self.model.command(commands, state, self.dt, memory)
            found.append(held)
            kept = memory if k == 0 else kept
        back = count - ahead
        return between(found[-1], found[-2], back) if back > 0.0 else found[-1], kept if lead is not None else None
