"""What the templates of the exported code ask for: sizes, constants, tables, and the cost in words."""

from __future__ import annotations

from typing import Any

import numpy as np

from wrenchgap.compensate import Combined
from wrenchgap.compensate.fast import ENOUGH, Plan
from wrenchgap.compensate.physics_program import STATE
from wrenchgap.compensate.reach import FAR, PULLS, ROUNDS, SLACK, Reach
from wrenchgap.compensate.step_row import STATE_MAX, TURN_MAX, TURN_MIN, VOLTAGE_MAX
from wrenchgap.flight.errors import UsageError
from wrenchgap.flight.flight import AXES, Array
from wrenchgap.plant.mismatch_inputs import COLUMNS
from wrenchgap.replay.compensation.compensators import Judged
from wrenchgap.replay.export.c_lines import Code, Own, Printer, literal
from wrenchgap.replay.export.counting import KINDS, Cost, Pieces, evaluations
from wrenchgap.replay.export.observer import observer_context
from wrenchgap.replay.export.records import LONGEST, record_type

_FIELDS = (("position_E", 0, 3), ("quat_EB", 3, 4), ("velocity_E", 7, 3), ("omega_B", 10, 3), ("time", 13, 1))
STATE_FIELDS = (*_FIELDS, ("voltage", 14, 1))
"""Fields of a `wg_input` that hold the state, with their places in `STATE`."""


def context(
    plan: Plan,
    pieces: Pieces,
    effects: tuple[str, ...],
    tables: list[tuple[str, Array, str]],
    observer: Combined | None,
    judged: Judged | None,
    reach: Reach,
) -> dict[str, Any]:
    """What the templates ask for, of a plan with `effects`."""
    # Long because it names every number of the templates, one a line.
    gate, expansion, physics = plan.gate, plan.expansion, plan.physics
    groups = () if expansion is None else expansion.input_groups
    places = np.cumsum([len(AXES), *(len(COLUMNS[g]) for g in groups)]).tolist()
    seen = _seen(plan) | ({"omega_B"} if observer is not None else set())
    never = not np.isfinite(gate.threshold)
    alone, whole = evaluations(plan)
    printer = None if physics is None else Printer(physics.mismatch)
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
        "both": expansion is not None and physics is not None,
        "groups": list(zip(groups, places, strict=False)),
        "lag": {name: repr(getattr(gate, name)) for name in ("a", "b0", "b1")},
        "unused": lambda field: "" if field in seen else "; not looked at",
        "looked_at": [
            (field, count, repr(max((*STATE_MAX, VOLTAGE_MAX)[first : first + count])))
            for field, first, count in STATE_FIELDS
            if field in seen
        ],
        "turn_min": repr(TURN_MIN),
        "turn_max": repr(TURN_MAX),
        "reach": _reach(reach),
        "correction_max": [f"{v:.4g}" for v in correction_max(plan, observer)],
        "evaluations_max": alone + whole + 1,
        "fixed": _said(pieces.fixed),
        "moving": _said(pieces.moving),
        "sent": _said(pieces.sent),
        "fixed_count": 0 if printer is None else len(printer.kept),
        "inputs": len(AXES) if expansion is None else len(expansion.input_mean),
        "points": points,
        "triangular": expansion is not None and expansion.triangular,
        "most": gate.most,
        "accept": repr(gate.accept),
        "enough": repr(gate.enough),
        "enough_float": repr(max(gate.accept * 1e-7, gate.accept * ENOUGH)),
        "never": never,
        "threshold": repr(gate.threshold),
        "kappa": repr(gate.kappa),
        "decay": repr(gate.decay),
        "rows": ", ".join(str(int(k)) for k in gate.rows),
        "bound": ", ".join(literal(float(b)) for b in gate.bound),
        "known_bound": ", ".join(literal(float(b)) for b in gate.known),
        "tables": [(name, _shape(name, values), note, Own(_values(name, values))) for name, values, note in tables],
        "contents": " ".join(contents),
    }


def _state_size(plan: Plan, observed: dict[str, Any] | None) -> dict[str, int]:
    """How many numbers and counts a `wg_memory` holds: six wrenches, `fresh`, actuators; what an observer keeps."""
    physics = plan.physics
    numbers = 6 * len(AXES) + 1 + (0 if physics is None else physics.arms + physics.memory) + 1
    counts = 1
    if observed is not None:
        follows = bool(observed["follow"])
        numbers += 3 * (2 + int(observed["asked"]) + 2 * follows)
        counts += 2 + follows
    if (size := record_type(8, numbers, counts).itemsize) > LONGEST:
        raise UsageError(
            f"export: a delay of commands is remembered period by period, and a state of {numbers} numbers makes "
            f"records of {size:,} bytes, more than {LONGEST:,}; use a longer --dt, or --without command_delay"
        )
    return {"state_numbers": numbers, "state_counts": counts}


def _reach(reach: Reach) -> dict[str, Any]:
    """Numbers of a reach as C."""

    def row(values: Array) -> list[str]:
        return [literal(float(v)) for v in values]

    return {
        "rows": [row(r) for r in reach.rows],
        "solve": [row(r) for r in reach.solve],
        "hover": row(reach.hover / reach.authority),
        **{name: row(getattr(reach, name)) for name in ("authority", "low", "high", "middle", "half", "weak")},
        "slack": repr(SLACK),
        "far": repr(FAR),
        "rounds": ROUNDS,
        "pulls": PULLS,
    }


def correction_max(plan: Plan, observer: Combined | None) -> Array:
    """Largest correction (6,) of all parts together [N, Nm]."""
    most, gate = np.zeros(len(AXES)), plan.gate
    most[gate.rows] = gate.bound + (gate.known if gate.has_process and gate.has_physics else 0.0)
    most[3:] += 0.0 if observer is None else observer.torque_max
    return most


def _seen(plan: Plan) -> set[str]:
    """Fields of the input that something looks at."""
    groups = () if plan.expansion is None else plan.expansion.input_groups
    by_group = {"velocity": ("velocity_E", "quat_EB"), "rates": ("omega_B",), "position": ("position_E",), "past": ()}
    seen = {field for group in groups for field in by_group[group]}
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


def tables_of(plan: Plan) -> list[tuple[str, Array, str]]:
    """Name, numbers and note of every table."""
    e, gate = plan.expansion, plan.gate
    if e is None:
        return []
    whitener = e.whitener.transpose(0, 2, 1)
    if e.triangular:
        upper = np.triu_indices(whitener.shape[1])
        whitener = np.stack([w[upper] for w in whitener])
    else:
        whitener = whitener.reshape(len(whitener), -1)
    return [
        ("wg_input_mean", e.input_mean, "x = (xi - mean) / scale"),
        ("wg_input_scale", e.input_scale, "in the units of the inputs"),
        ("wg_output_scale", e.output_scale, "[N] or [Nm]"),
        ("wg_mean", e.mean_coefficients, "b_0, then b of the mean function b_0 + b . x"),
        ("wg_lengthscales", e.lengthscales, "of x"),
        ("wg_points", e.points.transpose(0, 2, 1), "training or inducing points, by output and input, in lengthscales"),
        ("wg_alpha", e.alpha, "weights of the points"),
        ("wg_whitener", whitener, "C^-1 column by column" + (", the lower triangle" if e.triangular else "")),
        ("wg_signal", e.signal_variance, "variances of signal and noise, standardised"),
        ("wg_noise", e.noise_variance, "and of the noise"),
        ("wg_sigma_scale", e.sigma_scale, "calibration of sigma"),
        ("wg_watched", np.asarray(gate.watched, dtype=float), "outputs that have a vote in the gate"),
        ("wg_offset", gate.offset, "sigma of an output: (std - offset) / scale"),
        ("wg_scale", gate.scale, "the scale"),
    ]


def _shape(name: str, values: Array) -> str:
    first = "[L]" if name not in ("wg_input_mean", "wg_input_scale") else f"[{len(values)}]"
    return first + "".join(f"[{size}]" for size in np.shape(values)[1:])


def _values(name: str, values: Array) -> str:
    """Numbers of a table, a few in a row."""
    if np.ndim(values) > 1:
        return ",\n".join("{\n" + _values(name, part) + "\n}" for part in values)
    texts = [str(int(v)) if name == "wg_watched" else literal(float(v)) for v in values]
    return ",\n".join("    " + ", ".join(texts[k : k + 5]) for k in range(0, len(texts), 5))


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


assert len(STATE) == 15
