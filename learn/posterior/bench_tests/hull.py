"""Bench tests with rotors stopped: the vehicle as a body, what holds it, its IMU and its arms.

Eyes, scales, a string, a ruler, an inclinometer, a spring balance, a camera.
"""

from collections.abc import Sequence

import numpy as np

from wrenchgap.flight.flight import GRAVITY, Array
from wrenchgap.learn.posterior.bench_tests.trial import Fitted, Setup, above, bench_test, digits, off, reads, whole
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
PLAY = np.radians(0.1)
"""Of a free play, read from a pointer as long as the arm [rad]."""
FRAME = 4e-3
"""Of a camera of 240 pictures a second [s]."""
TURN = np.radians(0.2)
"""Of a vehicle's turn on a string, filmed [rad]."""
SWING = np.pi / 2
"""By which an arm is swung [rad]."""
LOAD = ("tether",)
"""A weight on a string weighs with the vehicle, a cable does not."""


def degrees(angle: float) -> str:
    """With its sign."""
    return f"{np.degrees(angle):+.1f} deg"


def body(vehicle: Vehicle, fitted: Fitted) -> Body:
    """The vehicle's body with the effects that change it, in the order in which a model applies them."""
    changed = vehicle.body
    effects = [e for e in map(find, fitted) if isinstance(e, BodyEffect)]
    for effect in sorted(effects, key=lambda e: (e.order, e.name)):
        changed = effect.apply(changed, fitted[effect.name])
    return changed


def tilting(vehicle: Vehicle) -> list[str]:
    """Names of the arms that tilt: the user's, else as effects call them."""
    arms, _ = vehicle.geometry()
    return [vehicle.arm_name(int(i)) for i in np.flatnonzero(arms.tilts)]


def step(dead: float, constants: Array, names: Sequence[str]) -> str:
    """A step response in words; time constants that the check does not tell apart are one."""
    if np.ptp(constants) <= FRAME:
        names, constants = ("63 %",), constants.mean(keepdims=True)
    lagging = [f"{name} {1e3 * t:.0f} ms later" for name, t in zip(names, constants, strict=True) if t > FRAME]
    start = f"first motion {1e3 * dead:.0f} ms after the command" if dead > FRAME else ""
    if not lagging:
        return start or "within a picture of the command"
    return ", ".join([start or "motion at once", *lagging])


@bench_test("look", 1, ("tether",), "whatever pulls or touches the vehicle in flight", "0.5 % of the weight")
def look(vehicle: Vehicle, sets: Sequence[Fitted]) -> Setup:
    """The force [N] of whatever pulls from outside."""
    least = PULL * vehicle.body.mass * GRAVITY
    return Setup(
        "Look for whatever pulls at the vehicle or touches it as it was flown",
        reads(1, tether=lambda theta: [float(np.linalg.norm(theta[:3]))]),
        least,
        above(least, lambda force: "a cable, rope or contact", "nothing that pulls or touches it"),
        "a cable, rope or contact",
    )


@bench_test("air", 1, ("wind",), "whether the air moved", "1 m/s")
def air(vehicle: Vehicle, sets: Sequence[Fitted]) -> Setup:
    """The speed [m/s] of the air where it flew."""
    return Setup(
        "Find out whether the air moved where it flew (indoors, weather record, anemometer)",
        reads(1, wind=lambda theta: [float(np.linalg.norm(theta))]),
        DRAUGHT,
        above(DRAUGHT, lambda speed: f"a wind of about {speed:.1f} m/s", "still air"),
        "moving air",
    )


@bench_test("weigh", 5, ("mass", "payload"), "mass, ready to fly", "0.2 % of the mass", LOAD)
def weigh(vehicle: Vehicle, sets: Sequence[Fitted]) -> Setup:
    """The mass [kg]."""
    resolution = SCALES * vehicle.body.mass
    per_unit, unit = (1.0, "kg") if vehicle.body.mass >= 1 else (1e3, "g")

    def weight(mass: float) -> str:
        return f"{digits(per_unit * mass, per_unit * resolution)} {unit}"

    told = vehicle.tolerances.mass
    known = (
        "" if told is None else f" as it flew (the model file says {weight(vehicle.body.mass)} +- {1e3 * told:.2g} g)"
    )
    return Setup(
        f"Weigh the vehicle ready to fly{known}, to {1e3 * resolution:.2g} g",
        lambda fitted: np.array([body(vehicle, fitted).mass]),
        resolution,
        lambda mass: weight(float(mass[0])),
        f"another mass than {weight(vehicle.body.mass)}",
    )


@bench_test("imu_place", 5, ("imu_lever_arm",), "place of the IMU", "2 mm")
def imu_place(vehicle: Vehicle, sets: Sequence[Fitted]) -> Setup:
    """How far the IMU sits from where the model has it (3,) [m]."""
    return Setup(
        f"Measure the place of the IMU against the model's imu_position, to {1e3 * RULER:.0f} mm",
        reads(3, imu_lever_arm=whole),
        RULER,
        off("xyz", RULER, lambda x: f"{1e3 * x:+.0f} mm", "where the model has it"),
        "elsewhere",
    )


@bench_test("rock", 5, ("backlash",), "free play of the arms, by hand", "0.1 deg")
def rock(vehicle: Vehicle, sets: Sequence[Fitted]) -> Setup:
    """Free play from stop to stop [rad]."""
    return Setup(
        f"Hold the tilt servos and rock each arm by hand, to {np.degrees(PLAY):.1g} deg",
        reads(1, backlash=whole),
        PLAY,
        above(PLAY, lambda play: f"{np.degrees(play):.1f} deg of free play", "no free play"),
        "free play",
    )


@bench_test("imu_level", 10, ("imu_misalignment",), "IMU still, in six positions", "0.2 deg")
def imu_level(vehicle: Vehicle, sets: Sequence[Fitted]) -> Setup:
    """How far the IMU is turned against the frame (3,) [rad].

    A bias keeps its sign when the vehicle is turned over, gravity does not, so half the difference of opposite
    positions is free of it.
    """
    return Setup(
        "Read the still accelerometer with the frame level, upside down and on its four sides; half the difference of "
        f"opposite positions is the IMU's misalignment, to {np.degrees(LEVEL):.1g} deg",
        reads(3, imu_misalignment=whole),
        LEVEL,
        off("xyz", LEVEL, degrees, "no misalignment"),
        "misaligned",
    )


@bench_test("imu_bias", 10, ("accelerometer_bias",), "IMU still, in six positions", "0.05 m/s^2")
def imu_bias(vehicle: Vehicle, sets: Sequence[Fitted]) -> Setup:
    """What the still accelerometer reads whichever side is up (3,) [m/s^2]."""
    return Setup(
        "Read the still accelerometer with the frame level, upside down and on its four sides; half the sum of "
        f"opposite positions is its bias, to {STILL:g} m/s^2",
        reads(3, accelerometer_bias=whole),
        STILL,
        off("xyz", STILL, lambda b: f"{b:+.2f} m/s^2", "no bias"),
        "a bias",
    )


@bench_test("tilt_zero", 15, ("tilt_offset",), "angle of the arms commanded to zero", "0.2 deg")
def zeros(vehicle: Vehicle, sets: Sequence[Fitted]) -> Setup:
    """How far each tilting arm stands from its command (A,) [rad], without load and in the middle of its play."""
    names = tilting(vehicle)
    return Setup(
        "Command all tilt angles to zero, rotors stopped, and read each arm with an inclinometer in the middle of its "
        f"play, to {np.degrees(LEVEL):.1g} deg",
        reads(len(names), tilt_offset=whole),
        LEVEL,
        off(names, LEVEL, degrees, "all at zero"),
        "an arm off zero",
    )


@bench_test("tilt_travel", 15, ("tilt_scale",), "angle of an arm commanded by 45 deg", "0.2 deg")
def travel(vehicle: Vehicle, sets: Sequence[Fitted]) -> Setup:
    """By how much a tilting arm turns further than it is commanded by, from zero to 45 deg [rad]."""
    return Setup(
        "Command the tilt angles from zero to 45 deg, rotors stopped, and read with an inclinometer by how much an arm "
        f"turned, to {np.degrees(LEVEL):.1g} deg",
        reads(1, tilt_scale=lambda theta: theta * np.pi / 4.0),
        LEVEL,
        off(("an arm",), LEVEL, degrees, "as commanded"),
        "it turns further or less",
    )


@bench_test("load_arm", 15, ("arm_twist",), "angle of an arm under half and one and a half hover thrusts", "0.2 deg")
def load(vehicle: Vehicle, sets: Sequence[Fitted]) -> Setup:
    """Twist of an arm when its load changes by a hover thrust [rad], away from the stops of its play."""
    arms, _ = vehicle.geometry()
    thrust = vehicle.body.mass * GRAVITY / len(arms)

    def says(twist: Array) -> str:
        return f"it twists by {degrees(float(twist[0]))}" if abs(twist[0]) > LEVEL else "it keeps its angle"

    return Setup(
        f"Pull at an arm's rotor along the thrust, servos holding, with {0.5 * thrust:.2g} N and then "
        f"{1.5 * thrust:.2g} N, and read the change of its angle, to {np.degrees(LEVEL):.1g} deg",
        reads(1, arm_twist=lambda theta: theta * thrust),
        LEVEL,
        says,
        "it twists",
    )


@bench_test(
    "hang",
    20,
    ("com_offset", "payload"),
    "centre of mass, from two points",
    "1 mm; 1 % of the arm where that is less",
    LOAD,
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


@bench_test(
    "servo_step",
    30,
    ("servo_lag", "command_delay"),
    "dead time and time constant of a tilt servo",
    "4 ms",
    tilts=True,
)
def servo_step(vehicle: Vehicle, sets: Sequence[Fitted]) -> Setup:
    """Dead time and time constant (2,) [s] of a tilt servo after a step in the direction of its last move."""
    return Setup(
        "Step a tilt servo twice the same way, rotors stopped, and film the arm at 240 pictures a second beside the "
        f"command, to {1e3 * FRAME:.0f} ms",
        reads(2, command_delay=lambda theta: [theta[0], 0.0], servo_lag=lambda theta: [0.0, theta[0]]),
        FRAME,
        lambda times: step(times[0], times[1:], ("63 %",)),
        "it moves late",
    )


@bench_test("swing_arm", 30, ("arm_reaction",), "turn of the hanging hull when an arm is swung", "0.2 deg")
def swing(vehicle: Vehicle, sets: Sequence[Fitted]) -> Setup:
    """Turn of the hull [rad] when one arm is swung about its axis: angular momentum stays zero, J_a dalpha / J."""
    arms, _ = vehicle.geometry()
    axis = arms.axis_B[np.flatnonzero(arms.tilts)[0]]
    about = float(axis @ vehicle.body.inertia @ axis)
    return Setup(
        f"Hang the vehicle on a string so that {tilting(vehicle)[0]} points up, swing that arm by "
        f"{np.degrees(SWING):.0f} deg with its servo, rotors stopped, and film the hull, to {np.degrees(TURN):.1g} deg",
        reads(1, arm_reaction=lambda theta: theta * SWING / about),
        TURN,
        above(TURN, lambda turn: f"the hull turns back by {np.degrees(turn):.1f} deg", "the hull stays"),
        "the hull turns back",
    )


@bench_test("pendulum", 90, ("inertia", "payload"), "moments of inertia, on two strings", "2 %", LOAD)
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
