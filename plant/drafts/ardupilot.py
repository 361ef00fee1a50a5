"""A vehicle from the parameters of ArduPilot, in a parameter file or a log: frame, motors, IMU; frames by name.

The parameters name a frame (FRAME_CLASS, FRAME_TYPE) and no lengths, so the arm has to be said. Angles of a frame are
ArduPilot's, clockwise from the nose as seen from above [deg]; turning +1 is counter-clockwise. Motors are in the order
of the outputs; PX4 numbers those of quad_x and hexa_x alike.
Motor outputs are pulse widths: u = 0 at MOT_PWM_MIN + MOT_SPIN_MIN (MAX - MIN), u = 1 at MOT_SPIN_MAX likewise; thrust
goes with MOT_THST_EXPO u^2 + (1 - MOT_THST_EXPO) u, which is MOT_THST_HOVER in hover. Where MOT_PWM_MIN and _MAX are 0,
the default of firmware before 4.1, the range is that of the throttle's channel, RC3_MIN to RC3_MAX (RCMAP_THROTTLE).
INS_POS1_* are in x forward, y right, z down. Source: ArduPilot parameter reference, "Motor Thrust Scaling" and "Connect
ESCs and Motors" (ardupilot.org), AP_MotorsMulticopter, AP_MotorsMatrix; PX4's airframe reference.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from wrenchgap.flight.errors import ModelError, UsageError
from wrenchgap.plant.drafts.draft import CommandDraft, RotorDraft, Sourced
from wrenchgap.plant.reader import text_of

Parameters = Mapping[str, float]
USUAL = {
    "MOT_PWM_MIN": 1000.0,
    "MOT_PWM_MAX": 2000.0,
    "MOT_SPIN_MIN": 0.15,
    "MOT_SPIN_MAX": 0.95,
    "MOT_THST_EXPO": 0.65,
    "MOT_THST_HOVER": 0.35,
}
"""ArduPilot's defaults."""


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


def read_parameters(path: Path) -> dict[str, float]:
    """Parameters of a file with `NAME,VALUE` or `NAME VALUE` a line; # begins a comment. Raises ModelError.

    Lines of QGroundControl have two numbers before and one behind: vehicle, component, NAME, VALUE, type.
    """
    found: dict[str, float] = {}
    for number, line in enumerate(text_of(path, "as parameters").splitlines(), 1):
        words = line.partition("#")[0].replace(",", " ").split()
        if not words:
            continue
        if len(words) == 5 and words[0].isdecimal():
            words = words[2:4]
        try:
            name, value = words[0].upper(), float(words[1])
        except (IndexError, ValueError):
            value = np.nan
        if not np.isfinite(value):
            raise ModelError(f"{path}, line {number}: got {line.strip()[:80]!r}, expected NAME,VALUE, a finite number")
        if found.setdefault(name, value) != value:
            raise ModelError(f"{path}, line {number}: {name} {value:g} was {found[name]:g} before; leave one of them")
    return found


def rotors_of(frame: str, arm: float, source: str) -> tuple[RotorDraft, ...]:
    """The rotors of a frame, `arm` [m] from the centre to the motors. Raises UsageError for an unknown name."""
    if frame not in FRAMES:
        raise UsageError(f"--frame {frame}: expected one of {', '.join(FRAMES)}")
    if not (np.isfinite(arm) and arm > 0.0):
        raise UsageError(f"--arm {arm:g}: expected the distance from the middle to the motors in metres, e.g. 0.25")
    up, out = Sourced((0.0, 0.0, 1.0), source), []
    for number, (angle, turn) in enumerate(FRAMES[frame], 1):
        azimuth = np.radians(-angle)
        place = (float(arm * np.cos(azimuth)), float(arm * np.sin(azimuth)), 0.0)
        out.append(RotorDraft(Sourced(place, source), up, Sourced(turn, source), name=f"M{number}"))
    return tuple(out)


def rotors_from(parameters: Parameters, arm: float | None, where: str) -> tuple[RotorDraft, ...]:
    """The rotors of the frame in the parameters, empty without one.

    Raises ModelError for a frame that is not in the table, and without the length of an arm.
    """
    if "FRAME_CLASS" not in parameters:
        return ()
    kind, shape = parameters["FRAME_CLASS"], parameters.get("FRAME_TYPE", 1.0)
    frame = f"{CLASSES.get(kind)}_{TYPES.get(shape)}"  # whatever is no whole number of the tables: None
    if frame not in FRAMES:
        raise ModelError(
            f"{where}: FRAME_CLASS {kind:g} with FRAME_TYPE {shape:g} is not known here; known: "
            f"{', '.join(FRAMES)}. Say the nearest with --frame, or write the model file by hand (docs/model-file.md)"
        )
    if arm is None:
        raise ModelError(
            f"{where}: the frame is {frame} (FRAME_CLASS, FRAME_TYPE), and its size is not among the parameters; "
            "measure from the middle to a motor and say --arm METRES"
        )
    return rotors_of(frame, arm, f"frame {frame} of FRAME_CLASS, FRAME_TYPE; --arm {arm:g}")


def command_of(parameters: Parameters) -> CommandDraft:
    """[command] for pulse widths."""

    def read(name: str) -> tuple[float, bool]:
        return float(parameters.get(name, USUAL[name])), name not in parameters

    (low, high), named, unknown = _pulses(parameters)
    (idle, _), (full, _) = (read(f"MOT_{name}") for name in ("SPIN_MIN", "SPIN_MAX"))
    (factor, curve), (hover, still) = read("MOT_THST_EXPO"), read("MOT_THST_HOVER")
    ends = [low + share * (high - low) for share in (idle, full)]
    keys = {
        "unit": Sourced("pwm", "motor outputs of RCOU [us]"),
        "range": Sourced(ends, f"{named}, MOT_SPIN_MIN, _MAX", assumed=unknown),
        "factor": Sourced(factor, "MOT_THST_EXPO" + (", ArduPilot's default" if curve else ""), assumed=curve),
    }
    words = f"hovering at MOT_THST_HOVER = {hover:.3g}" + (", ArduPilot's default" if still else "")
    return CommandDraft(keys, hover=Sourced(hover, words, assumed=still))


def _pulses(parameters: Parameters) -> tuple[tuple[float, float], str, bool]:
    """Smallest and largest pulse [us], the names of their parameters, and whether they are defaults."""
    throttle = f"RC{int(parameters.get('RCMAP_THROTTLE', 3.0))}"
    for low, high in (("MOT_PWM_MIN", "MOT_PWM_MAX"), (f"{throttle}_MIN", f"{throttle}_MAX")):
        if high not in parameters:
            break  # a file of some parameters: what the others are is not known
        found = float(parameters.get(low, 0.0)), float(parameters[high])
        if 0.0 < found[0] < found[1]:
            return found, f"{low}, _MAX", False
    return (USUAL["MOT_PWM_MIN"], USUAL["MOT_PWM_MAX"]), "MOT_PWM_MIN, _MAX", True
