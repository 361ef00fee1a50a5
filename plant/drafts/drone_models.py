"""A vehicle from drone-models' parameters (TOML): those of its drones, or the arguments of its `first_principles`.

From the centre of mass, rotors along z at (x, y) = L (-m_1, m_0), m the rows of mixing_matrix, m_2 the signs of the
torques on the body. Thrust and torque are parabolas T(n), Q(n) over revolutions a minute. With n_h, at which T carries
the weight, and s = n / n_h:

    nominal rotor        c_f of T(n_h), kappa = Q(n_h) / T(n_h)
    thrust_curve         the slope and the curvature of T(s); exact from s = 0.3 on
    drag_torque_of_speed the slope of Q(s), by the share that goes with s^2; exact where T and Q have no constant
    motor_lag            dn/dt = (n_cmd - n) (a + b (n_cmd + n)) about hover, tau = 1 / (a + 2 b n_h), up and down
    body_drag            the diagonal of drag_matrix
    rotor_gyroscopic     prop_inertia, with the sign of physics about x, where drone-models 0.1 has the other

Source: drone-models 0.1, first_principles/model.py and data/params.toml.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
from pydantic import model_validator

from wrenchgap._escaping import printable
from wrenchgap.flight.errors import ModelError, UsageError
from wrenchgap.flight.flight import RPM, Array
from wrenchgap.plant.drafts.draft import Draft, EffectDraft, RotorDraft, Sourced
from wrenchgap.plant.drafts.package_tables import CENTRE, UP, Numbers, lag_effect, notes_of, read_known
from wrenchgap.plant.reader import (
    NotNegative,
    Number,
    Positive,
    Table,
    Vector,
    expected,
    quoted,
    rule_error,
    text_of,
    toml,
)
from wrenchgap.plant.vehicle import GRAVITY

Parabola = Annotated[tuple[Number, Number, Number], expected("three finite numbers, the constant first")]
Rows = Annotated[tuple[Vector, Vector, Vector], expected("three rows of three finite numbers")]
NO_ROWS = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
CARRYING = np.linspace(0.7, 1.3, 13)
"""Speeds over hover's, at which a torque that has another shape than can be said is compared."""


class FirstPrinciples(Table):
    """What of a drone's parameters describes the vehicle."""

    mass: Positive
    L: Positive
    J: Rows
    J_inv: Rows | None = None
    rpm2thrust: Parabola
    rpm2torque: Parabola
    mixing_matrix: Annotated[tuple[Numbers, Numbers, Numbers], expected("three rows, a number for each rotor")]
    drag_matrix: Rows = NO_ROWS
    rotor_dyn_coef: Annotated[tuple[Number, Number, Number, Number], expected("four finite numbers")]
    prop_inertia: NotNegative = 0.0
    prop_radius: Positive | None = None
    thrust_max: Positive | None = None

    @model_validator(mode="after")
    def _fits(self) -> Self:
        counts = {len(row) for row in self.mixing_matrix}
        if len(counts) > 1 or not counts or not all(self.mixing_matrix[2]):
            raise rule_error("mixing_matrix: expected as many numbers in each row, and none in the last that is zero")
        if np.any(np.diag(self.drag_matrix) > 0.0):
            raise rule_error("drag_matrix: expected nothing positive in its diagonal: drag is against the velocity")
        if self.J_inv is not None and not np.allclose(np.array(self.J) @ self.J_inv, np.eye(3), atol=1e-3):
            raise rule_error("J_inv: is not the inverse of J")
        return self


def from_drone_models(path: Path, drone: str | None = None, mass: float | None = None) -> Draft:
    """A draft of a drone in a file of drone-models. Raises ModelError or UsageError, in one line.

    `drone` is its name where the file has several, `mass` [kg] what hovers, by default what the file says.
    """
    where, name, table = _table_of(path, drone)
    told, unread = read_known(FirstPrinciples, table, where)
    needed = (mass or told.mass) * GRAVITY / len(told.mixing_matrix[0])
    hover = _speed_of(told, needed, f"{where}: rpm2thrust", "a rotor's share of the weight")
    effects, notes = _effects(told, needed, hover, where)
    return Draft(
        name,
        path.name,
        _rotors(told, needed, hover, where),
        mass=_sourced(told.mass, "mass"),
        inertia=_sourced(told.J, "J"),
        com=CENTRE,
        effects=effects,
        notes=(*notes, *notes_of(where, [key for key in unread if key != "gravity_vec"], effects)),
    )


def _table_of(path: Path, drone: str | None) -> tuple[str, str, Mapping[str, Any]]:
    """Where a drone is in a file, in words, its name, its parameters."""
    text = text_of(path, "as parameters of drone-models")
    try:
        document = toml(text)
    except ModelError as error:
        raise ModelError(f"{path.name}: {error}") from None
    if "schema" in document:
        raise UsageError(f"--from {path}: is a model file already; say -m {path} to other commands")
    if "rpm2thrust" in document:
        return path.name, path.stem, document
    tables = {key: value for key, value in document.items() if isinstance(value, dict) and "rpm2thrust" in value}
    if not tables:
        raise ModelError(
            f"{path.name}: has no rpm2thrust, so it is no drone of drone-models; those are in its data/params.toml"
        )
    chosen = next(iter(tables)) if drone is None and len(tables) == 1 else drone
    if chosen not in tables:
        got = "" if drone is None else f", none called {quoted(printable(drone))}"
        names = quoted(printable(", ".join(tables)), 300)
        raise UsageError(f"--from {path}: has {len(tables)} drones{got}; say --name with one of {names}")
    return f"{path.name}: {printable(chosen)}", chosen, tables[chosen]


def _sourced(value: Any, keys: str) -> Sourced:
    return Sourced(value, f"{keys} of drone-models")


def _speed_of(told: FirstPrinciples, wanted: float, where: str, words: str) -> float:
    """The speed [1/min] at which the thrust of a rotor rises through `wanted` [N], in `words`."""
    c_0, c_1, c_2 = told.rpm2thrust
    square = c_1**2 + 4.0 * c_2 * (wanted - c_0)
    slope = c_1 + np.sqrt(max(square, 0.0))
    if not (square >= 0.0 and slope > 0.0 and wanted > c_0):
        raise ModelError(f"{where}: no speed makes {wanted:.4g} N, {words}; expected the constant first, per (1/min)^k")
    return float(2.0 * (wanted - c_0) / slope)


def _rotors(told: FirstPrinciples, needed: float, hover: float, where: str) -> tuple[RotorDraft, ...]:
    torque = float(np.polynomial.polynomial.polyval(hover, told.rpm2torque))
    if torque < 0.0:
        raise ModelError(f"{where}: rpm2torque: got {torque:.3g} Nm in hover, expected a positive torque")
    most = None
    if told.thrust_max is not None:
        fastest = _speed_of(told, told.thrust_max, f"{where}: rpm2thrust", "thrust_max")
        most = _sourced(fastest * RPM, "speed at thrust_max")
    return tuple(
        RotorDraft(
            _sourced((-told.L * about_y, told.L * about_x, 0.0), "L and mixing_matrix"),
            UP,
            _sourced(-int(np.sign(turn)), "mixing_matrix, against that torque on the body,"),
            kappa=_sourced(abs(turn) * torque / needed, "rpm2torque over rpm2thrust in hover"),
            c_f=_sourced(needed / (hover * RPM) ** 2, "rpm2thrust in hover"),
            radius=None if told.prop_radius is None else _sourced(told.prop_radius, "prop_radius"),
            speed_max=most,
        )
        for about_x, about_y, turn in zip(*told.mixing_matrix, strict=True)
    )


def _effects(
    told: FirstPrinciples, needed: float, hover: float, where: str
) -> tuple[tuple[EffectDraft, ...], list[str]]:
    """The terms beyond the nominal rotor, and what of them is not exact, in words."""
    out, notes = list[EffectDraft](), list[str]()

    def add(name: str, keys: str, **values: float) -> None:
        out.append(EffectDraft(name, values, f"{keys} of drone-models"))

    powers = hover ** np.arange(3)
    thrust, torque = np.array(told.rpm2thrust) * powers / needed, np.array(told.rpm2torque) * powers
    curvature = float(thrust[2]) - 1.0
    slope = 0.5 * float(thrust[1]) + curvature
    if max(abs(slope), abs(curvature)) > 1e-9:
        add("thrust_curve", "rpm2thrust", slope=slope, curvature=curvature)
    share, off = _share_of_speed(thrust, torque)
    if abs(share) > 1e-9:
        add("drag_torque_of_speed", "rpm2torque", change=0.0, of_speed=share)
    if off > 0.01:
        words = f"{100.0 * off:.2g} % of it between 0.7 and 1.3 times the speed of hover"
        notes.append(
            f"{where}: the torque of a rotor is that of rpm2torque in hover, and differs from it by up to {words}."
        )
    up, with_up, down, with_down = told.rotor_dyn_coef
    rates = up + 2.0 * with_up * hover, down + 2.0 * with_down * hover
    if min(rates) <= 0.0:
        raise ModelError(
            f"{where}: rotor_dyn_coef: in hover rotors answer at {min(rates):.3g} 1/s; expected more than 0"
        )
    out.extend(lag_effect(1.0 / rates[0], 1.0 / rates[1], "rotor_dyn_coef of drone-models, in hover"))
    if with_up or with_down:
        notes.append(f"{where}: rotor_dyn_coef: rates that go with the speed are taken in hover.")
    drag = -np.diag(told.drag_matrix)
    if drag.any():
        rest = {f"{kind}_{axis}": 0.0 for kind in ("quadratic", "point") for axis in "xyz"}
        add("body_drag", "drag_matrix", **{f"linear_{a}": float(d) for a, d in zip("xyz", drag, strict=True)}, **rest)
    if np.any(np.array(told.drag_matrix) != np.diag(-drag)):
        notes.append(f"{where}: drag_matrix: what is off its diagonal is not read.")
    if told.prop_inertia:
        add("rotor_gyroscopic", "prop_inertia", inertia=told.prop_inertia)
        notes.append(f"{where}: prop_inertia: about x, drone-models 0.1 has its gyroscopic torque with the other sign.")
    return tuple(out), notes


def _share_of_speed(thrust: Array, torque: Array) -> tuple[float, float]:
    """The share e of the torque that goes with s^2 whatever the thrust, and the largest error over that of hover.

    Of Q / Q(1) = e s^2 + (1 - e) T with T(1) = 1 the slope at s = 1 is 2 e + (1 - e) T'(1). Curves (3,) are in s.
    """
    if not torque.any():
        return 0.0, 0.0
    over_hover = torque / torque.sum()
    wanted, own = (float(curve[1] + 2.0 * curve[2]) for curve in (over_hover, thrust))
    share = max((wanted - own) / (2.0 - own), 0.0) if abs(2.0 - own) > 1e-6 else 0.0
    found = share * np.array([0.0, 0.0, 1.0]) + (1.0 - share) * thrust
    off = np.polynomial.polynomial.polyval(CARRYING, found - over_hover)
    return share, float(np.abs(off).max())
