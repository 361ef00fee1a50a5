"""What `explain` answers on a log that was not refused, against what the engine flew.

The vehicles of `benchmarks.meaning.flying` have rotors that follow with a first-order lag of 30 ms, linear drag of 0.12
1/s per mass, the same in every direction, and a biased IMU; nothing else is hidden. An answer is wrong where a firm
effect is none of these, or where the lag or a drag coefficient is off by more than `STANDARD` standard deviations as
stated.
"""

from __future__ import annotations

from dataclasses import dataclass

from benchmarks.meaning.flying import DRAG
from wrenchgap import explain
from wrenchgap.flight.errors import WrenchgapError
from wrenchgap.learn.data.opening import OpenFlight
from wrenchgap.plant.model import Model

LAG = 0.03  # s
NAMES = (
    *("motor_lag", "command_delay", "body_drag", "rotor_drag", "com_offset", "thrust_scale", "mass", "inertia"),
    *("drag_torque", "imu_misalignment", "imu_lever_arm", "accelerometer_bias", "constant_wrench"),
)
"""What is tried: what there is, and what the faults look like."""
TRUE = ("motor_lag", "body_drag", "rotor_drag", "accelerometer_bias")
"""What may be named firmly; drag of rotors at hovering speed is drag of the body."""
STANDARD = 3.0


@dataclass(frozen=True)
class Answer:
    """`firm` effects, and in words what of them is `wrong`, "" where nothing is."""

    firm: tuple[str, ...]
    wrong: str


def answer(opened: OpenFlight, model: Model) -> Answer:
    """What `explain` says of one flight; an answer that is refused is none."""
    try:
        found = explain([opened], model, names=NAMES, jobs=1)
    except WrenchgapError as error:
        return Answer((), f"refused: {error}" if "internal" in str(error) else "")
    firm = tuple(found.to_json()["firm"])
    off = [name for name in firm if name not in TRUE]
    mass = model.vehicle.body.mass
    truth = {"tau": LAG, "linear_x": DRAG * mass, "linear_y": DRAG * mass, "linear_z": DRAG * mass}
    for row in found.to_json()["fitted"]:
        if row["effect"] not in ("motor_lag", "body_drag") or row["effect"] not in firm:
            continue
        for one in row["parameters"]:
            if one["name"] in truth and abs(one["value"] - truth[one["name"]]) > STANDARD * one["std"]:
                off.append(f"{row['effect']}.{one['name']} {one['value']:.3g} +- {one['std']:.2g}")
    return Answer(firm, ", ".join(off))
