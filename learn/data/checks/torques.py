"""How commands turn the vehicle above `COMPARED.fast_hz`: by how much about each axis, and about which axes.

There torques turn the vehicle, and with the inertia J the angular acceleration that they make is J^-1 M. Where it has
the shape of the measured one (cosine) but another size, a number of the model is wrong: of the inertia, of the arms, or
kappa, which scales the torque about z alone. Where both are alike only after a turn about z, the IMU is mounted turned:
with a = (a_x, a_y) made and b = (b_x, b_y) measured, b turned by the angle of sum (a . b) + i sum (b x a) is closest to
a (Schoenemann 1966, in the plane). Blocks of time tell how well it is known.

A gyroscope in deg/s is told by what turns the vehicle, where no attitude is logged, whose rate would be a witness:
J domega + omega x J omega grows by 57.3 in its first term and by 57.3^2 in its second. The witness is the commanded
torque or, where none is logged, that of the logged actuators. Whatever it says, no torque can be larger than what the
rotors make at full speed.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from wrenchgap.flight.check import Check
from wrenchgap.flight.checks.motion import AXES_SEARCH, cosine, rms, rotation_words
from wrenchgap.flight.checks.remedies import option
from wrenchgap.flight.flight import GRAVITY, Array, Flight
from wrenchgap.learn.data.checks.commands_and_motion import CommandsAndMotion, at_lags, flown, moving
from wrenchgap.plant.effects import find
from wrenchgap.plant.model import Model
from wrenchgap.plant.vehicle import Vehicle
from wrenchgap.plant.wrench_model import cross


@dataclass(frozen=True)
class TorqueThresholds:
    """From when on the torques of commands and motion contradict each other."""

    alike: float = 0.8
    """Cosine from which on commands and motion are one signal, of a torque that is too small."""
    one: float = 0.97
    """The same of one that is too large. Commands answer disturbances, which moves nothing: on real hovers they are
    three to seven times what the motion needs, with cosines of 0.6 to 0.93. No disturbance makes them smaller."""
    size: float = 1.8
    """Factor between torque made and torque needed beyond which no effect of a flying vehicle is the likely reason."""
    together: float = 1.4
    """Within which factors about two axes are the same."""
    sure: float = 3.0
    """Standard errors of the angle that must lie between it and the smallest turn (`AXES_SEARCH.turned_deg`), and be
    less than that."""
    moves: float = 0.65
    """Cosine with the motion that a reading must reach (real hovers: 0.66 to 0.89), or the stated one is refused."""
    off: float = 4.0
    """Factor by which inertia, lags and noise may change the torque that a motion needs."""
    carries: tuple[float, float] = (0.4, 2.5)
    """Commanded force over the weight within which the command is in newtons: a normalised one says no size."""
    beyond: float = 3.0
    """The rms of a logged motion over the largest torque of the rotors from which on the rates cannot be true."""


TORQUES = TorqueThresholds()


AXES = "xyz"
DEGREES = 180.0 / np.pi


@dataclass(frozen=True)
class Turned:
    """An IMU turned about z, as said, and the cosine `whole` that it then has with the commands, about all axes."""

    check: Check
    whole: float


def sizes(model: Model, seen: CommandsAndMotion) -> Iterator[Check]:
    """Torques that are of another size than the motion needs."""
    felt, tried = _accelerations(model, seen)
    found = [_size(felt[:, k], [made[:, k] for made in tried]) for k in range(3)]
    if seen.made is not None and seen.wrench is not None:
        asked = at_lags(seen, seen.wrench[:, 3:] / np.diag(model.vehicle.body.inertia), fast=True)
        known = [_size(felt[:, k], [torque[:, k] for torque in asked]) for k in range(3)]
        off = {k: s for k, s in enumerate(found) if s is not None and _is_off(s) and known[k] is not None}
        if off and not any(map(_is_off, known)):
            yield _of_arms(off)
            return
    yield from _of_sizes(model, found, logged=seen.made is not None)


def _is_off(size: float | None) -> bool:
    return size is not None and not 1.0 / TORQUES.size < size < TORQUES.size


def _of_arms(off: dict[int, float]) -> Check:
    """Where the commanded torque turns the vehicle as the model's inertia says, and that of the actuators does not."""
    listed = ", ".join(f"{s:.2g} about {AXES[k]}" for k, s in off.items())
    words = "The commanded torque turns the vehicle as the model's inertia says, and what the model makes of the logged"
    ask = "kappa" if set(off) == {2} else "the arms' length, or c_f"
    return Check("inertia", "bad", f"{words} actuators does so by factors of {listed}: correct {ask}, in the model")


def _accelerations(model: Model, seen: CommandsAndMotion) -> tuple[Array, list[Array]]:
    """Angular accelerations (K, 3) measured, and made by the actuators, else by the command, at each of the lags."""
    inertia, pushed = np.diag(model.vehicle.body.inertia), seen.pushed if seen.made is None else seen.made
    felt = moving(seen, seen.measured[:, 3:], fast=True) / inertia
    return felt, [torque / inertia for torque in at_lags(seen, pushed[:, 3:], fast=True)]


def _size(felt: Array, tried: list[Array]) -> float | None:
    """Torque made over torque needed about one axis, at the likeliest lag; None where they are not one signal."""
    made = max(tried, key=lambda signal: cosine(felt[:, None], signal[:, None]))
    size = float(np.linalg.norm(made) / max(float(np.linalg.norm(felt)), 1e-30))
    return None if cosine(felt[:, None], made[:, None]) < (TORQUES.one if size > 1.0 else TORQUES.alike) else size


def _of_sizes(model: Model, sizes: list[float | None], *, logged: bool) -> Iterator[Check]:
    off = {k: s for k, s in enumerate(sizes) if s is not None and _is_off(s)}
    if not off:
        return
    vehicle = model.vehicle
    who = "logged actuators" if logged else "commanded wrench"
    listed = ", ".join(f"{s:.2g} about {AXES[k]}" for k, s in enumerate(sizes) if s is not None)
    words = f"The {who} and the model's inertia turn the vehicle more than it does by factors of {listed}"
    fixed = vehicle.arms is not None and not vehicle.arms.tilts.any()
    if set(off) == {2} and fixed and logged:
        yield Check("kappa", "warn", f"{words}: correct vehicle.rotor.kappa, or the inertia about z, in the model")
        return
    known, moments = [s for s in sizes if s is not None], np.diag(vehicle.body.inertia)
    by_log = ", ".join("?" if s is None else f"{s * J:.3g}" for s, J in zip(sizes, moments, strict=True))
    if len(known) == 3 and max(known) < TORQUES.together * min(known):
        hint = "the unit of the torques, or how thrust goes with the commands"
    elif 2 not in off:
        hint = "or the arms' length"
    else:
        hint = "whose order is xx, yy, zz, the arms' length or kappa"
    can_be = find("inertia").parameters(vehicle)[:3]  # xx, yy, zz; beyond them the effect does not reach
    fits = all(can_be[k].low < (s - 1.0) * moments[k] < can_be[k].high for k, s in off.items())
    words = f"{words}; by this log the moments of inertia are {by_log} kg m^2"
    yield Check("inertia", "warn" if fits else "bad", f"{words}: correct vehicle.inertia, {hint}, in the model")


def turned_imu(flight: Flight, model: Model, seen: CommandsAndMotion) -> Turned | None:
    """An IMU turned about z beyond a mounting error, where no attitude tells and all of the flight does; else None."""
    if flight.imu is None or flight.odometry is not None:
        return None
    felt, tried = _accelerations(model, seen)
    if not felt[:, :2].any():
        return None
    made = max(tried, key=lambda signal: _fits(signal, felt, _angle(signal, felt)))
    angle = _angle(made, felt)
    pieces = (np.array_split(part, AXES_SEARCH.blocks) for part in (made, felt))
    parts = [_angle(a, b) for a, b in zip(*pieces, strict=True)]
    away = np.degrees((np.array(parts) - angle + np.pi) % (2.0 * np.pi) - np.pi)
    error = float(np.sqrt(np.mean(away**2) / AXES_SEARCH.blocks))
    as_is, fits = _fits(made, felt, 0.0), _fits(made, felt, angle)
    if (
        abs(np.degrees(angle)) - TORQUES.sure * error < AXES_SEARCH.turned_deg
        or TORQUES.sure * error > AXES_SEARCH.turned_deg
        or fits < max(TORQUES.moves, as_is + AXES_SEARCH.better)
    ):
        return None
    words = (
        f"The vehicle turns about x and y as the commands make it by a cosine of {as_is:.2f}, with the IMU turned "
        f"about z by {np.degrees(angle):.0f} +- {max(error, 0.5):.1g} deg by {fits:.2f}: it "
        "is mounted so, or the rotors are"
    )
    mend = option(flight, rotation_words(_about_z(angle)), "imu")
    check = Check("body-frame", "bad" if as_is < TORQUES.moves else "warn", words, mend)
    return Turned(check, cosine(made, felt @ _about_z(angle).T))


def _angle(made: Array, felt: Array) -> float:
    """Angle [rad] about z by which `felt` (K, 3) must be turned to be closest to `made` (K, 3)."""
    (ax, ay), (bx, by) = made[:, :2].T, felt[:, :2].T
    return float(np.arctan2(ay @ bx - ax @ by, ax @ bx + ay @ by))


def _fits(made: Array, felt: Array, angle: float) -> float:
    """Cosine about x and y with `felt` turned."""
    return cosine(made[:, :2], (felt @ _about_z(angle).T)[:, :2])


def _about_z(angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def gyroscope(flight: Flight, model: Model, seen: CommandsAndMotion) -> Iterator[Check]:
    """Whether the rates are in deg/s, or need more torque than the rotors have; nothing where an attitude tells."""
    if flight.imu is None or any(check.name == "gyroscope" for check in flight.checks or ()):
        return
    inertia = np.asarray(np.diag(model.vehicle.body.inertia))
    whirl = cross(seen.omega, seen.omega @ model.vehicle.body.inertia.T)
    slower = (seen.measured[:, 3:] - whirl) / DEGREES + whirl / DEGREES**2  # the torques of rates in deg/s
    who = "logged actuators make it" if seen.wrench is None else "commanded wrench makes it"
    alike = _alike(seen, slower, inertia)
    felt, less, made = (
        rms(moving(seen, torque, fast=True) / inertia) for torque in (seen.measured[:, 3:], slower, seen.pushed[:, 3:])
    )
    sizes = felt > DEGREES / TORQUES.off * made and 1.0 / TORQUES.off < less / max(made, 1e-12) < TORQUES.off
    if seen.wrench is not None:  # a command that does not carry the weight, about, says nothing of sizes
        force = float(np.median(np.linalg.norm(flown(seen, seen.wrench[:, :3]), axis=1)))
        weights = force / (model.vehicle.body.mass * GRAVITY)
        sizes = sizes and TORQUES.carries[0] < weights < TORQUES.carries[1]
    if sizes and alike > max(TORQUES.moves, _alike(seen, seen.measured[:, 3:], inertia)):
        words = f"Read in deg/s, it turns as the {who} (cosine {alike:.2f}), in rad/s far too fast"
        yield Check("gyroscope", "bad", words, option(flight, "deg", "imu"))
        return
    most = largest_torque(model.vehicle) if model.command is None else None  # a curve to newtons leaves c_f free
    needed = rms(flown(seen, seen.measured[:, 3:]))
    if most is not None and needed > TORQUES.beyond * most:
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


def _alike(seen: CommandsAndMotion, felt: Array, inertia: Array) -> float:
    """Cosine of torques (N, 3) with those commanded, each axis by its inertia, at the likeliest lag."""
    truth = moving(seen, felt, fast=True) / inertia
    return max(cosine(truth, made / inertia) for made in at_lags(seen, seen.pushed[:, 3:], fast=True))
