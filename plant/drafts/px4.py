"""A vehicle from the parameters of PX4: CA_ROTOR* and related ones.

PX4's body frame is x forward, y right, z down, so (x, y, z) there is (x, -y, -z) in B. CA_ROTORn_PX, _PY, _PZ [m] are
from the centre of mass, _AX, _AY, _AZ is the direction of the thrust (0, 0, -1: up), _KM the torque per thrust [m],
positive for a rotor that turns counter-clockwise about its thrust. CT is relative to u^2 and 6.5 wherever nobody set
it, so it is not taken for newtons.

The motor command u of `actuator_motors` is what PX4 takes for a share of full thrust where THR_MDL_FAC is set: it sends
the ESCs the root of f s^2 + (1 - f) s = u. With THR_MDL_FAC = 0 it sends u itself, and thrust goes rather with u^2.
Source: PX4 parameter reference and "Control Allocation" (docs.px4.io).
"""

import re
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from wrenchgap.flight.errors import ModelError
from wrenchgap.plant.drafts.ardupilot import rotors_of as usual_frame
from wrenchgap.plant.drafts.draft import CommandDraft, RotorDraft, Sourced, parameter

Parameters = Mapping[str, float]
MULTIROTORS = {0: "multirotor", 7: "motors in all directions", 8: "multirotor with tilt"}
"""CA_AIRFRAME of what rotors alone carry."""
DEFAULTS = {"KM": 0.05, "MPC_THR_HOVER": 0.5}
"""PX4's defaults of CA_ROTOR*_KM and MPC_THR_HOVER."""
MOST_ROTORS = 12
"""Of PX4: it has no output functions of further motors. More are of a damaged log."""


def flipped(x: float, y: float, z: float) -> tuple[float, float, float]:
    """From PX4's body frame (forward, right, down) to B (forward, left, up)."""
    return (float(x), -float(y) + 0.0, -float(z) + 0.0)


def has_geometry(parameters: Parameters) -> bool:
    """Whether the parameters describe rotors: firmware since 1.13."""
    return 0 < int(parameters.get("CA_ROTOR_COUNT", 0)) <= MOST_ROTORS


def rotors_of(parameters: Parameters, where: str, arm: float | None = None) -> tuple[RotorDraft, ...]:
    """Rotors as CA_ROTOR* have them, empty without such parameters.

    PX4 needs the ratios of their places alone: with the length of an `arm` [m] the farthest is there. Raises ModelError
    for a rotor without a direction, and for places that nobody measured.
    """
    if not has_geometry(parameters):
        return ()
    keys = [f"CA_ROTOR{k}_P{a}" for k in range(int(parameters["CA_ROTOR_COUNT"])) for a in "XY"]
    absent = [key for key in keys if key not in parameters]
    if 0 < len(absent) < len(keys):  # of another rotor it is there: PX4 has all of them
        raise ModelError(
            f"{where}: {', '.join(absent)} is not a number; expected one for each rotor: is the log damaged?"
        )
    found = tuple(_rotor(parameters, number, where) for number in range(int(parameters["CA_ROTOR_COUNT"])))
    if arm is not None:
        farthest = max(float(np.linalg.norm(r.position_B.value[:2])) for r in found)
        if farthest <= 0.0:
            raise ModelError(f"{where}: CA_ROTOR* have all rotors in the middle: --arm cannot say where they are")
        scaled, words = arm / farthest, f"scaled to --arm {arm:g}"
        places = [(tuple(scaled * x for x in r.position_B.value), f"{r.position_B.source}; {words}") for r in found]
        return tuple(replace(r, position_B=Sourced(*place)) for r, place in zip(found, places, strict=True))
    if placeholders(parameters):
        raise ModelError(
            f"{where}: CA_ROTOR* have rotors at 1 m forward and 1 m to the side, as where nobody measured them (PX4 "
            "needs their ratios alone); measure from the middle to a motor and say --arm METRES"
        )
    return found


def placeholders(parameters: Parameters) -> bool:
    """Whether the farthest rotor is at one metre along x and along y: ratios, not lengths."""
    numbers = range(int(parameters["CA_ROTOR_COUNT"])) if has_geometry(parameters) else ()
    return all(
        max((abs(parameters.get(f"CA_ROTOR{k}_P{axis}", 0.0)) for k in numbers), default=0.0) == 1.0 for axis in "XY"
    )


def _rotor(parameters: Parameters, number: int, where: str) -> RotorDraft:
    name = f"CA_ROTOR{number}"

    def read(key: str, default: float = 0.0) -> float:
        return float(parameters.get(f"{name}_{key}", default))

    axis = np.array(flipped(read("AX"), read("AY"), read("AZ", -1.0)))
    length = float(np.linalg.norm(axis))
    if length < 1e-6:
        raise ModelError(
            f"{where}: {name}_AX, _AY, _AZ are all zero, so the rotor has no direction; set them and log anew"
        )
    km = read("KM", DEFAULTS["KM"])
    usual = abs(abs(km) - DEFAULTS["KM"]) < 1e-6
    words = f"{name}_KM = {km:.4g}" + (", which is PX4's default" if usual else "")
    return RotorDraft(
        Sourced(flipped(read("PX"), read("PY"), read("PZ")), f"{name}_PX, _PY, _PZ; forward, left, up"),
        Sourced(tuple((axis / length + 0.0).tolist()), f"{name}_AX, _AY, _AZ"),
        Sourced(1 if km >= 0.0 else -1, f"{name}_KM {'positive' if km >= 0.0 else 'negative'}"),
        kappa=Sourced(abs(km), words, assumed=usual) if km else None,
        name=f"M{number + 1}",
    )


def imu_of(parameters: Parameters, prefix: str = "EKF2_IMU_POS", autopilot: str = "PX4") -> Sourced | None:
    """Position of the IMU by the parameters `prefix`_X, _Y, _Z, in forward, right, down; None without them."""
    if f"{prefix}_X" not in parameters:
        return None
    at = flipped(*(parameter(parameters, f"{prefix}_{axis}", 0.0, -10.0, 10.0) for axis in "XYZ"))  # [m]
    words = f"{prefix}_X, _Y, _Z" + ("" if any(at) else f", which are {autopilot}'s default")
    return Sourced(at, words, assumed=not any(at))


def com_of(parameters: Parameters) -> Sourced | None:
    """The centre of mass, from which PX4 gives the rotors."""
    return Sourced((0.0, 0.0, 0.0), "CA_ROTOR* are from the centre of mass") if has_geometry(parameters) else None


def command_of(parameters: Parameters, unit: str = "normalised") -> CommandDraft:
    """[command] for `actuator_motors`, or for pulse widths where `unit` is "pwm" (older firmware)."""
    factor = parameter(parameters, "THR_MDL_FAC", 0.0, 0.0, 1.0)
    keys = {"unit": Sourced(unit, "actuator_motors: 0 to 1" if unit == "normalised" else "actuator_outputs [us]")}
    square = "THR_MDL_FAC is 0: PX4 does not linearise, propellers as usual: thrust with the square"
    if unit == "pwm":
        low, high = (float(parameters.get(f"PWM_{end}", usual)) for end, usual in (("MIN", 1000.0), ("MAX", 2000.0)))
        keys["range"] = Sourced([low, high], "PWM_MIN, PWM_MAX", assumed="PWM_MIN" not in parameters)
        shape = Sourced(factor or 1.0, "THR_MDL_FAC" if factor else square, assumed=not factor)
    elif factor > 0.0:
        shape = Sourced(0.0, f"THR_MDL_FAC = {factor:.3g}: PX4 commands shares of thrust")
    else:
        shape = Sourced(1.0, f"{square} of the command", assumed=True)
    default = DEFAULTS["MPC_THR_HOVER"]
    hover = float(parameters.get("MPC_THR_HOVER", default))
    origin = "" if hover != default and "MPC_THR_HOVER" in parameters else ", which is PX4's default"
    share = hover if shape.value == 0.0 else float(shape.value) * hover**2 + (1.0 - float(shape.value)) * hover
    words = f"hovering at MPC_THR_HOVER = {hover:.3g}{origin}"
    return CommandDraft({**keys, "factor": shape}, hover=Sourced(share, words, assumed=bool(origin)))


def notes_of(parameters: Parameters, where: str) -> tuple[str, ...]:
    """Notes on these parameters for the user."""
    found = []
    kind = int(parameters.get("CA_AIRFRAME", 0))
    if kind not in MULTIROTORS:
        found.append(f"{where}: CA_AIRFRAME is {kind}, no multirotor: wings and control surfaces are not in the model.")
    tilting = [k for k in parameters if re.fullmatch(r"CA_ROTOR\d+_TILT", k) and parameters[k]]
    if tilting:
        found.append(
            f"{where}: {', '.join(sorted(tilting))} say that rotors tilt; they are fixed in the model: edit it."
        )
    return tuple(found)


def arm_notes(parameters: Parameters, arm: float | None, where: str, nearly: float = 0.05) -> tuple[str, ...]:
    """A note where `arm` [m] differs by more than the share `nearly` from the one that CA_ROTOR* have as a length."""
    if arm is None or not has_geometry(parameters) or placeholders(parameters):
        return ()
    farthest = max(float(np.linalg.norm(r.position_B.value[:2])) for r in rotors_of(parameters, where))
    if abs(arm - farthest) <= nearly * farthest:
        return ()
    return (f"{where}: CA_ROTOR* have the farthest motor {farthest:.3g} m from the middle, --arm {arm:g} is used",)


def frame_notes(parameters: Parameters, typed: str | None, where: str, nearly: float = 0.97) -> tuple[str, ...]:
    """A note where CA_ROTOR* have motors elsewhere than the frame that was typed; ModelError where it has other rotors.

    Motors are elsewhere where directions from the middle differ by a cosine below `nearly`, 14 deg.
    """
    logged = rotors_of(parameters, where, 1.0)
    if typed is None or not logged:
        return ()
    frame = usual_frame(typed, 1.0, "")
    if len(frame) != len(logged):
        raise ModelError(
            f"--frame {typed}: has {len(frame)} rotors, and {where} has CA_ROTOR_COUNT {len(logged)}; leave --frame "
            "out, or say one of as many"
        )
    places = (np.array([r.position_B.value[:2] for r in rotors], dtype=float) for rotors in (logged, frame))
    directions = [at / np.maximum(np.linalg.norm(at, axis=1, keepdims=True), 1e-9) for at in places]
    if np.all(np.sum(directions[0] * directions[1], axis=1) > nearly):
        return ()
    return (f"{where}: CA_ROTOR* have the motors elsewhere than --frame {typed}, which is used: which is flown?",)
