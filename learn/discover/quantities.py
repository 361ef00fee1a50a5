"""What a law may be made of: quantities of a flight, as the lines of Python that an effect file of the law has.

Every line is written once, here: the search evaluates it on the flights, the file of a law found contains it. N
samples; vectors in B unless their name ends in _E. `unit` are powers of newton, metre, second and volt, so that the
unit of a coefficient follows from what it multiplies, and a law with a wrong unit cannot be written.
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass

Unit = tuple[float, float, float, float]

ONE: Unit = (0.0, 0.0, 0.0, 0.0)
NEWTON: Unit = (1.0, 0.0, 0.0, 0.0)
METRE: Unit = (0.0, 1.0, 0.0, 0.0)
SECOND: Unit = (0.0, 0.0, 1.0, 0.0)
SPEED: Unit = (0.0, 1.0, -1.0, 0.0)
RATE: Unit = (0.0, 0.0, -1.0, 0.0)
SYMBOLS = ("N", "m", "s", "V")


@dataclass(frozen=True)
class Quantity:
    """One line: `code`, the value of a name. `cause` says in words what a law that uses it depends on."""

    code: str
    unit: Unit = ONE
    cause: str = ""
    pose: bool = False
    air: bool = False
    voltage: bool = False
    rotors: bool = False
    tilt: bool = False
    rates: bool = False


LINES = {
    "com": Quantity("context.vehicle.body.com_B", METRE),
    "quat": Quantity("context.state.quat_EB", pose=True),
    "v": Quantity("context.velocity_through_air_B", SPEED, "velocity", pose=True, air=True),
    "speed": Quantity("(1e-12 + np.sum(v * v, axis=1, keepdims=True)) ** 0.5", SPEED, "velocity"),
    "omega": Quantity("context.state.omega_B", RATE, "body rates"),
    "rate": Quantity("(1e-12 + np.sum(omega * omega, axis=1, keepdims=True)) ** 0.5", RATE, "body rates"),
    "north": Quantity("rotate_inverse(quat, np.array([1.0, 0.0, 0.0]))", cause="heading"),
    "west": Quantity("rotate_inverse(quat, np.array([0.0, 1.0, 0.0]))", cause="heading"),
    "up": Quantity("rotate_inverse(quat, np.array([0.0, 0.0, 1.0]))", cause="attitude"),
    "place": Quantity("rotate_inverse(quat, context.state.position_E)", METRE, "position", pose=True),
    "height": Quantity("context.state.position_E[:, 2:]", METRE, "height", pose=True),
    "low": Quantity("1.0 / (1.0 + (height / SPAN) ** 2)", cause="height"),
    "heading": Quantity("2.0 * np.arctan2(quat[:, 3:], quat[:, :1])", cause="heading"),
    "time": Quantity("context.state.time[:, None]", SECOND, "time"),
    "charge": Quantity("(context.state.voltage[:, None] / VOLTS) ** 2 - 1.0", cause="battery voltage", voltage=True),
    "thrust": Quantity("(1e-12 + np.sum(wrench_B[:, :3] ** 2, axis=1, keepdims=True)) ** 0.5", NEWTON, "thrust"),
    "T": Quantity("actuation.thrust", NEWTON, "thrust of rotors", rotors=True),
    "n": Quantity("actuation.normal_B", rotors=True),
    "r": Quantity("actuation.hub_B", METRE, rotors=True),
    "spin": Quantity("context.vehicle.rotors.spin", rotors=True),
    "arm": Quantity("context.vehicle.rotors.arm", rotors=True),
    "alpha": Quantity("actuation.tilt", cause="tilt of the arms", rotors=True, tilt=True),
    "alpha_dot": Quantity("actuation.tilt_rate", RATE, "tilt rates of the arms", rotors=True, tilt=True, rates=True),
    "alpha_ddot": Quantity("actuation.tilt_acceleration", RATE, "tilt rates", rotors=True, tilt=True, rates=True),
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
    """Names of the quantities that these expressions use, themselves or through others, in the order of `LINES`."""
    found: set[str] = set()
    waiting = list(codes)
    while waiting:
        new = {n for n in _NAME.findall(waiting.pop()) if n in LINES} - found
        found |= new
        waiting += [LINES[n].code for n in new]
    return tuple(n for n in LINES if n in found)


def causes(codes: Iterable[str]) -> tuple[str, ...]:
    """What laws of these expressions depend on, in words."""
    found = {n for code in codes for n in _NAME.findall(code) if n in LINES}
    return tuple(dict.fromkeys(LINES[n].cause for n in LINES if n in found and LINES[n].cause))


def added(a: Unit, b: Unit) -> Unit:
    """Powers of a product."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3])


def scaled(unit: Unit, by: float) -> Unit:
    """Of a power."""
    return (by * unit[0], by * unit[1], by * unit[2], by * unit[3])


def unit_text(unit: Unit) -> str:
    """Such as "N s^1.5/m^1.5"; "1" for a pure number."""

    def powers(sign: float) -> str:
        parts = [(s, sign * p) for s, p in zip(SYMBOLS, unit, strict=True) if sign * p > 0.0]
        return " ".join(s if p == 1.0 else f"{s}^{p:g}" for s, p in parts)

    over, under = powers(1.0), powers(-1.0)
    return (over or "1") + (f"/{under.replace(' ', '/')}" if under else "") if over or under else "1"
