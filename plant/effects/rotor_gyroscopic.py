"""The angular momentum of the rotors."""

import numpy as np

from wrenchgap.plant.effects.effect import Actuation, Array, Context, Parameter, Vehicle, WrenchEffect, pure_torque


class RotorGyroscopic(WrenchEffect):
    """Rotors resist being turned, and turn the body when they spin up.

        h_r = spin_r J_r Omega_r n_r,   M = -sum_r [(omega + dalpha a) x h_r + spin_r J_r dOmega_r n_r]

    What of a rotor's inertia turns with the body counts as the body's. Source: angular momentum of a gyrostat, Hughes,
    "Spacecraft Attitude Dynamics", 1986, ch. 3. Size: our estimate for such rotors, 3-6e-5 kg m^2.
    """

    name = "rotor_gyroscopic"
    excited_by = "unequal speeds within a pair, fast rates; cancels in pairs at equal speeds"
    confused_with = ("drag_torque",)
    needs_rotors = True
    needs_rates = True
    depends_on = "commands"
    linear = True

    def parameters(self, vehicle: Vehicle) -> tuple[Parameter, ...]:
        """Inertia of one rotor about its axis; a typical one is that of a slender blade of 1 % of the weight."""
        _, rotors = vehicle.geometry()
        typical = 0.01 * vehicle.body.mass * float(rotors.radius.mean()) ** 2 / 12.0
        return (Parameter("inertia", "kg m^2", 0.0, 20.0 * typical, typical),)

    def apply(self, actuation: Actuation | None, wrench_B: Array, theta: Array, context: Context) -> Array:
        """The added torque."""
        assert actuation is not None
        arms, rotors = context.vehicle.geometry()
        n, spin = actuation.normal_B, rotors.spin
        turning = context.state.omega_B[:, None] + actuation.tilt_rate[:, rotors.arm, None] * arms.axis_B[rotors.arm]
        momentum = (spin * actuation.rotor_speed)[..., None] * n
        torque = np.cross(turning, momentum) + (spin * actuation.rotor_acceleration)[..., None] * n
        torque = -theta[0] * torque.sum(axis=1)
        return pure_torque(torque)
