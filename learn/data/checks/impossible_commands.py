"""Commands that a vehicle cannot follow, or that the log has lost: left out, and said."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.check import Check
from wrenchgap.flight.checks.clipping import stopped_together
from wrenchgap.flight.checks.masking import MASKING, without
from wrenchgap.flight.flight import Array, Flight
from wrenchgap.flight.row_kernels import lengths, runs
from wrenchgap.plant.model import Model


@dataclass(frozen=True)
class CommandThresholds:
    """From when on a command is none."""

    speed_margin: float = 1.2
    """Times a rotor's `speed_max` beyond which no command is one."""
    force_margin: float = 3.0
    """Times the force of all rotors at `speed_max` beyond which no command is one."""
    many: float = 0.3
    """Share of the samples up to which they are left out where all are far from the others."""
    far: float = 3.0
    """How many times what three quarters of the others are counts as far."""
    turning: float = 0.5
    """Of a rotor's median speed: what a rotor turns with before and after a value that is lost."""
    moment: float = 0.02
    """Time [s] in which no rotor stops and starts: the quickest follow with 20 ms."""
    others: float = 0.15
    """Of the thrust that a rotor loses for a moment: what a mixer that takes it gives to another one at least. Beside
    84 lost values others change by 0.02 at most, beside 25 that an ArduPilot quadrotor commanded by 0.3 at least. Half
    and double of this, and of `moment`, tell the same of all."""


COMMANDS = CommandThresholds()


def _some(beyond: NDArray[np.bool_], size: Array) -> bool:
    """Whether some samples (N,) of these sizes are wrong: few of them, or many that are nowhere near the others."""
    share = float(beyond.mean())
    if share <= MASKING.rare:
        return share > 0.0
    return share <= COMMANDS.many and float(size[beyond].min()) > COMMANDS.far * float(np.percentile(size[~beyond], 75))


def _lost(time: Array, speed: Array) -> NDArray[np.bool_]:
    """Rows (N,) with zeros of speeds (N, n) [rad/s] for a moment, between two samples of a rotor that turns, while the
    others go on as they do, or are zero as well. A mixer that stops one rotor speeds others up.
    """  # noqa: D205
    typical = np.median(speed, axis=0)
    turns, lost = speed > COMMANDS.turning * typical, np.zeros(len(time), bool)
    thrust = (speed / np.maximum(typical, 1e-30)) ** 2
    for rotor, zero in enumerate((speed == 0.0).T):
        for a, b in runs(zero):
            if a == 0 or b == len(time) or time[b - 1] - time[a] >= COMMANDS.moment:
                continue
            steps = np.abs(thrust[[a, b]] - thrust[[a - 1, b - 1]])
            other = np.max(steps[:, np.all(speed[a:b] > 0.0, axis=0)], initial=0.0)
            alone = other < COMMANDS.others * steps[:, rotor].min()
            lost[a:b] |= alone & turns[a - 1, rotor] & turns[b, rotor]
    return lost


def without_impossible_commands(flight: Flight, model: Model) -> tuple[Flight, tuple[Check, ...]]:
    """The flight without single commands that its vehicle cannot follow; what is beyond all the time is a unit.

    And whether several commands stop at one value below what it can.
    """
    vehicle = model.vehicle
    if not vehicle.has_rotors:
        return flight, ()
    _, rotors = vehicle.geometry()
    found: list[Check] = []
    sent = flight.actuators
    if sent is not None and sent.unit == "rad/s":
        found += stopped_together(sent.rotor_speed, float(rotors.speed_max.max()))
    if sent is not None and sent.rotor_speed.shape[1] == len(rotors):
        speed = np.abs(sent.rotor_speed)
        beyond = np.any(speed > COMMANDS.speed_margin * rotors.speed_max, axis=1)
        beyond &= _some(beyond, np.max(speed, axis=1))
        lost = _lost(sent.time, speed)
        lost &= float(lost.mean()) <= MASKING.rare
        limit = f"beyond {COMMANDS.speed_margin:g} times vehicle.rotor.speed_max"
        for bad, words in ((beyond, limit), (lost, "where a turning rotor's speed is lost (0 for a moment)")):
            if bad.any():
                found.append(Check("spikes", "warn", f"actuators: {int(bad.sum())} sample(s) {words}: left out."))
        if np.any(beyond | lost):
            flight = without(flight, "actuators", beyond | lost, "impossible command")
    if flight.commanded is not None:
        size = lengths(flight.commanded.wrench_B[:, :3])
        most = COMMANDS.force_margin * float(np.sum(rotors.c_f * rotors.speed_max**2))
        beyond = (size > most) & (size > 10.0 * np.percentile(size, 95))
        if _some(beyond, size):
            flight = without(flight, "commanded", beyond, "beyond all rotors")
            words = f"commanded: {int(beyond.sum())} sample(s) beyond {most:.3g} N, {COMMANDS.force_margin:g} times"
            found.append(Check("spikes", "warn", f"{words} all rotors: left out."))
    return flight, tuple(found)
