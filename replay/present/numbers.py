"""How a number is printed: the one place that decides digits, signs, units and per cent."""

import math
from collections.abc import Iterable, Mapping, Sequence
from operator import attrgetter
from typing import Any

import numpy as np

from wrenchgap.flight.flight import AXES, Array
from wrenchgap.learn.data.measurement import names_of
from wrenchgap.plant.history import Snapshot, Value
from wrenchgap.plant.vehicle import Vehicle

AXIS_HEADS = ("F_x", "F_y", "F_z", "M_x", "M_y", "M_z")
UNIT_HEADS = tuple(f"{name} [{'N' if k < 3 else 'Nm'}]" for k, name in enumerate(AXIS_HEADS))

DIRECTIONS = ("front", "front left", "left", "back left", "back", "back right", "right", "front right")
"""Sectors about the vehicle's z, from 0 deg in steps of 45."""


def capitalised(text: str) -> str:
    """A text with a capital at its beginning, and the rest as it is."""
    return text[:1].upper() + text[1:]


def listed(words: Sequence[str], most: int, between: str = ", ", last: str = " and ") -> str:
    """The first `most` of some words, and how many more there are."""
    more = f"{last}{len(words) - most} more" if len(words) > most else ""
    return f"{between.join(words[:most])}{more}"


def direction(degrees: float) -> str:
    """A direction in the body from its angle from x towards y [deg]."""
    return DIRECTIONS[round(degrees / 45.0) % 8]


def side_of(x: float, y: float) -> str:
    """The direction in the body of a point from its middle, x forward and y to the left."""
    return direction(float(np.degrees(np.arctan2(y, x))))


def number(value: float | None, digits: int = 3) -> str:
    """Significant digits, without exponent where a reader expects none; "-" for what is not a number."""
    if value is None or not np.isfinite(value):
        return "-"
    if value == 0:
        return "0"
    if 1e-4 <= abs(value) < 1e5:
        decimals = max(0, digits - 1 - int(np.floor(np.log10(abs(value)))))
        return f"{value:.{min(decimals, 6)}f}"
    return f"{value:.{digits - 1}e}"


def unmeasured(noise: Array) -> list[str]:
    """Names of the axes that were not measured: those without a noise (6,)."""
    return list(names_of(np.isfinite(noise)))


def row(values: Iterable[float], digits: int = 3) -> list[str]:
    """Several numbers."""
    return [number(float(v), digits) for v in values]


def share(value: float) -> str:
    """A part of a whole: whole per cent from 10 % on, a digit more below; 0 % is said of zero only."""
    return _per_cent(value, 0.095) if np.isfinite(value) else "-"


def certainty(probability: float) -> str:
    """How sure a name is, in whole per cent, never rounded up to what is firm."""
    return f"{math.floor(100.0 * probability)} %"


def _per_cent(value: float, whole: float, sign: str = "") -> str:
    """Whole per cent from the share `whole` on, a digit more below; of less than a tenth of a per cent its bound."""
    if 0 < abs(value) < 5e-4:
        return "< 0.1 %" if value > 0 else "> -0.1 %"
    return f"{100 * value:{sign}.{0 if abs(value) >= whole or value == 0 else 1}f} %"


def change(value: float) -> str:
    """A relative change with its sign in whole per cent, a digit more below 1 %; 0 % is said of zero only."""
    if not np.isfinite(value):
        return "-"
    return "0 %" if abs(value) < 1e-9 else _per_cent(value, 0.0095, "+")  # rounding


def unit_of(axis: int) -> str:
    """Of an axis by its index."""
    return "N" if axis < 3 else "Nm"


def unit(name: str) -> str:
    """A unit as printed: nothing for a pure number."""
    return "" if name == "1" else name


def quantity(value: float, unit_name: str, digits: int = 3) -> str:
    """A number with its unit."""
    return f"{number(value, digits)} {unit(unit_name)}".rstrip()


def with_std(v: Value) -> str:
    """A value with its unit, and its standard deviation where it has one."""
    return quantity(v.value, v.unit) if not v.std else f"{number(v.value)} +- {quantity(v.std, v.unit, 2)}"


LIGHT = 0.02
"""Weight of a set [-] below which it is not put in words: one in fifty is no alternative to act on."""
SCALED = {"1": (100.0, "%"), "rad": (180.0 / np.pi, "deg")}
"""Factor and unit in which a size is said."""
MILLI = frozenset({"m", "s", "N", "Nm", "kg"})
"""Units that take the prefix of a thousandth below a tenth."""


def signed(value: float, words: str) -> str:
    """The value in words with its sign."""
    return f"+{words}" if value > 0.0 else words


def size_in_words(value: float, unit_name: str, std: float | None = None) -> str:
    """A size as it is said: two digits, in per cent, degrees, or thousandths of a unit where it is small; with its
    standard deviation where it has one: "3.9 +- 1.0 %".
    """  # noqa: D205
    factor, words = SCALED.get(unit_name, (1.0, unit(unit_name)))
    if unit_name in MILLI and abs(value) < 0.1:
        factor, words = 1000.0, {"kg": "g"}.get(unit_name, f"m{unit_name}")
    uncertain = f" +- {number(factor * std, 2)}" if std else ""
    return f"{number(factor * value, 2)}{uncertain} {words}"


def separation(value: float, most: float = 100.0) -> str:
    """A separation in standard errors; beyond `most` no digit says anything."""
    return f"{round(value, 1) + 0.0:.1f}" if value < most else f"> {most:.0f}"  # + 0.0: no minus before a zero


def user_name(name: str, vehicle: Vehicle | None) -> str:
    """A parameter in a sentence: the name of the rotor or arm that it belongs to."""
    return name if vehicle is None else vehicle.called(name)


def label(name: str, vehicle: Vehicle | None) -> str:
    """A parameter in a table: "M3 (rotor_2)" where its rotor or arm is called otherwise, else its own."""
    own = user_name(name, vehicle)
    return name if own == name else f"{own} ({name})"


def parameters_in_words(values: Sequence[Value], vehicle: Vehicle | None = None) -> str:
    """Parameters in a few words: all of up to three, else the two clearest; one alone with its interval."""
    if len(values) == 1:
        (one,) = values
        return f"{user_name(one.name, vehicle)} {number(one.value)} +- {number(one.std, 2)} {unit(one.unit)}".rstrip()
    clearest = sorted(values, key=lambda v: -abs(v.value) / max(v.std or 0.0, 1e-30))
    shown = values if len(values) <= 3 else clearest[:2]
    more = f", ... ({len(values)})" if len(values) > 3 else ""
    return ", ".join(f"{user_name(v.name, vehicle)} {quantity(v.value, v.unit)}" for v in shown) + more


def parameter_rows(effects: Sequence[Snapshot]) -> list[dict[str, Any]]:
    """A row for each parameter: effect, parameter, value, std, unit."""
    names = ("parameter=name", "value", "std", "unit")
    return [{"effect": s.effect, **entries(v, *names)} for s in effects for v in s.values]


def by_axis(name: str, values: Array) -> dict[str, Any]:
    """Wrenches (6,) or (N, 6) as columns of a frame: `name.force_x`, ..."""
    return {f"{name}.{axis}": values[..., k] for k, axis in enumerate(AXES)}


def reasons_json(kind: str, reasons: Mapping[str, str]) -> list[dict[str, str]]:
    """Why things of a kind are lacking, by their names."""
    return [{kind: name, "reason": why} for name, why in reasons.items()]


def by_reason(pairs: Iterable[tuple[str, str]]) -> dict[str, list[str]]:
    """Names by the reason that they share, of pairs of reason and name."""
    found: dict[str, list[str]] = {}
    for reason, name in pairs:
        found.setdefault(reason, []).append(name)
    return found


def entries(found: object, *names: str) -> dict[str, Any]:
    """Attributes for JSON, each under its own name, or as `key=attribute`."""
    pairs = [name.partition("=") for name in names]
    return {key: attrgetter(attribute or key)(found) for key, _, attribute in pairs}
