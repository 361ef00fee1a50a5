"""What is known of changes before any flight: how large, in which direction, and how rare.

A model file may be wrong by all of an effect's typical size (`plant.effects.Parameter.scale`). What one vehicle differs
by between two flights is less, and not the same for all effects: propellers get nicked, batteries slip, servo horns
turn on their splines; the laws of the flow, the shape of a thrust curve and the drag torque per thrust of all rotors at
once stay what they are. Shares and prices are our estimates, and coarse.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ChangePrior:
    """`share` of an effect's typical size that is typical of its change; `price` log odds against it besides those of
    any effect; `far` the largest change in typical sizes; `loses` says that parameters only become smaller. `slack`, in
    sizes of the prior, is what the effect seems to differ by from one trajectory to the next while nothing changed: a
    law is nearly right, and on each trajectory off by something else.
    """  # noqa: D205

    share: float
    price: float = 0.0
    far: float = 1e3
    loses: bool = False
    slack: float = 0.1


LAW = ChangePrior(0.2, 2.0, 4.0, slack=0.3)
"""A law of the flow, or a property of the type of a part: does not change by itself."""

_KNOWN = {
    "rotor_thrust": ChangePrior(1.0, loses=True),
    "com_offset": ChangePrior(1.0),
    "mass": ChangePrior(1.0),
    "payload": ChangePrior(1.0, -3.0),
    "tilt_offset": ChangePrior(1.0),
    "servo_lag": ChangePrior(0.5, slack=0.04),
    "motor_lag": ChangePrior(0.5, slack=0.04),
    "asymmetric_motor_lag": ChangePrior(0.5, 1.0, slack=0.04),
    "command_delay": ChangePrior(0.3, 1.0, slack=0.04),
    "backlash": ChangePrior(1.0),
    "arm_twist": ChangePrior(0.5, 1.0),
    "thrust_scale": ChangePrior(0.5),
    "battery_sag": ChangePrior(0.3, 1.0, 1.0),
    "thrust_fade": ChangePrior(0.5, 1.0),
    "accelerometer_bias": ChangePrior(0.5),
    "imu_misalignment": ChangePrior(0.5),
    "imu_lever_arm": ChangePrior(0.5, 1.0),
    "inertia": ChangePrior(0.5, 1.0),
    "wind": ChangePrior(1.0),
    "body_drag": ChangePrior(0.3, 1.0, slack=0.2),
    "body_drag_areas": ChangePrior(0.3, 1.0, slack=0.2),
    "tether": ChangePrior(1.0, 2.0),
    "constant_wrench": ChangePrior(1.0, 2.0),
}


def change_prior(name: str) -> ChangePrior:
    """Of an effect by its name; of one that is not listed, that of a law."""
    return _KNOWN.get(name, LAW)


# A payload stands for two effects (`plant.effects.Effect.parts`) but is one thing that somebody has put on.

NAMELESS = ("constant_wrench",)
"""Effects that say that something is there and not what."""
