"""Thrust over the command that is not the square of a rotor speed."""

import numpy as np

from wrenchgap.flight.flight import GRAVITY
from wrenchgap.plant.effects.effect import Actuation, Array, Context, Parameter, ThrustEffect
from wrenchgap.plant.vehicle import Vehicle


class ThrustCurve(ThrustEffect):
    """Thrust over the command has another slope and curvature at hover than c_f Omega^2; the thrust there is right.

        T = c_f Omega^2 + T_h [2 p (s - 1) + c (s - 1)^2],   s = Omega / Omega_h,   c_f Omega_h^2 = T_h = m g / R

    For commands that are no rotor speeds (normalised, PWM), of which Omega is a constant times the command. p and c are
    relative: the nominal T_h s^2 has the slope 2 T_h and the curvature 2 T_h. R: number of rotors. Together with
    `thrust_scale`, the level, this is every parabola in the command.
    Source: thrust = f u^2 + (1 - f) u over the signal u, PX4's THR_MDL_FAC f and ArduPilot's MOT_THST_EXPO; the Taylor
    series of any other curve, a dead band (u - u_0)^2 or a power u^n, about hover.
    """

    name = "thrust_curve"
    excited_by = "thrust that varies about hover's by a fifth or more; torque commands show the slope"
    confused_with = ("thrust_scale", "inertia", "asymmetric_motor_lag")
    order = -10  # the curve makes the thrust that losses and gains then change

    def parameters(self, vehicle: Vehicle) -> tuple[Parameter, ...]:
        """Relative changes of slope and curvature at hover."""
        return (Parameter("slope", "1", -0.7, 0.7, 0.15), Parameter("curvature", "1", -2.0, 2.0, 0.4))

    def apply(self, actuation: Actuation, theta: Array, context: Context) -> Array:
        """Thrusts (N, R) of the curve; they push, or there is none."""
        vehicle = context.vehicle
        _, rotors = vehicle.geometry()
        hover = vehicle.body.mass * GRAVITY / len(rotors)
        command = np.abs(actuation.rotor_speed) * np.sqrt(rotors.c_f / hover)
        near = np.maximum(command, 0.3)  # below, the deviation falls to zero with the command, as the thrust does
        deviation = 2.0 * theta[0] * (near - 1.0) + theta[1] * (near - 1.0) ** 2
        thrust = np.abs(actuation.thrust) + hover * deviation * (command / near)
        return np.asarray(np.sign(actuation.thrust) * np.maximum(thrust, 0.0))
