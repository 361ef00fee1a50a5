"""What the templates of the exported code ask for: sizes, constants, tables, cost in words, steps of the self-test.

The self-test repeats desired wrenches among the process's own training commands, in motion.
"""

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wrenchgap.compensate import Combined, Compensator, generated
from wrenchgap.compensate.c_expressions import INT, bounds, fields_of, name_of_constant
from wrenchgap.compensate.fast import Plan, compensation_of, sizes_of
from wrenchgap.compensate.run import run
from wrenchgap.compensate.tables import STATE, rows_of
from wrenchgap.flight import UsageError, so3
from wrenchgap.flight.flight import AXES, Array
from wrenchgap.plant.mismatch import output_indices
from wrenchgap.plant.state import State
from wrenchgap.plant.vehicle import GRAVITY, Vehicle
from wrenchgap.replay.compensation.compensators import Judged
from wrenchgap.replay.export.c_lines import KINDS, Code, Cost, Own, Pieces, Printer, evaluations, literal
from wrenchgap.replay.export.observer import observer_context
from wrenchgap.replay.export.records import LONGEST, record_type

GENERATED = Path(generated.__file__).parent

STATE_FIELDS = (
    ("position_E", 0, 3),
    ("quat_EB", 3, 4),
    ("velocity_E", 7, 3),
    ("omega_B", 10, 3),
    ("time", 13, 1),
    ("voltage", 14, 1),
)
"""Fields of a `wg_input` that hold the state, with their places in `STATE`."""
BY_PRECISION = ("enough", "pivot", "still", "stalled")
"""Numbers of a gate that are rounding: the code has them for both precisions."""
NOTES = {
    "wg_reach_rows": "limits on W / authority, in shares of themselves; pairs of arms that tilt first",
    "wg_reach_solve": "of the search for the nearest wrench",
    "wg_reach_authority": "largest wrench [N, Nm]",
    "wg_reach_hover": "a wrench well within reach, in authorities",
    "wg_reach_middle": "middle of the range of tilt [rad]",
    "wg_reach_half": "half of that range [rad]; pi or more: none",
    "wg_reach_weak": "share of its thrust below which the direction of an arm is none",
    "wg_process_input_mean": "x = (xi - mean) / scale",
    "wg_process_output_scale": "[N] or [Nm]",
    "wg_process_coefficients": "b_0, then b of the mean function b_0 + b . x",
    "wg_process_lengthscales": "of x",
    "wg_process_points": "training or inducing points, by output and input, in lengthscales",
    "wg_process_alpha": "weights of the points",
    "wg_process_whitener": "C^-1 row by row",
    "wg_process_signal": "variance of the signal, standardised",
    "wg_process_noise": "and of the noise",
    "wg_process_sigma_scale": "calibration of sigma",
    "wg_rows": "components that are corrected",
    "wg_bound": "by how much at most [N, Nm]",
    "wg_known": "by the effects alone",
    "wg_watched": "outputs that have a vote in the gate",
    "wg_offset": "sigma of an output: (std - offset) / scale",
    "wg_looked": "which of position_E, quat_EB, velocity_E, omega_B, time, voltage must be such as a flight can have",
    "wg_observer_inertia": "in B [kg m^2]",
    "wg_observer_torque_max": "largest estimate [Nm]",
    "wg_observer_jump": "torque beyond which a change of rate is no motion [Nm]",
    "wg_observer_follow_a": "first-order hold of the lag with which the vehicle follows",
}
"""What the tables hold, where their names do not say it."""


class Table(NamedTuple):
    """A table of the exported code: its name, type and shape in C, and its numbers."""

    name: str
    kind: str
    shape: str
    numbers: Array


def context(
    plan: Plan,
    pieces: Pieces,
    effects: tuple[str, ...],
    tables: list[Table],
    macros: list[tuple[str, str]],
    observer: Combined | None,
    judged: Judged | None,
) -> dict[str, Any]:
    """What the templates ask for, of a plan with `effects`."""
    # Long because it names every number of the templates, one a line.
    gate, expansion, physics = plan.gate, plan.expansion, plan.physics
    seen = _seen(plan, observer)
    alone, whole = evaluations(plan)
    points = 0 if expansion is None else expansion.points.shape[1]
    contents = [f"A Gaussian process of {points} points."] if expansion is not None else []
    contents += [f"Effects: {', '.join(effects)}."] if physics is not None else []
    contents += [] if observer is None else [f"An observer of {observer.bandwidth_hz:.3g} Hz."]
    observed = None if observer is None or judged is None else observer_context(observer, judged)
    return {
        "outputs": tuple(AXES[k] for k in gate.rows),
        "observer": observed,
        "arms": 0 if physics is None else physics.arms,
        "memory": 0 if physics is None else physics.memory,
        **_state_size(plan, observed),
        "process": expansion is not None,
        "physics": physics is not None,
        "unused": lambda field: "" if field in seen else "; not looked at",
        "correction_max": [f"{v:.4g}" for v in correction_max(plan, observer)],
        "evaluations_max": alone + whole + 1,
        "fixed": _said(pieces.fixed),
        "moving": _said(pieces.moving),
        "sent": _said(pieces.sent),
        "enough": repr(gate.enough),
        "enough_float": repr(max(gate.accept * 1e-7, gate.enough)),
        "sizes": [(n, v) for n, v in sizes(plan).items() if n not in ("WG_OUTPUTS", "WG_ACTUATORS")],
        "macros": macros,
        "tables": [(t.name, t.kind, t.shape, NOTES.get(t.name, ""), Own(numbers_text(t))) for t in tables],
        "period": Own((GENERATED / "period.c").read_text()),
        "memory_struct": Own((GENERATED / "memory.h").read_text()),
        "contents": " ".join(contents),
    }


def sizes(plan: Plan) -> dict[str, int]:
    """Sizes of `compensate.tables` as the exported code needs them."""
    found = {n: v for n, v in sizes_of(plan, compensation_of(plan)).items() if n.startswith("WG_")}
    return found | {"WG_FIXED": 0 if plan.physics is None else len(Printer(plan.physics.mismatch).kept)}


def _state_size(plan: Plan, observed: dict[str, Any] | None) -> dict[str, int]:
    """How many numbers and counts a `wg_memory` holds: six wrenches, `fresh`, actuators; what an observer keeps."""
    physics = plan.physics
    numbers = 6 * len(AXES) + 1 + max(1, 0 if physics is None else physics.arms + physics.memory)
    counts = 1
    if observed is not None:
        numbers += 3 * (4 + int(observed["asked"]))
        counts += 3
    if (size := record_type(8, numbers, counts).itemsize) > LONGEST:
        raise UsageError(
            f"export: a delay of commands is remembered period by period, and a state of {numbers} numbers makes "
            f"records of {size:,} bytes, more than {LONGEST:,}; use a longer --dt, or --without command_delay"
        )
    return {"state_numbers": numbers, "state_counts": counts}


def correction_max(plan: Plan, observer: Combined | None) -> Array:
    """Largest correction (6,) of all parts together [N, Nm]."""
    most, gate = np.zeros(len(AXES)), plan.gate
    most[gate.rows] = gate.bound + (gate.known if gate.has_process and gate.has_physics else 0.0)
    most[3:] += 0.0 if observer is None else observer.torque_max
    return most


def _seen(plan: Plan, observer: Combined | None) -> set[str]:
    """Fields of the input that something looks at."""
    groups = () if plan.expansion is None else plan.expansion.input_groups
    by_group = {"velocity": ("velocity_E", "quat_EB"), "rates": ("omega_B",), "position": ("position_E",), "past": ()}
    seen = {field for group in groups for field in by_group[group]}
    seen |= set() if observer is None else {"omega_B"}
    if plan.physics is not None:
        for program in (plan.physics.mismatch, plan.physics.sent):
            arguments = {int(a) for line in program.code.tolist() for a in line[1:]} | set(program.results.tolist())
            used = {k - len(AXES) for k, line in enumerate(program.inputs.tolist()) if line in arguments}
            seen |= {field for field, first, count in STATE_FIELDS if used & set(range(first, first + count))}
    return seen


def _said(code: Code | None) -> dict[str, str] | None:
    if code is None:
        return None
    counts = ", ".join(f"{code.counts[kind]} {kind}" for kind in KINDS if code.counts[kind])
    return {"text": code.text, "counts_text": counts or "nothing"}


def numbers_of(plan: Plan, observer: Combined | None) -> tuple[list[Table], list[tuple[str, str]]]:
    """Tables of a plan and an observer, and their single numbers as macros."""
    given = compensation_of(plan)
    seen = _seen(plan, observer)
    looked = [int(any(f in seen and a <= k < a + n for f, a, n in STATE_FIELDS)) for k in range(len(STATE))]
    gate = given.gate._replace(looked=np.array(looked, dtype=np.int64), lenient=1)
    tables: list[Table] = []
    macros: list[tuple[str, str]] = []
    for part in (given.reach, given.process, gate, *([] if observer is None else [observer.table])):
        for field, kind in fields_of(type(part).__name__).items():
            name, value = name_of_constant(type(part).__name__, field, kind), getattr(part, field)
            if kind.sizes:
                tables.append(Table(name, kind.name, bounds(kind.sizes), value))
            elif field not in BY_PRECISION:
                macros.append((name, str(int(value)) if kind == INT else literal(float(value))))
    return tables, macros


def numbers_text(table: Table) -> str:
    """Numbers of a table, a few in a row."""

    def rows(values: Array) -> str:
        if not np.size(values):
            return "0"
        if np.ndim(values) > 1:
            return ",\n".join("{\n" + rows(part) + "\n}" for part in values)
        texts = [str(int(v)) if table.kind == "int" else literal(float(v)) for v in values]
        return ",\n".join("    " + ", ".join(texts[k : k + 5]) for k in range(0, len(texts), 5))

    return rows(table.numbers)


def words_of(price: Cost) -> str:
    """The cost as a table of Markdown."""
    heads = ["| operations of a step | " + " | ".join(KINDS) + " | evaluations |", "|" + " --- |" * (len(KINDS) + 2)]
    usual = [f"{price.usual[k]}" for k in KINDS]
    worst = [f"{price.at_worst[k]}" for k in KINDS]
    heads.append(f"| usual, in the recorded steps | {' | '.join(usual)} | {price.evaluations_usual:.1f} |")
    heads.append(f"| at worst | {' | '.join(worst)} | {price.evaluations_worst} |")
    return "\n".join(heads) + (
        f"\n\nMemory: {price.tables} bytes of constants, {price.memory} of state, at most {price.stack} of stack (all "
        "numbers of a function at once; a compiler reuses most of it)."
    )


@dataclass(frozen=True)
class SelfTest:
    """The steps of a self-test; the motion is moderate, so that every effect has something to do."""

    steps: int = 60
    pace: int = 12
    """Steps from one command to the next."""
    speed: float = 1.5
    """Largest speed [m/s]."""
    rate: float = 0.6
    """Largest rate [rad/s]."""
    height: float = 2.0
    """Of the middle of the motion [m]."""
    voltage: float = 15.0
    """Of the battery [V]."""
    hidden: float = 0.5
    """Share of its bounds that an observer has to find."""
    turn: float = 300.0
    """Angular acceleration beyond which no torque is hidden [rad/s^2]: ten times that of a lively flight."""


SELF_TEST = SelfTest()


def motion(dt: float) -> State:
    """A slow turn about all axes (N = `SELF_TEST.steps`)."""
    t = np.arange(SELF_TEST.steps, dtype=float) * dt
    turn = np.stack((np.sin(3.0 * t), np.sin(2.0 * t + 1.0), np.sin(2.5 * t + 2.0)), axis=1)
    place = turn + np.array([0.0, 0.0, SELF_TEST.height])
    velocity, omega = SELF_TEST.speed * turn[:, ::-1], SELF_TEST.rate * turn
    return State(t, place, so3.exp(0.5 * turn), velocity, omega, np.full(len(t), SELF_TEST.voltage))


def wrenches(commands: Array | None, mass: float, dt: float) -> Array:
    """Desired wrenches (N, 6): from one of `commands` (N, 6) to the next; about hover where there are none."""
    steps = SELF_TEST.steps
    if commands is None or not len(commands):
        t = np.arange(steps)[:, None] * dt
        weight = mass * GRAVITY
        swing = np.sin(t * np.arange(1, 7)) * weight * np.array([0.1, 0.1, 0.1, 0.01, 0.01, 0.01])
        return np.asarray(swing + weight * np.eye(6)[2])
    stops = commands[np.linspace(0, len(commands) - 1, steps // SELF_TEST.pace + 2).astype(int)]
    place = np.arange(steps) / SELF_TEST.pace
    return np.stack([np.interp(place, np.arange(len(stops)), column) for column in stops.T], axis=1)


@dataclass(frozen=True)
class Vectors:
    """Inputs (K, 27) and results (K, 13) of the self-test, the mean number of evaluations, and the share solved.

    The self-test ends before the first step that is not solved: where there is no solution, rounding decides where the
    search ends, and another precision ends elsewhere.
    """

    given: Array
    wanted: Array
    evaluations: float
    solved: float


def recorded(helper: Compensator | Combined, commands: Array | None, vehicle: Vehicle) -> Vectors:
    """What the exported code must repeat, among `commands` (N, 6) or about hover."""
    dt = helper.dt if isinstance(helper, Combined) else helper.settings.dt
    desired, states = wrenches(commands, vehicle.body.mass, dt), motion(dt)
    helper.reset()
    if isinstance(helper, Combined):
        omega, wanted, evaluations, accepted = _observed(helper, desired, states)
        states = replace(states, omega_B=omega)
    else:
        found = run(helper, desired, states)
        expected = found.wrench_cmd.copy()
        expected[:, output_indices(helper.model.outputs)] += found.after
        wanted = np.hstack((found.wrench_cmd, expected, found.beta[:, None]))
        evaluations, accepted = found.iterations.astype(float), found.accepted
    given = np.hstack((desired, np.zeros((len(desired), len(AXES))), rows_of(states)))
    count = len(desired) if accepted.all() else max(1, int(np.argmin(accepted)))
    return Vectors(given[:count], wanted[:count], float(np.mean(evaluations)), float(np.mean(accepted)))


def _observed(helper: Combined, desired: Array, states: State) -> tuple[Array, Array, Array, NDArray[np.bool_]]:
    """Rates (N, 3), results (N, 13), evaluations and whether solved, step by step with an observer.

    The rates are those of a body that makes what the feed-forward is asked for, late by the delay, and feels a torque
    nobody knows of, so that the estimate has something to find: `SELF_TEST.hidden` of its bounds, where these are not
    so wide for the body that its rates have no end.
    """
    J, omega, asked = helper.inertia, states.omega_B[0], []
    rates, wanted, evaluations, accepted = [], [], [], []
    late = math.ceil(helper.delay / helper.dt)
    size = SELF_TEST.hidden * np.minimum(helper.torque_max, SELF_TEST.turn * np.diag(J))
    for k, wrench in enumerate(desired):
        now = replace(states.take(slice(k, k + 1)), omega_B=omega[None])
        made = helper.step(wrench, now)
        ahead = helper.feedforward
        expected = made.wrench_cmd.copy()
        if ahead is not None:
            expected[output_indices(ahead.model.outputs)] += ahead.expected(made.wrench_cmd)
        rates.append(omega)
        wanted.append(np.concatenate((made.wrench_cmd, expected, [made.beta])))
        evaluations.append(made.iterations)
        accepted.append(made.accepted)
        asked.append(wrench[3:] - helper.estimate)
        hidden = size * np.sin(np.array([3.0, 5.0, 7.0]) * k * helper.dt)
        torque = asked[max(len(asked) - 1 - late, 0)] + hidden - np.cross(omega, J @ omega)
        omega = omega + helper.dt * np.linalg.solve(J, torque)
    return np.array(rates), np.array(wanted), np.array(evaluations, dtype=float), np.array(accepted)
