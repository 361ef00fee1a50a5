"""The corrected allocation as files: C99 without dependencies, and one Python module that needs numpy alone.

Both are made of `compensate.allocation_kernels`: the C is printed from it, the Python has its functions as they stand.
"""

import ast
import inspect
import re
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from wrenchgap._escaping import printable
from wrenchgap.compensate import allocation_kernels as kernels
from wrenchgap.compensate.allocation_tables import AllocationTable
from wrenchgap.compensate.allocator import Allocator, Left, Margins, left_by_model, margins
from wrenchgap.compensate.c_expressions import INT, bounds, fields_of, name_of_constant
from wrenchgap.compensate.compiling import PRINTED
from wrenchgap.flight.arguments import check_arguments
from wrenchgap.flight.errors import ModelError
from wrenchgap.flight.flight import Array
from wrenchgap.flight.result import Result
from wrenchgap.learn.identify.add import Addition, model_of
from wrenchgap.plant.allocation_problem import allocation_problem
from wrenchgap.plant.effectiveness import Effectiveness, effectiveness
from wrenchgap.plant.model import Model
from wrenchgap.plant.model_file import content_hash, tool_version
from wrenchgap.plant.targets.quantities import acting_effects, at_limit
from wrenchgap.replay.export.c_lines import Own, literal, rows_text
from wrenchgap.replay.export.context import GENERATED, Table, numbers_text
from wrenchgap.replay.export.export import Precision, environment
from wrenchgap.replay.export.folder import checked, write_folder

FILES = (
    "wrenchgap_allocation.h",
    "wrenchgap_allocation.c",
    "wrenchgap_allocation.py",
    "allocation_selftest.c",
    "Makefile",
)
STEPS = 40
"""Demands of the self-test, among them some beyond the limits and one that is not finite."""
NOTES = {
    "demand": "b = demand (W - bias)",
    "bias": "wrench of all groups in the middle of their ranges [N, Nm]",
    "along": "b per share of range along the direction at rest, by row of b and group",
    "across": "the same across it; zero for arms that do not tilt",
    "made_along": "wrench per newton along, by axis and group, about the centre of mass [1, m]",
    "made_across": "the same across",
    "made_bias": "wrench without thrusts by the linear law [N, Nm]",
    "hover": "shares of the range in hover, along and across",
    "centre": "middle of the range [N]",
    "half": "half of the range [N]; all of it for arms that tilt",
    "low": "least thrust of a group [N]",
    "high": "largest thrust of a group [N]",
    "weak": "thrust below which an arm keeps its angle [N]",
    "tilting": "whether the arm of a group tilts",
    "arm": "of a group",
    "tilt_min": "[rad]",
    "tilt_max": "[rad]",
    "owner": "group of a rotor",
    "share": "of a rotor in the thrust of its group",
    "least": "thrust of a rotor at speed_min [N]",
    "most": "thrust of a rotor at speed_max [N]",
    "far": "demands are cut to this [N, Nm]",
    "rounds": "of the search for the largest margin; 0: pseudo-inverse",
    "calm": "share of a range up to which the pseudo-inverse is taken as it is; 0: the largest margin everywhere",
}


@dataclass(frozen=True, repr=False)
class AllocationExport(Result):
    """A corrected allocation: `files` by name, `effects` that it allows for, what the model leaves of demands with it
    and without, margins over demands that can be made.
    """  # noqa: D205

    model: Model
    files: dict[str, str]
    effects: tuple[str, ...]
    precision: Precision
    left: Left
    margins: Margins


def _require_known_rotors(model: Model) -> None:
    """Raise ModelError where an effect of single rotors is at its limit: it is left out, and a dead motor used."""
    single = (one for one in model.effects if one.effect.place == "thrusts" and one.effect.sparse)
    stuck = [one.name for one in single if at_limit(one, model.vehicle)]
    if stuck:
        raise ModelError(
            f"{model.name}: {', '.join(stuck)} is at a limit of what is plausible: its law is wrong, what rotors make "
            "is not known (a motor that has failed?); take it out (wrenchgap remove) for the nominal allocation"
        )


@check_arguments
def export_allocation(
    model: Model | Addition,
    folder: str | Path | None = None,
    *,
    precision: Precision = "double",
    command: str = "wrenchgap.export_allocation",
    force: bool = False,
) -> AllocationExport:
    """The corrected allocation of a model as C99 and Python; with a `folder` all files are written there, or none.

    Parameters
    ----------
    model
        With rotors and fitted effects.
    folder
        None: nothing is written, `files` of the result has the texts by name.
    precision
        "double" or "float", of the C unless its build says otherwise.
    command
        What the files say that they were written with.
    force
        Whether a folder that this function wrote may be replaced.

    Returns
    -------
    AllocationExport
        Files, effects that are allowed for, and the margins of rotors over demands that the vehicle can make.

    Raises
    ------
    UsageError
        Where the folder exists and `force` is not given.
    ModelError
        For a model without rotors or with one of them at the limit of an effect, a vehicle that cannot hover as flown,
        and one of which the corrected allocation would by the model itself make worse what is asked for.
    """
    known = model_of(model)
    if folder is not None:
        checked(Path(folder), FILES, force=force, model=known)
    _require_known_rotors(known)
    problem = allocation_problem(known)
    allocator, left = Allocator(problem), left_by_model(known, problem)
    if left.worse:
        raise ModelError(
            f"{known.name}: by the model itself the corrected allocation leaves {left.corrected[0]:.2g} N and "
            f"{left.corrected[1]:.2g} Nm of what is asked for, the nominal one {left.nominal[0]:.2g} N and "
            f"{left.nominal[1]:.2g} Nm: its effects are no straight line of the thrusts; compensate them instead "
            "(wrenchgap learn)"
        )
    effects = tuple(one.name for one in acting_effects(known))
    said = _context(known, allocator, precision, command) | {"effects": effects}
    files = {name: environment(name).get_template(f"{name}.jinja").render(**said) for name in FILES[:-1]}
    files["Makefile"] = environment("Makefile").get_template("allocation_Makefile.jinja").render(**said)
    if folder is not None:
        write_folder(Path(folder), files, force=force)
    return AllocationExport(known, files, effects, precision, left, margins(problem))


def effectiveness_and_allocation(model: Model) -> tuple[Effectiveness, AllocationExport | str]:
    """The effectiveness of a model, and its corrected allocation, or why it has none."""
    found = effectiveness(model)
    try:
        return found, export_allocation(model)
    except ModelError as error:
        return found, str(error)


def _context(model: Model, allocator: Allocator, precision: Precision, command: str) -> dict[str, Any]:
    vehicle, table = model.vehicle, allocator.table
    arms, rotors = vehicle.geometry()
    given, wanted = _recorded(allocator)
    sizes = {"WGA_RANK": len(table.demand), "WGA_GROUPS": len(table.half)}
    return {
        "vehicle": vehicle.name,
        "version": tool_version(),
        "date": f"{datetime.now(UTC):%Y-%m-%d}",
        "command": printable(command),
        "model_hash": content_hash(model),
        "precision": precision,
        "rotors": [vehicle.rotor_name(r) for r in range(len(rotors))],
        "arms": [vehicle.arm_name(a) for a in range(len(arms))],
        "tilts": bool(arms.tilts.any()),
        "rounds": table.rounds,
        "sizes": sizes,
        "declarations": Own((GENERATED / "allocation.h").read_text()),
        "functions": Own((GENERATED / "allocation.c").read_text()),
        "tables": list(_tables(table)),
        "python_table": Own(_python_table(table)),
        "python_functions": Own("\n\n\n".join(_python_functions())),
        "python_constants": Own(_python_constants()),
        "given": rows_text(given),
        "wanted": rows_text(wanted),
        "steps": len(given),
        "columns": wanted.shape[1],
        "tolerance_float": f"{1e-3 * float(np.max(table.most)):.2g}",
    }


def _own(text: str) -> str:
    """Names of this export: it may stand beside that of the compensation."""
    return re.sub(r"\bWG(?=[_(])", "WGA", re.sub(r"\bwg_", "wga_", text))


def _tables(table: AllocationTable) -> Iterator[dict[str, Any]]:
    """Declarations of constants in C, with what they hold."""
    for field, kind in fields_of("AllocationTable").items():
        name, value = name_of_constant("AllocationTable", field, kind), getattr(table, field)
        if kind.sizes:
            text = numbers_text(Table(name, kind.name, "", value))
            said = f"static const {kind.name} {name}{bounds(kind.sizes)} = {{\n{text}\n}};"
        else:
            said = f"#ifndef {name}\n#define {name} {int(value) if kind == INT else literal(float(value))}\n#endif"
        yield {"note": NOTES[field], "text": Own(_own(said))}


def _python_table(table: AllocationTable) -> str:
    """The constants as keyword arguments, one a line."""
    rows = []
    for field, value in table._asdict().items():
        text = repr(np.asarray(value).tolist()).replace("inf", "np.inf")
        rows.append(f"    {field}={text if np.isscalar(value) else f'np.array({text})'},  # {NOTES[field]}")
    return "\n".join(rows)


def _python_functions() -> Iterator[str]:
    """The functions of the kernels without decorators and annotations, in their order."""
    for node in ast.parse(inspect.getsource(kernels)).body:
        if not isinstance(node, ast.FunctionDef) or not {ast.unparse(d) for d in node.decorator_list} & {*PRINTED}:
            continue
        node.decorator_list, node.returns = [], None
        for argument in node.args.args:
            argument.annotation = None
        yield ast.unparse(node)


def _python_constants() -> str:
    """Constants of the kernels as they stand."""
    names = ("TURN", "FLOOR", "SMALL", "SAME_ANGLE", "WOUND", "BLEND", "RAMP", "SLACK", "MADE", "BAD_DEMAND", "REDUCED")
    return "\n".join(f"{name} = {getattr(kernels, name)!r}" for name in names)


def _recorded(allocator: Allocator) -> tuple[Array, Array]:
    """Demands (N, 6) in order, and thrusts, tilts, wrench made and status of each."""
    rng, p = np.random.default_rng(0), allocator.problem
    scale = allocator.table.far / 10.0
    given = p.hover + rng.uniform(0.0, 0.6, size=(STEPS, 1)) * rng.normal(size=(STEPS, 6)) * scale
    given[STEPS // 2] = np.nan
    allocator.reset()
    wanted = []
    for row in given:
        out = allocator.step(row)
        wanted.append(np.concatenate((out.thrust, out.tilt, out.made, [out.status])))
    return given, np.array(wanted)
