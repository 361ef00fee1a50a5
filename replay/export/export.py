"""A compensation as a folder of C99: what can be exported, and the text of every file."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, cast, get_args

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined

from wrenchgap.compensate import Compensator, PhysicsMismatch, Settings
from wrenchgap.compensate.fast import ENOUGH, Plan
from wrenchgap.compensate.physics_program import STATE, untraceable
from wrenchgap.flight.errors import UsageError
from wrenchgap.flight.flight import AXES, Array
from wrenchgap.flight.result import Result
from wrenchgap.learn.process.gp import GaussianProcess
from wrenchgap.plant.mismatch_inputs import COLUMNS
from wrenchgap.plant.model import Model
from wrenchgap.plant.model_file import content_hash, tool_version
from wrenchgap.replay.compensation.compensators import TORQUE, ProcessCaveat, caveats, compensator
from wrenchgap.replay.export.c_lines import Code, Printer, literal
from wrenchgap.replay.export.counting import KINDS, Cost, Pieces, cost, evaluations
from wrenchgap.replay.export.vectors import recorded

Precision = Literal["double", "float"]
BYTES = {"double": 8, "float": 4}
EVALUATIONS = 12
"""Default of the evaluations in one search on the vehicle; four are usual."""
TOLERANCE = 1e-9
"""Of the self-test in double precision [N, Nm]."""
OF_WRENCH, OF_CORRECTION = 5e-6, 0.01
"""Of the self-test in single precision: shares of the largest component, and of the largest correction."""
FILES = {
    "wrenchgap_compensator.h": "compensator.h.jinja",
    "wrenchgap_compensator.c": "compensator.c.jinja",
    "wrenchgap_tables.h": "tables.h.jinja",
    "selftest.c": "selftest.c.jinja",
    "Makefile": "Makefile.jinja",
    "CMakeLists.txt": "CMakeLists.txt.jinja",
    "README.md": "README.md.jinja",
}
_FIELDS = (("position_E", 0, 3), ("quat_EB", 3, 4), ("velocity_E", 7, 3), ("omega_B", 10, 3), ("time", 13, 1))
STATE_FIELDS = (*_FIELDS, ("voltage", 14, 1))
"""Fields of a `wg_input` that hold the state, with their places in `STATE`."""


@dataclass(frozen=True, repr=False)
class Export(Result):
    """A compensation as C99.

    files      content by name
    effects    names of the effects in it, and `left_out` of those that were left out, with the reason
    solved     share of the recorded steps that the search solves
    caveats    what `learn` warned of
    precision  "double" or "float", of the build unless it says otherwise
    """

    model: Model
    outputs: tuple[str, ...]
    files: dict[str, str]
    effects: tuple[str, ...]
    left_out: dict[str, str]
    precision: Precision
    dt: float
    points: int
    inputs: tuple[str, ...]
    cost: Cost
    has_process: bool
    solved: float
    caveats: tuple[ProcessCaveat, ...]


def export(
    process: GaussianProcess | None,
    model: Model,
    settings: Settings | None = None,
    *,
    lead: float | None = None,
    precision: str = "double",
    leave_out: Sequence[str] = (),
    names: tuple[str, str] = ("-", "-"),
    command: str = "wrenchgap export",
    date: str = "",
) -> Export:
    """The compensation of `process`, and of the effects of `model` where its mean is physics, as C99.

    Without a process, of the effects alone. `settings.dt` is the control period; `settings.max_evaluations` bounds each
    search. Effects in `leave_out` are not exported. `names` are those of the files of model and process.

    Raises UsageError for effects that cannot be exported, by name, and for a precision that is none.
    """
    if precision not in get_args(Precision):
        raise UsageError(f"export: precision is {precision!r}, expected one of {', '.join(get_args(Precision))}")
    kept, left_out = _without(model, leave_out)
    asked = replace(settings or Settings(max_evaluations=EVALUATIONS), solver="onboard")
    if asked.regulariser > 0.0:
        raise UsageError("export: regulariser is not zero, and the exported search has none; leave it out")
    loop = _loop(process, kept, asked, lead)
    plan = loop.plan
    assert plan is not None
    commands = None if process is None else (process.input_mean + process.input_scale * process.inputs)[:, : len(AXES)]
    given, wanted, usual, solved = recorded(loop, commands, kept.vehicle.body.mass)
    pieces = _pieces(plan)
    tables = _tables(plan)
    numbers = sum(int(np.size(values)) for _, values, _ in tables)
    price = cost(plan, pieces, usual, BYTES[precision], numbers)
    said: dict[str, Any] = {"precision": precision, "dt": asked.dt, "date": date, "command": command}
    said |= _names(process, kept, names) | _context(plan, pieces, loop, tables)
    said |= {"given": _rows(given), "wanted": _rows(wanted), "steps": len(given), "columns": given.shape[1]}
    single = OF_WRENCH * np.abs(wanted[:, :6]).max() + OF_CORRECTION * np.abs(wanted[:, :6] - given[:, :6]).max()
    said |= {"tolerance_double": TOLERANCE, "tolerance_float": f"{single:.2g}", "com": _com(kept)}
    has_physics = plan.physics is not None
    return Export(
        model=kept,
        outputs=loop.model.outputs,
        files={name: _environment().get_template(t).render(**said, cost=_words(price)) for name, t in FILES.items()},
        effects=tuple(e.name for e in loop_effects(loop)) if has_physics else (),
        left_out=left_out,
        precision=cast(Precision, precision),
        dt=asked.dt,
        points=0 if plan.expansion is None else plan.expansion.points.shape[1],
        inputs=() if plan.expansion is None else plan.expansion.input_groups,
        cost=price,
        has_process=plan.expansion is not None,
        solved=solved,
        caveats=() if process is None else caveats(process, model),
    )


def loop_effects(loop: Compensator) -> tuple[Any, ...]:
    """The effects that a compensator knows; those on sensors are not among them."""
    physics = loop.model if isinstance(loop.model, PhysicsMismatch) else loop.physics
    return () if physics is None else physics.model.effects


def _without(model: Model, names: Sequence[str]) -> tuple[Model, dict[str, str]]:
    have = [e.name for e in model.effects]
    for name in names:
        if name not in have:
            raise UsageError(
                f"export: --without {name}: the model has no such effect; it has {', '.join(have) or 'none'}"
            )
    kept = replace(model, effects=tuple(e for e in model.effects if e.name not in names))
    return kept, dict.fromkeys(names, "left out as asked")


def _loop(process: GaussianProcess | None, model: Model, settings: Settings, lead: float | None) -> Compensator:
    """The compensator that is exported."""
    if process is None and not model.effects:
        raise UsageError(f"export: {model.name} has no effects, and no GP is given: there is nothing to export")
    outputs = TORQUE if process is None else process.outputs
    needed = process is None or process.settings.mean == "physics"
    if needed and model.effects:
        physics = PhysicsMismatch(model.wrench_model, outputs, lead)
        refused = untraceable(physics, settings.dt)
        if refused:
            said = "; ".join(refused.values())
            raise UsageError(
                f"export: {', '.join(refused)} cannot be exported ({said}); leave it out with "
                f"{' '.join(f'--without {name}' for name in refused)}, or learn on a model without it"
            )
        if process is None:
            return Compensator(physics, settings)
    assert process is not None
    if needed and not model.effects:
        return Compensator(process, settings)  # everything was left out, as asked
    return compensator(process, model, settings, lead=lead)


def _pieces(plan: Plan) -> Pieces:
    if plan.physics is None:
        return Pieces(None, None, None)
    mismatch = Printer(plan.physics.mismatch)
    return Pieces(mismatch.fixed(), mismatch.moving(), Printer(plan.physics.sent, "s").fixed(results=True))


def _names(process: GaussianProcess | None, model: Model, names: tuple[str, str]) -> dict[str, Any]:
    gp_hash = "-"
    if process is not None:
        content = b"".join(np.ascontiguousarray(getattr(process, n)).tobytes() for n in sorted(process.array_shapes()))
        gp_hash = hashlib.sha256(content).hexdigest()
    return {
        "vehicle": model.vehicle.name,
        "version": tool_version(),
        "model_name": names[0],
        "gp_name": names[1],
        "model_hash": content_hash(model),
        "gp_hash": gp_hash,
    }


def _context(plan: Plan, pieces: Pieces, loop: Compensator, tables: list[tuple[str, Array, str]]) -> dict[str, Any]:
    """What the templates ask for."""
    gate, expansion, physics = plan.gate, plan.expansion, plan.physics
    groups = () if expansion is None else expansion.input_groups
    places = np.cumsum([len(AXES), *(len(COLUMNS[g]) for g in groups)]).tolist()
    seen = _seen(plan)
    never = not np.isfinite(gate.threshold)
    alone, whole = evaluations(plan)
    printer = None if physics is None else Printer(physics.mismatch)
    points = 0 if expansion is None else expansion.points.shape[1]
    named = ", ".join(e.name for e in loop_effects(loop))
    contents = [f"A Gaussian process of {points} points."] if expansion is not None else []
    contents += [f"Effects: {named}."] if physics is not None else []
    return {
        "outputs": loop.model.outputs,
        "arms": 0 if physics is None else physics.arms,
        "memory": 0 if physics is None else physics.memory,
        "process": expansion is not None,
        "physics": physics is not None,
        "both": expansion is not None and physics is not None,
        "groups": list(zip(groups, places, strict=False)),
        "lag": {name: repr(getattr(gate, name)) for name in ("a", "b0", "b1")},
        "unused": lambda field: "" if field in seen else "; not looked at",
        "looked_at": [(field, count) for field, _, count in STATE_FIELDS if field in seen],
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
        "tables": [(name, _shape(name, values), note, _values(name, values)) for name, values, note in tables],
        "contents": " ".join(contents),
    }


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


def _tables(plan: Plan) -> list[tuple[str, Array, str]]:
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


def _rows(values: Array) -> str:
    return ",\n".join("    {" + ", ".join(repr(float(v)) for v in row) + "}" for row in values)


def _com(model: Model) -> str:
    return "(" + ", ".join(f"{float(v):g}" for v in model.vehicle.body.com_B) + ")"


def _words(price: Cost) -> str:
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


def _environment() -> Environment:
    loader = PackageLoader("wrenchgap.replay.export", "templates")
    return Environment(
        loader=loader, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True
    )


def write(made: Export, folder: Path, *, force: bool = False) -> Path:
    """Write the files into a new folder, all of them or none; returns it. See `replay.export.folder`."""
    from wrenchgap.replay.export.folder import write_folder

    return write_folder(folder, made.files, force=force)


__all__ = ["Export", "export", "write"]
assert len(STATE) == 15
