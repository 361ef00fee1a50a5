"""Whether the model's rotors stand where the autopilot's parameters put its motors."""

import numpy as np

from wrenchgap.flight.autopilot import Autopilot
from wrenchgap.flight.check import Check
from wrenchgap.flight.errors import ModelError
from wrenchgap.flight.flight import Array, Flight
from wrenchgap.plant.drafts import ardupilot, px4
from wrenchgap.plant.vehicle import Vehicle


def frame(flight: Flight, vehicle: Vehicle, limit_deg: float = 30.0) -> list[Check]:
    """A check `frame` where the log and the model both say in which directions motors 1, 2, ... are.

    Directions are compared, seen from the middle of the rotors; a frame has no lengths. `limit_deg`: a plus frame is
    45 deg from an X, motors of an octocopter are 45 deg apart, and a frame stretched to 1 : 3 is 27 deg from its X.
    """
    said = None if flight.autopilot is None else _places_of(flight.autopilot)
    if said is None or vehicle.rotors is None or len(vehicle.rotors) != len(said[0]):
        return []
    arms, rotors = vehicle.geometry()
    there, here = (_directions(places) for places in (said[0], arms.position_B[rotors.arm]))
    apart = np.degrees(np.abs(np.angle(here / there)))
    worst = int(np.argmax(np.nan_to_num(apart.round(3))))
    if not apart[worst] > limit_deg:
        return [Check("frame", "ok", f"Rotors are where the log's parameters ({said[1]}) have them.")]
    words = f"{vehicle.rotor_name(worst)} of {vehicle.name} is {apart[worst]:.0f} deg from where the log has motor"
    ask = "correct the frame, or the order of the rotors, in the model"
    return [Check("frame", "bad", f"{words} {worst + 1} ({said[1]}): {ask}")]


def _places_of(autopilot: Autopilot) -> tuple[Array, str] | None:
    """Places of motors in B (N, 3), of any size, and what says so; None where the parameters have none."""
    parameters = autopilot.parameters
    try:
        if px4.has_geometry(parameters):
            rotors, words = px4.rotors_of(parameters, "log", arm=1.0), "CA_ROTOR*"
        else:
            known = ardupilot.frame_of(parameters, autopilot.frame)
            if known is None or known[0] not in ardupilot.FRAMES:
                return None
            rotors, words = ardupilot.rotors_of(known[0], 1.0, "log"), f"{known[0]} by {known[1]}"
    except ModelError:
        return None
    return np.array([rotor.position_B.value for rotor in rotors], dtype=np.float64), words


def _directions(places_B: Array, middle: float = 0.1) -> Array:
    """Directions of places (N, 3), seen from their mean, as complex numbers (N,): x + i y, NaN for those in the middle.

    `middle`: share of the farthest distance within which a rotor has no direction of its own.
    """
    flat = (places_B[:, 0] + 1j * places_B[:, 1]) - np.mean(places_B[:, 0] + 1j * places_B[:, 1])
    near = np.abs(flat) <= middle * np.max(np.abs(flat))
    return np.where(near, np.nan, flat)
