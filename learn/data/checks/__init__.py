"""Is this log of this vehicle? Checks that need a model, wherever a log is opened for one.

    commands_and_motion    side by side
    impossible_commands    beyond what the rotors can do, or lost by the log for a moment
    vehicle     numbers of the vehicle that contradict one another; weight and actuators against the commanded wrench
    wrench      the commanded wrench: units, axes
    rotors      order, spin, sign of tilt
    bench       motors that turned, and a vehicle that did not move
    frame       places of the rotors against the autopilot's parameters
    torques     torques by axis: inertia, arms, kappa; an IMU turned about z, in deg/s, or beyond what the rotors can do

What the log says by itself is asked in `flight.checks`.
"""

from collections.abc import Sequence

import numpy as np

from wrenchgap.flight.check import Check
from wrenchgap.flight.checks.channels import sensors_held_for
from wrenchgap.flight.checks.wrench import behind_body_frame
from wrenchgap.flight.flight import Flight, Samples, Series
from wrenchgap.learn.data.checks.bench import bench
from wrenchgap.learn.data.checks.commands_and_motion import commands_and_motion
from wrenchgap.learn.data.checks.rotors import rotors
from wrenchgap.learn.data.checks.torques import gyroscope, sizes, turned_imu
from wrenchgap.learn.data.checks.vehicle import vehicle_checks
from wrenchgap.learn.data.checks.wrench import axes, force_unit, speed_unit, torque_unit
from wrenchgap.plant.model import Model

SAID = {
    *("force-unit", "torque-unit", "wrench-frame", "rotors", "weight", "rotor-speed-unit", "inertia", "kappa"),
    *("gyroscope", "body-frame"),
}
"""Checks of numbers that make torques of another size or about other axes, which then is no news."""


def against_model(flight: Flight, model: Model, stretches: Sequence[Samples]) -> tuple[Check, ...]:
    """What a model says of a flight whose `stretches` are on one clock."""
    found = [*vehicle_checks(model)]
    seen = commands_and_motion(stretches, model.vehicle)
    if seen is not None and (stood := bench(seen, stretches)):
        return (*found, *stood)
    if seen is not None and not any(check.level == "bad" and check.name == "inertia" for check in found):
        found += gyroscope(flight, model, seen)
    if any(check.name == "gyroscope" for check in found):
        return tuple(found)
    turned = None if seen is None else turned_imu(flight, model, seen)
    if seen is not None and seen.wrench is None:  # where tilt has the wrong sign, forces are wrong as well
        found += rotors(flight, model, seen, turned)
    if seen is not None and all(check.level != "bad" for check in found):
        found += [*force_unit(flight, model, seen), *speed_unit(flight, model, seen)]
        if all(check.level == "ok" for check in found):  # a wrong inertia has said so
            found += torque_unit(flight, model, seen)
        if seen.wrench is not None and not any(check.level == "bad" for check in found):
            turned_wrench = behind_body_frame(axes(flight, model, seen), flight.checks or ())
            found += turned_wrench if turned is None else [turned.check]
            found += rotors(flight, model, seen)
        units = (check for check in flight.checks or () if check.level == "bad")
        doubted = (c.name for c in (*found, *units) if c.level == "bad" or (c.level == "warn" and c.name != "inertia"))
        if SAID.isdisjoint(doubted):  # that an inertia looks small says nothing of the torques
            found += sizes(model, seen)
    return tuple(found)


RATE_OVER_CUTOFF = 2.5
"""How many times the cut-off of a filter readings must come, so that its band is in them (Shannon: 2)."""


def rates(flight: Flight, cutoff_hz: float, *, rotors: bool = True) -> tuple[Check, ...]:
    """Whether motion and commands come fast enough for a filter of `cutoff_hz`; `rotors`: the model uses actuators.

    Where a wrench and actuators are logged, both are commands: the wrench is predicted by the one, effects of rotors by
    the other.
    """
    played = flight.series()
    motion = "imu" if "imu" in played else "odometry"
    sent = ("commanded", *(("actuators",) if rotors or "commanded" not in played else ()))
    asked: list[tuple[str, Series]] = [(role, played[role]) for role in (motion, *sent) if role in played]
    needed = RATE_OVER_CUTOFF * cutoff_hz
    repeated = max(sensors_held_for(flight).values(), default=1)
    each = {role: 1.0 / s.period / (repeated if role == "imu" else 1) for role, s in asked}
    slow = [(role, s, each[role]) for role, s in asked if each[role] < needed]
    if not slow:
        return (Check("rate", "ok", f"Motion and commands are fast enough for {cutoff_hz:g} Hz."),)
    role, series, rate = min(slow, key=lambda item: item[2])
    words = (
        f"{series.topic} ({role}) comes at {rate:.3g} Hz, a filter of {cutoff_hz:g} Hz needs {needed:g}: "
        "what is faster is folded into what is slower, and no filter takes it out again; log it faster next time"
    )
    if rate < 1.0:  # Hz: what is left of a motion then is no flight
        return (Check("rate", "bad", f"{words}; or are its times in another unit, ms or us?"),)
    return (Check("rate", "bad", words, f"--cutoff {usable_cutoff(rate):g}"),)


def usable_cutoff(rate_hz: float) -> float:
    """The highest cut-off [Hz], to a tenth, for which readings at this rate are fast enough."""
    return float(np.floor(9.7 * rate_hz / RATE_OVER_CUTOFF) / 10.0)
