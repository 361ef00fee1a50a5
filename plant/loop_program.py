"""One step of a plant as a program: from commands, state and memory to the wrench and what is remembered of it.

Nothing is written twice: `WrenchModel.actuate` and the effects' own `apply` run once on arrays that write down what is
done with them (`plant.tracing`).

Inputs, in this order: the command's wrench (6,) [N, Nm], tilts (A,) [rad] and rotor speeds (R,) [rad/s]; the state
(15,): position in E [m], quaternion B to E (w, x, y, z), velocity in E [m/s], body rates [rad/s], time [s], voltage
[V]; what effects remember (M,). Results: the wrench (6,) about O, what they remember then (M,).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from wrenchgap.flight.flight import Array
from wrenchgap.plant.state import Commands, Motion, State
from wrenchgap.plant.tape import Program, Tape, program
from wrenchgap.plant.traced_effects import leaves, rebuilt, wrapped
from wrenchgap.plant.tracing import Node, Traced, Untraceable
from wrenchgap.plant.wrench_model import WrenchModel

STATE = 15
CATALOGUE = "wrenchgap.plant.effects."
"""Where effects stand whose `apply` is known to depend on nothing but its arguments."""


@dataclass(frozen=True, eq=False)
class PlantPrograms:
    """The step of a plant, and how its gyroscope reads the state: from the state (15,) to rates (3,) [rad/s]."""

    step: Program
    gyro: Program


def traced(plant: WrenchModel, commands: Commands, memory: dict[str, Any], dt: float, voltage: bool) -> PlantPrograms:
    """The programs of a plant that is stepped every `dt` [s].

    `commands` (N = 1) and `memory` show what there is: memory that no longer changes its form, as after two steps.
    Raises Untraceable for effects of a user's own, and for what decides by a value.
    """
    for item in plant.effects:
        if not type(item.effect).__module__.startswith(CATALOGUE):
            raise Untraceable(f"effect {item.name} is not of the catalogue")
    model = WrenchModel(plant.vehicle, tuple(wrapped(item) for item in plant.effects))
    try:
        return PlantPrograms(_step(model, commands, memory, dt, voltage), _gyro(model, voltage))
    except (TypeError, AttributeError, ValueError) as error:
        raise Untraceable(" ".join(str(error).split())) from None


def numbers_of(memory: Any) -> Array:
    """What effects remember (M,), in the order of the program."""
    return np.concatenate([np.zeros(0), *(np.ravel(leaf) for leaf in leaves(memory))])


class _Writing:
    """A tape and its inputs so far."""

    def __init__(self) -> None:
        self.tape, self.inputs = Tape(), list[int]()

    def given(self, kind: str, shape: Sequence[int]) -> Traced:
        """New inputs as an array."""
        lines = [self.tape.input(f"{kind} {k}") for k in range(int(np.prod(shape)))]
        self.inputs += lines
        return Traced.of(Traced.of([Node(self.tape, line) for line in lines]).reshape(shape))

    def state(self, voltage: bool) -> State:
        """A state (N = 1) of new inputs."""
        p, q, v, w, t, u = np.split(self.given("state", (STATE,)), [3, 7, 10, 13, 14])
        return State(t, p[None], q[None], v[None], w[None], u if voltage else None)

    def lines(self, values: Any) -> list[int]:
        """Lines of the numbers of an array."""
        nodes = (n if isinstance(n, Node) else Node(self.tape, self.tape.constant(float(n))) for n in np.ravel(values))
        return [node.line for node in nodes]


def _step(model: WrenchModel, commands: Commands, memory: dict[str, Any], dt: float, voltage: bool) -> Program:
    w = _Writing()
    wrench = w.given("wrench", (1, 6))
    tilt, speed = (
        None if known is None else w.given(name, known.shape)
        for name, known in (("tilt", commands.tilt), ("rotor_speed", commands.rotor_speed))
    )
    state = w.state(voltage)
    before = rebuilt(memory, lambda leaf: w.given("memory", np.shape(leaf)))
    made, after = model.actuate(Commands(wrench, tilt, speed), state, dt, before)
    kept = [line for leaf in leaves(after) for line in w.lines(leaf)]
    if [np.shape(leaf) for leaf in leaves(after)] != [np.shape(leaf) for leaf in leaves(memory)]:
        raise Untraceable("effects remember more from step to step")
    return program(w.tape, w.inputs, [], w.lines(made) + kept)


def _gyro(model: WrenchModel, voltage: bool) -> Program:
    """Rates (3,) as `WrenchModel.read_imu` has them."""
    w = _Writing()
    state = w.state(voltage)
    read = model.read_imu(Motion(state.omega_B, np.zeros((1, 3)), np.zeros((1, 3))), state)
    return program(w.tape, w.inputs, [], w.lines(read.omega_B))
