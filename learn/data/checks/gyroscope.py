"""A gyroscope in deg/s, told by what turns the vehicle: where no attitude is logged, its rate is no witness.

J domega + omega x J omega grows by 57.3 in its first term and by 57.3^2 in its second if omega is in deg/s. The witness
is the commanded torque or, where none is logged, that of the logged actuators. Whatever it says, no torque can be
larger than what the rotors make at full speed.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from wrenchgap.flight.check import Check
from wrenchgap.flight.checks.mending import option
from wrenchgap.flight.checks.motion import cosine, rms
from wrenchgap.flight.flight import Array, Flight
from wrenchgap.flight.gravity import GRAVITY
from wrenchgap.learn.data.checks.compared import LAGS, Compared, flown, moving
from wrenchgap.learn.data.checks.turning import MOVES
from wrenchgap.plant.model import Model
from wrenchgap.plant.vehicle import Vehicle
from wrenchgap.plant.wrench_model import cross

DEGREES, OFF = 180.0 / np.pi, 4.0
"""Of a radian, and the factor by which inertia, lags and noise may change the torque that a motion needs."""
CARRIES = (0.4, 2.5)
"""Commanded force over the weight within which the command is in newtons: a normalised one says nothing of sizes."""
BEYOND = 3.0
"""Times the largest torque of the rotors that the rms of a logged motion may need before the rates cannot be true."""


def gyroscope(flight: Flight, model: Model, seen: Compared) -> Iterator[Check]:
    """Whether the rates are in deg/s, or need more torque than the rotors have; nothing where an attitude tells."""
    pushed = seen.wrench if seen.wrench is not None else seen.made
    asked = any(check.name == "gyroscope" for check in flight.checks or ())
    if pushed is None or flight.imu is None or asked:
        return
    inertia = np.asarray(np.diag(model.vehicle.body.inertia))
    slower = _in_radians(model.vehicle, seen)
    who = "logged actuators make it" if seen.wrench is None else "commanded wrench makes it"
    alike = _alike(seen, slower, pushed, inertia)
    sizes = _sizes(seen, slower, pushed, inertia) and (seen.wrench is None or _carries(seen, model.vehicle))
    if sizes and alike > max(MOVES, _alike(seen, seen.measured[:, 3:], pushed, inertia)):
        words = f"Read in deg/s, it turns as the {who} (cosine {alike:.2f}), in rad/s far too fast"
        yield Check("gyroscope", "bad", words, option(flight, "deg", "imu"))
        return
    most = largest_torque(model.vehicle) if model.command is None else None  # a curve to newtons leaves c_f free
    needed = rms(flown(seen, seen.measured[:, 3:]))
    if most is not None and needed > BEYOND * most:
        words = f"The motion as logged needs torques of {needed:.3g} Nm rms, and all rotors at full speed make less "
        words += f"than {most:.3g} Nm: the rates are in another unit (in deg/s: `imu=TOPIC:deg`) or full of noise, or "
        yield Check("gyroscope", "bad", f"{words}vehicle.inertia is not this vehicle's")


def largest_torque(vehicle: Vehicle) -> float | None:
    """Torque [Nm] that the rotors cannot exceed, each at its limit of speed and at its largest lever; None without."""
    if not vehicle.has_rotors:
        return None
    arms, rotors = vehicle.geometry()
    lever = np.linalg.norm(arms.position_B - vehicle.body.com_B, axis=1)[rotors.arm] + np.abs(rotors.offset)
    return float(np.sum(rotors.c_f * rotors.speed_max**2 * np.hypot(lever, rotors.kappa)))


def _in_radians(vehicle: Vehicle, seen: Compared) -> Array:
    """Torques (N, 3) of the motion whose logged rates are in deg/s."""
    whirl = cross(seen.omega, seen.omega @ vehicle.body.inertia.T)
    return np.asarray((seen.measured[:, 3:] - whirl) / DEGREES + whirl / DEGREES**2)


def _sizes(seen: Compared, slower: Array, pushed: Array, inertia: Array) -> bool:
    """Whether the torques have about the size of the witness in deg/s, and are far larger as they are."""
    felt, less, made = (
        rms(moving(seen, torque, fast=True) / inertia) for torque in (seen.measured[:, 3:], slower, pushed[:, 3:])
    )
    return felt > DEGREES / OFF * made and 1.0 / OFF < less / max(made, 1e-12) < OFF


def _carries(seen: Compared, vehicle: Vehicle) -> bool:
    """Whether the commanded force is about the weight."""
    assert seen.wrench is not None
    force = float(np.median(np.linalg.norm(flown(seen, seen.wrench[:, :3]), axis=1)))
    return CARRIES[0] < force / (vehicle.body.mass * GRAVITY) < CARRIES[1]


def _alike(seen: Compared, felt: Array, pushed: Array, inertia: Array) -> float:
    """Cosine of torques (N, 3) with those of the witness, each axis by its inertia, at the likeliest lag."""
    truth = moving(seen, felt, fast=True) / inertia
    return max(cosine(truth, moving(seen, pushed[:, 3:], tau, fast=True) / inertia) for tau in LAGS)
