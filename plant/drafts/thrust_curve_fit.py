"""Fit of the thrust curve over the command, from a flight of a vehicle of known weight.

In the air the accelerometer along the thrust reads m f_z = T_max sum_r n_r,z [f u_r^2 + (1 - f) u_r]. Both columns are
known, so T_max and f follow from least squares. f is accepted where its standard deviation by the jackknife over blocks
of the flight is small (`FitLimits.max_std`); else the assumed f stays, and T_max alone is the median over the samples.

Where the voltage of the battery is logged, T_max goes with (V / V_0)^k. Speed goes with the voltage at a given command,
and thrust with the square of speed, so k = 2. That holds of commands as motors got them, whether or not the autopilot
makes up for the voltage before. Where the flight shows k, it is the slope of log thrust over log V.
Source: Newton's second law along the thrust; Efron, "The jackknife", 1982.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from wrenchgap.flight.flight import Array, Flight, Mask
from wrenchgap.plant.drafts.draft import Draft, Sourced
from wrenchgap.plant.vehicle import GRAVITY


@dataclass(frozen=True)
class FitLimits:
    """Which samples count as flight, and when a flight determines the curve. Experience with logs of PX4 and ArduPilot.

    A multirotor has a thrust of `thrust_to_weight` times its weight at full throttle.
    """

    window: float = 0.5  # [s] over which force and commands are averaged: the vehicle responds with a lag
    lift_share: float = 0.6  # of the flight's 90th percentile of lift, from which on the rotors carry the vehicle
    idle_throttle: float = 0.1  # mean share of full throttle below which the rotors idle on the ground
    min_height: float = 0.2  # above the ground [m], from which on the vehicle flies, where there is odometry
    min_time: float = 3.0  # in the air [s]
    thrust_to_weight: tuple[float, float] = (1.05, 12.0)
    max_std: float = 0.15  # of the factor
    min_variation: float = 0.02  # range of the throttle (5 to 95 %), over its median, that shows the curve's shape
    blocks: int = 8  # of the jackknife
    max_std_of_exponent: float = 0.3  # of k: 1 % of the thrust at a voltage 3 % lower
    # Share of the thrust by which propellers and sensors change in a flight, as the voltage does. Doubled, none of
    # three real logs (PX4, ArduPilot) shows its power k, halved the same one of them as at 1 %.
    drift: float = 0.01
    least_voltage: float = 2.0  # [V], below which it is no battery's


LIMITS = FitLimits()


def with_fitted_thrust(draft: Draft, flown: Flight) -> Draft:
    """The draft with the level of its thrust curve from this flight, and with its shape where that was assumed.

    The draft is returned unchanged where the flight is too short or has commands of another unit or number.
    """
    command, sent, imu = draft.command, flown.actuators, flown.imu
    if command is None or sent is None or imu is None or draft.mass is None or not draft.rotors:
        return draft
    if sent.unit != command.keys["unit"].value or sent.rotor_speed.shape[1] != len(draft.rotors):
        return draft
    columns = _columns(draft, sent.rotor_speed)
    lift, force, voltage = _in_the_air(flown, sent.time, columns)
    seconds = len(force) * float(np.median(np.diff(sent.time)))
    if seconds < LIMITS.min_time:
        return draft
    carried = float(draft.mass.value) * force
    where = f"{seconds:.0f} s of {flown.path.name}"
    factor, keys = command.keys["factor"], dict(command.keys)
    nominal = float(np.median(voltage))
    charge = voltage / nominal if nominal > LIMITS.least_voltage and voltage.min() > 0.0 else np.ones(len(voltage))
    if factor.assumed and (found := _factor(lift * charge[:, None] ** 2, carried)) is not None:
        value, std = found
        factor = Sourced(
            round(value, 3), f"fitted: the accelerometer's force over the commands, {where}, +-{max(std, 0.01):.2g}"
        )
        keys["factor"] = factor
    shape = lift @ (1.0 - float(factor.value), float(factor.value))
    if np.ptp(charge) > 0.0:
        exponent = _exponent(charge, carried / shape, where)
        keys["voltage"] = replace(exponent, value={"nominal": round(nominal, 2), "exponent": exponent.value})
        shape = shape * charge ** float(exponent.value)
    low, middle, high = np.percentile(carried / shape, (25.0, 50.0, 75.0))
    words = (
        f"fitted: the accelerometer's force over the commands, median of {where} "
        f"(middle half +-{50.0 * (high - low) / middle:.1f} %)"
    )
    rotors = abs(float(np.sum([r.direction_B.value[2] for r in draft.rotors])))
    ratio = float(middle) * rotors / (float(draft.mass.value) * GRAVITY)
    least, most = LIMITS.thrust_to_weight
    if not least < ratio < most:
        note = f"{where}: full throttle would lift {ratio:.3g} times the weight; not believed, is this a flight?"
        return replace(draft, notes=(*draft.notes, note))
    note = (
        "forces and torques scale with the mass that was given, which no log of throttle can check: weigh the vehicle"
    )
    fitted = replace(command, keys=keys, thrust_max=Sourced(float(middle), words))
    return replace(draft, command=fitted, notes=(*draft.notes, note))


def _columns(draft: Draft, raw: Array) -> Array:
    """Sums (N, 2) over rotors of n_z u and n_z u^2, of commands (N, R) as logged."""
    assert draft.command is not None
    keys = draft.command.keys
    low, high = keys["range"].value if "range" in keys else (0.0, 1.0)
    u = np.clip((np.nan_to_num(raw) - low) / (high - low or 1.0), 0.0, 1.0)  # a model with one end twice is refused
    up = np.array([r.direction_B.value for r in draft.rotors])[:, 2]
    return np.stack((u @ up, u**2 @ up), axis=1)


def _in_the_air(flown: Flight, at: Array, columns: Array) -> tuple[Array, Array, Array]:
    """Columns (M, 2), specific force along z (M,) and voltage (M,), averaged, where the rotors carry the vehicle.

    The voltage is zero where none is logged.
    """
    nothing = np.empty((0, 2)), np.empty(0), np.empty(0)
    assert flown.imu is not None
    time, force = flown.imu.time, flown.imu.specific_force_B[:, 2]
    known = np.isfinite(force)
    if known.sum() < 2 or len(at) < 2:
        return nothing
    covered = (at >= time[known][0]) & (at <= time[known][-1])
    lift = np.stack([_averaged(at, column) for column in columns.T], axis=1)
    specific = np.interp(at, time[known], _averaged(time[known], force[known]))
    assert flown.actuators is not None
    spinning = lift[:, 0] > LIMITS.idle_throttle * flown.actuators.rotor_speed.shape[1]
    if not spinning.any():
        return nothing
    large = float(np.percentile(lift[spinning, 1], 90.0))
    flying = covered & spinning & (lift[:, 1] > LIMITS.lift_share * large) & (specific > 0.5 * GRAVITY)
    flying &= _off_the_ground(flown, at, spinning)
    voltage = np.zeros(len(at))
    if flown.battery is not None:
        voltage = np.interp(at, flown.battery.time, _averaged(flown.battery.time, flown.battery.voltage))
    return lift[flying], specific[flying], voltage[flying]


def _off_the_ground(flown: Flight, at: Array, spinning: Mask) -> Mask:
    """Where (N,) the vehicle is above its height with rotors at rest; if they never rest, whether it moved."""
    if flown.odometry is None:
        return np.ones(len(at), dtype=bool)
    places = [np.interp(at, flown.odometry.time, column) for column in flown.odometry.position_E.T]
    if (~spinning).any():
        return np.asarray(places[2] > float(np.median(places[2][~spinning])) + LIMITS.min_height)
    return np.full(len(at), max(float(np.ptp(column)) for column in places) > LIMITS.min_height)


def _averaged(time: Array, values: Array) -> Array:
    width = max(1, round(LIMITS.window / max(float(np.median(np.diff(time))), 1e-6)))
    padded = np.pad(values, (width // 2, width - 1 - width // 2), mode="edge")
    return np.convolve(padded, np.full(width, 1.0 / width), mode="valid")


def _factor(lift: Array, carried: Array) -> tuple[float, float] | None:
    """The curve's factor and its standard deviation; None where the flight does not show it."""

    def share(rows: Mask) -> float:
        line, square = np.linalg.lstsq(lift[rows], carried[rows], rcond=None)[0]
        return float(square / (line + square)) if line + square > 0.0 else float("nan")

    low, middle, high = np.percentile(lift[:, 0], (5.0, 50.0, 95.0))
    if high - low < LIMITS.min_variation * middle:
        return None
    found, std = _jackknifed(share, len(carried))
    sure = std < LIMITS.max_std and -3.0 * LIMITS.max_std < found < 1.0 + 3.0 * LIMITS.max_std
    return (float(np.clip(found, 0.0, 1.0)), std) if sure else None


def _exponent(charge: Array, thrust: Array, where: str) -> Sourced:
    """The power k with which `thrust` (M,) goes with `charge` (M,), V / V_0: 2, or what the flight shows."""

    def slope(rows: Mask) -> float:
        return float(np.polyfit(np.log(charge[rows]), np.log(thrust[rows]), 1)[0])

    found, std = _jackknifed(slope, len(charge))
    std = float(np.hypot(std, LIMITS.drift / np.ptp(np.log(charge))))
    if std < LIMITS.max_std_of_exponent:
        return Sourced(round(float(np.clip(found, 0.0, 3.0)), 2), f"fitted: thrust over voltage, {where}, +-{std:.2g}")
    return Sourced(2.0, "speed in proportion to the voltage at a given command, as usual", assumed=True)


def _jackknifed(estimate: Callable[[Mask], float], count: int) -> tuple[float, float]:
    """An estimate from `count` rows, and its standard deviation by the jackknife over blocks of them."""
    block = np.arange(count) * LIMITS.blocks // count
    without = [estimate(block != k) for k in range(LIMITS.blocks)]
    return estimate(block >= 0), float(np.sqrt((LIMITS.blocks - 1) * np.var(without)))
