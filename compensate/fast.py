"""The compensation in compiled code: the same steps as with plain models, some twenty times as fast.

Newton on r(dW) = mu(W_des + dW) + dW, with derivatives in closed form for the process and by tangent propagation for
the physics (`compensate.kernels`). Where Newton does not settle a step, nlopt's L-BFGS decides it, on the same compiled
functions.
"""

import math
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from wrenchgap.compensate import kernels
from wrenchgap.compensate.generated.views import opened
from wrenchgap.compensate.kernels import COST, EVALUATIONS, EXPECTED, LIMITED, SIGMA
from wrenchgap.compensate.lbfgs import Optimiser, Optimum
from wrenchgap.compensate.physics import PhysicsMismatch, PhysicsPrograms, trace
from wrenchgap.compensate.reach import Reach, no_reach
from wrenchgap.compensate.tables import (
    IMPLAUSIBLE,
    STATE,
    Compensation,
    Gate,
    Process,
    Tape,
    looked_at,
    packed,
    state_row,
)
from wrenchgap.compensate.uncertainty import UncertaintyFilter
from wrenchgap.flight.flight import AXES, Array, Mask
from wrenchgap.plant.mismatch import (
    Expands,
    Expansion,
    Follows,
    LinearMismatch,
    MismatchModel,
    linear_expansion,
    output_indices,
)
from wrenchgap.plant.mismatch_inputs import COLUMNS, PAST_SECONDS
from wrenchgap.plant.state import State
from wrenchgap.plant.trace.arrays import Untraceable
from wrenchgap.plant.trace.tape import Program

WITHHELD = "the model's standard deviation is not finite: correction withheld"


@dataclass(frozen=True)
class NewtonSettings:
    """When a Newton search stops; the last three are relative sizes at the level of rounding, which count as zero."""

    enough: float = 1e-14  # J, relative to the acceptance threshold: a ten-millionth of its error
    evaluations: int = 30  # at most; four are usual
    pivot: float = 1e-14
    still: float = 1e-13  # of a step
    stalled: float = 1e-12  # of a decrease of J


NEWTON = NewtonSettings()
TAPE_SIZES = {"LINES": "code", "ASKED": "inputs", "FREE": "free", "RESULTS": "results", "SLOPED": "tangent"}
"""Sizes of a tape, and the part of `compensate.tables.Tape` that has each."""


class Plan(NamedTuple):
    """What is compiled: the process and the programs of the physics, of either of which there may be none, and the
    constants.
    """  # noqa: D205

    expansion: Expansion | None
    physics: PhysicsPrograms | None
    gate: Gate
    reach: Reach


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
    constants = _gate(output_indices(model.outputs), expansion, programs, gate, limits)
    return Plan(expansion, programs, constants, limits.reach or no_reach())


def _gate(
    rows: Any, expansion: Expansion | None, physics: PhysicsPrograms | None, gate: UncertaintyFilter, limits: Limits
) -> Gate:
    groups = () if expansion is None else expansion.input_groups
    ends = np.cumsum([len(AXES), *(len(COLUMNS[name]) for name in groups)]).tolist()
    at = {f"{name}_at": -1 for name in COLUMNS} | {f"{name}_at": end for name, end in zip(groups, ends, strict=False)}
    a = math.exp(-limits.dt / PAST_SECONDS)
    q = (1.0 - a) * PAST_SECONDS / limits.dt
    moves = physics is not None or any(name != "past" for name in groups)
    return Gate(
        rows=np.array(rows, dtype=np.int64),
        bound=np.array(limits.bound[rows]),
        known=np.array(limits.known[rows]),
        watched=np.array(gate.watched, dtype=np.int64),
        offset=np.array(gate.offset, dtype=float),
        scale=np.array(gate.scale, dtype=float),
        looked=looked_at(moves, powered=physics is not None and physics.needs_voltage),
        accept=float(limits.accept),
        enough=NEWTON.enough * float(limits.accept),
        pivot=NEWTON.pivot,
        still=NEWTON.still,
        stalled=NEWTON.stalled,
        threshold=float(gate.threshold),
        kappa=float(gate.kappa),
        decay=float(gate.decay),
        lag_a=a,
        lag_b0=q - a,
        lag_b1=1.0 - q,
        most=min(NEWTON.evaluations, limits.most),
        lenient=int(limits.lenient),
        has_process=int(expansion is not None),
        has_physics=int(physics is not None),
        **at,
    )


def sizes_of(step_plan: Plan, given: Compensation) -> dict[str, int]:
    """The sizes that `compensate.tables` names."""
    physics, process, reach = step_plan.physics, given.process, given.reach
    outputs = len(step_plan.gate.rows)
    actuators = 0 if physics is None else physics.arms + physics.memory
    return {
        "WG_OUTPUTS": outputs,
        "WG_INPUTS": len(process.input_mean),
        "WG_POINTS": process.alpha.shape[1],
        "WG_WHITENER": process.whitener.shape[1],
        "WG_LIMITS": len(reach.rows),
        "WG_TILTING": len(reach.middle),
        "WG_SINGLES": len(reach.low),
        "WG_ACTUATORS": actuators,
        "WG_STATE": len(AXES) + len(STATE) + 1 + actuators,
        "WG_FIXED": 0,
        "WG_ROW": EXPECTED + 2 * outputs,
        **{
            f"{name}_{size}": len(getattr(tape, part))
            for name, tape in (("PHYSICS", given.physics), ("SENT", given.sent))
            for size, part in TAPE_SIZES.items()
        },
    }


def process_of(expansion: Expansion) -> Process:
    """Arrays of a process as the step takes them."""
    e = expansion
    size = e.whitener.shape[1]
    kept = np.tril(np.ones((size, size), dtype=bool)) | (not e.triangular)
    return Process(
        *(e.input_mean, e.input_scale, e.output_scale, e.mean_coefficients, e.lengthscales),
        points=e.points.transpose(0, 2, 1),
        alpha=e.alpha,
        whitener=e.whitener[:, kept],
        signal=e.signal_variance,
        noise=e.noise_variance,
        sigma_scale=e.sigma_scale,
        triangular=int(e.triangular),
    )


def tape_of(program: Program | None, outputs: int) -> Tape:
    """Arrays of a program; empty ones where there is none."""
    none = np.zeros(0, dtype=np.int64)
    if program is None:
        return Tape(np.zeros((0, 4), dtype=np.int64), none, none, none, np.zeros(0), np.zeros((0, outputs)), 0)
    tangent = np.zeros((len(program.code) if len(program.free) else 0, outputs))
    for k, place in enumerate(program.free):
        tangent[program.inputs[place], k] = 1.0
    code = program.code.astype(np.int64)
    return Tape(code, program.inputs, program.free, program.results, program.start, tangent, program.split)


def compensation_of(step_plan: Plan) -> Compensation:
    """What a step takes of a plan."""
    outputs = len(step_plan.gate.rows)
    nothing = linear_expansion((), np.zeros(outputs), np.zeros((outputs, len(AXES))), np.zeros(outputs))
    process = process_of(step_plan.expansion or nothing)
    programs = (None, None) if step_plan.physics is None else (step_plan.physics.mismatch, step_plan.physics.sent)
    return Compensation(step_plan.reach.table, process, step_plan.gate, *(tape_of(one, outputs) for one in programs))


class Stepper:
    """Steps a `Plan`, one period or many at once; what it remembers lies in `flat`."""

    def __init__(self, step_plan: Plan, optimiser: Optimiser, known: Optimiser) -> None:
        self.plan = step_plan
        self._optimisers = (replace(known), replace(optimiser))
        given, outputs = compensation_of(step_plan), len(step_plan.gate.rows)
        self._packed = packed(given, sizes_of(step_plan, given))
        (self._compensation, self._memory, self._room), self.flat, _ = opened(*self._packed)
        self._row = np.zeros((1, EXPECTED + 2 * outputs))
        self._wrench, self._state = np.zeros((1, len(AXES))), np.zeros((1, len(STATE)))
        self.trouble = ""
        self.reset()

    @property
    def needs_state(self) -> bool:
        """Whether a state must be given."""
        return bool(self.plan.gate.looked.any())

    def reset(self) -> None:
        """Forget the past."""
        self.flat[:] = 0.0
        self._memory.fresh[0] = 1.0

    def one(self, wrench: Array, state: State | None) -> Array:
        """Results of one step (see `kernels`), from the desired wrench (6,); `trouble` says what went wrong."""
        self._wrench[0] = wrench
        if state is not None and self.needs_state:
            self._state[0] = state_row(state)
        self.trouble = ""
        self._step(self._wrench, self._state, self._row, False)
        if _refused(self._row)[0]:
            self.trouble = IMPLAUSIBLE
        return np.asarray(self._row[0])

    def many(self, wrenches: Array, states: Array, out: Array) -> dict[int, str]:
        """Consecutive steps, with the mismatch expected before and after, into `out` (K, 24 + 2 L); trouble by step.

        `wrenches` (K, 6) in B [N, Nm], `states` (K, 15) as `compensate.tables.STATE` has them.
        """
        trouble, done = dict[int, str](), 0
        wrenches, states = np.array(wrenches, order="C"), np.array(states, order="C")
        while done < len(wrenches):
            self.trouble = ""
            done += self._step(wrenches[done:], states[done:], out[done:], True)
            if self.trouble:
                trouble[done - 1] = self.trouble
        for k in np.flatnonzero(_refused(out)).tolist():
            trouble.setdefault(k, IMPLAUSIBLE)
        for k in np.flatnonzero(~np.isfinite(out[:, SIGMA])).tolist():
            trouble.setdefault(k, WITHHELD)
        return trouble

    def _step(self, wrenches: Array, states: Array, out: Array, expects: bool) -> int:
        """Steps until the end, or through the first that L-BFGS has to decide; how many."""
        done = kernels.advance(*self._packed, wrenches, states, out, expects)
        if done < len(wrenches):
            self._hand_over(wrenches[done], states[done], out[done], expects)
            done += 1
        return done

    def expected(self, wrench: Array) -> Array:
        """Mismatch (L,) of a command (6,) as the models have it in the last step."""
        found = np.zeros(len(self.plan.gate.rows))
        kernels.mismatch(self._compensation, self._room, np.array(wrench, dtype=float), found)
        return found

    def _hand_over(self, wanted: Array, state: Array, out: Array, expects: bool) -> None:
        """One step whose optima L-BFGS finds."""
        gate, memory, evaluations, known = self.plan.gate, self._memory, 0, None
        limited = kernels.begin(self._compensation, memory, self._room, wanted, state)
        wrench = self._room.wrench.copy()
        if gate.has_process and gate.has_physics:
            physics = self._optimisers[0].solve(_Linear(self, False), wrench, memory.known)
            known, evaluations = physics.correction, physics.iterations
            memory.known[:] = known
        model = _Linear(self, bool(gate.has_process))
        found: Optimum = self._optimisers[1].solve(model, wrench, memory.optimum, known)
        self.trouble = found.trouble
        memory.optimum[:] = found.correction
        self._room.wrench[:] = wrench
        out[COST : LIMITED + 1] = found.cost, evaluations + found.iterations, found.accepted, limited
        kernels.end(self._compensation, memory, self._room, out, expects)


def _refused(rows: Array) -> Mask:
    """Which results (K, 24 + 2 L) are those of a state that is none (`kernels.refuse`): no model was evaluated."""
    return np.asarray(np.isnan(rows[:, COST]) & (rows[:, EVALUATIONS] == 0.0))


class _Linear:
    """The compiled models of this period, as L-BFGS asks for them."""

    def __init__(self, stepper: Stepper, process: bool) -> None:
        self._compensation, self._room, self._process = stepper._compensation, stepper._room, process
        self.outputs = tuple(AXES[k] for k in stepper.plan.gate.rows)
        self._zero = np.zeros(len(self.outputs))

    def mean_and_jacobian(self, wrench_cmd: Array, /) -> tuple[Array, Array]:
        room, count = self._room, len(self.outputs)
        room.wrench[:] = wrench_cmd[0]
        kernels.linearise(self._compensation, room, self._zero, self._process)
        jacobian = np.zeros((1, count, len(AXES)))
        jacobian[0][:, self._compensation.gate.rows] = room.A - np.eye(count)
        return room.r[None].copy(), jacobian

    def mean(self, wrench_cmd: Array, /) -> Array:
        return self.mean_and_jacobian(wrench_cmd)[0]

    def std(self, wrench_cmd: Array, /) -> Array:
        return np.zeros((1, len(self.outputs)))

    def jacobian(self, wrench_cmd: Array, /) -> Array:
        return self.mean_and_jacobian(wrench_cmd)[1]


def warm() -> None:
    """Compile what is not in numba's cache yet, once per machine and version."""
    gate = UncertaintyFilter(np.ones(1, dtype=bool), np.zeros(1), np.ones(1), math.inf, 1.0, 0.9)
    line = LinearMismatch((AXES[-1],), np.zeros(1), np.zeros((1, len(AXES))), np.ones(1))
    bound = np.ones(len(AXES))
    step_plan = plan(line, None, gate, Limits(bound, bound, None, 1e-4, NEWTON.evaluations, 0.01, True))
    stepper = Stepper(step_plan, Optimiser(-bound, bound), Optimiser(-bound, bound))
    stepper.one(np.zeros(len(AXES)), None)
    stepper.expected(np.zeros(len(AXES)))
    stepper._hand_over(np.zeros(len(AXES)), np.zeros(len(STATE)), stepper._row[0], False)
