"""Checks of the vehicle as a body, of what holds it and of its IMU: eyes, scales, a string, a ruler, a level."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from wrenchgap.flight.flight import GRAVITY, Array
from wrenchgap.learn.posterior.bench_tests.trial import Fitted, Setup, digits, off, total
from wrenchgap.plant.effects import BodyEffect, find
from wrenchgap.plant.effects.com_offset import span
from wrenchgap.plant.vehicle import Body, Vehicle

SCALES = 0.002
"""Of kitchen and parcel scales, as a share of the mass."""
BALANCE, BALANCE_SHARE = 1e-3, 0.01
"""Of a plumb line or an edge: the place of a centre of mass [m], on small vehicles a share of the longest arm."""
RULER = 2e-3
"""Of the place of an IMU inside its case [m]."""
STILL = 0.05
"""Of half the sum of an accelerometer's readings in opposite positions [m/s^2]."""
LEVEL = np.radians(0.2)
"""Of an inclinometer or a levelled table [rad]."""
PENDULUM = 0.02
"""Of a bifilar pendulum, as a share of the inertia: Jardin and Mueller, AIAA 2007-6822."""
DRAUGHT = 1.0
"""Wind that somebody notices or finds in a weather record [m/s]."""
PULL = 0.005
"""Force of a cable that somebody notices, as a share of the weight."""


def body(vehicle: Vehicle, fitted: Fitted) -> Body:
    """The vehicle's body with the effects that change it, in the order in which a model applies them."""
    changed = vehicle.body
    effects = [e for e in map(find, fitted) if isinstance(e, BodyEffect)]
    for effect in sorted(effects, key=lambda e: (e.order, e.name)):
        changed = effect.apply(changed, fitted[effect.name])
    return changed


def look(vehicle: Vehicle, sets: Sequence[Fitted]) -> Setup:
    """Whether anything outside pulls: the force of a tether [N]."""
    least = PULL * vehicle.body.mass * GRAVITY

    def says(force: Array) -> str:
        return "a cable, rope or contact" if force[0] > least else "nothing that pulls or touches it"

    return Setup(
        "Look at the vehicle as it flies for whatever pulls or touches it",
        lambda fitted: total(fitted, 1, ("tether", lambda theta: [float(np.linalg.norm(theta[:3]))])),
        least,
        says,
        "a cable, rope or contact",
    )


def air(vehicle: Vehicle, sets: Sequence[Fitted]) -> Setup:
    """Whether the air moved where it flew: its speed [m/s]."""

    def says(speed: Array) -> str:
        return f"a wind of about {speed[0]:.1f} m/s" if speed[0] > DRAUGHT else "still air"

    return Setup(
        "Find out whether the air moved where it flew (indoors, weather record, anemometer)",
        lambda fitted: total(fitted, 1, ("wind", lambda theta: [float(np.linalg.norm(theta))])),
        DRAUGHT,
        says,
        "moving air",
    )


def weigh(vehicle: Vehicle, sets: Sequence[Fitted]) -> Setup:
    """The mass [kg]."""
    resolution = SCALES * vehicle.body.mass

    def kilograms(mass: float) -> str:
        return (
            f"{digits(mass, resolution)} kg" if vehicle.body.mass >= 1 else f"{digits(1e3 * mass, 1e3 * resolution)} g"
        )

    return Setup(
        f"Weigh the vehicle ready to fly, to {1e3 * resolution:.2g} g",
        lambda fitted: np.array([body(vehicle, fitted).mass]),
        resolution,
        lambda mass: kilograms(float(mass[0])),
        f"another mass than {kilograms(vehicle.body.mass)}",
    )


def hang(vehicle: Vehicle, sets: Sequence[Fitted]) -> Setup:
    """The centre of mass (3,) [m] from O."""
    resolution = min(BALANCE, BALANCE_SHARE * span(vehicle))

    def place(com: Array) -> str:
        return f"({', '.join(digits(1e3 * float(x), 1e3 * resolution) for x in com)}) mm"

    return Setup(
        f"Hang the vehicle from two points, ready to fly, and find its centre of mass from the body origin, to "
        f"{1e3 * resolution:.2g} mm",
        lambda fitted: np.asarray(body(vehicle, fitted).com_B, dtype=float),
        resolution,
        place,
        f"another place than {place(vehicle.body.com_B)}",
    )


def pendulum(vehicle: Vehicle, sets: Sequence[Fitted]) -> Setup:
    """The moments of inertia (3,) [kg m^2] about axes along B through the centre of mass."""
    nominal = np.diag(vehicle.body.inertia).astype(float)

    def says(moments: Array) -> str:
        return f"({', '.join(f'{j:.3g}' for j in moments)}) kg m^2"

    return Setup(
        f"Swing the vehicle on two strings about x, y and z for its moments of inertia, to {100 * PENDULUM:.0f} %",
        lambda fitted: np.diag(body(vehicle, fitted).inertia).astype(float),
        PENDULUM * nominal,
        says,
        f"others than {says(nominal)}",
    )


def imu_place(vehicle: Vehicle, sets: Sequence[Fitted]) -> Setup:
    """How far the IMU sits from where the model has it (3,) [m]."""
    return Setup(
        f"Measure the place of the IMU against the model's imu_position, to {1e3 * RULER:.0f} mm",
        lambda fitted: total(fitted, 3, ("imu_lever_arm", lambda theta: theta)),
        RULER,
        lambda r: off(r, "xyz", RULER, lambda x: f"{1e3 * x:+.0f} mm", "where the model has it"),
        "elsewhere",
    )


def imu_level(vehicle: Vehicle, sets: Sequence[Fitted]) -> Setup:
    """How far the IMU is turned against the frame (3,) [rad].

    A bias keeps its sign when the vehicle is turned over, gravity does not, so half the difference of opposite
    positions is free of it.
    """
    return Setup(
        "Read the still accelerometer with the frame level, upside down and on its four sides; half the difference of "
        f"opposite positions is the IMU's misalignment, to {np.degrees(LEVEL):.1g} deg",
        lambda fitted: total(fitted, 3, ("imu_misalignment", lambda theta: theta)),
        LEVEL,
        lambda e: off(e, "xyz", LEVEL, lambda x: f"{np.degrees(x):+.1f} deg", "no misalignment"),
        "misaligned",
    )


def imu_bias(vehicle: Vehicle, sets: Sequence[Fitted]) -> Setup:
    """What the still accelerometer reads whichever side is up (3,) [m/s^2]."""
    return Setup(
        "Read the still accelerometer with the frame level, upside down and on its four sides; half the sum of "
        f"opposite positions is its bias, to {STILL:g} m/s^2",
        lambda fitted: total(fitted, 3, ("accelerometer_bias", lambda theta: theta)),
        STILL,
        lambda b: off(b, "xyz", STILL, lambda x: f"{x:+.2f} m/s^2", "no bias"),
        "a bias",
    )
