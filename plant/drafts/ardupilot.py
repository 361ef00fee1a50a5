"""A vehicle from the parameters of ArduPilot, in a parameter file or a log: frame, motors, IMU; frames by name.

The parameters name a frame (FRAME_CLASS, FRAME_TYPE) and no lengths, so the arm has to be said. Firmware before 3.5 has
FRAME for its type and is compiled for a class, which its log says as text ("Frame: QUAD"). Angles of a frame are
ArduPilot's, clockwise from the nose as seen from above [deg]; turning +1 is counter-clockwise. Motors are in the order
of the outputs; PX4 numbers those of quad_x and hexa_x alike.
Motor outputs are pulse widths: u = 0 at MOT_PWM_MIN + MOT_SPIN_MIN (MAX - MIN), u = 1 at MOT_SPIN_MAX likewise; thrust
goes with MOT_THST_EXPO u^2 + (1 - MOT_THST_EXPO) u, which is MOT_THST_HOVER in hover. Where MOT_PWM_MIN and _MAX are 0,
the default of firmware before 4.1, the range is that of the throttle's channel, RC3_MIN to RC3_MAX (RCMAP_THROTTLE).
Firmware before 3.5 has THR_MIN, in thousandths of the range, for MOT_SPIN_MIN, and MOT_THST_MAX, a share of the range
above that, for MOT_SPIN_MAX; until 3.3 there is no MOT_PWM_MIN.
INS_POS1_* are in x forward, y right, z down. Source: ArduPilot parameter reference, "Motor Thrust Scaling" and "Connect
ESCs and Motors" (ardupilot.org), AP_MotorsMulticopter, AP_MotorsMatrix; PX4's airframe reference.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from wrenchgap.flight.errors import ModelError, UsageError
from wrenchgap.plant.drafts.draft import CommandDraft, RotorDraft, Sourced, parameter
from wrenchgap.plant.reader import text_of

Parameters = Mapping[str, float]
USUAL = {
    "MOT_PWM_MIN": 1000.0,
    "MOT_PWM_MAX": 2000.0,
    "MOT_SPIN_MIN": 0.15,
    "MOT_SPIN_MAX": 0.95,
    "THR_MIN": 130.0,
    "MOT_THST_MAX": 0.95,
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
CRAZYFLIE_FRAME = "quad_cw_x"
"""The frame with the order and the turning directions of the Crazyflie's motors."""
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
            name, text = words  # more of them is a decimal comma, say
            value = np.nan if name.isdecimal() or "_" in text else float(text)
            name = name.upper()
        except ValueError:
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


def frame_of(parameters: Parameters, text: str = "") -> tuple[str, str] | None:
    """The frame and what says so, by the parameters and the log's `text` of it; None where they say none.

    A frame that is not in `FRAMES` has None in its name.
    """
    if "FRAME_CLASS" in parameters:
        kind, shape = parameters["FRAME_CLASS"], parameters.get("FRAME_TYPE", 1.0)
        words = f"FRAME_CLASS {kind:g} with FRAME_TYPE {shape:g}"
        return f"{CLASSES.get(kind)}_{TYPES.get(shape)}", words  # what is no whole number of the tables: None
    if "FRAME" in parameters and text:
        shape = parameters["FRAME"]
        return f"{text.lower()}_{TYPES.get(shape)}", f"FRAME {shape:g} with the log's text Frame: {text}"
    return None


def rotors_from(parameters: Parameters, arm: float | None, where: str, text: str = "") -> tuple[RotorDraft, ...]:
    """The rotors of the frame in the parameters and the log's `text` of it, empty without one.

    Raises ModelError for a frame that is not in the table, and without the length of an arm.
    """
    found = frame_of(parameters, text)
    if found is None:
        return ()
    frame, words = found
    if frame not in FRAMES:
        raise ModelError(
            f"{where}: {words} is not known here; known: "
            f"{', '.join(FRAMES)}. Say the nearest with --frame, or write the model file by hand (docs/model-file.md)"
        )
    if arm is None:
        raise ModelError(
            f"{where}: the frame is {frame} ({words}), and its size is not among the parameters; "
            "measure from the middle to a motor and say --arm METRES"
        )
    return rotors_of(frame, arm, f"frame {frame} of {words}; --arm {arm:g}")


def frame_notes(parameters: Parameters, text: str, typed: str | None, where: str) -> tuple[str, ...]:
    """A note where the frame that was typed is not that of the parameters; ModelError where it has other rotors."""
    found = frame_of(parameters, text)
    if typed is None or found is None or found[0] not in FRAMES or found[0] == typed:
        return ()
    if len(FRAMES[typed]) != len(FRAMES[found[0]]):
        raise ModelError(
            f"--frame {typed}: has {len(FRAMES[typed])} rotors, and {where} is of {found[0]} ({found[1]}), which has "
            f"{len(FRAMES[found[0]])}; leave --frame out, or say one of as many"
        )
    return (f"{where}: the frame is {found[0]} ({found[1]}), and --frame {typed} is used: which of them is flown?",)


def command_of(parameters: Parameters) -> CommandDraft:
    """[command] for pulse widths."""

    def read(name: str, low: float = 0.0, high: float = 1.0) -> tuple[float, bool]:
        return parameter(parameters, name, USUAL[name], low, high), name not in parameters

    low, high, names = _pulses(parameters)
    start, end = "MOT_SPIN_MIN", "MOT_SPIN_MAX"
    if "THR_MIN" in parameters and start not in parameters:  # firmware before 3.5
        start, end = "THR_MIN", "MOT_THST_MAX"
        idle = low + 1e-3 * read(start, high=1000.0)[0] * (high - low)
        ends = [idle, idle + read(end)[0] * (high - idle)]
    else:
        ends = [low + read(name)[0] * (high - low) for name in (start, end)]
    (factor, curve), (hover, still) = read("MOT_THST_EXPO"), read("MOT_THST_HOVER", -np.inf, np.inf)
    every = (*names, start, end)
    assumed = [name for name in every if name not in parameters or (name in names and not parameters[name])]
    words = ", ".join(name for name in every if name not in assumed)
    if assumed:
        words += f"{'; ' if words else ''}ArduPilot's default of {', '.join(assumed)}"
    keys = {
        "unit": Sourced("pwm", "motor outputs of RCOU [us]"),
        "range": Sourced(ends, words, assumed=bool(assumed)),
        "factor": Sourced(factor, "MOT_THST_EXPO" + (", ArduPilot's default" if curve else ""), assumed=curve),
    }
    words = f"hovering at MOT_THST_HOVER = {hover:.3g}" + (", ArduPilot's default" if still else "")
    return CommandDraft(keys, hover=Sourced(hover, words, assumed=still))


def _pulses(parameters: Parameters) -> tuple[float, float, tuple[str, str]]:
    """Smallest and largest pulse [us], and the names of their parameters; of the defaults, where these tell none."""
    throttle = f"RC{int(parameters.get('RCMAP_THROTTLE', 3.0))}"
    usual = ("MOT_PWM_MIN", "MOT_PWM_MAX")
    for names in (usual, (f"{throttle}_MIN", f"{throttle}_MAX")):
        if names[1] not in parameters:
            if "THR_MIN" in parameters:
                continue  # firmware that has no such parameter
            break  # a file of some parameters: what the others are is not known
        low, high = float(parameters.get(names[0], 0.0)), float(parameters[names[1]])
        if 0.0 < low < high:
            return low, high, names
    return USUAL[usual[0]], USUAL[usual[1]], usual
