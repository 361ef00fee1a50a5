"""Checks of arms that tilt, rotors stopped: an inclinometer, a spring balance, a camera."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from wrenchgap.flight.flight import GRAVITY, Array
from wrenchgap.learn.posterior.bench_tests.hull import LEVEL
from wrenchgap.learn.posterior.bench_tests.trial import Fitted, Setup, off, total
from wrenchgap.plant.vehicle import Vehicle

PLAY = np.radians(0.1)
"""Of a free play, read from a pointer as long as the arm [rad]."""
FRAME = 4e-3
"""Of a camera of 240 pictures a second [s]."""
TURN = np.radians(0.2)
"""Of a vehicle's turn on a string, filmed [rad]."""
SWING = np.pi / 2
"""By which an arm is swung [rad]."""


def degrees(angle: float) -> str:
    """With its sign."""
    return f"{np.degrees(angle):+.1f} deg"


def tilting(vehicle: Vehicle) -> list[str]:
    """Names of the arms that tilt: the user's, else as effects call them."""
    arms, _ = vehicle.geometry()
    return [vehicle.arm_name(int(i)) for i in np.flatnonzero(arms.tilts)]


def zeros(vehicle: Vehicle, sets: Sequence[Fitted]) -> Setup:
    """How far each tilting arm stands from its command (A,) [rad], without load and in the middle of its play."""
    names = tilting(vehicle)
    return Setup(
        "Command all tilt angles to zero, rotors stopped, and read each arm with an inclinometer in the middle of its "
        f"play, to {np.degrees(LEVEL):.1g} deg",
        lambda fitted: total(fitted, len(names), ("tilt_offset", lambda theta: theta)),
        LEVEL,
        lambda angles: off(angles, names, LEVEL, degrees, "all at zero"),
        "an arm off zero",
    )


def rock(vehicle: Vehicle, sets: Sequence[Fitted]) -> Setup:
    """Free play from stop to stop [rad]."""

    def says(play: Array) -> str:
        return f"{np.degrees(play[0]):.1f} deg of free play" if play[0] > PLAY else "no free play"

    return Setup(
        f"Hold the tilt servos and rock each arm by hand, to {np.degrees(PLAY):.1g} deg",
        lambda fitted: total(fitted, 1, ("backlash", lambda theta: theta)),
        PLAY,
        says,
        "free play",
    )


def load(vehicle: Vehicle, sets: Sequence[Fitted]) -> Setup:
    """Twist of an arm when its load changes by a hover thrust [rad], away from the stops of its play."""
    arms, _ = vehicle.geometry()
    thrust = vehicle.body.mass * GRAVITY / len(arms)

    def says(twist: Array) -> str:
        return f"it twists by {degrees(float(twist[0]))}" if abs(twist[0]) > LEVEL else "it keeps its angle"

    return Setup(
        f"Pull at an arm's rotor along the thrust, servos holding, with {0.5 * thrust:.2g} N and then "
        f"{1.5 * thrust:.2g} N, and read the change of its angle, to {np.degrees(LEVEL):.1g} deg",
        lambda fitted: total(fitted, 1, ("arm_twist", lambda theta: theta * thrust)),
        LEVEL,
        says,
        "it twists",
    )


def servo_step(vehicle: Vehicle, sets: Sequence[Fitted]) -> Setup:
    """Dead time and time constant (2,) [s] of a tilt servo after a step in the direction of its last move."""
    return Setup(
        "Step a tilt servo twice the same way, rotors stopped, and film the arm at 240 pictures a second beside the "
        f"command, to {1e3 * FRAME:.0f} ms",
        lambda fitted: total(
            fitted, 2, ("command_delay", lambda theta: [theta[0], 0.0]), ("servo_lag", lambda theta: [0.0, theta[0]])
        ),
        FRAME,
        lambda times: step(times[0], times[1:], ("63 %",)),
        "it moves late",
    )


def step(dead: float, constants: Array, names: Sequence[str]) -> str:
    """A step response in words; time constants that the check does not tell apart are one."""
    if np.ptp(constants) <= FRAME:
        names, constants = ("63 %",), constants.mean(keepdims=True)
    lagging = [f"{name} {1e3 * t:.0f} ms later" for name, t in zip(names, constants, strict=True) if t > FRAME]
    start = f"first motion {1e3 * dead:.0f} ms after the command" if dead > FRAME else ""
    if not lagging:
        return start or "within a picture of the command"
    return ", ".join([start or "motion at once", *lagging])


def swing(vehicle: Vehicle, sets: Sequence[Fitted]) -> Setup:
    """Turn of the hull [rad] when one arm is swung about its axis: angular momentum stays zero, J_a dalpha / J."""
    arms, _ = vehicle.geometry()
    axis = arms.axis_B[np.flatnonzero(arms.tilts)[0]]
    about = float(axis @ vehicle.body.inertia @ axis)

    def says(turn: Array) -> str:
        return f"the hull turns back by {np.degrees(turn[0]):.1f} deg" if turn[0] > TURN else "the hull stays"

    return Setup(
        f"Hang the vehicle on a string so that {tilting(vehicle)[0]} points up, swing that arm by "
        f"{np.degrees(SWING):.0f} deg with its servo, rotors stopped, and film the hull, to {np.degrees(TURN):.1g} deg",
        lambda fitted: total(fitted, 1, ("arm_reaction", lambda theta: theta * SWING / about)),
        TURN,
        says,
        "the hull turns back",
    )
