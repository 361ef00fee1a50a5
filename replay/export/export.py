"""A compensation as a folder of C99: what can be exported, and the text of every file."""

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined

from wrenchgap._escaping import build_text, c_comment, comment, markdown, printable
from wrenchgap.compensate import Compensator, PhysicsMismatch, Settings
from wrenchgap.compensate.fast import Plan
from wrenchgap.compensate.physics import untraceable
from wrenchgap.compensate.reach import reach_of
from wrenchgap.flight.arguments import check_arguments
from wrenchgap.flight.errors import UsageError
from wrenchgap.flight.flight import AXES
from wrenchgap.flight.result import Result
from wrenchgap.learn import GaussianProcess, Learnt
from wrenchgap.learn.identify.add import Addition, model_of
from wrenchgap.learn.process.predictors import check_effects
from wrenchgap.plant.mismatch import LinearMismatch
from wrenchgap.plant.model import Model
from wrenchgap.plant.model_file import content_hash, tool_version
from wrenchgap.plant.wrench_model import ModelEffect
from wrenchgap.replay.compensation import compensators
from wrenchgap.replay.compensation.compensators import TORQUE, Judged, ProcessCaveat
from wrenchgap.replay.export.c_lines import Cost, Own, Pieces, Printer, cost, rows_text
from wrenchgap.replay.export.context import Table, Vectors, context, correction_max, numbers_of, recorded, words_of
from wrenchgap.replay.export.folder import checked, write_folder
from wrenchgap.replay.export.observer import Asked, observed, with_observer
from wrenchgap.replay.export.records import HASHED, export_id

Precision = Literal["double", "float"]
BYTES = {"double": 8, "float": 4}
EVALUATIONS = 12
"""Default of the evaluations in one search on the vehicle; four are usual."""
FILES = (
    *("wrenchgap_compensator.h", "wrenchgap_compensator.c", "wrenchgap_tables.h"),
    *("wrenchgap_record.h", "wrenchgap_record.c", "selftest.c", "Makefile", "CMakeLists.txt", "README.md"),
)
"""Each has a template, which is called as it without the `wrenchgap_`."""
ESCAPES: dict[str, Callable[[str], str]] = {".c": c_comment, ".h": c_comment, ".md": markdown, ".py": comment}
"""What makes a name harmless in a file, by its ending; `build_text` in all others."""


@dataclass(frozen=True, repr=False)
class Export(Result):
    """A compensation as C99.

    files      content by name
    effects    names of the effects in it, and `left_out` of those that were left out, with the reason
    corrected  which components are corrected, in words: those with the verdict "do not" are not, or not by the process
    solved     share of the recorded steps that the search solves
    caveats    what `learn` warned of
    precision  "double" or "float", of the build unless it says otherwise
    observer_hz, observer_max   bandwidth of the observer and largest estimate (3,) [Nm]; None and () without one
    correction_max  largest correction (6,) of all parts together [N, Nm]
    judged          that observer in the attitude loop of the model, None without one
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
    corrected: str = ""
    observer_hz: float | None = None
    observer_max: tuple[float, ...] = ()
    correction_max: tuple[float, ...] = ()
    judged: Judged | None = None


@check_arguments
def export_compensator(
    gp: GaussianProcess | Learnt | None,
    model: Model | Addition,
    folder: str | Path | None = None,
    settings: Settings | None = None,
    *,
    lead: float | None = None,
    precision: Precision = "double",
    without: Sequence[str] = (),
    names: tuple[str, str] = ("-", "-"),
    command: str = "wrenchgap.export_compensator",
    force: bool = False,
    observer: Asked = None,
    observer_max: float | None = None,
) -> Export:
    """The compensation as C99 (docs/export.md); with a `folder` all files are written there, or none.

    Of a process, and where its mean is physics of the effects of `model`; without a process, of the effects alone.
    `settings` are by default those of the model's control rate, with 12 evaluations of the model in one search.
    `settings.dt` is the control period; `settings.max_evaluations` bounds each search. Effects in `without` are left
    out. `names` are those of the files of model and process. With an `observer` of so many Hz, or "log" for the
    bandwidth in the GP's file, what the rest leaves is corrected too, by at most `observer_max` [Nm].

    Raises UsageError where the folder exists and `force` is not given, and for what cannot be exported, by name.
    """
    # Long because an `Export` has as many fields, one a line.
    known, process = model_of(model), None if gp is None else compensators.gp_of(gp)
    if folder is not None:
        checked(Path(folder), FILES, force=force, model=known)
    kept, left_out = _without(process, known, without)
    asked = settings or Settings(dt=1.0 / known.controller.rate_hz, max_evaluations=EVALUATIONS)
    asked = replace(asked, solver="onboard")
    if asked.regulariser > 0.0:
        raise UsageError("export: regulariser is not zero, and the exported search has none; leave it out")
    idle = tuple(e for e in known.effects if e.name in left_out)
    loop, plan = _parts(process, kept, asked, lead, idle, alone=observer is not None)
    watched = observed(observer, observer_max, loop, process, kept, asked.dt)
    in_loop = None if watched is None else compensators.judged(process, kept, watched.bandwidth_hz)
    commands = None if process is None else (process.input_mean + process.input_scale * process.inputs)[:, : len(AXES)]
    vectors = recorded(watched or cast(Compensator, loop), commands, kept.vehicle)
    plan = plan._replace(reach=reach_of(kept.vehicle))
    plan.reach.check_apart([AXES[k] for k in plan.gate.rows], kept.vehicle.name)
    pieces, (tables, macros) = _pieces(plan), numbers_of(plan, watched)
    _check_range(tables, precision)
    price = cost(plan, pieces, vectors.evaluations, BYTES[precision], sum(int(np.size(t.numbers)) for t in tables))
    price = price if watched is None else with_observer(price, watched, BYTES[precision])
    effects: tuple[str, ...] = ()  # those on sensors are not among them
    if loop is not None and plan.physics is not None:
        physics = loop.model if isinstance(loop.model, PhysicsMismatch) else loop.physics
        effects = () if physics is None else tuple(e.name for e in physics.model.effects)
    said = {"precision": precision, "dt": asked.dt, "date": f"{datetime.now(UTC):%Y-%m-%d}"}
    said["command"] = Own(printable(command))
    said |= _names(process, kept, names) | _recorded(vectors)
    said |= context(plan, pieces, effects, tables, macros, watched, in_loop)
    outputs = tuple(AXES[k] for k in plan.gate.rows)
    refused = () if process is None or asked.despite_verdict else process.refused
    corrected = _corrected(outputs, refused, effects, observed=watched is not None)
    com = ", ".join(f"{float(v):g}" for v in kept.vehicle.body.com_B)
    said |= {"com": f"({com})", "cost": Own(words_of(price)), "corrected": corrected}
    made = Export(
        model=kept,
        outputs=outputs,
        files=_files(said),
        effects=effects,
        left_out=left_out,
        precision=precision,
        dt=asked.dt,
        points=0 if plan.expansion is None else plan.expansion.points.shape[1],
        inputs=() if plan.expansion is None else plan.expansion.input_groups,
        has_process=plan.expansion is not None,
        cost=price,
        solved=vectors.solved,
        caveats=() if process is None else compensators.caveats(process, known),
        corrected=corrected,
        observer_hz=None if watched is None else watched.bandwidth_hz,
        observer_max=() if watched is None else tuple(watched.torque_max.tolist()),
        correction_max=tuple(correction_max(plan, watched).tolist()),
        judged=in_loop,
    )
    if folder is not None:
        write_folder(Path(folder), made.files, force=force)
    return made


def _check_range(tables: Sequence[Table], precision: str) -> None:
    """Raise UsageError for a number of the tables that single precision cannot hold."""
    most = float(np.finfo(np.float32).max)
    for name, _, _, values in tables:
        largest = np.abs(values).max(initial=0.0, where=np.isfinite(values))
        if precision == "float" and largest > most:
            raise UsageError(f"export: {name} of the GP holds {largest:.3g}, too large for --precision float")


def _files(said: dict[str, Any]) -> dict[str, str]:
    """The text of every file by its name, with the id of all that are hashed."""

    def text(name: str, export: str) -> str:
        return environment(name).get_template(f"{name.removeprefix('wrenchgap_')}.jinja").render(**said, export=export)

    found = export_id({name: text(name, "").encode() for name in HASHED})
    return {name: text(name, found) for name in FILES}


def _corrected(outputs: Sequence[str], refused: Sequence[str], effects: Sequence[str], *, observed: bool) -> str:
    """Which components are corrected, and those that the process is refused for: by what else, or that they are not."""
    others = [*(["the effects"] if effects else []), *(["the observer"] if observed else [])]
    parts = [", ".join(name for name in outputs if name not in refused)]
    if refused:
        alone = f"by {' and '.join(others)} alone" if others else "not corrected (verdict of learn)"
        parts.append(f"{', '.join(refused)} {alone}")
    return "; ".join(part for part in parts if part)


def _recorded(
    vectors: Vectors, double: float = 1e-9, of_wrench: float = 5e-6, of_correction: float = 0.01
) -> dict[str, Any]:
    """What the self-test repeats, and how nearly.

    In `double` precision to so many N or Nm, in single to a share of the largest component and one of the largest
    correction.
    """
    given, wanted = vectors.given, vectors.wanted
    single = of_wrench * np.abs(wanted[:, :6]).max() + of_correction * np.abs(wanted[:, :6] - given[:, :6]).max()
    return {
        "given": rows_text(given),
        "wanted": rows_text(wanted),
        "steps": len(given),
        "columns": given.shape[1],
        "tolerance_double": double,
        "tolerance_float": f"{single:.2g}",
    }


def _parts(
    process: GaussianProcess | None,
    model: Model,
    settings: Settings,
    lead: float | None,
    without: tuple[ModelEffect, ...],
    *,
    alone: bool,
) -> tuple[Compensator | None, Plan]:
    """The feed-forward and what of it becomes code; none where all is refused, if an observer may be `alone`."""
    if alone and process is not None and compensators.all_refused(process, settings):
        count = len(process.outputs)
        idle = LinearMismatch(process.outputs, np.zeros(count), np.zeros((count, len(AXES))), np.ones(count))
        made = Compensator(idle, settings, vehicle=model.vehicle).plan
        assert made is not None
        return None, made._replace(expansion=None, gate=made.gate._replace(has_process=0))
    if process is None and not model.effects:
        raise UsageError(f"export: {model.name} has no effects, and no GP is given: there is nothing to export")
    loop = None
    if model.effects and (process is None or process.settings.mean == "physics"):
        physics = PhysicsMismatch(model.wrench_model, TORQUE if process is None else process.outputs, lead)
        refused = untraceable(physics, settings.dt)
        if refused:
            said = "; ".join(refused.values())
            raise UsageError(
                f"export: {', '.join(refused)} cannot be exported ({said}); leave it out with "
                f"{' '.join(f'--without {name}' for name in refused)}, or learn on a model without it"
            )
        loop = Compensator(physics, settings) if process is None else None
    elif process is not None and process.settings.mean == "physics":
        loop = Compensator(process, settings, vehicle=model.vehicle)  # everything was left out, as asked
    if loop is None:
        assert process is not None
        loop = compensators.compensator(process, model, settings, lead=lead, without=without)
    assert loop.plan is not None
    return loop, loop.plan


def _without(process: GaussianProcess | None, model: Model, names: Sequence[str]) -> tuple[Model, dict[str, str]]:
    """The model without some effects, once it is known to have those of the process."""
    if process is not None and process.settings.mean == "physics":
        check_effects(process, model)
    have = [e.name for e in model.effects]
    for name in names:
        if name not in have:
            raise UsageError(
                f"export: --without {name}: the model has no such effect; it has {', '.join(have) or 'none'}"
            )
    kept = replace(model, effects=tuple(e for e in model.effects if e.name not in names))
    return kept, dict.fromkeys(names, "left out as asked")


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


def environment(name: str) -> Environment:
    """Templates of a file of this name: every text but `Own` is escaped as that kind of file needs it."""
    escape = ESCAPES.get(Path(name).suffix, build_text)
    return Environment(
        loader=PackageLoader("wrenchgap.replay.export", "templates"),
        finalize=lambda value: escape(value) if type(value) is str else value,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
