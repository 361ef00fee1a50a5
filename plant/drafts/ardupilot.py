"""A vehicle from the parameters of ArduPilot, in a parameter file or a log: frame, motors, IMU.

The parameters name a frame (FRAME_CLASS, FRAME_TYPE: `plant.drafts.frames`) and no lengths, so the arm has to be said.
Motor outputs are pulse widths: u = 0 at MOT_PWM_MIN + MOT_SPIN_MIN (MAX - MIN), u = 1 at MOT_SPIN_MAX likewise; thrust
goes with MOT_THST_EXPO u^2 + (1 - MOT_THST_EXPO) u, which is MOT_THST_HOVER in hover. Where MOT_PWM_MIN and _MAX are 0,
the default of firmware before 4.1, the range is that of the throttle's channel, RC3_MIN to RC3_MAX (RCMAP_THROTTLE).
INS_POS1_* are in x forward, y right, z down. Source: ArduPilot parameter reference and "Motor Thrust Scaling"
(ardupilot.org), AP_MotorsMulticopter.
"""

from collections.abc import Mapping
from pathlib import Path

from wrenchgap.flight.errors import ModelError
from wrenchgap.plant.drafts.draft import CommandDraft, RotorDraft, Sourced
from wrenchgap.plant.drafts.frames import ardupilot_frame, rotors_of

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


def read_parameters(path: Path) -> dict[str, float]:
    """Parameters of a file with `NAME,VALUE` or `NAME VALUE` a line; # begins a comment. Raises ModelError."""
    found: dict[str, float] = {}
    try:
        text = path.read_text(encoding="utf-8", errors="replace")
    except OSError as error:
        raise ModelError(f"{path}: cannot be read as parameters: {error.strerror}") from None
    for number, line in enumerate(text.splitlines(), 1):
        words = line.partition("#")[0].replace(",", " ").split()
        if not words:
            continue
        try:
            found[words[0].upper()] = float(words[1])
        except (IndexError, ValueError):
            got = repr(line.strip()[:80])
            raise ModelError(f"{path}, line {number}: got {got}, expected NAME,VALUE") from None
    return found


def rotors_from(parameters: Parameters, arm: float | None, where: str) -> tuple[RotorDraft, ...]:
    """The rotors of the frame in the parameters, empty without one; ModelError without the length of an arm."""
    if "FRAME_CLASS" not in parameters:
        return ()
    kind, shape = parameters["FRAME_CLASS"], parameters.get("FRAME_TYPE", 1.0)
    frame = ardupilot_frame(kind, shape, where)
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
