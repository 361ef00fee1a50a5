"""Near the ground all rotors lift more by the same factor."""

from wrenchgap.plant.effects.effect import Actuation, Array, Context
from wrenchgap.plant.effects.ground_effect import GroundEffect


class GroundEffectOneHeight(GroundEffect):
    """Near the ground thrust grows: T -> T / (1 - g (R / 4h)^2), with h = z - z_0 the height of the body origin.

    `ground_effect` with the vehicle's height in place of each hub's: where the wakes meet below the body they lift the
    vehicle as a whole, and it is not righted when it rolls.
    Source: Cheeseman and Bennett, ARC R&M 3021, 1955, with one height for the vehicle as in Sanchez-Cuevas, Heredia and
    Ollero, Int. J. Aerospace Eng. 2017, 1823056. Limits are those of `ground_effect`.
    """

    name = "ground_effect_one_height"
    form = "one height for all rotors"
    confused_with = ("ground_effect", "thrust_scale", "mass")

    def heights_E(self, actuation: Actuation, context: Context) -> Array:
        """That of the body origin (N, 1) in E [m], for all rotors."""
        return context.state.position_E[:, 2:]
