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
from wrenchgap.plant import Model, Vehicle
from wrenchgap.plant.effects import find
from wrenchgap.plant.history import Value
from wrenchgap.plant.wrench_model import ModelEffect
from wrenchgap.replay.present.numbers import share, size_in_words, user_name, with_std

PLURAL = ("the motors", "the tilt servos")
"""Subjects of more than one thing."""
SENSORS = {
    LATE_CLOCK: "the measured motion is late, by a clock or a low-pass of the IMU or the odometry",
    LATE_GYROSCOPE: "the gyroscope is late, by a low-pass of its own",
    ACCELEROMETER: "the accelerometer's calibration is off by as much",
    GYROSCOPE: "the gyroscope's calibration is off by as much",
}
"""What stands beside an effect, and is none."""
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
    return f"{'Largest: ' if len(found) > 1 else ''}{clause[:1].upper()}{clause[1:]} ({one.values})."


def either(found: Explanation, group: Sequence[str], most: int = 3) -> str:
    """What cannot be told apart, each in a pilot's words with its size and its weight; of many the likeliest."""
    vehicle, place = found.model.vehicle, tuple(group[0].split(" + "))
    rivals = {r.names: r for m in found.members for r in m.alike if r.members == place}
    mine = sum(s.weight for s in found.posterior.sets if set(place) <= set(s.names))
    own = [e for e in found.fit.effects if e.name in place]
    said = [together(own, vehicle, share(mine))]
    for names, rival in rivals.items():
        having = (s for s in found.posterior.sets if set(names) <= set(s.names) and not set(place) & set(s.names))
        theta = next((s.theta(found.model) for s in having), {})
        effects = [ModelEffect(find(name), theta[name]) for name in names if name in theta]
        weight = share(rival.weight)
        sensor = next((f"{SENSORS[name]} ({rival.name}, {weight})" for name in names if name in SENSORS), "")
        whole = together(effects, vehicle, weight) if len(effects) == len(names) else f"{rival.name} ({weight})"
        said.append(sensor or whole)
    more = len(said) - most
    listed = said[:most] + ([f"{'one other' if more == 1 else f'one of {more} others'} (--details)"] * (more > 0))
    flights = "this flight" if len(found.flights) == 1 else "these flights"
    return f"Either {', or '.join(listed)}: {flights} cannot tell which."


def together(effects: Sequence[ModelEffect], vehicle: Vehicle, weight: str) -> str:
    """What one or two effects say together as a clause, with their values and a weight; of more, or of two without
    words of their own, the names alone.
    """  # noqa: D205
    found = [_in_words(one, vehicle, stds=True) for one in effects]
    wordless = any(one.is_so in ("", DIFFERENT) for one in found)
    if len(effects) > 2 or (len(effects) == 2 and wordless):
        return f"{' + '.join(one.name for one in effects)} ({weight})"
    if wordless:
        return f"{found[0].values} ({weight})"
    return f"{' and '.join(map(_clause, found))} ({' + '.join(one.values for one in found)}, {weight})"


def _clause(one: FittedEffect) -> str:
    return f"{one.subject} {'are' if one.subject in PLURAL else 'is'} {one.is_so}"


def _in_words(effect: ModelEffect, vehicle: Vehicle, *, stds: bool = False, prominent: float = 0.3) -> FittedEffect:
    """An effect in words, its values with their standard deviations where `stds`; a further value of it is said from
    `prominent` times the largest on, or its typical size.
    """  # noqa: D205
    parameters, std = (
        effect.effect.parameters(vehicle),
        np.zeros(len(effect.theta)) if effect.std is None else effect.std,
    )
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
        return FittedEffect("", "", f"{effect.name} {user_name(nearest.name, vehicle)} {with_std(nearest)}", 0.0)
    largest = sizes[clearest[0]] if clearest else 0.0
    said = [by[n] for n in clearest[:3] if sizes[n] > min(1.0, prominent * largest)]
    listed = ", ".join(f"{user_name(v.name, vehicle)} {with_std(v)}" for v in said)
    subject, is_so = _words(effect.name, by, clearest, vehicle) if clearest else ("", "")
    return FittedEffect(subject, is_so, f"{effect.name} {listed}".rstrip(), largest)


def _words(name: str, by: Mapping[str, Value], clearest: Sequence[str], vehicle: Vehicle) -> tuple[str, str]:
    """What an effect with these values is about, and how that is off."""
    first = by[clearest[0]]
    x, y, z = (by[axis].value if axis in by else 0.0 for axis in "xyz")
    length, more = float(np.linalg.norm([x, y, z])), first.value > 0.0
    size, where = size_in_words(abs(first.value), first.unit), user_name(first.name, vehicle)
    match name:
        case "com_offset" if x or y:
            return "the centre of mass", f"{size_in_words(np.hypot(x, y), 'm')} towards the {towards(vehicle, x, y)}"
        case "com_offset":
            return "the centre of mass", f"{size} {'higher' if more else 'lower'}"
        case "rotor_thrust":
            return where, f"{size} {'stronger' if more else 'weaker'}"
        case "tilt_offset":
            return where, f"tilted {size} off"
        case "imu_misalignment":
            return "the IMU", f"turned by {size_in_words(length, 'rad')}"
        case "imu_lever_arm":
            return "the IMU", f"{size_in_words(length, 'm')} away from where it was given"
        case "mass":
            return "the vehicle", f"{size} {'heavier' if more else 'lighter'}"
        case "thrust_scale":
            return "all thrust", f"{size} {'higher' if more else 'lower'}"
        case "drag_torque":
            return "the rotors' torque per thrust", f"{size} {'higher' if more else 'lower'}"
        case "motor_lag" | "servo_lag":
            return PLURAL[0 if name == "motor_lag" else 1], f"{size} slower"
        case "command_delay":
            return "what is commanded", f"{size} late"
    return name.replace("_", " "), DIFFERENT
