"""The effectiveness of rotors as flown: what a newton asked of each makes of force and torque, beside the nominal one.

About hover at one tilt of the arms, with thrusts t that the controller asks for, T = c_f Omega^2 of the nominal rotor:

    dW = B dt,    B (6, R) about the centre of mass, by central differences of the model with its effects

so thrust gains, wakes, slopes of thrust curves, drag torques, twisted arms, servo zeros and the place of the centre of
mass are in it; B_0 is that of the vehicle without effects. A controller that allocates with B_0's pseudo-inverse gets

    G = B B_0^+    (6, 6), the identity within the directions that the vehicle can make, where nothing is wrong

and with B^+ what it asked for, as far as the rotors can: that is the corrected allocation, of changes from hover.
Directions in which the vehicle nominally makes no wrench are not asked for, however little an effect makes there. Where
arms tilt, both are those of the thrusts along and across their directions at rest, T cos(alpha) and T sin(alpha): B of
these has the columns at 0 and at 90 deg. Rotors of an arm that tilts share its thrust as in the nominal allocation
(`plant.allocation`), so that they ask for one tilt. The wrench is linear in these thrusts at any tilt, but for effects
that depend on tilt or thrust in another way (wakes, twisted arms, slopes of thrust curves), which are taken there. Lags
act later and are not in it. Sources: Johansen and Fossen, "Control allocation - a survey", Automatica 2013; Kamel et
al., "The Voliro omniorientational hexacopter", RAM 2018.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wrenchgap.flight.errors import ModelError, UsageError
from wrenchgap.flight.flight import Array
from wrenchgap.flight.result import Result
from wrenchgap.plant.allocation import allocation_of
from wrenchgap.plant.model import Model
from wrenchgap.plant.targets.quantities import Quantity, Values, at_limit, hover_speeds, propagated, still_wrench
from wrenchgap.plant.vehicle import GRAVITY, Vehicle
from wrenchgap.plant.wrench_model import ModelEffect, WrenchModel, about_com

STEP = 0.05
"""Of the thrust in hover, for the differences: a slope of the curve where the vehicle flies, and not at a point."""
ROUNDING = 1e-9
"""Of the largest entry: what is below is none."""
RANK = 1e-6
"""Singular values below so much of the largest are directions that the vehicle cannot make."""


@dataclass(frozen=True, repr=False, eq=False)
class Effectiveness(Result):
    """Of R rotors about hover at `tilt` (A,) [rad]: wrench per newton asked, about the centre of mass [1, m].

    `matrix` (6, R) is as flown, with standard deviations; `achieved` (6, 6) is what comes of a unit of each axis asked
    for with the nominal allocation; both with their nominal values. `allocation` (R + R', 6) is the corrected one [1,
    1/m]: changes from hover of the thrusts of all rotors and, where arms tilt, of their R' rotors across the directions
    at rest. `left_out` are effects with a value at its limit.
    """

    vehicle: Vehicle
    tilt: Array
    matrix: Quantity
    achieved: Quantity
    allocation: Quantity
    left_out: tuple[str, ...] = ()


def effectiveness(model: Model, tilt: Sequence[float] | float = 0.0) -> Effectiveness:
    """The effectiveness of a model at one `tilt` of all arms, or one for each [rad].

    Raises ModelError for a model without rotors, or with arms beside which forces are rounding, UsageError for tilts
    that the arms do not have.
    """
    arms, _ = model.vehicle.geometry()
    angles = np.atleast_1d(np.asarray(tilt, dtype=float))
    if not np.all(np.abs(angles) <= 2.0 * np.pi):
        raise UsageError("--tilt: expected degrees, from -360 to 360")
    if len(angles) not in (1, len(arms)):
        raise UsageError(f"--tilt: got {len(angles)} angles, expected one for all, or one for each of {len(arms)} arms")
    angles = np.broadcast_to(angles, len(arms)).copy()
    fixed = np.flatnonzero(~arms.tilts & (angles != 0.0)) if len(np.atleast_1d(tilt)) > 1 else np.empty(0, dtype=int)
    if fixed.size or (angles.any() and not arms.tilts.any()):
        raise UsageError(f"--tilt: {model.vehicle.arm_name(int(fixed[0]) if fixed.size else 0)} does not tilt")
    angles = np.where(arms.tilts, angles, 0.0)
    nominal, each = linear_matrix(model, []), spread(model.vehicle)
    makes = makeable(nominal)
    inverse = np.linalg.pinv(nominal, rcond=RANK)

    def values(effects: Sequence[ModelEffect]) -> Values:
        linear = linear_matrix(model, effects)
        found = {"matrix": _matrix(model, effects, angles), "achieved": linear @ inverse}
        found["allocation"] = each @ np.linalg.pinv(makes.T @ linear, rcond=RANK) @ makes.T
        return {name: np.where(np.abs(x) < ROUNDING * np.abs(x).max(), 0.0, x) for name, x in found.items()}

    found = propagated(model, values)
    if not np.all(np.linalg.norm(found["matrix"].nominal[:3], axis=0)):
        raise ModelError(
            "effectiveness: a rotor's force is nothing beside the torques; check arms [m] and kappa [m] of the model"
        )
    ended = tuple(one.name for one in model.effects if at_limit(one, model.vehicle))
    return Effectiveness(model.vehicle, angles, found["matrix"], found["achieved"], found["allocation"], ended)


def makeable(nominal: Array) -> Array:
    """Unit directions (6, K) of the wrenches that a nominal matrix (6, U) makes."""
    directions, sizes, _ = np.linalg.svd(nominal)
    return np.asarray(directions[:, : int(np.sum(sizes > RANK * sizes[0]))])


def spread(vehicle: Vehicle) -> Array:
    """Thrusts (R + R', U) of rotors, along and across, per unknown of the allocation.

    Unknowns are the thrusts of G groups along their directions at rest and of those that tilt across them; a group is a
    rotor, or all rotors of an arm that tilts.
    """
    arms, rotors = vehicle.geometry()
    groups = allocation_of(vehicle).groups
    along = np.zeros((len(rotors), len(groups)))
    for g, (_, members) in enumerate(groups):
        along[members, g] = rotors.c_f[members] / rotors.c_f[members].sum()
    tilting = [bool(arms.tilts[arm]) for arm, _ in groups]
    across = along[arms.tilts[rotors.arm]][:, tilting]
    return np.block([[along, np.zeros((len(along), across.shape[1]))], [np.zeros((len(across), len(groups))), across]])


def linear_matrix(model: Model, effects: Sequence[ModelEffect]) -> Array:
    """B (6, U) of the unknowns of the allocation (`spread`)."""
    arms, rotors = model.vehicle.geometry()
    along, turning = _matrix(model, effects, np.zeros(len(arms))), arms.tilts[rotors.arm]
    across = _matrix(model, effects, np.where(arms.tilts, 0.5 * np.pi, 0.0))[:, turning]
    return np.asarray(np.hstack((along, across)) @ spread(model.vehicle))


def _matrix(model: Model, effects: Sequence[ModelEffect], tilt: Array) -> Array:
    """B (6, R), by central differences in the nominal thrust of each rotor."""
    acting, hover = WrenchModel(model.vehicle, tuple(effects)), hover_speeds(model.vehicle)
    count = len(hover)
    more, less = (hover * np.sqrt(1.0 + sign * STEP * np.eye(count)) for sign in (1.0, -1.0))
    ends = about_com(acting.body, still_wrench(acting, np.vstack((more, less)), tilt))
    return np.asarray((ends[:count] - ends[count:]).T / (2.0 * STEP * model.vehicle.body.mass * GRAVITY / count))
