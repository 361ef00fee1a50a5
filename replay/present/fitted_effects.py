"""What a model's fitted effects say of the vehicle, in a pilot's words: "the centre of mass 32 mm towards the back"."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from wrenchgap.learn.changed.places import towards
from wrenchgap.learn.data.blocks import SIGNIFICANCE
from wrenchgap.learn.identify.fit import MATERIAL
from wrenchgap.plant import Model, Vehicle
from wrenchgap.plant.history import Value
from wrenchgap.plant.wrench_model import ModelEffect
from wrenchgap.replay.present.numbers import quantity, size_in_words, user_name

PLURAL = ("the motors", "the tilt servos")
"""Subjects of more than one thing."""


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
    verb = f"{one.subject[:1].upper()}{one.subject[1:]} {'are' if one.subject in PLURAL else 'is'} {one.is_so}"
    return f"{'Largest: ' if len(found) > 1 else ''}{verb} ({one.values})."


def _in_words(effect: ModelEffect, vehicle: Vehicle, prominent: float = 0.3) -> FittedEffect:
    """An effect in words; a further value of it is said from `prominent` times the largest on, or its typical size."""
    parameters, stds = effect.effect.parameters(vehicle), effect.std if effect.std is not None else effect.theta
    sizes = {
        p.name: abs(value) / p.scale
        for p, value, std in zip(parameters, effect.theta, stds, strict=True)
        if abs(value) > SIGNIFICANCE.alone * std
    }
    clearest = sorted(sizes, key=lambda name: -sizes[name])
    values = [Value(p.name, v, None, p.unit) for p, v in zip(parameters, effect.theta.tolist(), strict=True)]
    by = {v.name: v for v in values if v.name in sizes}
    largest = sizes[clearest[0]] if clearest else 0.0
    said = [by[n] for n in clearest[:3] if sizes[n] > min(1.0, prominent * largest)]
    listed = ", ".join(f"{user_name(v.name, vehicle)} {quantity(v.value, v.unit)}" for v in said)
    subject, is_so = _words(effect.name, by, clearest, vehicle) if clearest else ("", "")
    return FittedEffect(subject, is_so, f"{effect.name} {listed}", largest)


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
    return name.replace("_", " "), "different from the model file's"
