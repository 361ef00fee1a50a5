"""What is known of changes before any flight: how large, in which direction, and how rare.

A model file may be wrong by all of an effect's typical size (`plant.effects.Parameter.scale`). What one vehicle differs
by between two flights is less, and not the same for all effects: propellers get nicked, batteries slip, servo horns
turn on their splines; the laws of the flow, the shape of a thrust curve and the drag torque per thrust of all rotors at
once stay what they are. Shares and prices are our estimates, and coarse.

A damaged propeller loses drag torque too, and more of it than thrust.

Of propellers alike but for their diameter D, T = C_T rho n^2 D^4 and Q = C_Q rho n^2 D^5: a cut tip takes more of Q
than of T. A motor at a given voltage then speeds up, which gives back the same share of both: at
V = K Omega + (R / K) Q and s = (R / K) Q / (K Omega), a diameter smaller by e changes T by -4 e + 10 e s / (1 + 2 s)
and Q by e less. The ratio of the two losses is 1.25 with a governed speed (s = 0), 1.5 at s = 0.3 and 2.5 at s = 1, a
small brushed motor of which half the power is heat; of surfaces that only got rough or dirty it may be anything near
one. A change of a rotor is therefore any sum, both losses, of

    thrust and drag torque by the same share
    thrust by a share, drag torque by `MOST` times that

Source: McCormick, "Aerodynamics, Aeronautics, and Flight Mechanics", 2nd ed., ch. 6 (coefficients of propellers), and
the equation of a direct-current motor.
"""

from dataclasses import dataclass, replace

import numpy as np

from wrenchgap.flight.flight import Array
from wrenchgap.learn.posterior.columns import Column
from wrenchgap.plant.effects import find
from wrenchgap.plant.model import Model
from wrenchgap.plant.vehicle import Vehicle


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
ROTOR_THRUST = "rotor_thrust"
MOST = 2.5
"""Largest ratio of the share of drag torque that a damaged propeller loses to that of thrust."""


def without_drag_torque(model: Model) -> Model:
    """The model with rotors that only lift: what it makes of the same commands lacks their drag torques."""
    _, rotors = model.vehicle.geometry()
    return replace(model, vehicle=replace(model.vehicle, rotors=replace(rotors, kappa=np.zeros_like(rotors.kappa))))


def damaged(line: Column, torque: Array) -> Column:
    """The change of a rotor's thrust (R parameters) with the second kind of loss beside it (2 R)."""

    def twice(values: Array) -> Array:
        return np.concatenate((values, values))

    return replace(
        line,
        jacobian=np.concatenate((line.jacobian, line.jacobian + (MOST - 1.0) * torque), axis=2),
        origin=twice(line.origin),
        theta=twice(line.theta),
        low=twice(line.low),
        high=twice(line.high),
        scale=twice(line.scale),
        sparse=np.concatenate((line.sparse, line.sparse)),
        per_place=2,
    )


def read(vehicle: Vehicle, name: str, size: int) -> Array:
    """From the `size` unknowns of a change to the parameters (P, size) of its effect; both losses take thrust."""
    count = len(find(name).parameters(vehicle))
    return np.tile(np.eye(count), (1, size // count))
