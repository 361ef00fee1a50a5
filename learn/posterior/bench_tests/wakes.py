"""Bench tests of air and rotors: a fan, a board, the vehicle held on a force stand."""

from collections.abc import Sequence
from functools import partial

import numpy as np

from wrenchgap.flight.flight import GRAVITY, Array
from wrenchgap.learn.posterior.bench_tests.rotors import STAND, at_rest, hover_speed, hover_thrust, thrust_ratio
from wrenchgap.learn.posterior.bench_tests.trial import Fitted, Setup, bench_test, off, per_cent, reads
from wrenchgap.plant.effects import Context, WrenchEffect, find
from wrenchgap.plant.vehicle import Vehicle

BREEZE = 5.0
"""Of a fan or a wind tunnel [m/s]."""
BLOWN = 0.01
"""Of a drag in a fan, as a share of the weight."""
CLEARANCE = 2.0
"""Between body and board, in rotor radii."""


def kept(vehicle: Vehicle, name: str, theta: Array) -> Array:
    """Shares of thrust (2, R) that rotors keep, all arms at 90 deg one way or the other, speeds of hover."""
    arms, _ = vehicle.geometry()
    tilt = np.pi / 2 * np.array([[1.0], [-1.0]]) * arms.tilts
    return thrust_ratio(vehicle, name, theta, tilt, np.tile(hover_speed(vehicle), (2, 1)))


@bench_test("board", 120, ("ground_effect", "ground_effect_one_height"), "thrust two rotor radii above a board", "1 %")
def board(vehicle: Vehicle, sets: Sequence[Fitted]) -> Setup:
    """Relative gain of thrust, vehicle held level at hover's command, `CLEARANCE` radii above a board.

    Both forms of ground effect know no more than g there: in level flight they are the same.
    """
    arms, rotors = vehicle.geometry()
    height = CLEARANCE * float(rotors.radius.mean())
    speed = hover_speed(vehicle)[None]

    def gain(name: str, theta: Array) -> Array:
        ratio = thrust_ratio(vehicle, name, theta, np.zeros((1, len(arms))), speed, theta[1] + height)
        return np.array([ratio.mean() - 1.0])

    return Setup(
        f"Hold the vehicle level on a force stand, rotors at hover's command, and bring a board to {height:.2g} m "
        f"below it, to {100 * STAND:.0f} % of the thrust",
        reads(1, **{form: partial(gain, form) for form in ("ground_effect", "ground_effect_one_height")}),
        STAND,
        off(["thrust"], STAND, per_cent, "the same thrust"),
        "more thrust",
    )


@bench_test("blockage", 120, ("downwash_blockage",), "thrust of an arm that blows at its neighbours' booms", "1 %")
def blockage(vehicle: Vehicle, sets: Sequence[Fitted]) -> Setup:
    """Relative change of an arm's thrust at 90 deg, where it blows at booms; the arm and the side that lose most."""
    return Setup(
        "Hold the vehicle on a force stand, run one arm alone, upright and tilted by 90 deg to either side, and "
        f"compare its thrusts, to {100 * STAND:.0f} %",
        reads(1, downwash_blockage=lambda theta: [kept(vehicle, "downwash_blockage", theta).min() - 1.0]),
        STAND,
        off(["tilted"], STAND, per_cent, "the same thrust"),
        "less thrust tilted",
    )


@bench_test(
    "interference", 120, ("rotor_interference",), "torque about z of all arms together and one by one, at 90 deg", "1 %"
)
def interference(vehicle: Vehicle, sets: Sequence[Fitted]) -> Setup:
    """Relative change of the torque about z, all arms at 90 deg the same way, when they run at once."""
    return Setup(
        "Hold the vehicle on a force stand, all arms tilted by 90 deg the same way, and compare the torque about z "
        f"when all run with the sum of the arms run one by one, to {100 * STAND:.0f} %",
        reads(1, rotor_interference=lambda theta: [kept(vehicle, "rotor_interference", theta)[0].mean() - 1.0]),
        STAND,
        off(["together"], STAND, per_cent, "the sum"),
        "less than the sum",
    )


@bench_test(
    "fan", 120, ("body_drag", "body_drag_areas"), "force in a wind of 5 m/s, rotors stopped", "1 % of the weight"
)
def fan(vehicle: Vehicle, sets: Sequence[Fitted]) -> Setup:
    """Force (3,) [N] on the vehicle along body x, y and z in air that comes along each, rotors stopped."""
    resolution = BLOWN * vehicle.body.mass * GRAVITY

    def drag(name: str, theta: Array) -> Array:
        effect = find(name)
        assert isinstance(effect, WrenchEffect)
        context = Context(vehicle, at_rest(3), BREEZE * np.eye(3))
        return np.diag(effect.apply(None, np.zeros((3, 6)), theta, context)[:, :3])

    return Setup(
        f"Blow at the vehicle on a force stand, rotors stopped, with {BREEZE:.0f} m/s along each body axis, to "
        f"{resolution:.2g} N",
        reads(3, **{form: partial(drag, form) for form in ("body_drag", "body_drag_areas")}),
        resolution,
        off("xyz", resolution, lambda f: f"{f:.2g} N", "no force"),
        "a force",
    )


# the linear part of rotational_drag may be what rotors do in moving air
@bench_test(
    "rotor_fan",
    180,
    ("rotor_drag", "translational_lift", "axial_inflow"),
    "forces of one rotor in a wind of 5 m/s",
    "1 %",
    ("rotational_drag",),
)
def rotor_fan(vehicle: Vehicle, sets: Sequence[Fitted]) -> Setup:
    """Forces of one rotor at hover's speed Omega in air of speed U, over its thrust (3,).

    lambda Omega U in its plane and k_h U^2 more thrust in air that comes edgewise, k_z Omega U less against the thrust.
    Source: the equations of `rotor_drag`, `translational_lift` and `axial_inflow`.
    """
    speed, weight = float(hover_speed(vehicle).mean()), hover_thrust(vehicle)
    names = ("in-plane force edgewise", "thrust edgewise", "thrust in air along the axis")
    return Setup(
        f"Blow at one rotor at hover's speed on a thrust stand with {BREEZE:.0f} m/s, edgewise and from above, to "
        f"{100 * STAND:.0f} % of its thrust",
        reads(
            3,
            rotor_drag=lambda theta: [theta[0] * speed * BREEZE / weight, 0.0, 0.0],
            translational_lift=lambda theta: [0.0, theta[0] * BREEZE**2 / weight, 0.0],
            axial_inflow=lambda theta: [0.0, 0.0, -theta[0] * speed * BREEZE / weight],
        ),
        STAND,
        off(names, STAND, per_cent, "no change"),
        "a force in the rotor's plane or another thrust",
    )
