"""The simulated VoliroX of the paper's experiments: what its controller believes, and what it really is.

The truth is a mix of effects of plausible size, scaled once so that the nominal torque errors on the pitch flight are
of the paper's size, and one effect that the catalogue does not have, so that naming effects cannot explain it all.
Learning never looks in here: it sees logs.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wrenchgap.plant.effects.effect import Actuation, Array, Context, Parameter, Vehicle, WrenchEffect
from wrenchgap.plant.model import Model, make_effect
from wrenchgap.plant.model_file import load
from wrenchgap.plant.wrench_model import ModelEffect, cross

MODEL = Path(__file__).parents[2] / "models" / "voliro_x.toml"

INTEGRAL_LIMIT = 1.0
"""Bound of the controller's integral [rad s]; the paper gives none. The model file's 0.3 would clamp before the paper's
0.5 Nm of yaw offset are taken up."""

SERVO_LAG, MOTOR_LAG, DELAY = 0.06, 0.02, 0.01
"""Time constants and bus delay [s]: our estimate for such servos and motors; RotorS' omav.xacro has 12.5 to 25 ms for
the motors."""


PLAY = 0.01
"""Play between servo and arm [rad]."""
COM = np.array([0.0, 0.007, -0.006])
"""Centre of mass [m]."""
TILT_COMMON = 0.051
TILT = np.array([-0.023, -0.01, 0.024, 0.026, -0.008, -0.007])
"""Servo zeros [rad]: what all have in common (3 deg; the paper's 0.5 Nm of yaw asks for it), and each arm's own."""
THRUST = np.array([-0.024, -0.021, 0.021, 0.017, 0.016, 0.025, -0.026, -0.035, 0.006, 0.002, -0.012, -0.007])
"""Relative errors of the rotors' thrusts."""


class LegWake(WrenchEffect):
    """Wakes that blow at the landing gear. Not in the catalogue.

    A leg stands below the gap between two neighbouring arms; the wake of either arm, which leaves along -n_i, hits it
    when the arm has tilted towards it by about `angle`, and pushes it along:

        F_i = -k_i T_i exp(-((s_i alpha_i - angle) / width)^2) n_i,     M_i = r_i x F_i,    r_i = 0.2 a_i - 0.15 e_z

    s_i is the side of the leg (+1 and -1 alternate); the legs on arms 0 and 3 are wider than the others, which share
    a third of `loss`.
    """

    name = "leg_wake"
    excited_by = "tilts through the angle at which a wake meets a leg"
    needs_rotors = True
    WIDE: NDArray[np.float64] = np.array([1.0, 0.33, 0.33, 1.0, 0.33, 0.33])

    def parameters(self, vehicle: Vehicle) -> tuple[Parameter, ...]:
        """Share k of the thrust that a wide leg catches, angle and width of the wake's sweep."""
        del vehicle
        return (
            Parameter("loss", "1", 0.0, 0.5, 0.1),
            Parameter("angle", "rad", 0.0, 1.5, 0.5, start=0.6),
            Parameter("width", "rad", 0.1, 1.0, 0.3, start=0.4),
        )

    def apply(self, actuation: Actuation | None, wrench_B: Array, theta: Array, context: Context) -> Array:
        """The push on all legs (N, 6)."""
        if actuation is None or theta[0] == 0.0:
            return np.zeros_like(wrench_B)
        arms, rotors = context.vehicle.geometry()
        thrust = actuation.thrust @ (rotors.arm[:, None] == np.arange(len(arms)))
        side = np.where(np.arange(len(arms)) % 2, -1.0, 1.0)
        caught = self.WIDE * theta[0] * thrust * np.exp(-(((side * actuation.tilt - theta[1]) / theta[2]) ** 2))
        force = -caught[:, :, None] * actuation.arm_normal_B
        leg = 0.2 * arms.axis_B - 0.15 * np.array([0.0, 0.0, 1.0])
        return np.concatenate((force.sum(axis=1), cross(leg, force).sum(axis=1)), axis=-1)


@dataclass(frozen=True)
class Plant:
    """A vehicle that flies (`truth`) and the one that its controller knows (`believed`)."""

    believed: Model
    truth: Model


@cache
def believed() -> Model:
    """The model file with the paper's gains."""
    model = load(MODEL)
    gains = replace(model.controller, integral=0.3, integral_limit=INTEGRAL_LIMIT)
    return replace(model, controller=gains)


def vehicle(number: int = 0) -> Plant:
    """Vehicle `number`: 0 is the one of all tables; others have the same effects with values drawn anew.

    Servo zeros, rotor thrusts and centre of mass are drawn about those of vehicle 0 by half their size.
    """
    model = believed()
    rng = np.random.default_rng([number, 5])
    spread = 0.0 if number == 0 else 0.5

    def about(values: Array) -> Array:
        return values + spread * np.abs(values).max() * rng.uniform(-1.0, 1.0, values.shape)

    values = {
        "com_offset": about(COM),
        "tilt_offset": TILT_COMMON + about(TILT),
        "rotor_thrust": about(THRUST),
        "rotor_interference": (0.12, 1.2),
        "servo_lag": (SERVO_LAG,),
        "backlash": (PLAY,),
        "motor_lag": (MOTOR_LAG,),
        "command_delay": (DELAY,),
    }
    effects = [make_effect(model.vehicle, name, theta) for name, theta in values.items()]
    wake = ModelEffect(LegWake(), np.array([0.12, np.radians(42.0), np.radians(18.0)]))
    return Plant(model, model.with_effects((*effects, wake)))
