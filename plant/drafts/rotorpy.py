"""A vehicle from RotorPy's `quad_params`, a dict that a Python file assigns; the file is not run.

From the centre of mass; k_eta Omega^2 is a rotor's thrust along z, rotor_directions k_m Omega^2 its torque on the body
about z, whatever the air does to the thrust. Beyond that, each an effect:

    tau_m              motor_lag               dOmega/dt = (Omega_cmd - Omega) / tau_m
    c_Dx, c_Dy, c_Dz   body_drag_areas         -|v| c_D v
    k_d                rotor_drag              -Omega k_d v_t, at the hub and across z
    k_z                axial_inflow            -Omega k_z v_z, at the hub
    k_h                translational_lift      k_h |v_t|^2, at the hub
    k_m, with k_z or k_h: drag_torque_of_speed, since their change of the thrust is not in the torque

Source: rotorpy 3.0, vehicles/multirotor.py (`compute_body_wrench`) and the files vehicles/*_params.py.

Of the file counts, and no more: numbers, texts, lists, dicts with keys of text; the array of a list, `np.array([...])`;
names of numbers that were assigned above; + - * / of numbers, and of a number with an array. `import numpy as np` and
texts that stand alone (docstrings) are skipped. So nothing grows: an array has as many entries as the text writes out.
"""

import ast
import operator
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Self

import numpy as np
from pydantic import model_validator

from wrenchgap.flight.errors import ModelError
from wrenchgap.flight.flight import Array
from wrenchgap.plant.drafts.draft import Draft, EffectDraft, RotorDraft, Sourced
from wrenchgap.plant.drafts.package_tables import CENTRE, UP, Numbers, lag_effect, notes_of, read_known
from wrenchgap.plant.effects.body_drag_areas import BodyDragAreas
from wrenchgap.plant.reader import Integer, NotNegative, Number, Positive, Table, Vector, quoted, rule_error, text_of


class QuadParams(Table):
    """What of `quad_params` describes the vehicle, with RotorPy's defaults."""

    mass: Positive
    Ixx: Positive
    Iyy: Positive
    Izz: Positive
    Ixy: Number
    Ixz: Number
    Iyz: Number
    num_rotors: Integer
    rotor_pos: dict[str, Vector]
    rotor_directions: Numbers
    rotor_radius: Positive | None = None
    rI: Vector | None = None
    c_Dx: NotNegative = 0.0
    c_Dy: NotNegative = 0.0
    c_Dz: NotNegative = 0.0
    k_eta: Positive
    k_m: NotNegative
    k_d: NotNegative = 0.0
    k_z: NotNegative = 0.0
    k_h: NotNegative = 0.0
    tau_m: NotNegative
    rotor_speed_min: NotNegative
    rotor_speed_max: Positive

    @model_validator(mode="after")
    def _fits(self) -> Self:
        rotors, places, ways = self.num_rotors, len(self.rotor_pos), len(self.rotor_directions)
        if not rotors == places == ways:
            raise rule_error(
                f"num_rotors is {rotors}, rotor_pos has {places}, rotor_directions {ways}: expected as many"
            )
        if not all(abs(way) == 1.0 for way in self.rotor_directions):
            raise rule_error(f"rotor_directions: got {list(self.rotor_directions)}, expected 1 or -1 for each rotor")
        if self.rotor_speed_min >= self.rotor_speed_max:
            raise rule_error("rotor_speed_min: expected less than rotor_speed_max [rad/s]")
        return self


def from_rotorpy(path: Path) -> Draft:
    """A draft of the `quad_params` of a Python file. Raises ModelError, in one line."""
    found = constants(path).get("quad_params")
    if not isinstance(found, dict):
        raise ModelError(f"{path.name}: assigns no dict quad_params, as RotorPy's files vehicles/*_params.py do")
    told, unread = read_known(QuadParams, found, f"{path.name}: quad_params")
    effects = _effects(told)
    xy, xz, yz = told.Ixy, told.Ixz, told.Iyz
    return Draft(
        path.stem,
        path.name,
        _rotors(told),
        mass=_sourced(told.mass, "mass"),
        inertia=_sourced(((told.Ixx, xy, xz), (xy, told.Iyy, yz), (xz, yz, told.Izz)), "Ixx to Iyz"),
        com=CENTRE,
        imu_position=None if told.rI is None else _sourced(told.rI, "rI"),
        effects=effects,
        notes=notes_of(path.name, unread, effects),
    )


def _sourced(value: Any, keys: str) -> Sourced:
    return Sourced(value, f"{keys} of quad_params")


def _rotors(told: QuadParams) -> tuple[RotorDraft, ...]:
    radius = None if told.rotor_radius is None else _sourced(told.rotor_radius, "rotor_radius")
    return tuple(
        RotorDraft(
            _sourced(place, "rotor_pos"),
            UP,
            _sourced(-int(way), "rotor_directions, against that torque on the body,"),
            kappa=_sourced(told.k_m / told.k_eta, "k_m over k_eta"),
            c_f=_sourced(told.k_eta, "k_eta"),
            radius=radius,
            speed_min=_sourced(told.rotor_speed_min, "rotor_speed_min"),
            speed_max=_sourced(told.rotor_speed_max, "rotor_speed_max"),
        )
        for place, way in zip(told.rotor_pos.values(), told.rotor_directions, strict=True)
    )


def _effects(told: QuadParams) -> tuple[EffectDraft, ...]:
    """The terms beyond thrust and torque with the square of the speed."""
    half_density = 0.5 * BodyDragAreas.air_density
    areas = {"area_x": told.c_Dx / half_density, "area_y": told.c_Dy / half_density, "area_z": told.c_Dz / half_density}
    rows: tuple[tuple[str, str, dict[str, float], bool], ...] = (
        ("body_drag_areas", "c_Dx, c_Dy, c_Dz", areas, any(areas.values())),
        ("rotor_drag", "k_d", {"coefficient": told.k_d}, told.k_d > 0.0),
        ("axial_inflow", "k_z", {"k_z": told.k_z}, told.k_z > 0.0),
        ("translational_lift", "k_h", {"k_h": told.k_h}, told.k_h > 0.0),
        ("drag_torque_of_speed", "k_m", {"change": 0.0, "of_speed": 1.0}, told.k_m * max(told.k_z, told.k_h) > 0.0),
    )
    lag = lag_effect(told.tau_m, told.tau_m, "tau_m of quad_params")
    return (*lag, *(EffectDraft(name, values, f"{keys} of quad_params") for name, keys, values, said in rows if said))


LONGEST = 2**16
"""Characters: files of parameters have some thousands, and a parser needs a hundred times as many bytes."""
OPERATIONS: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
}
READ = "numbers, texts, lists, dicts, np.array([...]) and + - * / of numbers are read, and nothing is run"

Constant = float | str | Array | list[Any] | dict[str, Any]


class _Unread(Exception):
    """An expression that is none of a constant; its node is the argument."""


def constants(path: Path) -> dict[str, Constant]:
    """What the file assigns at its top level, by name, later assignments in place of earlier ones.

    Raises ModelError, in one line, for a file that cannot be read or has anything else in it.
    """
    text = text_of(path, "as Python")
    if len(text) > LONGEST:
        raise ModelError(
            f"{path.name}: is longer than {LONGEST:,} characters; leave the assignment of parameters alone"
        )
    found: dict[str, Constant] = {}
    numpy: set[str] = set()
    for statement in _statements(text, path.name):
        try:
            match statement:
                case ast.Expr(value=ast.Constant(value=str())):
                    pass
                case ast.Import(names=[ast.alias(name="numpy", asname=asname)]):
                    numpy.add(asname or "numpy")
                case ast.Assign(targets=[ast.Name(id=name)], value=value):
                    found[name] = _evaluated(value, found, numpy)
                case _:
                    raise _Unread(statement)
        except _Unread as error:
            line = error.args[0].lineno
            said = quoted(repr(text.split("\n")[line - 1].strip()))
            raise ModelError(
                f"{path.name}, line {line}: got {said}; {READ}: write the number there, or take the line out"
            ) from None
    return found


def _statements(text: str, where: str) -> list[ast.stmt]:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of what runs
            return ast.parse(text).body
    except SyntaxError as error:
        raise ModelError(f"{where}, line {error.lineno or 1}: is not Python: {error.msg}") from None
    except ValueError:  # a zero byte
        raise ModelError(f"{where}: is not Python: it has a zero byte") from None
    except (RecursionError, MemoryError):
        raise ModelError(
            f"{where}: is not Python that is read here: expressions within one another without end"
        ) from None


def _evaluated(node: ast.expr, known: Mapping[str, Constant], numpy: set[str], levels: int = 20) -> Constant:
    """The constant that an expression is; raises `_Unread` for any other, and for more `levels` within one another."""
    if levels < 0:
        raise _Unread(node)

    def inner(one: ast.expr) -> Constant:
        return _evaluated(one, known, numpy, levels - 1)

    match node:
        case ast.Constant(value=str() as text):
            return text
        case ast.Constant(value=int() | float() as number) if not isinstance(number, bool):
            return _finite(node, lambda: float(number))
        case ast.Name(id=name) if isinstance(value := known.get(name), float):
            return value
        case ast.List(elts=entries) | ast.Tuple(elts=entries):
            return [inner(one) for one in entries]
        case ast.Dict(keys=keys, values=values):
            names = [key.value if isinstance(key, ast.Constant) and isinstance(key.value, str) else "" for key in keys]
            if not all(names) or len(set(names)) < len(names):
                raise _Unread(node)
            return {name: inner(one) for name, one in zip(names, values, strict=True)}
        case ast.UnaryOp(op=ast.USub() | ast.UAdd() as sign, operand=operand):
            value = inner(operand)
            return _finite(node, lambda: _computed(operator.mul, -1.0 if isinstance(sign, ast.USub) else 1.0, value))
        case ast.BinOp(left=left, op=op, right=right) if type(op) in OPERATIONS:
            first, second = inner(left), inner(right)
            return _finite(node, lambda: _computed(OPERATIONS[type(op)], first, second))
        case ast.Call(
            func=ast.Attribute(value=ast.Name(id=module), attr="array"), args=[ast.List() as entries], keywords=[]
        ) if module in numpy:
            listed = inner(entries)
            return _finite(node, lambda: np.array(_numbers(listed), dtype=float))
    raise _Unread(node)


def _numbers(value: Constant) -> Constant:
    """The value, of which every entry is a number; TypeError for others: numpy takes texts for numbers."""
    if isinstance(value, list):
        return [_numbers(one) for one in value]
    if not isinstance(value, float):
        raise TypeError
    return value


def _computed(operation: Callable[[Any, Any], Any], first: Constant, second: Constant) -> float | Array:
    """The operation on two numbers, or on a number and an array; TypeError for others."""
    kinds = [isinstance(one, float) for one in (first, second)]
    arrays = [isinstance(one, np.ndarray) for one in (first, second)]
    if not any(kinds) or not all(a or b for a, b in zip(kinds, arrays, strict=True)):
        raise TypeError
    with np.errstate(all="ignore"):
        return operation(np.float64(first) if kinds[0] else first, second)  # type: ignore[no-any-return, arg-type]


def _finite(node: ast.expr, compute: Callable[[], float | Array]) -> float | Array:
    """The finite number or array that is computed; raises `_Unread` where it is none."""
    try:
        out = compute()
    except (TypeError, ValueError, ArithmeticError):
        raise _Unread(node) from None
    if not np.all(np.isfinite(out)):
        raise _Unread(node)
    return out if isinstance(out, np.ndarray) else float(out)
