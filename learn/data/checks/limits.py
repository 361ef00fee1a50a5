"""Commands beyond what the model says is possible: single samples are left out, and said."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.check import Check
from wrenchgap.flight.checks.masking import RARE, without
from wrenchgap.flight.flight import Array, Flight
from wrenchgap.flight.row_kernels import lengths
from wrenchgap.plant.model import Model

MARGIN = 1.2
"""Times a rotor's `speed_max` beyond which no command is one."""
FORCE_MARGIN = 3.0
"""Times the force of all rotors at `speed_max`, likewise."""
MANY, FAR = 0.3, 3.0
"""Share of the samples that are left out where all are at least so many times what three quarters of the others are."""


def _some(beyond: NDArray[np.bool_], size: Array) -> bool:
    """Whether some samples (N,) of these sizes are wrong: few of them, or many that are nowhere near the others."""
    share = float(beyond.mean())
    if share <= RARE:
        return share > 0.0
    return share <= MANY and float(size[beyond].min()) > FAR * float(np.percentile(size[~beyond], 75))


def possible(flight: Flight, model: Model) -> tuple[Flight, tuple[Check, ...]]:
    """The flight without single commands that its vehicle cannot follow; what is beyond all the time is a unit."""
    vehicle = model.vehicle
    if not vehicle.has_rotors:
        return flight, ()
    _, rotors = vehicle.geometry()
    found: list[Check] = []
    sent = flight.actuators
    if sent is not None and sent.rotor_speed.shape[1] == len(rotors):
        beyond = np.any(np.abs(sent.rotor_speed) > MARGIN * rotors.speed_max, axis=1)
        if _some(beyond, np.max(np.abs(sent.rotor_speed), axis=1)):
            flight = without(flight, "actuators", beyond, "beyond speed_max", split=False)
            words = (
                f"actuators: {int(beyond.sum())} sample(s) beyond {MARGIN:g} times vehicle.rotor.speed_max: left out."
            )
            found.append(Check("spikes", "warn", words))
    if flight.commanded is not None:
        size = lengths(flight.commanded.wrench_B[:, :3])
        most = FORCE_MARGIN * float(np.sum(rotors.c_f * rotors.speed_max**2))
        beyond = (size > most) & (size > 10.0 * np.percentile(size, 95))
        if _some(beyond, size):
            flight = without(flight, "commanded", beyond, "beyond all rotors", split=False)
            words = f"commanded: {int(beyond.sum())} sample(s) beyond {most:.3g} N, {FORCE_MARGIN:g} times all rotors"
            found.append(Check("spikes", "warn", f"{words}: left out."))
    return flight, tuple(found)
