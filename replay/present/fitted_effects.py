"""What a model's fitted effects say of the vehicle, in a pilot's words: "the centre of mass 32 mm towards the back"."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from wrenchgap.learn.changed.places import towards
from wrenchgap.learn.data.blocks import SIGNIFICANCE
from wrenchgap.learn.identify.fit import MATERIAL
from wrenchgap.learn.posterior.explain import Explanation
from wrenchgap.learn.posterior.sensor_causes import (
    ACCELEROMETER,
    GYROSCOPE,
    LATE_CLOCK,
    LATE_GYROSCOPE,
)
from wrenchgap.learn.posterior.sparse_commands import SPARSE_COMMANDS
from wrenchgap.plant import Model, Vehicle
from wrenchgap.plant.effects import find
from wrenchgap.plant.history import Value
from wrenchgap.plant.wrench_model import ModelEffect
from wrenchgap.replay.present.numbers import LIGHT, share, size_in_words, user_name, with_std

PLURAL = ("the motors", "the tilt servos")
"""Subjects of more than one thing."""
SENSORS = {
    LATE_CLOCK: "the measured motion is late, by a clock or a low-pass of the IMU or the odometry",
    LATE_GYROSCOPE: "the gyroscope is late, by a low-pass of its own",
    ACCELEROMETER: "the accelerometer's calibration is off by as much",
    SPARSE_COMMANDS: "the log does not say often enough what was commanded",
    GYROSCOPE: "the gyroscope's calibration is off by as much",
}
"""What stands beside an effect, and is none."""
SPOKEN = {"com_offset": ("x", "y"), "imu_misalignment": ("x", "y", "z"), "imu_lever_arm": ("x", "y", "z")}
"""Parameters that the words of an effect hold beside the clearest one."""
DIFFERENT = "different from the model file's"
"""Of effects that have no words of their own."""


@dataclass(frozen=True)
class FittedEffect:
    """What a fitted effect is about, how that is off, its values by name, and the largest in multiples of a typical."""

    subject: str
    is_so: str
    values: str
    size: float


def largest_first(model: Model) -> list[FittedEffect]:
    """Fitted effects of a model with a value beyond its uncertainty, in the order of their size."""
    found = [_in_words(effect, model.vehicle) for effect in model.effects if effect.std is not None]
    return sorted((one for one in found if one.size > 0.0), key=lambda one: -one.size)


def already_in(model: Model, named: Sequence[str] = (), most: int = 2) -> str:
    """What a model holds, beside what was `named`, that is large enough for a name, in a line; of more effects than
    `most` how many there are; empty where there is none.
    """  # noqa: D205
    given = model.with_effects(e for e in model.effects if e.name not in named)
    large = [one for one in largest_first(given) if one.size >= MATERIAL]
    if not large:
        return ""
    listed = " and ".join(f"{one.subject} {one.is_so} ({one.values})" for one in large[:most])
    more = f", and {len(large) - most} more" if len(large) > most else ""
    return f"The model already has, and `explain` does not name again: {listed}{more}."


def largest_of(model: Model, names: Sequence[str]) -> str:
    """The largest of these effects of a model as a sentence; empty where none is beyond its uncertainty."""
    found = largest_first(model.with_effects(e for e in model.effects if e.name in names))
    if not found:
        return ""
    one = found[0]
    clause = _clause(one)
    if one.subject == "the centre of mass" and "towards" in one.is_so:  # `calibrate`, which asks, tries no rotors
        clause += ", or propellers are weak there"
    elif one.subject == "what is commanded":  # the same for motion that is slow beside it
        clause += ", or the motors are slower by as much"
    elif one.subject == "the IMU" and one.is_so.startswith("turned"):  # in a hover the same
        clause += ", or wind or another constant force pushed"
    elif one.subject == "all thrust":
        clause += f", or the vehicle {'lighter' if one.is_so.endswith('higher') else 'heavier'}"
    return f"{'Largest: ' if len(found) > 1 else ''}{clause[:1].upper()}{clause[1:]} ({one.values})."


def likely_groups(found: Explanation, none: float = 0.5) -> list[tuple[str, ...]]:
    """Groups of what cannot be told apart, without those that are likelier not there; one, if that leaves none."""

    def weight(group: Sequence[str]) -> float:
        members = [set(name.split(" + ")) for name in group]
        return sum(s.weight for s in found.posterior.sets if any(one <= set(s.names) for one in members))

    return [group for group in found.groups if weight(group) > 1.0 - none] or [*found.groups[:1]]


def alternatives(found: Explanation, group: Sequence[str], most: int = 3) -> list[tuple[str, str]]:
    """What cannot be told apart, as weights and clauses in a pilot's words with their sizes, the likeliest first."""
    vehicle, place = found.model.vehicle, tuple(group[0].split(" + "))
    rivals = {r.names: r for m in found.members for r in m.alike if r.members == place}
    mine = sum(s.weight for s in found.posterior.sets if set(place) <= set(s.names))
    said = [(mine, together([e for e in found.fit.effects if e.name in place], vehicle))]
    named, rest = {place}, 1.0 - mine
    for names, rival in rivals.items():
        having = [
            s
            for s in found.posterior.sets
            if set(names) <= set(s.names) and not any(set(one) <= set(s.names) for one in named)
        ]
        named.add(names)
        weight = sum(s.weight for s in having)
        if weight < LIGHT:
            continue
        rest -= weight
        theta = next((s.theta(found.model) for s in having), {})
        effects = [ModelEffect(find(name), theta[name]) for name in names if name in theta]
        sensor = next((f"{SENSORS[name]} ({rival.name})" for name in names if name in SENSORS), "")
        whole = together(effects, vehicle) if len(effects) == len(names) else rival.name
        said.append((weight, sensor or whole))
    said.sort(key=lambda pair: -pair[0])
    if more := said[most:]:
        others = "one other" if len(more) == 1 else f"one of {len(more)} others"
        said = [*said[:most], (sum(weight for weight, _ in more), f"{others} (--details)")]
    none = [(rest, "none of these")] if rest >= LIGHT else []
    return [(share(weight), clause) for weight, clause in (*said, *none)]


def either(found: Explanation, group: Sequence[str]) -> str:
    """The `alternatives` as a sentence."""
    said = [f"{clause}, {weight}" for weight, clause in alternatives(found, group)]
    return f"Either {'; or '.join(said)}: {which_flights(found)} cannot tell which."


def is_independent_of_thrust(found: Explanation) -> bool:
    """Whether the constant wrench would clearly have been another one if it grew with the thrust.

    The two differ by its size times the rms variation of the commanded force over its mean; clear is more than
    `SIGNIFICANCE.alone` standard errors of the size. False without flights, which do not travel between processes.
    """
    if not found.flights:
        return False
    force = np.concatenate([r.commanded[:, :3] for f in found.flights for r in f.records])
    varied = np.sqrt(force.var(axis=0).sum()) / np.linalg.norm(force.mean(axis=0))
    sizes = [abs(v.value) / v.std for v in found.fit.values("constant_wrench") if v.std]
    return bool(max(sizes, default=0.0) * varied > SIGNIFICANCE.alone)


def which_flights(found: Explanation) -> str:
    """The subject of a sentence on what they cannot tell."""
    return "this flight" if len(found.flights) == 1 else "these flights"


def together(effects: Sequence[ModelEffect], vehicle: Vehicle) -> str:
    """What one or two effects say together as a clause, with their values; of more, or of two without words of their
    own, the names alone.
    """  # noqa: D205
    found = [_in_words(one, vehicle, stds=True) for one in effects]
    wordless = any(one.is_so in ("", DIFFERENT) for one in found)
    if len(effects) > 2 or (len(effects) == 2 and wordless):
        return " + ".join(one.name for one in effects)
    if wordless:
        return found[0].values
    return f"{' and '.join(map(_clause, found))} ({' + '.join(one.values for one in found)})"


def _clause(one: FittedEffect) -> str:
    return f"{one.subject} {'are' if one.subject in PLURAL else 'is'} {one.is_so}"


def _in_words(effect: ModelEffect, vehicle: Vehicle, *, stds: bool = False, prominent: float = 0.3) -> FittedEffect:
    """An effect in words and its values; a further value of it is said from `prominent` times the largest on, or its
    typical size. With `stds` the words have the standard deviation, and what they say stands in no value again.
    """  # noqa: D205
    parameters = effect.effect.parameters(vehicle)
    std = np.zeros(len(effect.theta)) if effect.std is None else effect.std
    sizes = {
        p.name: abs(value) / p.scale
        for p, value, one in zip(parameters, effect.theta, std, strict=True)
        if abs(value) > SIGNIFICANCE.alone * one
    }
    clearest = sorted(sizes, key=lambda name: -sizes[name])
    rows = zip(parameters, effect.theta.tolist(), std.tolist(), strict=True)
    values = [Value(p.name, v, one if stds else None, p.unit) for p, v, one in rows]
    by = {v.name: v for v in values if v.name in sizes}
    if stds and not by and values:  # what is named is said with its size, however unsure
        nearest = max(values, key=lambda v: abs(v.value) / (v.std or 1e-30))
        return FittedEffect("", "", f"{effect.name} {user_name(nearest.name, vehicle)} {_sized(nearest)}", 0.0)
    largest = sizes[clearest[0]] if clearest else 0.0
    said = [by[n] for n in clearest[:3] if sizes[n] > min(1.0, prominent * largest)]
    subject, is_so = _words(effect.name, by, clearest, vehicle) if clearest else ("", "")
    if stds and is_so != DIFFERENT:
        said = [v for v in said if v.name not in (*clearest[:1], *SPOKEN.get(effect.name, ()))]
    listed = ", ".join(f"{user_name(v.name, vehicle)} {_sized(v) if stds else with_std(v)}" for v in said)
    also = ", also" if said and stds and is_so != DIFFERENT else ""
    return FittedEffect(subject, is_so, f"{effect.name}{also} {listed}".rstrip(), largest)


def _sized(value: Value) -> str:
    return size_in_words(value.value, value.unit, value.std)


def _words(name: str, by: Mapping[str, Value], clearest: Sequence[str], vehicle: Vehicle) -> tuple[str, str]:
    """What an effect with these values is about, and how that is off, with its standard deviation where it has one."""
    first = by[clearest[0]]
    x, y, z = (by[axis].value if axis in by else 0.0 for axis in "xyz")
    more = first.value > 0.0
    size, where = size_in_words(abs(first.value), first.unit, first.std), user_name(first.name, vehicle)
    length = size_in_words(float(np.linalg.norm([x, y, z])), first.unit, first.std)
    level = size_in_words(float(np.hypot(x, y)), first.unit, first.std)
    match name:
        case "com_offset" if x or y:
            return "the centre of mass", f"{level} towards the {towards(vehicle, x, y)}"
        case "com_offset":
            return "the centre of mass", f"{size} {'higher' if more else 'lower'}"
        case "rotor_thrust":
            return where, f"{size} {'stronger' if more else 'weaker'}"
        case "tilt_offset":
            return where, f"tilted {size} off"
        case "imu_misalignment":
            return "the IMU", f"turned by {length}"
        case "imu_lever_arm":
            return "the IMU", f"{length} away from where it was given"
        case "mass":
            return "the vehicle", f"{size} {'heavier' if more else 'lighter'}"
        case "tilt_scale":
            return "the arms", f"turning {size} {'further' if more else 'less'} than commanded"
        case "thrust_scale":
            return "all thrust", f"{size} {'higher' if more else 'lower'}"
        case "drag_torque":
            return "the rotors' torque per thrust", f"{size} {'higher' if more else 'lower'}"
        case "motor_lag" | "servo_lag":
            return PLURAL[0 if name == "motor_lag" else 1], f"{size} slower"
        case "command_delay":
            return "what is commanded", f"{size} late"
    return name.replace("_", " "), DIFFERENT
