"""The compensation in compiled code: the same steps as with plain models, some twenty times as fast.

Newton on r(dW) = mu(W_des + dW) + dW, with derivatives in closed form for the process and by tangent propagation for
the physics. Where Newton does not settle a step, nlopt's L-BFGS decides it, on the same compiled functions.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from wrenchgap.compensate import compiled as step
from wrenchgap.compensate.compiled import (
    TILT,
    Gate,
    Kernel,
    Lines,
    Room,
    advance,
    as_kernel,
    as_lines,
    expected,
    finish,
    packed,
    prepare,
    residual,
    search,
    steepen,
)
from wrenchgap.compensate.optimiser import Optimiser, Optimum
from wrenchgap.compensate.physics import PhysicsMismatch
from wrenchgap.compensate.physics_program import STATE, PhysicsPrograms, trace
from wrenchgap.compensate.reach import Reach
from wrenchgap.compensate.step_row import BETA, COST, EXPECTED, IMPLAUSIBLE, LIMITED, SIGMA, VOLTAGE_MAX, state_row
from wrenchgap.compensate.uncertainty import UncertaintyFilter
from wrenchgap.flight.flight import AXES, Array
from wrenchgap.plant.expansion import Expands, Expansion, straight_line
from wrenchgap.plant.mismatch import Follows, LinearMismatch, MismatchModel, output_indices
from wrenchgap.plant.mismatch_inputs import COLUMNS, PAST_SECONDS
from wrenchgap.plant.state import State
from wrenchgap.plant.tracing import Untraceable

ENOUGH = 1e-14
"""Newton stops where J is below this share of the acceptance threshold: a ten-millionth of its error."""
WITHHELD = "the model's standard deviation is not finite: correction withheld"
MOST = 30
"""Evaluations of one Newton search. Four are usual."""


class Plan(NamedTuple):
    """What is compiled: the arrays of the process and the programs of the physics, of either of which there may be
    none, and the constants.
    """  # noqa: D205

    expansion: Expansion | None
    physics: PhysicsPrograms | None
    gate: Gate


@dataclass(frozen=True)
class Limits:
    """What of a compensation's settings the search needs; see `compensate.compensator.Settings`."""

    bound: Array
    known: Array
    reach: Reach | None
    accept: float
    most: int
    dt: float
    lenient: bool


def plan(
    model: MismatchModel | Follows, physics: PhysicsMismatch | None, gate: UncertaintyFilter, limits: Limits
) -> Plan:
    """What to compile for a model, or for a process on top of physics.

    Raises Untraceable, in one line, for what cannot be compiled.
    """
    expansion = None
    if isinstance(model, PhysicsMismatch):
        physics = model
    elif isinstance(model, Expands):
        expansion = model.expansion()
    else:
        raise Untraceable(f"a {type(model).__name__} is neither a process nor physics")
    programs = None if physics is None else trace(physics, limits.dt)
    return Plan(expansion, programs, _gate(model, expansion, physics is not None, gate, limits))


def _gate(
    model: MismatchModel | Follows, expansion: Expansion | None, physics: bool, gate: UncertaintyFilter, limits: Limits
) -> Gate:
    rows = output_indices(model.outputs)
    groups = () if expansion is None else expansion.input_groups
    none, reach = np.zeros(0), limits.reach
    a = math.exp(-limits.dt / PAST_SECONDS)
    q = (1.0 - a) * PAST_SECONDS / limits.dt
    return Gate(
        rows=np.array(rows, dtype=np.int64),
        bound=np.array(limits.bound[rows]),
        accept=float(limits.accept),
        enough=ENOUGH * float(limits.accept),
        most=min(MOST, limits.most),
        lenient=limits.lenient,
        watched=np.array(gate.watched, dtype=np.int64),
        offset=np.array(gate.offset, dtype=float),
        scale=np.array(gate.scale, dtype=float),
        threshold=float(gate.threshold),
        kappa=float(gate.kappa),
        decay=float(gate.decay),
        groups=np.array([name in groups for name in COLUMNS], dtype=np.int64),
        a=a,
        b0=q - a,
        b1=1.0 - q,
        has_process=expansion is not None,
        has_physics=physics,
        known=np.array(limits.known[rows]),
        reach=np.zeros((0, len(AXES))) if reach is None else reach.rows / reach.authority,
        low=none if reach is None else reach.low.copy(),
        high=none if reach is None else reach.high.copy(),
        middle=none if reach is None else reach.middle.copy(),
        half=none if reach is None else reach.half.copy(),
        weak=none if reach is None else reach.weak.copy(),
    )


class Stepper:
    """Steps a `Plan`, one period or many at once; `memory` is all that it keeps between steps."""

    def __init__(self, made: Plan, optimiser: Optimiser, known: Optimiser, reach: Reach | None) -> None:
        self.plan, self._reach = made, reach
        self._optimisers = (replace(known), replace(optimiser))
        gate, expansion, physics = made.gate, made.expansion, made.physics
        count = len(gate.rows)
        nothing = straight_line((), np.zeros(count), np.zeros((count, len(AXES))), np.zeros(count))
        kernel = as_kernel(nothing if expansion is None else expansion)
        lines, sent = (as_lines(None if physics is None else getattr(physics, n), count) for n in ("mismatch", "sent"))
        room = _room(count, len(kernel.input_mean), len(lines.inputs))
        self._packed, self._given = packed((gate, kernel, lines, sent, room))
        self.memory = np.zeros(TILT + (0 if physics is None else physics.arms + physics.memory))
        self._row = np.zeros((1, EXPECTED + 2 * count))
        self._wrench, self._state = np.zeros((1, len(AXES))), np.zeros((1, len(STATE)))
        self._looks = self.needs_state
        self.trouble = ""
        self.reset()

    @property
    def needs_state(self) -> bool:
        """Whether a state must be given."""
        gate = self.plan.gate
        return gate.has_physics or bool(gate.groups[:3].any())

    def reset(self) -> None:
        """Forget the past."""
        self.memory[:] = 0.0
        self.memory[step.FRESH] = 1.0

    def one(self, wrench: Array, state: State | None) -> Array:
        """Results of one step (see `compiled`), from the desired wrench (6,); `trouble` says what went wrong."""
        self._wrench[0] = wrench
        if state is not None and self._looks:
            self._state[0] = state_row(state)
            self._judge_voltage(self._state)
        self.trouble = ""
        row: Array = self._row[0]
        if advance(*self._packed, self.memory, self._wrench, self._state, self._row, False) == 0:
            self._hand_over(self._wrench[0], self._state[0], row, False)
        if row[LIMITED] > 0.0 or not math.isfinite(row[COST]):
            self._limit(row, False)
        return row

    def many(self, wrenches: Array, states: Array, out: Array) -> dict[int, str]:
        """Consecutive steps, with the mismatch expected before and after, into `out` (K, 24 + 2 L); trouble by step.

        `wrenches` (K, 6) in B [N, Nm], `states` (K, 15) as `physics_program.STATE` has them.
        """
        trouble, done = dict[int, str](), 0
        wrenches, states = np.array(wrenches, order="C"), np.array(states, order="C")
        self._judge_voltage(states)
        while done < len(wrenches):
            made = advance(*self._packed, self.memory, wrenches[done:], states[done:], out[done:], True)
            done += made
            self.trouble = ""
            if not made or (done < len(wrenches) and not out[done - 1, LIMITED] > 0.0):
                self._hand_over(wrenches[done], states[done], out[done], True)
                done += 1
            if out[done - 1, LIMITED] > 0.0 or not math.isfinite(out[done - 1, COST]):
                self._limit(out[done - 1], True)
            if self.trouble:
                trouble[done - 1] = self.trouble
        sigma = out[:, SIGMA]
        if not math.isfinite(sigma.sum()):
            for k in np.flatnonzero(~np.isfinite(sigma)).tolist():
                trouble.setdefault(k, WITHHELD)
        return trouble

    def expected(self, wrench: Array) -> Array:
        """Mismatch (L,) of a command (6,) as the models have it in the last step."""
        gate, kernel, lines, _, room = self._given
        found = np.zeros(len(gate.rows))
        expected(gate, kernel, lines, room, np.array(wrench, dtype=float), found, False)
        return found

    def _judge_voltage(self, states: Array) -> None:
        """Make a state (K, 15) none, in place, whose voltage is none and is needed; the kernels look at the rest."""
        physics = self.plan.physics
        if physics is not None and physics.needs_voltage:
            states[~(np.abs(states[:, -1]) <= VOLTAGE_MAX), 0] = np.nan

    def _hand_over(self, wanted: Array, state: Array, out: Array, expects: bool) -> None:
        """One step whose optima L-BFGS finds, or whose demand or state is none that a vehicle can have."""
        gate, kernel, lines, sent, room = self._given
        memory, evaluations, known = self.memory, 0, None
        wrench, limited = (wanted, False) if self._reach is None else self._reach.nearest(wanted)
        if not step.plausible(gate, state):
            self.trouble = IMPLAUSIBLE
            out[:] = 0.0
            out[: len(AXES)], out[BETA], out[COST], out[LIMITED] = wrench, 1.0, np.nan, limited
            return
        prepare(gate, lines, room, memory, wrench, state)
        if gate.lenient:
            search(gate, kernel, lines, room, memory, wrench, out)
            finish(gate, kernel, lines, sent, room, memory, wrench, out, expects)
            out[LIMITED] = max(out[LIMITED], limited)
            return
        if gate.has_process and gate.has_physics:
            physics = self._optimisers[0].solve(_Linear(self._given, False), wrench, memory[step.KNOWN : step.STAGE])
            known, evaluations = physics.correction, physics.iterations
            memory[step.KNOWN : step.STAGE] = known
        start = memory[step.OPTIMUM : step.CORRECTION]
        found: Optimum = self._optimisers[1].solve(_Linear(self._given, gate.has_process), wrench, start, known)
        self.trouble = found.trouble
        memory[step.OPTIMUM : step.CORRECTION] = found.correction
        out[COST:LIMITED] = found.cost, evaluations + found.iterations, found.accepted
        finish(gate, kernel, lines, sent, room, memory, wrench, out, expects)
        out[LIMITED] = max(out[LIMITED], limited)

    def _limit(self, out: Array, expects: bool) -> None:
        """The nearest command that the vehicle can make, behind which nothing is remembered."""
        if self._reach is not None:
            out[: len(AXES)], _ = self._reach.nearest(out[: len(AXES)])
        if expects:
            out[EXPECTED + len(self.plan.gate.rows) :] = self.expected(out[: len(AXES)])
        self.reset()


class _Linear:
    """The compiled models of this period, as L-BFGS asks for them."""

    def __init__(self, given: tuple[Gate, Kernel, Lines, Lines, Room], process: bool) -> None:
        self._gate, self._kernel, self._lines, _, self._room = given
        self._process = process
        self.outputs = tuple(AXES[k] for k in self._gate.rows)
        self._zero = np.zeros(len(self.outputs))

    def mean_and_jacobian(self, wrench_cmd: Array, /) -> tuple[Array, Array]:
        room, count = self._room, len(self.outputs)
        residual(self._gate, self._kernel, self._lines, room, wrench_cmd[0], self._zero, self._process, False)
        steepen(self._gate, self._kernel, room, self._process)
        jacobian = np.zeros((1, count, len(AXES)))
        jacobian[0][:, self._gate.rows] = room.A - np.eye(count)
        return room.r[None].copy(), jacobian

    def mean(self, wrench_cmd: Array, /) -> Array:
        return self.mean_and_jacobian(wrench_cmd)[0]

    def std(self, wrench_cmd: Array, /) -> Array:
        return np.zeros((1, len(self.outputs)))

    def jacobian(self, wrench_cmd: Array, /) -> Array:
        return self.mean_and_jacobian(wrench_cmd)[1]


def _room(count: int, dims: int, inputs: int) -> Room:
    sizes: dict[str, int | tuple[int, int]] = dict.fromkeys(Room._fields, count)
    sizes |= {"xi": dims, "inputs": max(inputs, 22), "A": (count, count), "square": (count + 1, count)}
    sizes |= {"A_at": (count, count), "saved": TILT + max(inputs - 22, 0)}
    return Room(**{name: np.zeros(size) for name, size in sizes.items()})


def warm() -> None:
    """Compile what is not in numba's cache yet: some twenty seconds of processor time, once per machine and version."""
    count = 1
    gate = UncertaintyFilter(np.ones(1, dtype=bool), np.zeros(1), np.ones(1), math.inf, 1.0, 0.9)
    line = LinearMismatch((AXES[-1],), np.zeros(count), np.zeros((count, len(AXES))), np.ones(count))
    bound = np.ones(len(AXES))
    made = plan(line, None, gate, Limits(bound, bound, None, 1e-4, MOST, 0.01, True))
    stepper = Stepper(made, Optimiser(-bound, bound), Optimiser(-bound, bound), None)
    stepper.one(np.zeros(len(AXES)), None)
    stepper.expected(np.zeros(len(AXES)))
    stepper._hand_over(np.zeros(len(AXES)), np.zeros(len(STATE)), stepper._row[0], False)
