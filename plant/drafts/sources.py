"""From a log, parameters, a robot description or answers of the user to a draft of a model."""

import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from wrenchgap import flight
from wrenchgap._escaping import file_word
from wrenchgap.flight.arguments import check_types
from wrenchgap.flight.budget import Budget
from wrenchgap.flight.errors import LogError, ModelError, UsageError
from wrenchgap.flight.flight import Flight
from wrenchgap.flight.formats.headers import CRAZYFLIE
from wrenchgap.plant.drafts import ardupilot, drone_models, px4, rotorpy, sdf
from wrenchgap.plant.drafts import mjcf_urdf as compiled
from wrenchgap.plant.drafts.ardupilot import CRAZYFLIE_FRAME, FRAMES, rotors_of
from wrenchgap.plant.drafts.draft import CommandDraft, Draft, Sourced
from wrenchgap.plant.drafts.thrust_curve_fit import with_fitted_thrust
from wrenchgap.plant.reader import BOUNDS

DESCRIPTIONS = (".urdf", ".sdf", ".world", ".xml", ".mjcf")
"""Endings of robot descriptions."""
KINDS = (
    ".ulg (PX4), .bin or .param (ArduPilot), .csv or .parquet (Betaflight), .urdf, .sdf, .xml (MuJoCo), .py (RotorPy), "
    ".toml (drone-models)"
)


@dataclass(frozen=True)
class Given:
    """Values by the user: `mass` [kg] and its tolerance, `frame`, `arm` [m], `radius` [m], `thrust_max` [N]."""

    name: str | None = None
    mass: float | None = None
    mass_tolerance: float | None = None
    frame: str | None = None
    arm: float | None = None
    radius: float | None = None
    thrust_max: float | None = None

    def __post_init__(self) -> None:
        check_types(type(self), vars(self))

    def check(self) -> None:
        """Raise UsageError for sizes that no vehicle has, for a frame that there is not or without an arm's length."""
        options = {"--mass": self.mass, "--mass-tolerance": self.mass_tolerance, "--arm": self.arm}
        options |= {"--rotor-radius": self.radius, "--thrust-max": self.thrust_max}
        for option, value in options.items():
            if value is not None and not BOUNDS.smallest <= value <= BOUNDS.largest:
                raise UsageError(
                    f"{option} {value:g}: expected a positive number, {BOUNDS.smallest:g} to {BOUNDS.largest:g}"
                )
        if self.frame is not None and self.frame not in FRAMES:
            raise UsageError(f"--frame {self.frame}: expected one of {', '.join(FRAMES)}")
        if self.frame is not None and self.arm is None:
            raise UsageError(f"--frame {self.frame}: say its size too, --arm METRES from the middle to a motor")


def draft_of_source(source: Path | None, user: Given, budget: Budget | str | None = None) -> Draft:
    """The draft of a source, with the values of the user in place of its own; `completed` completes it.

    `budget` is what reading a log may take (`flight.budget`).
    Raises UsageError for a source of a kind that is not read, ModelError and LogError for one that says nothing.
    """
    user.check()
    if source is None:
        return _over(Draft(user.name or "vehicle", "your answers"), user)
    if source.is_dir():
        raise UsageError(f"--from {source}: is a folder; expected a file: {KINDS}")
    if not source.is_file():
        raise UsageError(f"--from {source}: no such file; expected {KINDS}")
    match source.suffix.lower():
        case ".ulg":
            return _ulog(source, user, budget)
        case ".bin" | ".param" | ".params" | ".parm":
            return _ardupilot(source, user, budget)
        case ".csv" | ".parquet":
            return _table(source, user, budget)
        case suffix if suffix in DESCRIPTIONS:
            return _over(_described(source), user)
        case ".py" | ".toml":
            return _package(source, user)
        case ".xacro":
            raise UsageError(f"--from {source}: a macro; expand it first, `xacro {file_word(source)} > FILE.urdf`")
    raise UsageError(
        f"--from {source}: is of a kind that says nothing of its vehicle; expected {KINDS}. Without --from, --mass, "
        "--frame and --arm describe it, or --interactive asks"
    )


def _over(draft: Draft, user: Given) -> Draft:
    """The draft with the values of the user in place of those of the source."""
    rotors, effects = draft.rotors, draft.effects
    if user.frame is not None and user.arm is not None:
        rotors, effects = rotors_of(user.frame, user.arm, f"--frame {user.frame} --arm {user.arm:g}"), ()
    if user.radius is not None:
        radius = Sourced(user.radius, "--rotor-radius")
        rotors = tuple(replace(r, radius=radius) for r in rotors)
    mass = draft.mass
    if user.mass is not None:
        mass = Sourced(user.mass, "--mass", tolerance=user.mass_tolerance)
    inertia = draft.inertia
    if user.mass is not None and draft.mass is not None and inertia is not None:
        share = user.mass / float(draft.mass.value)
        scaled = np.asarray(inertia.value) * share
        words = f"{inertia.source}, times {share:.4g} for --mass"
        inertia = Sourced(tuple(map(tuple, scaled.tolist())), words, inertia.assumed)
    command = draft.command
    if user.thrust_max is not None:
        full = Sourced(user.thrust_max, "--thrust-max")
        rotors = tuple(replace(r, thrust_max=full) for r in rotors)
        command = None if command is None else replace(command, thrust_max=full)
    name = user.name or draft.name
    return replace(draft, name=name, rotors=rotors, mass=mass, inertia=inertia, command=command, effects=effects)


def _ulog(source: Path, user: Given, budget: Budget | str | None) -> Draft:
    from wrenchgap.flight.formats.ulog import parameters

    logged, flown, notes = parameters(source, budget), *_flown(source, budget)
    unit = "normalised" if px4.has_geometry(logged) else "pwm"
    rotors = () if user.frame else px4.rotors_of(logged, source.name, user.arm)
    if flown is not None and flown.actuators is not None:
        sent = flown.actuators.rotor_speed.shape[1]
        if rotors and sent and sent != len(rotors):
            raise ModelError(f"{flown.path.name}: CA_ROTOR_COUNT is {len(rotors)}, {sent} motors are commanded")
        unit = unit if flown.actuators.unit == "rad/s" else flown.actuators.unit
    draft = Draft(
        source.stem,
        source.name,
        rotors,
        com=px4.com_of(logged),
        imu_position=px4.imu_of(logged),
        command=px4.command_of(logged, unit),
        notes=(
            *px4.notes_of(logged, source.name),
            *px4.frame_notes(logged, user.frame, source.name),
            *px4.arm_notes(logged, user.arm, source.name),
            *notes,
        ),
    )
    return _level(_over(draft, user), flown)


def _ardupilot(source: Path, user: Given, budget: Budget | str | None) -> Draft:
    from wrenchgap.flight.formats import dataflash

    log = source.suffix.lower() == ".bin"
    logged = dataflash.parameters(source, budget) if log else ardupilot.read_parameters(source)
    flown, notes = _flown(source, budget) if log else (None, ())
    text = "" if flown is None or flown.autopilot is None else flown.autopilot.frame
    rotors = () if user.frame else ardupilot.rotors_from(logged, user.arm, source.name, text)
    draft = Draft(
        source.stem,
        source.name,
        rotors,
        imu_position=px4.imu_of(logged, "INS_POS1", "ArduPilot"),
        command=ardupilot.command_of(logged),
        notes=(*ardupilot.frame_notes(logged, text, user.frame, source.name), *notes),
    )
    return _level(_over(draft, user), flown)


def parameters_of(path: Path, budget: Budget | str | None = None) -> dict[str, float]:
    """Parameters of an autopilot in a log or a file; UsageError for another kind, LogError, ModelError."""
    from wrenchgap.flight.formats import dataflash, ulog

    if not path.is_file():
        raise UsageError(f"{path}: no such file; expected a log of PX4 or ArduPilot, or its parameters")
    match path.suffix.lower():
        case ".ulg":
            return dict(ulog.parameters(path, budget))
        case ".bin" | ".log":
            return dict(dataflash.parameters(path, budget))
        case ".param" | ".params" | ".parm":
            return ardupilot.read_parameters(path)
    raise UsageError(f"{path}: expected parameters of an autopilot: .ulg (PX4), .bin or .log (ArduPilot), .params")


def _table(source: Path, user: Given, budget: Budget | str | None) -> Draft:
    """Of a table of shares of full throttle (Betaflight, INAV), the thrust curve; the vehicle is as the user says."""
    flown, notes = _flown(source, budget)
    if flown is not None and flown.firmware == CRAZYFLIE and user.frame not in (None, CRAZYFLIE_FRAME):
        raise UsageError(
            f"--frame {user.frame}: {source.name} has the columns of the Crazyflie's firmware, whose motors M1 to M4 "
            f"go clockwise from the front right: say --frame {CRAZYFLIE_FRAME}. The Crazyflie itself needs no new "
            "model: -m crazyflie"
        )
    draft = Draft(source.stem, source.name, notes=notes)
    if flown is None or flown.actuators is None or flown.actuators.unit != "normalised":
        return _over(draft, user)
    shape = Sourced(1.0, "propellers as usual: thrust with the square of the command", assumed=True)
    keys = {"unit": Sourced("normalised", f"{flown.actuators.topic}: 0 to 1"), "factor": shape}
    hover = Sourced(0.25, "hovering at half throttle", assumed=True)
    return _level(_over(replace(draft, command=CommandDraft(keys, hover=hover)), user), flown)


def _level(draft: Draft, flown: Flight | None) -> Draft:
    """The draft with the flight's rate, and with the level of its thrust curve from the flight unless it is known."""
    if flown is None:
        return draft
    rates = [1.0 / series.period for series in (flown.imu, flown.actuators) if series is not None]
    draft = replace(draft, slowest_hz=min(rates, default=None))
    has_level = draft.command is None or draft.command.thrust_max is not None
    return draft if has_level else with_fitted_thrust(draft, flown)


def _flown(source: Path, budget: Budget | str | None) -> tuple[Flight | None, tuple[str, ...]]:
    """The flight of a log, or None and the reason: the parameters alone may suffice."""
    try:
        return flight.load(source, budget=budget), ()
    except (LogError, UsageError) as error:
        return None, (f"the flight itself could not be read ({error}); parameters only.",)


def _described(source: Path, most_nested: int = 200) -> Draft:
    """The draft of a robot description, which its root element tells; readers of deeper ones run out of stack."""
    try:
        document = ElementTree.parse(source).getroot()
    except OSError as error:
        raise ModelError(f"{source}: cannot be read: {error.strerror}") from None
    except (ElementTree.ParseError, LookupError, ValueError) as error:  # the latter of its encoding
        raise ModelError(f"{source.name}: is not XML: {error}") from None
    if _depth(document) > most_nested:
        raise ModelError(f"{source.name}: elements lie in one another more than {most_nested} deep")
    with np.errstate(all="ignore"):  # numbers beyond all sizes are refused once they are all together
        match document.tag:
            case "robot":
                return compiled.from_urdf(source, document)
            case "sdf" | "model":
                return sdf.from_sdf(source, document)
            case "mujoco":
                return compiled.from_mjcf(source)
    raise ModelError(f"{source.name}: begins with <{document.tag}>, expected <robot> (URDF), <sdf> or <mujoco>")


def _depth(document: ElementTree.Element) -> int:
    """How deep elements lie in one another."""
    level, depth = [document], 0
    while level:
        level, depth = [child for element in level for child in element], depth + 1
    return depth


def _package(source: Path, user: Given) -> Draft:
    """The draft of parameters of a simulator in Python, which say where the rotors are."""
    if user.frame is not None:
        raise UsageError(f"--frame {user.frame}: {source.name} says where its rotors are; leave --frame and --arm out")
    if source.suffix.lower() == ".py":
        return _over(rotorpy.from_rotorpy(source), user)
    return _over(drone_models.from_drone_models(source, user.name, user.mass), user)


def beside(source: Path | None) -> list[Path]:
    """Files that are read with a robot description: those that an MJCF includes and names."""
    if source is None or source.suffix.lower() not in DESCRIPTIONS:
        return []
    if ElementTree.parse(source).getroot().tag != "mujoco":
        return []
    return sorted(path for path in compiled.files_of(source) if path.is_file())


Ask = Callable[[str, type, str | None, Sequence[str]], str]
"""Asks a question: words, kind (float or str), default (None: an answer is needed, "": it may stay open), choices."""
WAYS = {"ccw": 1, "cw": -1}


def answers(values: dict[str, float | str | None], draft: Draft, ask: Ask) -> dict[str, float | str | None]:
    """The values of the user, with answers to questions about what neither they nor the draft have."""
    out = dict(values)
    if draft.mass is None and out["mass"] is None:
        out["mass"] = float(ask("What does it weigh, with its battery [kg]?", float, None, ()))
        tolerance = ask("How well is that known [kg]? Leave empty if not.", float, "", ())
        out["mass_tolerance"] = float(tolerance) if tolerance else None
    if not draft.rotors and out["frame"] is None:
        out["frame"] = ask("Which frame, in your autopilot's order of motors?", str, "quad_x", tuple(FRAMES))
        out["arm"] = float(ask("How far is it from the middle to a motor [m]?", float, None, ()))
    if out["radius"] is None and (not draft.rotors or any(r.radius is None for r in draft.rotors)):
        radius = ask("Radius of the rotors [m]? Leave empty for an estimate.", float, "", ())
        out["radius"] = float(radius) if radius else None
    if out["thrust_max"] is None and (draft.command is None or draft.command.thrust_max is None):
        most = ask("Thrust of one rotor at full throttle [N]? Leave empty for an estimate.", float, "", ())
        out["thrust_max"] = float(most) if most else None
    return out


def with_spins(draft: Draft, ask: Ask) -> Draft:
    """The draft with the turning directions, as answered, of rotors of which they were assumed."""
    rotors = []
    for rotor in draft.rotors:
        if rotor.spin.assumed:
            usual = "ccw" if rotor.spin.value > 0 else "cw"
            x, y = rotor.position_B.value[:2]
            words = f"How does {rotor.name or 'the rotor'} at x {x:.3f} m, y {y:.3f} m turn, seen from above?"
            rotor = replace(rotor, spin=Sourced(WAYS[ask(words, str, usual, tuple(WAYS))], "your answer"))
        rotors.append(rotor)
    return replace(draft, rotors=tuple(rotors))
