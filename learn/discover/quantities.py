"""What a law may be made of: quantities of a flight, as the lines of Python that an effect file of the law has.

Every line is written once, here: the search evaluates it on the flights, the file of a law contains it. N samples;
vectors (N, 3) in B: `x_E`, `y_E`, `up` are the axes of E and `position` is the place of O in E, turned into B. A tensor
of rotors is (N, R), of arms (N, A).
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True)
class Unit:
    """Powers of newton, metre, second and volt."""

    N: float = 0.0
    m: float = 0.0
    s: float = 0.0
    V: float = 0.0

    def __mul__(self, other: Unit) -> Unit:
        return Unit(self.N + other.N, self.m + other.m, self.s + other.s, self.V + other.V)

    def __pow__(self, p: float) -> Unit:
        return Unit(p * self.N, p * self.m, p * self.s, p * self.V)

    def __truediv__(self, other: Unit) -> Unit:
        return self * other**-1.0

    def __str__(self) -> str:
        """Such as "N s^1.5/m^1.5"; "1" for a pure number."""

        def powers(sign: float) -> list[str]:
            there = [(symbol, sign * p) for symbol, p in vars(self).items() if sign * p > 0.0]
            return [symbol if p == 1.0 else f"{symbol}^{p:g}" for symbol, p in there]

        return "/".join([" ".join(powers(1.0)) or "1", *powers(-1.0)])


ONE = Unit()
NEWTON = Unit(N=1.0)
TORQUE = Unit(N=1.0, m=1.0)
METRE = Unit(m=1.0)
SECOND = Unit(s=1.0)
SPEED = Unit(m=1.0, s=-1.0)
RATE = Unit(s=-1.0)


@dataclass(frozen=True)
class Quantity:
    """One line: `code`, the value of a name. `cause` says in words what a law that uses it depends on; the others say
    what a log must have.
    """  # noqa: D205

    code: str
    cause: str = ""
    pose: bool = False
    air: bool = False
    voltage: bool = False
    rotors: bool = False
    tilt: bool = False
    rates: bool = False


QUANTITIES = {
    "com": Quantity("context.vehicle.body.com_B"),
    "quat": Quantity("context.state.quat_EB", pose=True),
    "v": Quantity("context.velocity_through_air_B", cause="velocity", pose=True, air=True),
    "speed": Quantity("(1e-12 + np.sum(v * v, axis=1, keepdims=True)) ** 0.5", cause="velocity"),
    "omega": Quantity("context.state.omega_B", cause="body rates"),
    "rate": Quantity("(1e-12 + np.sum(omega * omega, axis=1, keepdims=True)) ** 0.5", cause="body rates"),
    "x_E": Quantity("rotate_inverse(quat, np.array([1.0, 0.0, 0.0]))", cause="attitude and heading"),
    "y_E": Quantity("rotate_inverse(quat, np.array([0.0, 1.0, 0.0]))", cause="attitude and heading"),
    "up": Quantity("rotate_inverse(quat, np.array([0.0, 0.0, 1.0]))", cause="attitude"),
    "position": Quantity("rotate_inverse(quat, context.state.position_E)", cause="position", pose=True),
    "height": Quantity("context.state.position_E[:, 2:]", cause="height", pose=True),
    "low": Quantity("1.0 / (1.0 + (height / SPAN) ** 2)", cause="height"),
    "heading": Quantity("2.0 * np.arctan2(quat[:, 3:], quat[:, :1])", cause="heading"),
    "time": Quantity("context.state.time[:, None]", cause="time"),
    "voltage_excess": Quantity(
        "(context.state.voltage[:, None] / VOLTS) ** 2 - 1.0", cause="battery voltage", voltage=True
    ),
    "thrust": Quantity("(1e-12 + np.sum(wrench_B[:, :3] ** 2, axis=1, keepdims=True)) ** 0.5", cause="thrust"),
    "T": Quantity("actuation.thrust", cause="thrust of rotors", rotors=True),
    "n": Quantity("actuation.normal_B", rotors=True),
    "r": Quantity("actuation.hub_B", rotors=True),
    "spin": Quantity("context.vehicle.rotors.spin", rotors=True),
    "arm": Quantity("context.vehicle.rotors.arm", rotors=True),
    "alpha": Quantity("actuation.tilt", cause="tilt of the arms", rotors=True, tilt=True),
    "alpha_dot": Quantity("actuation.tilt_rate", cause="tilt rates of the arms", rotors=True, tilt=True, rates=True),
    "alpha_ddot": Quantity(
        "actuation.tilt_acceleration", cause="tilt rates of the arms", rotors=True, tilt=True, rates=True
    ),
    "axis": Quantity("context.vehicle.arms.axis_B", rotors=True),
    "azimuth": Quantity("np.arctan2(context.vehicle.arms.position_B[:, 1], context.vehicle.arms.position_B[:, 0])"),
    "around": Quantity("np.argsort(azimuth)"),
    "rank": Quantity("np.argsort(around)"),
    "upper": Quantity("np.argmax(arm == np.arange(len(rank))[:, None], axis=1)"),
    "left": Quantity("around[rank - len(rank) + 1][arm]"),
    "right": Quantity("around[rank - 1][arm]"),
}
"""By name. SPAN [m] and VOLTS [V] are numbers of the vehicle that the file states. `left` and `right` are the arms
beside that of each rotor (R,), `upper` the first rotor of each arm."""

_NAME = re.compile(r"(?<![\w.])[A-Za-z_]\w*")


def needed(codes: Iterable[str]) -> tuple[str, ...]:
    """Names of the quantities that these expressions use, themselves or through others, in the order of the table."""
    found: set[str] = set()
    waiting = list(codes)
    while waiting:
        new = {n for n in _NAME.findall(waiting.pop()) if n in QUANTITIES} - found
        found |= new
        waiting += [QUANTITIES[n].code for n in new]
    return tuple(n for n in QUANTITIES if n in found)


def causes(codes: Iterable[str]) -> tuple[str, ...]:
    """What laws of these expressions depend on, in words."""
    found = {n for code in codes for n in _NAME.findall(code) if n in QUANTITIES}
    return tuple(dict.fromkeys(QUANTITIES[n].cause for n in QUANTITIES if n in found and QUANTITIES[n].cause))
