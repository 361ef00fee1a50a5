"""Whether the model's rotors stand where the autopilot's parameters put its motors."""

import re

import numpy as np

from wrenchgap.flight.check import Check
from wrenchgap.flight.errors import ModelError
from wrenchgap.flight.flight import Array, Flight
from wrenchgap.flight.formats.headers import CRAZYFLIE
from wrenchgap.plant.drafts import ardupilot, px4
from wrenchgap.plant.drafts.ardupilot import CRAZYFLIE_FRAME
from wrenchgap.plant.drafts.draft import RotorDraft
from wrenchgap.plant.vehicle import Vehicle


def frame(flight: Flight, vehicle: Vehicle, limit_deg: float = 30.0) -> list[Check]:
    """A check `frame` where the log (its autopilot) and the model both say in which directions motors 1, 2, ... are.

    Directions are compared, seen from the middle of the rotors; a frame has no lengths. `limit_deg`: a plus frame is
    45 deg from an X, motors of an octocopter are 45 deg apart, and a frame stretched to 1 : 3 is 27 deg from its X.
    """
    motors = () if _reordered(flight) else motors_of(flight)
    if not motors or vehicle.rotors is None or len(vehicle.rotors) != len(motors):
        return []
    arms, rotors = vehicle.geometry()
    said = np.array([motor.position_B.value for motor in motors], dtype=np.float64)
    there, here = (_directions(places) for places in (said, arms.position_B[rotors.arm]))
    apart = np.degrees(np.abs(np.angle(here / there)))
    worst = int(np.argmax(np.nan_to_num(apart.round(3))))
    source = motors[worst].position_B.source.partition(";")[0]
    if not apart[worst] > limit_deg:
        return [Check("frame", "ok", f"Rotors are where the log has its motors ({source}).")]
    words = f"{vehicle.rotor_name(worst)} of {vehicle.name} is {apart[worst]:.0f} deg from where the log has motor"
    ask = "correct the frame, or the order of the rotors, in the model"
    return [Check("frame", "bad", f"{words} {worst + 1} ({source}): {ask}")]


def _reordered(flight: Flight) -> bool:
    """Whether somebody has said which column is which rotor's, as in `rotor_speed=/motors[0,2,1,3]`."""
    listed = re.search(r"\[([\d,]+)\]", flight.mapping.get("rotor_speed", ""))
    columns = [] if listed is None else [int(text) for text in listed[1].split(",") if text]
    return columns != sorted(columns)


def motors_of(flight: Flight) -> tuple[RotorDraft, ...]:
    """Rotors by the parameters of the log's autopilot, the farthest one unit from the middle; those of the Crazyflie's
    firmware; empty where nothing names them.
    """  # noqa: D205
    if flight.firmware == CRAZYFLIE:
        return ardupilot.rotors_of(CRAZYFLIE_FRAME, 1.0, f"as the firmware of the {CRAZYFLIE} counts")
    autopilot = flight.autopilot
    if autopilot is None:
        return ()
    try:
        if px4.has_geometry(autopilot.parameters):
            return px4.rotors_of(autopilot.parameters, "log", arm=1.0)
        return ardupilot.rotors_from(autopilot.parameters, 1.0, "log", autopilot.frame)
    except ModelError:  # a frame that is not in the table, rotors in the middle
        return ()


def _directions(places_B: Array, middle: float = 0.1) -> Array:
    """Directions of places (N, 3), seen from their mean, as complex numbers (N,): x + i y, NaN for those in the middle.

    `middle`: share of the farthest distance within which a rotor has no direction of its own.
    """
    flat = (places_B[:, 0] + 1j * places_B[:, 1]) - np.mean(places_B[:, 0] + 1j * places_B[:, 1])
    near = np.abs(flat) <= middle * np.max(np.abs(flat))
    return np.where(near, np.nan, flat)
