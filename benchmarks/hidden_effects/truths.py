"""What the parameters of a named effect should have come out as, where the hidden physics has the same quantity."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.hidden_effects.airframe import MASS
from benchmarks.hidden_effects.engine import ALWAYS, Truth
from benchmarks.hidden_effects.hidden import HOVER_THRUST

Values = dict[str, float]
Given = dict[str, Any]


def _xyz(given: Given) -> Values:
    return {axis: float(given[axis]) for axis in "xyz"}


def _inertia(given: Given) -> Values:
    x, y, z = given["sx"], given["sy"], given["sz"]
    return {"xx": y + z, "yy": x + z, "zz": x + y, "xy": 0.0, "xz": 0.0, "yz": 0.0}


def _rotors(given: Given) -> Values:
    return {f"rotor_{k}": -given["loss"] if k == given["rotor"] else 0.0 for k in range(12)}


def _jet(given: Given) -> Values:
    force = np.array(given["force"])
    wrench = (*force, *np.cross(given["at"], force))
    names = [f"{kind}_{axis}" for kind in ("force", "torque") for axis in "xyz"]
    return {name: float(value) for name, value in zip(names, wrench, strict=True)}


TRUE: dict[tuple[str, str], Callable[[Given], Values]] = {
    ("com_offset", "com_offset"): _xyz,
    ("inertia", "inertia"): _inertia,
    ("mass", "mass"): lambda g: {"added": MASS * g["relative"]},
    ("payload", "payload"): lambda g: {"mass": g["mass"], **_xyz(g)},
    ("heavy_arms", "arm_reaction"): lambda g: {"inertia": ALWAYS["arm_reaction"] + g["added"]},
    ("servo_lag", "servo_lag"): lambda g: {"tau": ALWAYS["servo_lag"] + g["added"]},
    ("motor_lag", "motor_lag"): lambda g: {"tau": g["tau"]},
    ("command_delay", "command_delay"): lambda g: {"delay": g["delay"]},
    ("tilt_offset", "tilt_offset"): lambda g: {f"arm_{k}": a for k, a in enumerate(g["per_arm"])},
    ("backlash", "backlash"): lambda g: {"play": g["gap"]},
    ("droop", "arm_twist"): lambda g: {"twist": -g["angle"] / (2 * HOVER_THRUST)},
    ("weak_rotor", "rotor_thrust"): _rotors,
    ("thin_air", "thrust_scale"): lambda g: {"scale": -g["missing"]},
    ("fan", "tether"): lambda g: {f"force_{axis}": g[axis] for axis in "xyz"},
    ("jet", "constant_wrench"): _jet,
    ("drag_torque", "drag_torque"): lambda g: {"change": g["relative"]},
    ("gyroscopic", "rotor_gyroscopic"): lambda g: {"inertia": g["inertia"]},
    ("imu_turned", "imu_misalignment"): _xyz,
    ("imu_moved", "imu_lever_arm"): _xyz,
}
"""(hidden effect, catalogue effect) to the true values of the latter's parameters."""


def true_values(truth: Truth) -> dict[str, Values]:
    """By catalogue effect: what its parameters really are on this flight, as far as that can be said."""
    out: dict[str, Values] = {}
    for (hidden, named), values in TRUE.items():
        if hidden in truth.effects:
            out[named] = values(truth.parameters[hidden])
    return out
