"""A model written in the terms of another program, and what of it those terms cannot say."""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from wrenchgap._escaping import comment, printable
from wrenchgap.flight.errors import ModelError, UsageError
from wrenchgap.flight.result import Result
from wrenchgap.plant.model import Model
from wrenchgap.plant.targets import TARGETS, simulators
from wrenchgap.plant.targets.autopilots import AUTOPILOTS
from wrenchgap.plant.targets.quantities import Quantity, Values, acting_effects, at_limit, quantities, values_of
from wrenchgap.plant.vehicle import Vehicle

WORDS = {
    "mass": "the mass",
    "com": "the centre of mass",
    "inertia": "the inertia",
    "imu": "the place of the IMU",
    "misalignment": "an IMU that is turned",
    "direction": "the directions of thrust",
    "balance": "rotors of unequal thrust",
    "yaw": "the drag torque",
    "level": "the thrust at a speed",
    "curve": "the shape of the thrust curve",
    "lag": "the lag of the rotors",
    "delay": "a delay",
    "linear": "linear drag",
    "quadratic": "quadratic drag",
    "lift": "the lift of rotors that move sideways",
    "push": "a constant force",
    "couple": "a constant torque",
}
"""Quantities that a program may lack a parameter for."""


@dataclass(frozen=True)
class Simulator:
    """A format: its text for a vehicle and its quantities, which of them it can say, and its comments.

    `inherent` are effects that its own equations have.
    """

    name: str
    text: Callable[[Vehicle, Values], str]
    uses: frozenset[str]
    comment: tuple[str, str]
    inherent: frozenset[str] = frozenset()


BODY = frozenset({"mass", "com", "inertia", "level", "yaw", "lag"})
XML, HASH = ("<!--", "-->"), ("#", "")
SIMULATORS = {
    "mjcf": Simulator("MJCF", simulators.mjcf, BODY | {"imu", "direction", "balance"}, XML),
    "sdf": Simulator("Gazebo's motor model", simulators.sdf, BODY | {"direction", "balance", "linear"}, XML),
    "urdf": Simulator("Gazebo's motor model", simulators.urdf, BODY | {"direction", "balance", "linear"}, XML),
    "rotorpy": Simulator(
        "RotorPy",
        simulators.rotorpy,
        BODY | {"imu", "linear", "quadratic", "lift"},
        HASH,
        frozenset({"drag_torque_of_speed"}),
    ),
    "drone-models": Simulator("drone-models", simulators.drone_models, BODY | {"curve", "twist", "linear"}, HASH),
}


@dataclass(frozen=True)
class WrittenParameter:
    """A parameter of an autopilot: its value, standard deviation, the effects that it comes from.

    `before` is the value that was set, None where it is not known; `nominal` that of the model without effects.
    """

    name: str
    value: float
    std: float
    before: float | None
    nominal: float
    effects: tuple[str, ...]


@dataclass(frozen=True, repr=False)
class Written(Result):
    """A model for `target`: `text` of its file, of autopilots its `parameters`, `lost` what it cannot say, in words."""

    vehicle: str
    target: str
    text: str
    parameters: tuple[WrittenParameter, ...]
    lost: tuple[str, ...]


def written(model: Model, target: str, before: Mapping[str, float] | None = None, origin: str = "") -> Written:
    """A model in the terms of `target`, one of `TARGETS`; of an autopilot what was identified alone.

    `before` are parameters of the autopilot as they were, `origin` says in a line what the model is. Raises UsageError
    for an unknown target, ModelError for a model without rotors, for rotors that the target cannot have, and where
    nothing was identified that an autopilot has a parameter for.
    """
    if target not in TARGETS:
        raise UsageError(f"--to {target}: expected one of {', '.join(TARGETS)}")
    if target in AUTOPILOTS:
        return _parameters(model, target, before or {}, origin)
    form = SIMULATORS[target]
    values = values_of(model, acting_effects(model))
    lost = _lost(model, quantities(model), form.name, form.uses, fitted=False, inherent=form.inherent)
    first, last = form.comment
    head = [origin, *(f"not in it: {words}" for words in lost)]
    comments = [f"{first} {comment(line)} {last}".rstrip() for line in head if line]
    return Written(model.name, target, "\n".join([*comments, form.text(model.vehicle, values)]), (), tuple(lost))


def _parameters(model: Model, target: str, before: Mapping[str, float], origin: str) -> Written:
    pilot = AUTOPILOTS[target]
    pilot.check(model, before)
    rows, lost = [], []
    own = quantities(model)
    found = pilot.quantities(model, before, own["curve"].identified)
    asked = {name for name, one in found.items() if one.identified}
    for pattern in pilot.together:
        group = {name for name in found if re.fullmatch(pattern, name)}
        asked |= group if group & asked else set()
    for name, one in found.items():
        if name not in asked or not np.isfinite(one.value):
            continue
        value = pilot.nearest(name, float(one.value), float(one.std))
        if (refusal := pilot.refused(name, value)) is not None:
            lost.append(refusal)
            continue
        nominal = float(one.nominal) if abs(one.nominal) > 1e-9 * abs(one.value) else 0.0  # no rounding
        numbers = (value, float(one.std), before.get(name), nominal)
        rows.append(WrittenParameter(name, *numbers, one.by))
    without_curve = {"level", "curve"} | ({"mass"} if pilot.curve else set())
    hovers = "signal" in own and bool(np.isfinite(own["signal"].value))
    if target == "px4" and model.vehicle.geometry()[0].tilts.any():
        words = "" if any(name.startswith("CA_SV_TL") for name in found) else "; zeros of servos need the set CA_SV_TL*"
        lost.append(f"arms that tilt: CA_ROTOR* describe them at zero tilt{words}")
    lost += _lost(model, own, pilot.name, pilot.uses if hovers else pilot.uses - without_curve, fitted=True)
    if not rows:
        raise ModelError(
            f"{model.name}: holds nothing identified that {pilot.name} has a parameter for"
            + "".join(f"; {words}" for words in lost)
            + "; add effects with `wrenchgap add` or `calibrate`"
        )
    head = [origin, *(f"not in it: {words}" for words in lost)]
    if not before and pilot.relative:
        head.append(f"made for {pilot.relative}: if the log was flown with others, say them with --parameters")
    lines = [f"# {printable(line)}" for line in head if line]
    if target == "px4":
        lines.append("# Vehicle-Id Component-Id Name Value Type")
    for row in rows:
        was = f"nominally {row.nominal:.6g}" if row.before is None else f"was {row.before:.6g}"
        lines.append(f"# {row.name}: +-{row.std:.2g}, {was}; {', '.join(row.effects)}")
        lines.append(f"1\t1\t{row.name}\t{row.value:.6g}\t9" if target == "px4" else f"{row.name},{row.value:.6g}")
    return Written(model.name, target, "\n".join(lines) + "\n", tuple(rows), tuple(lost))


def _lost(
    model: Model,
    found: Mapping[str, Quantity],
    program: str,
    uses: frozenset[str],
    *,
    fitted: bool,
    inherent: frozenset[str] = frozenset(),
) -> list[str]:
    """In words, what effects of a model say that a program cannot; `fitted`: which were not fitted, too."""
    out = []
    for one in model.effects:
        moved = [name for name, quantity in found.items() if name in WORDS and one.name in quantity.by]
        missing = [WORDS[name] for name in moved if name not in uses]
        if at_limit(one, model.vehicle):
            out.append(f"{one.name}: is at a limit of what is plausible, so its law is wrong")
        elif fitted and moved and not missing and one.std is None:
            out.append(f"{one.name}: was not fitted, it has no standard deviation")
        elif missing:
            out.append(f"{one.name}: {program} has no parameter for {' and '.join(missing)}")
        elif not moved and one.name not in inherent and not any(one.name in found[n].by for n in uses & found.keys()):
            out.append(f"{one.name}: {program} has no parameter for it")
    return out
