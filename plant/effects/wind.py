"""Air that moves."""

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from wrenchgap.flight import so3
from wrenchgap.plant.effects.effect import AirEffect, Array, Context, Parameter, State, Vehicle


class Wind(AirEffect):
    """The air moves with a velocity v_w that is constant in E and horizontal.

    It has no force of its own: every aerodynamic effect sees v - v_w in place of v, so drag D is felt as -D (v - v_w).
    Source: Galileo's relativity; aerodynamic forces depend on the motion relative to the air, e.g. Stevens, Lewis and
    Johnson, "Aircraft Control and Simulation", 3rd ed., 2016, ch. 2.
    """

    name = "wind"
    excited_by = "fast legs in several directions, with a drag in the model"
    confused_with = ("tether", "body_drag", "constant_wrench", "imu_misalignment")
    needs_pose = True
    least_change: ClassVar[float] = 0.2
    """Share of the typical wind's force that must change within a flight, for it to be no constant force: 12 deg of
    turns, or 0.6 m/s. With less the trim of a quadrotor indoors (5 deg, 0.3 m/s) was named a wind of 4 m/s."""

    def parameters(self, vehicle: Vehicle) -> tuple[Parameter, ...]:
        """The air's velocity along E's x and y; a light breeze is typical, 7 on Beaufort's scale the most to fly in."""
        strongest = 15.0
        return tuple(Parameter(f"velocity_{a}", "m/s", -strongest, strongest, 3.0) for a in "xy")

    def unexcited(self, context: Context) -> str | None:
        """Seen from the body, air that hardly turns and a vehicle that hardly moves make a constant force."""
        state, typical = context.state, self.parameters(context.vehicle)[0].scale
        along_B = so3.matrix(state.quat_EB)[:, :2, :]  # E's x and y in B
        turned = float(np.sqrt(np.mean(np.sum((along_B - along_B.mean(axis=0)) ** 2, axis=(1, 2)) / 2.0)))
        moved = float(np.sqrt(np.mean(np.sum((state.velocity_E - state.velocity_E.mean(axis=0)) ** 2, axis=1))))
        if turned > self.least_change or moved > self.least_change * typical:
            return None
        return (
            f"a constant force on these flights: the vehicle turned by {np.degrees(turned):.0f} deg rms and moved by "
            f"{moved:.2g} m/s rms; fly in several directions, or faster"
        )

    def outdated(self, values: Mapping[str, float]) -> str | None:
        """Version 0.1.0 had a drag D of its own, the same in every direction, and the force w = D v_w."""
        if not {"drag", "force_x", "force_y"} & set(values):
            return None
        drag, *force = (float(values.get(key, 0.0)) for key in ("drag", "force_x", "force_y"))
        same = f"a tether with force_x = {force[0]:.6g}, force_y = {force[1]:.6g}"
        if drag > 0.0:
            x, y = (f / drag for f in force)
            same = f"body_drag with linear_x = linear_y = linear_z = {drag:.6g} (the rest 0) and wind with "
            same += f"velocity_x = {x:.6g}, velocity_y = {y:.6g}"
        return (
            "drag, force_x and force_y are those of an earlier version; wind is now the air's velocity and has no "
            f"force of its own: write {same} instead, or fit both anew with `wrenchgap add body_drag wind`"
        )

    def apply(self, state: State, theta: Array) -> Array:
        """The same for all samples."""
        return np.broadcast_to(np.append(theta, 0.0), state.velocity_E.shape)
