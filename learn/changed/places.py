"""Where on the vehicle: which rotor, arm, servo or sensor a parameter is of, in the user's names, and how sure that is.

Of a sparse effect (one gain per rotor) one place is likelier than several. With everything else of the set free, every
place by itself takes some of the cost off; the odds between two places are what those differ by.
"""

from dataclasses import dataclass

import numpy as np

from wrenchgap.flight.flight import Array
from wrenchgap.learn.changed.search import Weighed
from wrenchgap.learn.posterior.kernels import bounded
from wrenchgap.plant.effects import find
from wrenchgap.plant.vehicle import Vehicle

WHOLE = {
    "accelerometer_bias": "accelerometer",
    "imu_misalignment": "IMU mounting",
    "imu_lever_arm": "IMU mounting",
    "motor_lag": "motors and speed controllers",
    "asymmetric_motor_lag": "motors and speed controllers",
    "servo_lag": "tilt servos",
    "backlash": "tilt servos",
    "arm_twist": "arms",
    "arm_reaction": "arms",
    "command_delay": "radio link or flight controller",
    "thrust_scale": "battery and all propellers",
    "battery_sag": "battery",
    "thrust_fade": "battery",
    "thrust_curve": "motors and speed controllers",
    "drag_torque": "all propellers",
    "drag_torque_of_speed": "all propellers",
    "mass": "payload or battery",
    "com_offset": "payload or battery",
    "payload": "payload or battery",
    "inertia": "payload or battery",
    "tether": "cables and ropes",
    "wind": "the air",
    "constant_wrench": "",
}
"""What an effect is about, where it is about no single part."""
AHEAD = {"x": ("front", "back"), "y": ("left", "right"), "z": ("top", "bottom")}


@dataclass(frozen=True)
class Place:
    """One part of the vehicle at which a change may have happened, with the probability that it is that one."""

    effect: str
    parameter: str
    where: str
    probability: float


def where_of(vehicle: Vehicle, effect: str, parameter: str) -> str:
    """The user's name of the rotor or arm that a parameter is of, else what the effect is about; "" for nothing."""
    kind, _, number = parameter.partition("_")
    if number.isdecimal() and kind == "rotor":
        return vehicle.rotor_name(int(number))
    if number.isdecimal() and kind == "arm":
        return vehicle.arm_name(int(number))
    return WHOLE.get(effect, "")


def places(found: Weighed, names: tuple[str, ...], name: str) -> tuple[Place, ...]:
    """Places of a sparse effect of the set `names`, likeliest first; none of another effect."""
    vehicle, space = found.pool.model.vehicle, found.scorer.spectrum
    if not find(name).sparse:
        return ()
    scored = found.scorer(tuple(sorted(names)))
    whole = found.scorer.eliminated(scored.variance)
    others = [k for k in names if k != name]
    rest = np.concatenate([np.zeros(0, np.intp), *(space.parameters[k] for k in others)])
    fixed = np.array([0, *(space.offset[k] for k in names)])
    y = np.array([1.0, *(-1.0 for _ in names)])
    gains = []
    count = len(find(name).parameters(vehicle))
    for own in space.parameters[name].reshape(-1, count).T:  # all unknowns of one place
        unknown = np.append(rest, own)
        A, b = whole[np.ix_(unknown, unknown)], whole[np.ix_(unknown, fixed)] @ y
        scale = np.append(space.scale[rest], 4.0 * space.scale[own])
        theta = bounded(A, b, space.low[unknown], space.high[unknown], scale)
        gains.append(float(theta @ b - 0.5 * theta @ A @ theta - 0.5 * np.sum((theta / scale) ** 2)))
    odds: Array = np.exp(np.array(gains) - max(gains))
    share = odds / odds.sum()
    parameters = [p.name for p in find(name).parameters(vehicle)]
    listed = [Place(name, p, where_of(vehicle, name, p), float(s)) for p, s in zip(parameters, share, strict=True)]
    return tuple(sorted(listed, key=lambda p: -p.probability))


def towards(vehicle: Vehicle, x: float, y: float) -> str:
    """The side of the vehicle in a direction of the body's x-y plane, and the rotor there: "front left (M4)"."""
    size = float(np.hypot(x, y))
    if size == 0.0:
        return ""
    words = [AHEAD[a][0] if v > 0 else AHEAD[a][1] for a, v in (("x", x), ("y", y)) if abs(v) > 0.38 * size]
    side = " ".join(words)
    if vehicle.arms is None or vehicle.rotors is None:
        return side
    at = vehicle.arms.position_B[:, :2]
    bearing = np.degrees(np.arctan2(at[:, 1], at[:, 0]) - np.arctan2(y, x))
    apart = np.abs((bearing + 180.0) % 360.0 - 180.0)
    order = [int(k) for k in np.argsort(apart)]
    near = order[: 1 if apart[order[0]] < 90.0 / len(at) else 2]
    carried = [np.flatnonzero(vehicle.rotors.arm == arm) for arm in near]  # one rotor, or the arm is named
    names = [
        vehicle.rotor_name(int(r[0])) if len(r) == 1 else vehicle.arm_name(k)
        for k, r in zip(near, carried, strict=True)
    ]
    return f"{side} ({' and '.join(names)})"
