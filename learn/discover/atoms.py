"""The laws that are tried: a direction times functions of quantities, as wrenches about O (docs/theory/laws.md, Atoms).

Forces act at the centre of mass or at the rotors. A law with several coefficients (a sine and a cosine, a spring and
where its end is) is one law. Sources of the forms: Hoerner, "Fluid-Dynamic Drag", 1965 (powers of speed); Leishman,
"Principles of Helicopter Aerodynamics", 2nd ed. (rotors in translation, near the ground and in each other's wake);
Etkin, "Dynamics of Atmospheric Flight", 1972 (derivatives of force and moment by velocities and rates).
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from wrenchgap.learn.discover.quantities import (
    METRE,
    NEWTON,
    ONE,
    QUANTITIES,
    RATE,
    SECOND,
    SPEED,
    TORQUE,
    Unit,
    causes,
    needed,
)
from wrenchgap.learn.discover.settings import SETTINGS
from wrenchgap.plant.effects.com_offset import span
from wrenchgap.plant.effects.effect import weight_scale
from wrenchgap.plant.vehicle import Vehicle

COMMANDS = frozenset(("thrust", "thrust of rotors"))
"""Causes that are commands, which answer a disturbance at once."""
MOTION = frozenset(("velocity", "body rates"))
"""Causes that are the motion itself."""


@dataclass(frozen=True)
class Term:
    """One coefficient of a law: the expression (N, 6) that it multiplies, how that is written, its unit and size."""

    code: str
    symbol: str
    unit: str
    scale: float


@dataclass(frozen=True)
class Atom:
    """A law. `price` [nats] is how much longer it takes to say than the shortest ones."""

    name: str
    formula: str
    terms: tuple[Term, ...]
    price: float = 0.0

    @property
    def lines(self) -> tuple[str, ...]:
        """Names of the quantities (`quantities.QUANTITIES`) that it needs."""
        return needed(t.code for t in self.terms)

    @property
    def causes(self) -> tuple[str, ...]:
        """What it depends on, in words."""
        return causes(t.code for t in self.terms)

    @property
    def commanded(self) -> bool:
        """Whether it depends on commands alone, which answer a disturbance: then gains of it are the controller's."""
        return bool(self.causes) and set(self.causes) <= COMMANDS

    @property
    def of_motion(self) -> bool:
        """Whether it depends on the motion alone, from which a passive force or torque takes energy."""
        return bool(self.causes) and set(self.causes) <= MOTION

    def needs(self, what: str) -> bool:
        """Whether one of its quantities needs a pose, moving air, a voltage, rotors, tilts or rates."""
        return any(getattr(QUANTITIES[name], what) for name in self.lines)


@dataclass(frozen=True)
class Factor:
    """phi: `code` (N, 1), how it is written, its unit, what is typical of it, and its price in nats."""

    code: str
    symbol: str
    unit: Unit = ONE
    typical: float = 1.0
    price: float = 0.0


def times(a: Factor, b: Factor) -> Factor:
    """The product of two functions."""
    unit = a.unit * b.unit
    return Factor(
        f"{a.code} * {b.code}", f"{a.symbol} {b.symbol}", unit, a.typical * b.typical, a.price + b.price + 0.5
    )


def power(of: Factor, p: float) -> Factor:
    """A power of a function."""
    unit = of.unit**p
    return Factor(f"{of.code} ** {p:g}", f"{of.symbol}^{p:g}", unit, of.typical**p, of.price + (p not in (1, 2)))


def size_of(of: Factor) -> Factor:
    """Its absolute value."""
    return Factor(f"np.abs({of.code})", f"|{of.symbol}|", of.unit, of.typical, of.price)


@dataclass(frozen=True)
class Direction:
    """d: `code` (N, 3) or (3,), how it is written, its unit and what is typical of its length."""

    code: str
    symbol: str
    unit: Unit = ONE
    typical: float = 1.0


PLAIN = Factor("1.0", "")
SPEED_OF = Factor("speed", "|v|", SPEED, 3.0)
LOW = Factor("low", "1/(1 + h^2/l^2)", ONE, 0.5, 1.0)
VOLTAGE = Factor("voltage_excess", "(V^2/V0^2 - 1)", ONE, 0.2)
TIME = Factor("time", "t", SECOND, 60.0)
V = [Factor(f"v[:, {i}:{i + 1}]", f"v_{a}", SPEED, 2.0) for i, a in enumerate("xyz")]
OMEGA = [Factor(f"omega[:, {i}:{i + 1}]", f"omega_{a}", RATE) for i, a in enumerate("xyz")]
UP = [Factor(f"up[:, {i}:{i + 1}]", f"up_{a}", ONE, 0.3) for i, a in enumerate("xyz")]
AXES = [Direction(f"np.array({np.eye(3)[i].tolist()})", f"e_{a}", ONE) for i, a in enumerate("xyz")]
VELOCITY = Direction("v", "v", SPEED, 3.0)
TURNING = Direction("omega", "omega", RATE)
ACROSS = Direction("np.cross(np.array([0.0, 0.0, 1.0]), v)", "e_z x v", SPEED, 2.0)
LEVELLING = Direction("np.cross(np.array([0.0, 0.0, 1.0]), up)", "e_z x up", ONE, 0.3)
CORIOLIS = Direction("np.cross(omega, v)", "omega x v", RATE * SPEED, 2.0)
GYROSCOPIC = Direction("np.cross(omega, np.array([0.0, 0.0, 1.0]))", "omega x e_z", RATE)


def atoms(vehicle: Vehicle) -> tuple[Atom, ...]:
    """All laws of a vehicle."""
    return tuple(_Library(vehicle).all())


class _Library:
    """`span` [m] is the length that torques and heights are compared with."""

    def __init__(self, vehicle: Vehicle) -> None:
        self.vehicle, self.weight, self.span = vehicle, weight_scale(vehicle), span(vehicle)
        self.thrust = Factor("thrust", "|F|", NEWTON, self.weight)

    def all(self) -> Iterator[Atom]:
        yield from self.vectors()
        yield from self.along_axes()
        yield from self.fixed_in_the_world()
        yield from self.shares()
        if self.vehicle.has_rotors:
            yield from self.rotors()
            yield from self.arms()

    def atom(self, name: str, kind: str, direction: Direction, *factors: Factor) -> Atom:
        """A force at the centre of mass, or a torque, along a direction times functions, of one coefficient each."""
        terms = [self.term(kind, direction, f) for f in factors]
        written = " + ".join(f"k{j} {t.symbol}" if len(terms) > 1 else f"k {t.symbol}" for j, t in enumerate(terms, 1))
        price = max(f.price for f in factors) + len(factors) - 1.0
        return Atom(name, f"{'F' if kind == 'force' else 'M'} = {written}", tuple(terms), price)

    def term(self, kind: str, direction: Direction, factor: Factor) -> Term:
        size = self.weight * (1.0 if kind == "force" else self.span)
        made = NEWTON if kind == "force" else TORQUE
        unit = made / (direction.unit * factor.unit)
        code = f"({direction.code}) * ({factor.code})"
        whole = f"force_at(com, {code})" if kind == "force" else f"pure_torque({code})"
        symbol = " ".join(s for s in (factor.symbol, direction.symbol) if s)
        return Term(whole, symbol, str(unit), SETTINGS.small * size / (direction.typical * factor.typical))

    def vectors(self) -> Iterator[Atom]:
        """Along vectors that turn with what makes them."""
        thrust, speed = self.thrust, SPEED_OF
        scales = {
            "": PLAIN, "_speed_half": power(speed, 0.5), "_speed": speed, "_speed2": power(speed, 2),
            "_thrust": thrust, "_thrust_speed": times(thrust, speed), "_low": LOW, "_voltage": VOLTAGE, "_time": TIME,
            "_rate": Factor("rate", "|omega|", RATE), "_thrust_half": power(thrust, 0.5),
        }  # fmt: skip
        for kind, directions in (
            ("force", (VELOCITY, CORIOLIS, ACROSS, TURNING, GYROSCOPIC, LEVELLING)),
            ("torque", (VELOCITY, ACROSS, TURNING, GYROSCOPIC, LEVELLING, CORIOLIS)),
        ):
            for d, (suffix, factor) in itertools.product(directions, scales.items()):
                yield self.atom(f"{kind}_{_word(d.symbol)}{suffix}", kind, d, factor)

    def along_axes(self) -> Iterator[Atom]:
        """Along one body axis."""
        signed = [*V, *OMEGA]
        products = [times(a, b) for a, b in itertools.combinations(signed, 2)]
        factors = [
            *signed, *(times(x, size_of(x)) for x in signed), *(times(x, SPEED_OF) for x in V),
            *(power(x, 2) for x in signed), *(times(x, power(SPEED_OF, 0.5)) for x in V), *products,
            *(times(x, self.thrust) for x in signed), *UP, *(times(x, LOW) for x in UP),
            *(times(a, b) for a, b in itertools.combinations(UP, 2)), SPEED_OF, power(SPEED_OF, 2), self.thrust,
            power(self.thrust, 2), LOW, VOLTAGE, TIME, power(TIME, 2),
        ]  # fmt: skip
        for kind, axis in itertools.product(("force", "torque"), AXES):
            for f in factors:
                yield self.atom(f"{kind}_{axis.symbol[-1]}_{_word(f.symbol)}", kind, axis, f)
            for m in (1, 2, 3, 4):
                angle = "heading" if m == 1 else f"{m} * heading"
                said = "psi" if m == 1 else f"{m} psi"
                both = [Factor(f"np.{g}({angle})", f"{g} {said}") for g in ("sin", "cos")]
                yield self.atom(f"{kind}_{axis.symbol[-1]}_heading{m}", kind, axis, *both)

    def fixed_in_the_world(self) -> Iterator[Atom]:
        """Along directions of E: what pulls there whatever the attitude, and a spring."""
        world = [Direction(n, s) for n, s in (("x_E", "x_E"), ("y_E", "y_E"), ("up", "z_E"))]
        for kind in ("force", "torque"):
            terms = tuple(self.term(kind, d, PLAIN) for d in world)
            letter = "F" if kind == "force" else "M"
            written = " + ".join(f"k{j} {t.symbol}" for j, t in enumerate(terms, 1))
            yield Atom(f"{kind}_world", f"{letter} = {written}", terms, 2.0)
            for f in (TIME, LOW, SPEED_OF):
                growing = tuple(self.term(kind, d, f) for d in world)
                written = " + ".join(f"k{j} {t.symbol}" for j, t in enumerate(growing, 1))
                yield Atom(f"{kind}_world_{_word(f.symbol)}", f"{letter} = {written}", growing, 3.0)
        magnet = [Direction(f"np.cross({a.code}, {d.code})", f"{a.symbol} x {d.symbol}") for a in AXES for d in world]
        terms = tuple(self.term("torque", d, PLAIN) for d in magnet)
        yield Atom("torque_dipole", "M = sum_ij k_ij e_i x j_E, a magnet in a field", terms, 4.0)
        spring = Direction("position", "p", METRE, 1.0)
        terms = (self.term("force", spring, PLAIN), *(self.term("force", d, PLAIN) for d in world))
        yield Atom("force_spring", "F = k1 p + k2 x_E + k3 y_E + k4 z_E", terms, 2.0)

    def shares(self) -> Iterator[Atom]:
        """Shares of all that rotors make."""
        for f in (SPEED_OF, power(SPEED_OF, 2), V[2], power(V[2], 2), VOLTAGE, TIME, power(TIME, 2), LOW):
            term = Term(f"wrench_B * ({f.code})", f"{f.symbol} W", str(ONE / f.unit), SETTINGS.small / f.typical)
            yield Atom(f"share_{_word(f.symbol)}", f"W_added = k {f.symbol} W_rotors", (term,), f.price)

    def rotors(self) -> Iterator[Atom]:
        """Of each rotor by its thrust, all of them with one coefficient, or one alone."""
        count = len(self.vehicle.geometry()[1])
        hover = self.weight / count
        each = Factor("T", "T_i", NEWTON, hover)
        scales = [each, power(each, 2)]
        scales += [times(each, f) for f in (SPEED_OF, power(SPEED_OF, 2), V[2], VOLTAGE, TIME, LOW)]
        for f in scales:
            unit, size, word = str(NEWTON / f.unit), hover / f.typical, _word(f.symbol)
            every = Term(_forces(f"n * ({f.code})[:, :, None]"), f"sum_i {f.symbol} n_i", unit, SETTINGS.small * size)
            yield Atom(f"rotors_{word}", f"W = k {every.symbol} at r_i", (every,), f.price)
            for i in range(count):
                code = f"force_at(r[:, {i}], n[:, {i}] * ({f.code})[:, {i}:{i + 1}])"
                one = Term(code, f"{f.symbol} n_i", unit, SETTINGS.alone * size)
                yield Atom(f"rotor{i + 1}_{word}", f"W = k {one.symbol} at r_i, i = {i + 1}", (one,), 2.0 + f.price)
        lever = SETTINGS.small * self.weight * self.span / count
        for f in (each, power(each, 2), times(each, SPEED_OF), times(each, VOLTAGE)):
            code = _torques(f"n * (spin * ({f.code}))[:, :, None]")
            term = Term(code, f"sum_i s_i {f.symbol} n_i", str(TORQUE / f.unit), lever / f.typical)
            yield Atom(f"spins_{_word(f.symbol)}", f"M = k {term.symbol}", (term,), f.price)
        moving, across = times(each, Factor("1.0", "", SPEED, 2.0)), "np.cross(n, np.cross(n, v[:, None]))"
        for name, code, said, made in (
            ("flapping", _torques("np.cross(n, v[:, None]) * T[:, :, None]"), "n_i x v", TORQUE),
            ("flapping_spin", _torques(f"{across} * (spin * T)[:, :, None]"), "s_i n_i x (n_i x v)", TORQUE),
            ("hub_drag", _forces(f"{across} * T[:, :, None]"), "n_i x (n_i x v) at r_i", NEWTON),
        ):
            size = lever if made is TORQUE else SETTINGS.small * hover
            term = Term(code, f"sum_i T_i {said}", str(made / moving.unit), size / moving.typical)
            yield Atom(name, f"{'M' if made is TORQUE else 'W'} = k {term.symbol}", (term,), 0.5)

    def arms(self) -> Iterator[Atom]:
        """Of arms: as they bend under their thrust, what they do as they turn, and to the arm beside them."""
        arms, rotors = self.vehicle.geometry()
        hover, own = self.weight / len(rotors), "axis[arm]"
        each = Factor("T", "T_i", NEWTON, hover)
        for name, direction, said in (("across", f"np.cross({own}, n)", "a_i x n_i"), ("along", own, "a_i")):
            for begins, f in (("arm_bend", power(each, 2)), ("arm_pull", each)):
                code = _forces(f"({direction}) * ({f.code})[:, :, None]")
                term = Term(code, f"sum_i {f.symbol} {said}", str(NEWTON / f.unit), SETTINGS.small * hover / f.typical)
                yield Atom(f"{begins}_{name}", f"W = k {term.symbol} at r_i", (term,), 1.0)
        if not arms.tilts.any():
            return
        lever, squared = SETTINGS.small * self.weight * self.span / len(arms), RATE**2.0
        for name, code, said, unit in (
            ("tilt_rate_torque", "alpha_dot", "d alpha_i/dt", RATE),
            ("tilt_acceleration_torque", "alpha_ddot", "d2 alpha_i/dt2", squared),
            ("tilt_rate_drag", "alpha_dot * np.abs(alpha_dot)", "|d alpha_i/dt| d alpha_i/dt", squared),
            ("tilt_sine_torque", "np.sin(alpha)", "sin alpha_i", ONE),
        ):
            term = Term(_torques(f"axis * ({code})[:, :, None]"), f"sum_i {said} a_i", str(TORQUE / unit), lever)
            yield Atom(name, f"M = k {term.symbol}", (term,), 0.5)
        yield from self.wakes()

    def wakes(self) -> Iterator[Atom]:
        """Of arms side by side, whose rotors blow into one another."""
        hover = self.weight / len(self.vehicle.geometry()[1])
        for name, shape, symbol in (
            ("cos", "np.cos({0})", "cos(alpha_i - alpha_j)"),
            ("sin2", "np.sin({0}) ** 2", "sin^2(alpha_i - alpha_j)"),
        ):
            parts = [
                f"T * T[:, upper[{side}]] * {shape.format(f'alpha[:, arm] - alpha[:, {side}]')}"
                for side in ("left", "right")
            ]
            code = _forces(f"n * ({' + '.join(parts)})[:, :, None]")
            term = Term(code, f"sum_ij T_i T_j {symbol} n_i", "1/N", SETTINGS.small / hover)
            yield Atom(f"wake_{name}", f"W = k {term.symbol} at r_i, j the upper rotor of an arm beside", (term,), 1.0)


def constants(vehicle: Vehicle, volts: float) -> dict[str, str]:
    """The numbers that the lines of quantities use, as the file of a law states them."""
    return {"SPAN": f"{span(vehicle):.6g}", "VOLTS": f"{volts:.6g}"}


def _forces(code: str) -> str:
    """The wrench of forces (N, R, 3) at the rotors."""
    return f"np.sum(force_at(r, {code}), axis=1)"


def _torques(code: str) -> str:
    """The wrench of torques (N, X, 3)."""
    return f"pure_torque(np.sum({code}, axis=1))"


WORDS = (
    ("1/(1 + h^2/l^2)", "low"), ("(V^2/V0^2 - 1)", "voltage"), ("|", "_"), ("^0.5", "_half"), ("^", ""),
    (" x ", "_cross_"), (" ", "_"), ("omega", "w"), (".", "_"),
)  # fmt: skip


def _word(symbol: str) -> str:
    """A symbol as a part of a name."""
    for old, new in WORDS:
        symbol = symbol.replace(old, new)
    return "_".join(part for part in symbol.lower().split("_") if part)
