"""In what a log's commands are: rad/s and N, or what only a model of the vehicle turns into them.

Autopilots command shares of full throttle and of the largest torque (-1 to 1), or pulse widths. Such numbers follow the
wrench but are none: a log alone does not say how many newtons full throttle is. A series says so in its `unit`, which
comes from where the numbers lie: the field `normalized` of an Actuators message, or the words `normalised`,
`normalized`, `throttle` or `pwm` in the topic's name or behind it (`flight.mapping_units`).
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from wrenchgap.flight.errors import LogError
from wrenchgap.flight.flight import Array, Flight, SpeedUnit, WrenchSeries
from wrenchgap.flight.formats import Table
from wrenchgap.flight.formats.headers import meaning
from wrenchgap.flight.roles import Source
from wrenchgap.flight.topic_names import ROTOR, name_words

NORMALISED = frozenset({"normalised", "normalized", "throttle"})
ROTOR_WORDS = {"normalised": "normalised (shares of full throttle)", "pwm": "pulse widths in us"}
"""Of rotors: 0 to 1, and from -1 where a rotor reverses."""
WRENCH_WORDS = "normalised (shares of full authority)"
"""Of a wrench: -1 to 1."""
REMEDY = (
    "the model file must say how commands become newtons: take a model from the log with `wrenchgap model new --from "
    "LOG`, or write its [command]"
)
"""What to do about commands that are not in SI."""


def unit_of(source: Source) -> SpeedUnit:
    """What rotor commands from `source` are, by a word behind it or by the names of topic and field."""
    if source.meaning.command is not None:
        return source.meaning.command
    words = name_words(source.topic) | name_words(source.field)
    return "pwm" if "pwm" in words else "normalised" if words & NORMALISED else "rad/s"


def with_units(flight: Flight, sources: Mapping[str, Source]) -> Flight:
    """The flight with the units of its commands, which come from `sources` by part."""
    changed: dict[str, Any] = {}
    notes = []
    if flight.actuators is not None and "rotor_speed" in sources:
        unit = unit_of(sources["rotor_speed"])
        if unit != "rad/s" and flight.actuators.rotor_speed.shape[1]:
            changed["actuators"] = replace(flight.actuators, unit=unit)
            notes.append(f"{sources['rotor_speed']}: rotor commands are {ROTOR_WORDS[unit]}, not rad/s.")
    for role in ("commanded", "desired"):
        series: WrenchSeries | None = getattr(flight, role)
        if series is not None and role in sources and unit_of(sources[role]) == "normalised":
            changed[role] = replace(series, unit="normalised")
            notes.append(f"{sources[role]}: the {role} wrench is {WRENCH_WORDS}, not N and Nm.")
    return replace(flight, notes=(*flight.notes, *notes), **changed) if changed else flight


def option_for(table: Table | None) -> str | None:
    """How numbered columns of a table would be read as rotor commands: `rotor_speed=/table.u:throttle`; None without.

    Those that sound like rotors first, then those that come in fours; their sizes say which unit they may have.
    """
    arrays = {} if table is None or table.type != "table" else table.columns
    found: dict[str, Array] = {}
    for name, values in arrays.items():
        numbered = values.ndim == 2 and 2 < values.shape[1] <= 12 and name != "data"
        if numbered and not {f"{name}_x", f"{name}x"} & arrays.keys() and meaning(f"{name}_1") is None:
            found[name] = values
    if not found:
        return None
    name = min(found, key=lambda one: (not name_words(one) & ROTOR, found[one].shape[1] not in (4, 6, 8), one))
    known = found[name][np.isfinite(found[name])]
    low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 0.0)
    word = ":throttle" if low >= -1.0 and high <= 1.0 else ":pwm" if low >= 700.0 and high <= 2300.0 else ""
    if not word and low >= 0.0 and 3500.0 < high <= 65535.0:
        word = ":pwm=0..65535"
    return f"rotor_speed={table.topic}.{name}{word}" if table is not None else None


def in_si(flight: Flight, remedy: str = REMEDY) -> Flight:
    """The flight without commands that are not in SI, which its notes say, where others remain.

    Raises LogError with the `remedy` where no command remains: nothing there could be compared with a measured wrench.
    """
    units = {role: getattr(series, "unit", "") for role, series in flight.series().items()}
    out = {role: unit for role, unit in units.items() if unit in ROTOR_WORDS}
    if not out:
        return flight
    words = {role: ROTOR_WORDS[unit] if role == "actuators" else WRENCH_WORDS for role, unit in out.items()}
    said = ", ".join(f"{flight.series()[role].topic} ({role}, {words[role]})" for role in out)
    left = replace(flight, **dict.fromkeys(out))  # type: ignore[arg-type]
    if left.commanded is None and left.actuators is None and left.desired is None:
        raise LogError(f"{flight.path.name}: its commands are not in SI: {said}; {remedy}")
    return replace(left, notes=(*left.notes, f"{flight.name}: not in SI and left out: {said}; {remedy}."))
