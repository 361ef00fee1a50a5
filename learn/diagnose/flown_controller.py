"""Whether the controller of a model file flew a log: its law, on the recorded motion, makes the torques of the log."""

from collections.abc import Sequence

import numpy as np

from wrenchgap.learn.data.measurement import commands_of, low_pass
from wrenchgap.learn.data.opening import OpenFlight
from wrenchgap.plant.controller import control_law, integral_series, pushes_along_z_only
from wrenchgap.plant.model import Model
from wrenchgap.plant.state import State
from wrenchgap.plant.trajectory.shapes import Recorded


def flown_by_controller(model: Model, flights: Sequence[OpenFlight], least: float = 0.9) -> bool:
    """Whether the controller of the model file flew these: whether its torques, from the recorded motion and reference,
    go with the desired ones, both about the centre of mass and behind the flights' low-pass, their means aside, with a
    correlation and a slope (to either side) of `least`.
    """  # noqa: D205
    body, along_z = model.vehicle.body, pushes_along_z_only(model.vehicle)
    for flight, s, cutoff_hz in ((f.flight, s, f.records[0].cutoff_hz) for f in flights for s in f.flown):
        if flight.reference is None or s.quat_EB is None or s.position_E is None or s.velocity_E is None:
            return False
        state = State(s.time, s.position_E, s.quat_EB, s.velocity_E, s.omega_B)
        reference = Recorded(flight.reference, 0.0).at(s.time)
        _, error = control_law(model.controller, body, state, reference, np.zeros((len(s), 3)), along_z)
        integral = integral_series(model.controller, error, s.dt)
        law, _ = control_law(model.controller, body, state, reference, integral, along_z)
        desired = commands_of(s, model.vehicle)[0].wrench_B if s.wrench_des_B is None else s.wrench_des_B
        pair = (low_pass(np.ascontiguousarray(x[:, 3:]), s.dt, cutoff_hz) for x in (desired, law))
        for asked, own in zip(*(x.T for x in pair), strict=True):
            both = np.cov(asked, own)
            slope = both[0, 1] / max(both[1, 1], 1e-30)
            if both[0, 1] < least * np.sqrt(both[0, 0] * both[1, 1]) or not least < slope < 1.0 / least:
                return False
    return True
