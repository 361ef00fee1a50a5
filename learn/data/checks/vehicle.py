"""Numbers of a vehicle that contradict one another, whatever the log says.

All of a vehicle's mass is within its arms and rotors, so no moment of inertia exceeds m (L + r)^2, L the longest arm,
r the rotor's radius; and motors sit at the ends of the arms, so none is next to nothing. The drag torque of a rotor
over its thrust, kappa, is the radius times C_Q / C_T: between a fortieth and three radii for any propeller that flies
(C_T, C_Q of small propellers: Brandt and Selig, AIAA 2011-1255). Its thrust coefficient C_T = c_f / (rho pi R^4) is
about 0.01; a c_f per rpm^2 is a ninetieth of that, one per (1/s)^2 forty times as much.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from wrenchgap.flight.check import Check
from wrenchgap.plant.model import Model
from wrenchgap.plant.vehicle import Vehicle


@dataclass(frozen=True)
class VehicleRanges:
    """Within which ranges numbers of a vehicle that flies are."""

    least_gyration: float = 0.015
    """Moment of inertia over m L^2, L the rms length of the arms, below which nothing that flies is."""
    small_gyration: float = 0.03
    """The same below which hardly anything is."""
    kappa: tuple[float, float] = (0.025, 3.0)
    """Drag torque per thrust over the rotor's radius."""
    thrust_coefficient: tuple[float, float] = (0.0015, 0.1)
    """C_T = T / (rho pi R^2 (Omega R)^2); the vehicles that we have are at 0.007 to 0.021."""
    air_density: float = 1.225
    """Density of air at sea level [kg/m^3]."""


RANGES = VehicleRanges()


def vehicle_checks(model: Model) -> Iterator[Check]:
    """Inertia against mass and arms, kappa and c_f against the radius."""
    vehicle = model.vehicle
    if not vehicle.has_rotors:
        return
    yield _inertia(vehicle)
    yield _kappa(vehicle)
    if model.command is None:  # a curve from commands to newtons leaves c_f free
        yield _thrust(vehicle)


def _inertia(vehicle: Vehicle) -> Check:
    arms, rotors = vehicle.geometry()
    body = vehicle.body
    lengths = np.linalg.norm(arms.position_B - body.com_B, axis=1)
    usual, reach = float(np.sqrt(np.mean(lengths**2))), float(lengths.max() + rotors.radius.max())
    moments = np.linalg.eigvalsh(body.inertia)
    least, most = float(moments[0] / (body.mass * usual**2)), float(moments[-1] / (body.mass * reach**2))
    listed = ", ".join(f"{m:.3g}" for m in moments)
    described = f"vehicle.inertia {listed} kg m^2 with {body.mass:.3g} kg and arms of {usual:.3g} m"
    if most > 1.0:
        limit = body.mass * reach**2
        words = f"{described}: no mass within {reach:.3g} m has more than {limit:.3g} kg m^2; correct it in the model"
        return Check("inertia", "bad", words)
    if least < RANGES.least_gyration:
        words = (
            f"{described}: {least:.2g} of m L^2, expected at least {RANGES.least_gyration:g}; correct it in the model"
        )
        return Check("inertia", "bad", words)
    if least < RANGES.small_gyration:
        return Check("inertia", "warn", f"{described}: only {least:.2g} of m L^2; is it in kg m^2?")
    return Check("inertia", "ok", f"{described}: plausible.")


def _kappa(vehicle: Vehicle) -> Check:
    _, rotors = vehicle.geometry()
    kappa, radius = np.abs(rotors.kappa), rotors.radius
    share = kappa / radius
    if np.any(rotors.kappa < 0.0):
        words = "kappa is negative: which way a rotor turns says spin, and a negative kappa turns it over"
        return Check("kappa", "warn", f"{words}; write kappa without its sign in the model, and spin with it")
    if np.all(kappa == 0.0):
        return Check("kappa", "warn", "kappa is zero: rotors make no drag torque, and yaw is not predicted.")
    worst = int(
        np.argmax(np.abs(np.log(np.maximum(share, 1e-30)) - np.log(np.sqrt(RANGES.kappa[0] * RANGES.kappa[1]))))
    )
    described = f"kappa {kappa[worst]:.3g} m is {share[worst]:.2g} of the rotor's radius {radius[worst]:.3g} m"
    if RANGES.kappa[0] < share[worst] < RANGES.kappa[1]:
        return Check("kappa", "ok", f"{described}.")
    instead = kappa[worst] / rotors.c_f[worst]
    hint = ""
    if RANGES.kappa[0] < instead / radius[worst] < RANGES.kappa[1]:
        hint = f": it looks like the torque coefficient [N m s^2]; kappa is that over c_f, {instead:.3g} m"
    limits = f"expected {RANGES.kappa[0]:g} to {RANGES.kappa[1]:g}"
    return Check("kappa", "bad", f"{described}, {limits}{hint}; correct vehicle.rotor.kappa in the model")


def _thrust(vehicle: Vehicle) -> Check:
    _, rotors = vehicle.geometry()
    disc = RANGES.air_density * np.pi * rotors.radius**4
    coefficient = rotors.c_f / disc
    worst = int(
        np.argmax(
            np.abs(np.log(coefficient) - np.log(np.sqrt(RANGES.thrust_coefficient[0] * RANGES.thrust_coefficient[1])))
        )
    )
    found, c_f = float(coefficient[worst]), float(rotors.c_f[worst])
    described = (
        f"c_f {c_f:.3g} N s^2 with a radius of {rotors.radius[worst]:.3g} m is a thrust coefficient of {found:.2g}"
    )
    if RANGES.thrust_coefficient[0] < found < RANGES.thrust_coefficient[1]:
        return Check("thrust-coefficient", "ok", f"{described}.")
    units = {"rpm^2": (30.0 / np.pi) ** 2, "revolutions per second, squared": (0.5 / np.pi) ** 2}
    fitting = [
        unit for unit, k in units.items() if RANGES.thrust_coefficient[0] < found * k < RANGES.thrust_coefficient[1]
    ]
    hint = f": it looks like newtons per {fitting[0]}; in N s^2 it is {c_f * units[fitting[0]]:.3g}" if fitting else ""
    limits = f"expected {RANGES.thrust_coefficient[0]:g} to {RANGES.thrust_coefficient[1]:g}"
    words = f"{described}, {limits}{hint}; correct vehicle.rotor.c_f or radius in the model"
    return Check("thrust-coefficient", "warn", words)
