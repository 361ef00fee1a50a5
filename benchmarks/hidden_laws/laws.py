"""What is hidden: laws as functions of what the vehicle does, their sizes, and which answers are right.

A law gets a `View` and returns the force and the torque that it adds (3,), (3,) in B, about the centre of mass. `right`
are names of atoms (`learn.discover.atoms`) that say the same on that vehicle, `sign` that of the first coefficient.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from wrenchgap.flight.flight import Array

NONE = np.zeros(3)


@dataclass
class View:
    """What a vehicle does: of its rotors thrusts (R,), normals and places (R, 3), of its arms tilt, its rate, axes."""

    t: float
    position_E: Array
    v: Array
    omega: Array
    R: Array
    T: Array
    n: Array
    r: Array
    alpha: Array
    alpha_rate: Array
    axis: Array
    weight: float
    span: float

    @property
    def yaw(self) -> float:
        """Heading [rad]."""
        return float(np.arctan2(self.R[1, 0], self.R[0, 0]))

    def at_hubs(self, forces: Array) -> tuple[Array, Array]:
        """Force and torque of forces (R, 3) at the rotors."""
        return forces.sum(axis=0), np.cross(self.r, forces).sum(axis=0)


Wrench = tuple[Array, Array]


@dataclass(frozen=True)
class HiddenLaw:
    """`push(view, size)`; `vehicles` that can show it; `kind` of flight that excites it; a factor of its size."""

    push: Callable[[View, float], Wrench]
    size: float
    right: tuple[str, ...]
    vehicles: tuple[str, ...] = ("quadrotor", "hexarotor")
    kind: str = "excited"
    on_hexarotor: float = 1.0
    sign: float = 1.0


def _thrust_with_speed(x: View, k: float) -> Wrench:
    return x.at_hubs(-k * float(x.v @ x.v) * x.T[:, None] * x.n)


def _wake(x: View, k: float) -> Wrench:
    each, tilt = 0.5 * (x.T[0::2] + x.T[1::2]), x.alpha  # of a rotor of each arm
    loss = sum(np.roll(each, s) * np.cos(tilt - np.roll(tilt, s)) for s in (1, -1))
    return x.at_hubs(-k * np.repeat(loss, 2)[:, None] * x.T[:, None] * x.n)


def _bend(x: View, k: float) -> Wrench:
    axis = np.repeat(x.axis, 2, axis=0)
    return x.at_hubs(k * (x.T**2)[:, None] * np.cross(axis, x.n))


def _low(x: View) -> float:
    return 1.0 / (1.0 + (x.position_E[2] / x.span) ** 2)


E_Z = np.array([0.0, 0.0, 1.0])
LAWS = {
    "thrust_speed2": HiddenLaw(_thrust_with_speed, 0.012, ("share_v_2", "rotors_t_i_v_2"), sign=-1.0),
    "drag_1.5": HiddenLaw(
        lambda x, k: (-k * np.linalg.norm(x.v) ** 0.5 * x.v, NONE), 0.35, ("force_v_speed_half",), sign=-1.0
    ),
    "flapping": HiddenLaw(
        lambda x, k: (NONE, k * (x.T[:, None] * np.cross(x.n, x.v)).sum(axis=0)),
        0.004,
        ("flapping", "torque_e_z_cross_v_thrust"),
        on_hexarotor=0.3,
    ),
    "pressure_point": HiddenLaw(
        lambda x, k: (NONE, k * np.array([0.0, 0.0, x.v[1]])), 0.03, ("torque_z_v_y",), on_hexarotor=0.3
    ),
    "wake": HiddenLaw(_wake, 0.008, ("wake_cos",), ("hexarotor",), sign=-1.0),
    "tilt_rate": HiddenLaw(
        lambda x, k: (NONE, k * (x.alpha_rate[:, None] * x.axis).sum(axis=0)),
        0.03,
        ("tilt_rate_torque",),
        ("hexarotor",),
    ),
    "near_ground": HiddenLaw(
        lambda x, k: (NONE, k * _low(x) * np.cross(E_Z, x.R[2])),
        3.0,
        ("torque_e_z_cross_up_low",),
        kind="low",
    ),
    "damping": HiddenLaw(
        lambda x, k: (NONE, -k * np.linalg.norm(x.omega) * x.omega), 0.03, ("torque_w_rate",), sign=-1.0
    ),
    "crosswind_yaw": HiddenLaw(
        lambda x, k: (NONE, np.array([0.0, 0.0, k * x.v[0] * x.v[1]])), 0.02, ("torque_z_v_x_v_y",)
    ),
    "spring": HiddenLaw(
        lambda x, k: (-k * (x.R.T @ (x.position_E - [0.5, -0.3, 0.2])), NONE), 0.5, ("force_spring",), sign=-1.0
    ),
    "arm_bend": HiddenLaw(_bend, 0.01, ("arm_bend_across",), ("hexarotor",)),
    "yaw4": HiddenLaw(lambda x, k: (NONE, np.array([0.0, 0.0, k * np.sin(4 * x.yaw)])), 0.04, ("torque_z_heading4",)),
    "growing": HiddenLaw(lambda x, k: (np.array([k * x.t**2, 0.0, 0.0]), NONE), 0.0012, ("force_x_t2",)),
}
