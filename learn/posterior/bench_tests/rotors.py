"""Bench tests of rotors: two of them swapped, a camera, a thrust stand."""

from collections.abc import Sequence

import numpy as np

from wrenchgap.flight.flight import GRAVITY, Array
from wrenchgap.learn.posterior.bench_tests.hull import FRAME, step
from wrenchgap.learn.posterior.bench_tests.trial import Fitted, Setup, above, bench_test, off, per_cent, reads, whole
from wrenchgap.plant.effects import Context, ThrustEffect, find
from wrenchgap.plant.effects.com_offset import span
from wrenchgap.plant.state import Actuation, State
from wrenchgap.plant.vehicle import Vehicle

STAND = 0.01
"""Of a thrust stand, as a share of a rotor's thrust (or of its torque)."""
COMMANDS = (0.8, 1.2)
"""At which a thrust curve is read, relative to hover's command."""
DRAINED = 0.1
"""Share of its voltage that a battery has lost when it is nearly empty."""
SPUN = 0.3
"""Of a rotor's inertia, as a share of a typical one (`rotor_gyroscopic`)."""


def hover_thrust(vehicle: Vehicle) -> float:
    """Of one rotor [N]; of all together where the model file gives no rotors."""
    return vehicle.body.mass * GRAVITY / (1 if vehicle.rotors is None else len(vehicle.rotors))


def hover_speed(vehicle: Vehicle) -> Array:
    """Rotor speeds (R,) [rad/s] at the thrust of hover."""
    _, rotors = vehicle.geometry()
    return np.sqrt(hover_thrust(vehicle) / rotors.c_f)


def at_rest(count: int, height: float = 0.0) -> State:
    """`count` samples of a vehicle that is held level, O at this height [m]."""
    position = np.tile([0.0, 0.0, height], (count, 1))
    still = np.zeros((count, 3))
    return State(np.zeros(count), position, np.tile([1.0, 0.0, 0.0, 0.0], (count, 1)), still, still)


def thrust_ratio(vehicle: Vehicle, name: str, theta: Array, tilt: Array, speed: Array, height: float = 0.0) -> Array:
    """Thrusts (N, R) with the effect over those without, of a vehicle that is held with O at `height` [m].

    `tilt` (N, A) [rad], `speed` (N, R) [rad/s].
    """
    effect = find(name)
    assert isinstance(effect, ThrustEffect)
    _, rotors = vehicle.geometry()
    nominal = rotors.c_f * speed**2
    actuation = Actuation(vehicle, tilt, speed, nominal)
    return effect.apply(actuation, theta, Context(vehicle, at_rest(len(speed), height))) / nominal


def apart(vehicle: Vehicle, gains: Array) -> tuple[int, int] | None:
    """The rotor whose gain is the most unlike the others' and the one, turning alike, with which a swap moves most."""
    arms, rotors = vehicle.geometry()
    odd = int(np.argmax(np.abs(gains - np.median(gains))))
    alike = np.flatnonzero((rotors.spin == rotors.spin[odd]) & (np.arange(len(rotors)) != odd))
    if alike.size == 0:
        return None
    place = arms.position_B[rotors.arm]
    far = np.linalg.norm(place[alike] - place[odd], axis=1) * np.abs(gains[alike] - gains[odd])
    return odd, int(alike[np.argmax(far)])


@bench_test(
    "swap",
    25,
    ("rotor_thrust",),
    "torque in hover after two rotors have changed places",
    "2 % of a rotor's thrust times the arm",
)
def swap(vehicle: Vehicle, sets: Sequence[Fitted]) -> Setup:
    """Change of the torque in hover (3,) [Nm] after two rotors have changed places.

    Where no gain is known neither is the pair: the torque moves in one of the swaps, by an unknown amount.
    """
    arms, rotors = vehicle.geometry()
    resolution = 2.0 * STAND * hover_thrust(vehicle) * span(vehicle)
    known = [fitted["rotor_thrust"] for fitted in sets if "rotor_thrust" in fitted]
    pair = apart(vehicle, known[0]) if known else None
    place, normal = arms.position_B[rotors.arm], arms.normal_B[rotors.arm]
    lever = np.cross(place, normal) - (rotors.spin * rotors.kappa)[:, None] * normal

    def moved(gains: Array) -> Array:
        if pair is None:
            return np.zeros(3) if known else np.full(3, np.nan)
        one, other = pair
        return np.asarray(hover_thrust(vehicle) * (gains[other] - gains[one]) * (lever[one] - lever[other]))

    def says(torque: Array) -> str:
        size = float(np.linalg.norm(torque))
        return f"they differ by {1e3 * size:.3g} mNm" if size > resolution else "they are the same"

    which = "rotors that turn alike, pair after pair" if pair is None else " and ".join(map(vehicle.rotor_name, pair))
    return Setup(
        f"Swap {which} (propeller, motor and speed controller), hover as before, and compare the mean torques that the "
        f"motors are commanded in the two logs, to {1e3 * resolution:.3g} mNm",
        reads(3, rotor_thrust=moved),
        resolution,
        says,
        "the torque moves with a rotor",
    )


@bench_test(
    "rotor_step",
    30,
    ("motor_lag", "asymmetric_motor_lag", "command_delay"),
    "dead time and time constants of a rotor's speed, up and down",
    "4 ms",
)
def rotor_step(vehicle: Vehicle, sets: Sequence[Fitted]) -> Setup:
    """Dead time, time constants of speeding up and of slowing down (3,) [s] of a rotor's speed after a step."""
    return Setup(
        "Step one rotor's command up and down on a stand and record its speed (ESC telemetry, or film at 240 pictures "
        f"a second) beside the command, to {1e3 * FRAME:.0f} ms",
        reads(
            3,
            command_delay=lambda theta: [theta[0], 0.0, 0.0],
            motor_lag=lambda theta: [0.0, theta[0], theta[0]],
            asymmetric_motor_lag=lambda theta: [0.0, theta[0], theta[1]],
        ),
        FRAME,
        lambda times: step(times[0], times[1:], ("63 % up", "63 % down")),
        "late",
    )


@bench_test(
    "rotor_inertia",
    30,
    ("rotor_gyroscopic",),
    "inertia of a propeller with its motor bell",
    "30 % of a typical rotor's",
)
def spin(vehicle: Vehicle, sets: Sequence[Fitted]) -> Setup:
    """Inertia [kg m^2] of a rotor with what of the motor turns with it."""
    (typical,) = find("rotor_gyroscopic").parameters(vehicle)
    resolution = SPUN * typical.scale

    return Setup(
        f"Swing a propeller with its motor bell on two strings for its inertia, to {resolution:.0e} kg m^2",
        reads(1, rotor_gyroscopic=whole),
        resolution,
        above(resolution, lambda inertia: f"{inertia:.1e} kg m^2", f"less than {resolution:.0e} kg m^2"),
        f"more than {resolution:.0e} kg m^2",
    )


@bench_test(
    "pair",
    60,
    ("coaxial_loss", "coaxial_loss_of_wake"),
    "thrust of the lower rotor, alone and below the upper one",
    "1 %",
)
def pair(vehicle: Vehicle, sets: Sequence[Fitted]) -> Setup:
    """Change of a lower rotor's thrust, relative, when the upper one of its pair runs."""
    return Setup(
        "Run the lower rotor of a pair on a thrust stand, then both, and compare the sum with the two alone, to "
        f"{100 * STAND:.0f} % of a rotor's thrust",
        reads(1, coaxial_loss=lambda theta: -theta, coaxial_loss_of_wake=lambda theta: -theta),
        STAND,
        off(["the lower rotor's"], STAND, per_cent, "the sum of the two"),
        "less than the sum",
    )


@bench_test("curve", 60, ("thrust_curve",), "thrust at 80, 100 and 120 % of hover's command", "1 %")
def curve(vehicle: Vehicle, sets: Sequence[Fitted]) -> Setup:
    """Thrust relative to hover's over the square of the command, less one, at `COMMANDS` (2,)."""

    def deviation(theta: Array) -> Array:
        arms, _ = vehicle.geometry()
        speed = np.array(COMMANDS)[:, None] * hover_speed(vehicle)
        return thrust_ratio(vehicle, "thrust_curve", theta, np.zeros((len(COMMANDS), len(arms))), speed)[:, 0] - 1.0

    low, high = (f"{100 * c:.0f} %" for c in COMMANDS)
    return Setup(
        f"Run a rotor on a thrust stand, from a steady supply, at {low}, 100 % and {high} of hover's command and "
        f"compare with the square of the command, to {100 * STAND:.0f} %",
        reads(len(COMMANDS), thrust_curve=deviation),
        STAND,
        off([f"at {low}", f"at {high}"], STAND, per_cent, "the square"),
        "another curve",
    )


@bench_test("torque", 60, ("drag_torque", "drag_torque_of_speed"), "torque over thrust of a rotor", "2 %")
def torque(vehicle: Vehicle, sets: Sequence[Fitted]) -> Setup:
    """Drag torque per thrust over the model's kappa, less one."""
    _, rotors = vehicle.geometry()
    kappa = float(rotors.kappa.mean())
    resolution = 2.0 * STAND  # two readings, each of a stand

    return Setup(
        f"Measure a rotor's torque over its thrust on a stand, to {100 * resolution:.0f} %",
        reads(1, drag_torque=whole, drag_torque_of_speed=lambda theta: theta[:1]),
        resolution,
        lambda change: f"{1e3 * kappa * (1.0 + change[0]):.1f} mm",
        f"another lever than {1e3 * kappa:.1f} mm",
    )


# sag is right at a voltage of its own: what it makes of the level on another supply is not known
@bench_test(
    "thrust",
    90,
    ("thrust_scale", "rotor_thrust"),
    "thrust of each rotor at hover's command, one at a time",
    "1 %",
    ("battery_sag",),
)
def thrust(vehicle: Vehicle, sets: Sequence[Fitted]) -> Setup:
    """Thrust of each rotor on its own over the model's, less one (R,), at hover's command."""
    count = 1 if vehicle.rotors is None else len(vehicle.rotors)
    names = [vehicle.rotor_name(r) for r in range(count)] if count > 1 else ["thrust"]
    what = "Run one rotor at a time" if count > 1 else "Run the vehicle"

    scale, gains = reads(1, thrust_scale=whole), reads(count, rotor_thrust=whole)
    return Setup(
        f"{what} on a thrust stand, from a steady supply at hover's command "
        f"({hover_thrust(vehicle):.3g} N by the model), to {100 * STAND:.0f} %",
        lambda fitted: (1.0 + scale(fitted)) * (1.0 + gains(fitted)) - 1.0,
        STAND,
        off(names, STAND, per_cent, "the model's thrust"),
        "another thrust",
    )


@bench_test(
    "discharge", 90, ("battery_sag", "thrust_fade"), "thrust at one command, battery full and nearly empty", "1 %"
)
def discharge(vehicle: Vehicle, sets: Sequence[Fitted]) -> Setup:
    """Relative change of thrust at one command when the battery has lost `DRAINED` of its voltage.

    thrust_fade says nothing of voltages: how much it falls is not known, only that it does.
    """
    return Setup(
        f"Run a rotor on a thrust stand at hover's command from the flight battery, full and with "
        f"{100 * DRAINED:.0f} % less voltage, to {100 * STAND:.0f} %",
        reads(
            1,
            battery_sag=lambda theta: -DRAINED * theta[:1],
            thrust_fade=lambda theta: [np.nan if theta[0] else 0.0],
        ),
        STAND,
        off(["thrust"], STAND, per_cent, "the same thrust"),
        "less thrust",
    )
