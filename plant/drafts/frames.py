"""Frames of autopilots by name: positions and turning directions of motors, in the order of the outputs.

Angles are ArduPilot's, clockwise from the nose as seen from above [deg]; turning +1 is counter-clockwise. PX4 numbers
the motors of quad_x and hexa_x alike. Source: the frame classes and types of ArduPilot (ardupilot.org, "Connect ESCs
and Motors"; AP_MotorsMatrix), and PX4's airframe reference.
"""

import numpy as np

from wrenchgap.flight.errors import ModelError, UsageError
from wrenchgap.plant.drafts.draft import RotorDraft, Sourced

Frame = tuple[tuple[float, int], ...]

FRAMES: dict[str, Frame] = {
    "quad_plus": ((90, 1), (-90, 1), (0, -1), (180, -1)),
    "quad_x": ((45, 1), (-135, 1), (-45, -1), (135, -1)),
    "quad_h": ((45, -1), (-135, -1), (-45, 1), (135, 1)),
    "quad_bf_x": ((135, -1), (45, 1), (-135, 1), (-45, -1)),
    "quad_bf_x_reversed": ((135, 1), (45, -1), (-135, -1), (-45, 1)),
    "quad_dji_x": ((45, 1), (-45, -1), (-135, 1), (135, -1)),
    "quad_cw_x": ((45, 1), (135, -1), (-135, 1), (-45, -1)),
    "hexa_plus": ((0, -1), (180, 1), (-120, -1), (60, 1), (-60, 1), (120, -1)),
    "hexa_x": ((90, -1), (-90, 1), (-30, -1), (150, 1), (30, 1), (-150, -1)),
    "hexa_dji_x": ((30, 1), (-30, -1), (-90, 1), (-150, -1), (150, 1), (90, -1)),
    "hexa_cw_x": ((30, 1), (90, -1), (150, 1), (-150, -1), (-90, 1), (-30, -1)),
    "octa_plus": ((0, -1), (180, -1), (45, 1), (135, 1), (-45, 1), (-135, 1), (-90, -1), (90, -1)),
    "octa_x": ((22.5, -1), (-157.5, -1), (67.5, 1), (157.5, 1), (-22.5, 1), (-112.5, 1), (-67.5, -1), (112.5, -1)),
}
CLASSES: dict[float, str] = {1: "quad", 2: "hexa", 3: "octa"}
TYPES: dict[float, str] = {0: "plus", 1: "x", 3: "h", 12: "bf_x", 13: "dji_x", 14: "cw_x", 18: "bf_x_reversed"}
"""ArduPilot's FRAME_CLASS and FRAME_TYPE."""


def rotors_of(frame: str, arm: float, source: str, *, assumed: bool = False) -> tuple[RotorDraft, ...]:
    """The rotors of a frame, `arm` [m] from the centre to the motors. Raises UsageError for an unknown name."""
    if frame not in FRAMES:
        raise UsageError(f"--frame {frame}: expected one of {', '.join(FRAMES)}")
    if not (np.isfinite(arm) and arm > 0.0):
        raise UsageError(f"--arm {arm:g}: expected the distance from the middle to the motors in metres, e.g. 0.25")
    out = []
    for number, (angle, turn) in enumerate(FRAMES[frame], 1):
        azimuth = np.radians(-angle)
        place = (float(arm * np.cos(azimuth)), float(arm * np.sin(azimuth)), 0.0)
        out.append(
            RotorDraft(
                Sourced(place, source),
                Sourced((0.0, 0.0, 1.0), source),
                Sourced(turn, source, assumed),
                name=f"M{number}",
            )
        )
    return tuple(out)


def ardupilot_frame(frame_class: float, frame_type: float, where: str) -> str:
    """The frame of two parameters; ModelError for one that is not in the table."""
    kind, shape = CLASSES.get(frame_class), TYPES.get(frame_type)  # whatever is no whole number of the table: None
    name = f"{kind}_{shape}"
    if name not in FRAMES:
        raise ModelError(
            f"{where}: FRAME_CLASS {frame_class:g} with FRAME_TYPE {frame_type:g} is not known here; known: "
            f"{', '.join(FRAMES)}. Say the nearest with --frame, or write the model file by hand (docs/model-file.md)"
        )
    return name
