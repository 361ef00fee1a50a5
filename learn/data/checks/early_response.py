"""Whether the motion comes before its commands: then the stamps of commands and IMU are apart."""

from collections.abc import Iterator, Sequence

import numpy as np

from wrenchgap.flight.check import Check
from wrenchgap.flight.flight import Flight
from wrenchgap.learn.data.measurement import Record
from wrenchgap.learn.data.response import responses
from wrenchgap.plant.model import Model


def early_response(flight: Flight, model: Model, records: Sequence[Record], fewest: int = 2) -> Iterator[Check]:
    """On `fewest` axes or more, and on none the other way round: one clock moves all axes, a disturbance that commands
    answer does not. A lead is what a moment of inertia of the rotors makes of commands that change, and other effects
    of rates. None of 70 recorded flights, nor of ten of a multibody engine, has such an axis.

    Commands are taken for held until the next one; where the log has a snapshot of faster ones now and then, the motion
    is early by half the time in between, which is no fault.
    """  # noqa: D205
    found = responses(flight, model.vehicle, records)
    sent = flight.actuators if flight.commanded is None else flight.commanded
    half = 0.5 * max([0.0 if sent is None else sent.period, *(r.command_period for r in records)])
    early = [(r.axis, r.early) for r in found if r.early is not None and r.early > half]
    if len(early) < fewest or any(r.plain and r.offset.certain for r in found):
        return
    axes = ", ".join(axis for axis, _ in early)
    words = f"On {axes} the vehicle follows its commands {1e3 * np.median([s for _, s in early]):.0f} ms before they "
    words += "are given: the stamps of the commands are late, or those of the IMU early, by that and by what the "
    words += "actuators take besides. Correct them where they are made, or shift one (--shift)"
    yield Check("early-response", "bad", words)
