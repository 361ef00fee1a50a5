"""Reference trajectories: the desired motion as a function of time, with consistent derivatives.

Every trajectory gives position, velocity and acceleration of O in E, the attitude `quat_ED` of the reference frame D,
and its rate and acceleration in D, vectorised over time. All start and end at rest (`Step` jumps on purpose; the
flat attitude of an excited trajectory starts to move with a few hundredths of a rad/s).

Names for the command line are in `TRAJECTORIES`; `named` builds one. The pitch, figure-8 and step flights are those of
Zhang et al., "Learning dynamics for improving control of overactuated flying systems", RA-L 2020; where the paper gives
no equation (the slopes of the tilt, the figure-8), the form is our choice.
"""

from collections.abc import Callable

import numpy as np

from wrenchgap.flight.errors import UsageError
from wrenchgap.plant.trajectory.reference import Reference, Trajectory
from wrenchgap.plant.trajectory.shapes import (
    Circle,
    Excited,
    FigureEight,
    Flat,
    Hover,
    Multisine,
    Recorded,
    Step,
    Tilts,
)

__all__ = ["TRAJECTORIES", "Hover", "Recorded", "Reference", "Step", "Tilts", "Trajectory", "named"]

_E_X, _E_Y = np.array([[1.0, 0.0, 0.0]]), np.array([[0.0, 1.0, 0.0]])
_AZIMUTHS = np.radians([0.0, 180.0, 60.0, 240.0, 120.0, 300.0, 90.0, 270.0])
_ALL_ROUND = np.stack((np.cos(_AZIMUTHS), np.sin(_AZIMUTHS), np.zeros(len(_AZIMUTHS))), axis=-1)

TRAJECTORIES: dict[str, tuple[Callable[[float], Trajectory], float, str]] = {
    "hover": (lambda d: Hover(d), 10.0, "level at one place"),
    "pitch": (lambda d: Tilts(d, _E_Y, np.radians(60.0)), 100.0, "pitch 0-60-0 deg every 10 s (the paper's)"),
    "roll": (lambda d: Tilts(d, _E_X, np.radians(60.0)), 100.0, "roll 0-60-0 deg every 10 s"),
    "multi_axis": (
        lambda d: Tilts(d, _ALL_ROUND, np.radians(70.0), period=20.0 / 3.0),
        40.0,
        "tilts to 70 deg about one horizontal axis after another",
    ),
    "figure8": (lambda d: FigureEight(d), 40.0, "figure-8 with roll and pitch up to a tilt of 63 deg (the paper's)"),
    "step": (lambda d: Step(d), 6.0, "a 40 deg step in roll after 1 s (the paper's)"),
    "circle": (lambda d: Flat(Circle(d)), 30.0, "circle, thrust along the body z axis (fixed rotors)"),
    "figure8_level": (lambda d: Flat(FigureEight(d, tilt=0.0)), 40.0, "figure-8, thrust along the body z axis"),
}
"""name -> (builder taking the duration, default duration [s], one line for the help)."""


def named(name: str, duration: float | None = None, excitation: float = 0.0, seed: int = 0) -> Trajectory:
    """The trajectory called `name`, with a multisine of `excitation` times its default size on top (0: none).

    A trajectory for fixed rotors is excited in position only and stays flyable: the excitation goes below the
    attitude. Raises UsageError for an unknown name or a length that is not positive.
    """
    if name not in TRAJECTORIES:
        raise UsageError(f"trajectory: no trajectory is called '{name}'; available: {', '.join(TRAJECTORIES)}")
    build, default, _ = TRAJECTORIES[name]
    length = default if duration is None else duration
    if not (np.isfinite(length) and length > 0):
        raise UsageError(f"trajectory '{name}': got a duration of {length} s, expected a positive number")
    trajectory = build(length)
    if excitation == 0.0:
        return trajectory
    position, attitude, fade = 0.1 * excitation, np.radians(7.0) * excitation, min(2.0, length / 4.0)  # m, rad, s
    sine_sum = Multisine(length, position, attitude, fade=fade, seed=seed)
    if isinstance(trajectory, Flat):
        return Flat(Excited(trajectory.base, sine_sum))
    return Excited(trajectory, sine_sum)
