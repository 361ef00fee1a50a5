"""The commanded wrench against the motion: units, axes.

A vehicle does what it is commanded to, about: F is m f, M is J domega + omega x J omega. What differs by a factor that
no effect makes is a unit, or a mass or inertia that is not this vehicle's.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from wrenchgap.flight.check import Check
from wrenchgap.flight.checks.motion import Axes, best_axes, cosine, rms
from wrenchgap.flight.checks.remedies import factor, option
from wrenchgap.flight.flight import GRAVITY, Array, Flight
from wrenchgap.learn.data.checks.commands_and_motion import CommandsAndMotion, at_lags, flown, moving
from wrenchgap.learn.data.checks.torques import largest_torque
from wrenchgap.plant.model import Model
from wrenchgap.plant.vehicle import Vehicle


@dataclass(frozen=True)
class WrenchThresholds:
    """From when on a commanded wrench is in another unit or about other axes."""

    force: tuple[float, float] = (0.5, 2.0)
    """Commanded over measured force that an effect may make."""
    torque: tuple[float, float] = (0.3, 10.0)
    """Commanded over measured torque; commands that answer a disturbance move nothing, and may well be larger."""
    alike: float = 0.5
    """Cosine from which on command and motion belong together."""
    much_alike: float = 0.7
    """Cosine from which on a command may be called too small."""
    wild: float = 100.0
    """Times the measured torque that a commanded one is in another unit, alike or not; and the other way round."""
    full: float = 1.05
    """Largest of a normalised command."""
    still: float = 0.01
    """Largest rotor speed, in any unit, of rotors that carry nothing."""
    turned: float = 0.001
    """Share of the rotors' largest torque that a motion needs (rms) for a far smaller command to be no command."""
    seen: float = 0.3
    """Share of a command's torque that an axis must have to be asked."""


WRENCH = WrenchThresholds()


def force_unit(flight: Flight, model: Model, seen: CommandsAndMotion) -> Iterator[Check]:
    """Size of the force, of the commanded wrench or of the logged rotors."""
    sent, felt = flown(seen, seen.pushed)[:, :3], flown(seen, seen.measured)[:, :3]
    along = np.sum(sent * felt, axis=1) / np.maximum(np.sum(felt**2, axis=1), 1e-12)
    ratio = max(abs(float(np.median(along))), 1e-12)  # along the measured force: chatter is no larger
    said = f"The {'commanded' if seen.wrench is not None else 'nominal'} force is {ratio:.3g} times the measured one"
    if np.median(along) < 0.0 and WRENCH.force[0] < ratio < WRENCH.force[1]:
        words = f"{said}, and points the other way: the frames of pose, twist or IMU are not those that were said"
        yield Check("inertial-frame", "bad", f"{words} (:ned, :enu, :frd, :flu), or not those that the log says")
    elif WRENCH.force[0] < ratio < WRENCH.force[1]:
        yield Check("force-unit", "ok", f"{said}.")
    elif seen.wrench is not None and _same_force(seen):
        mass = ratio * model.vehicle.body.mass
        why = f"the rotors' thrusts (c_f) make the commanded force too, and carry {mass:.3g} kg: correct vehicle.mass"
        yield Check("force-unit", "bad", f"{said}; {why} in the model")
    elif seen.wrench is not None:
        words, why = _force_words(ratio, model.vehicle.body.mass, float(np.max(np.abs(sent))))
        yield Check("force-unit", "bad", f"{said}: {why}", option(flight, words, "commanded"))
    else:
        yield _speeds(flight, model.vehicle, seen, ratio, said)


def _same_force(seen: CommandsAndMotion, within: float = 0.1) -> bool:
    """Whether the model's rotors make of their logged speeds the commanded force, within this share of it."""
    if seen.made is None or seen.wrench is None:
        return False
    sent, made = flown(seen, seen.wrench)[:, :3], flown(seen, seen.made)[:, :3]
    return float(np.median(np.linalg.norm(made - sent, axis=1) / np.linalg.norm(sent, axis=1))) < within


def speed_unit(flight: Flight, model: Model, seen: CommandsAndMotion) -> Iterator[Check]:
    """Rotor speeds against the commanded wrench where both are logged: thrusts go with the square of a unit."""
    if seen.wrench is None or seen.made is None:
        return
    sent, made = flown(seen, seen.wrench)[:, :3], flown(seen, seen.made)[:, :3]
    ratio = abs(float(np.median(np.sum(sent * made, axis=1) / np.maximum(np.sum(sent**2, axis=1), 1e-12))))
    said = f"The logged rotors' force is {ratio:.3g} times the commanded one"
    found = _speeds(flight, model.vehicle, seen, ratio, said)
    if found.name == "rotor-speed-unit":
        yield found


def _force_words(ratio: float, mass: float, largest: float) -> tuple[str, str]:
    """The words that bring a force to newtons, and what it seems to be."""
    units = {"g": mass * GRAVITY, "kgf": GRAVITY, "m/s^2": mass, "mN": 1e-3}
    fitting = {unit: k for unit, k in units.items() if abs(np.log(ratio * k)) < 0.35}
    if fitting:
        unit = min(fitting, key=lambda u: abs(np.log(ratio * fitting[u])))
        words = unit if unit in ("kgf", "mN") else f"force*{factor(fitting[unit])}"
        what = {"g": "in units of g (a share of the weight)", "m/s^2": "an acceleration [m/s^2]"}
        return words, f"it is {what.get(unit, f'in {unit}')}"
    kind = "normalised" if largest <= WRENCH.full else "in another unit, or the mass is not this vehicle's"
    return f"force*{factor(1.0 / ratio)}", f"it is {kind}"


def _speeds(flight: Flight, vehicle: Vehicle, seen: CommandsAndMotion, ratio: float, said: str) -> Check:
    """Rotor speeds in another unit make thrusts by its square; a factor that is no unit is another vehicle's."""
    for word, k, unit in (("rpm", np.pi / 30.0, "rpm"), ("*6.283185", 2.0 * np.pi, "revolutions per second")):
        if WRENCH.force[0] < ratio * k**2 < WRENCH.force[1]:
            words = f"{said}: rotor speeds are in {unit}"
            return Check("rotor-speed-unit", "bad", words, option(flight, word, "rotor_speed"))
    largest = np.inf if seen.speed is None else float(np.max(np.abs(seen.speed)))
    if largest < WRENCH.still:
        words = f"{said}: the logged rotors stand still; map their speeds with --topic rotor_speed=/your/topic"
        return Check("rotor-speed-unit", "bad", words)
    if largest <= WRENCH.full:
        words = f"{said}: rotor speeds are normalised"
        mend = option(flight, f"*{factor(1.0 / np.sqrt(ratio))}", "rotor_speed")
        return Check("rotor-speed-unit", "bad", words, mend)
    words = f"{said}, and no usual unit of rotor speeds explains it: is {vehicle.name} the model of this vehicle?"
    return Check("weight", "bad", f"{words} Else correct its mass or c_f")


def torque_unit(flight: Flight, model: Model, seen: CommandsAndMotion) -> Iterator[Check]:
    """Size of the commanded torque, each axis by its inertia."""
    if seen.wrench is None:
        return
    inertia = np.diag(model.vehicle.body.inertia)
    motion, sent = _accelerations(seen, inertia)
    size = np.sqrt(np.mean(sent**2, axis=0))
    if not size.any():
        return
    used = size > WRENCH.seen * size.max()
    ratio = rms(sent[:, used]) / max(rms(motion[:, used]), 1e-12)
    alike = cosine(motion[:, used], sent[:, used])
    said = f"The commanded torque is {ratio:.3g} times what inertia and motion make (cosine {alike:.2f})"
    pushed, felt = (rms(moving(seen, wrench[:, :3])) for wrench in (seen.wrench, seen.measured))
    usual = max(1.0, pushed / max(felt, 1e-12))  # more than 1: a command that chatters, and that no vehicle can follow
    turning, asked = (part[:, used] for part in _quick(seen, inertia))
    quick = rms(asked) / max(rms(turning), 1e-12)
    small = ratio < WRENCH.torque[0] and abs(alike) > WRENCH.much_alike
    large = ratio > WRENCH.torque[1] * usual and abs(alike) > WRENCH.alike
    most = largest_torque(model.vehicle)  # in a hover in still air nothing is commanded, and what is felt is noise
    turned = most is not None and rms(flown(seen, seen.measured[:, 3:])) > WRENCH.turned * most
    if turned and max(ratio, quick) < 1.0 / WRENCH.wild and not small:
        words = f"{said}: another unit, of the torques or of the gyroscope, or vehicle.inertia is not this vehicle's"
        yield Check("torque-unit", "bad", words)
        return
    if (small and quick < 1.0) or ((large or ratio > WRENCH.wild * usual) and quick > WRENCH.torque[1]):
        unit = ratio if small else quick  # what answers disturbances is larger than what moves the vehicle
        words = "Nmm" if 0.2 < unit / 1000.0 < 5.0 else f"torque*{factor(1.0 / unit)}"
        kind = "in Nmm" if words == "Nmm" else "normalised, in another unit, or vehicle.inertia is not this vehicle's"
        yield Check("torque-unit", "bad", f"{said}: it is {kind}", option(flight, words, "commanded"))
        return
    words = f"{said}." if alike > WRENCH.alike else f"{said}: too little in common to check its unit."
    yield Check("torque-unit", "ok", words)


def _accelerations(seen: CommandsAndMotion, inertia: Array) -> tuple[Array, Array]:
    """Of the motion (K, 3), and those commanded, behind the lag at which the two are most alike."""
    assert seen.wrench is not None
    motion = moving(seen, seen.measured[:, 3:]) / inertia
    tried = [torque / inertia for torque in at_lags(seen, seen.wrench[:, 3:])]
    return motion, max(tried, key=lambda sent: abs(cosine(motion, sent)))


def _quick(seen: CommandsAndMotion, inertia: Array) -> tuple[Array, Array]:
    """The same where torques turn the vehicle: a unit is the same at all frequencies."""
    assert seen.wrench is not None
    motion, sent = (moving(seen, wrench[:, 3:], fast=True) / inertia for wrench in (seen.measured, seen.wrench))
    return motion, sent


def axes(flight: Flight, model: Model, seen: CommandsAndMotion) -> Iterator[Check]:
    """Axes of the commanded wrench, among 48, against those of the motion."""
    if seen.wrench is None:
        return
    inertia = np.diag(model.vehicle.body.inertia)
    motion, sent = _accelerations(seen, inertia)
    forces = flown(seen, seen.measured[:, :3]), flown(seen, seen.wrench[:, :3])
    if not sent.any() or not forces[1].any():
        return
    quick = _quick(seen, inertia)

    def turned(found: Axes | None) -> Axes | None:
        """Axes that fit better also where torques turn the vehicle."""
        return found if found is not None and cosine(quick[0], quick[1] @ found.matrix.T) > cosine(*quick) else None

    together = turned(best_axes([(motion, sent), forces]))
    if together is not None and cosine(forces[0], forces[1] @ together.matrix.T) > cosine(*forces) - 0.02:
        words = (
            f"The motion goes with the commanded wrench by a cosine of {together.as_is:.2f}, with its axes read as "
            f"{together.words} by {together.fits:.2f}: its axes, or those of the IMU"
        )
        yield Check("wrench-frame", "bad", words, option(flight, together.words, "commanded"))
        return
    alone = turned(best_axes([(motion, sent)]))
    if alone is not None and "=" in alone.words and "," not in alone.words and alone.words.startswith("axes"):
        words = f"The motion goes with the commanded torque by a cosine of {alone.as_is:.2f}, as {alone.words} by "
        mend = option(flight, f"torque.{alone.words}", "commanded")
        yield Check("wrench-frame", "bad", f"{words}{alone.fits:.2f}", mend)
