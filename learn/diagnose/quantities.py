"""What a flight was doing, sample by sample: quantities that a user can act on, and groups of inputs to regress on.

    up_B        = R_EB^T e_z                                    third row of R_EB
    tilt        = arccos(up_B . e_z)
    direction   = atan2(-up_By, -up_Bx)                         the side of the body that is down: 0 nose, 90 deg left
    heading     = 2 atan2(q_z, q_w)                             what is left when the shortest rotation undoes the tilt

The direction of tilt is given in the body, because that says which arms are low (a weak rotor, an offset of the centre
of mass); what is fixed in the world (wind, a magnet, a cable) shows in the heading. The heading is the twist about the
vertical of the swing-twist decomposition (Dobrowolski, "Swing-twist decomposition in Clifford algebra", 2015), which
has no singularity at 90 deg of tilt, only upside down.

The commanded torque is no quantity to sort by: a feedback controller answers every disturbance with it, so that it goes
with whatever is wrong.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from wrenchgap.flight import so3
from wrenchgap.flight.flight import AXES, Array
from wrenchgap.learn.data.dataset import Dataset
from wrenchgap.learn.data.measurement import Record, derivative, low_pass

NO_POSE = "the log has no pose and velocity; map them with --topic odometry=/your/topic"
NO_VOLTAGE = "the log has no battery voltage; map it with --topic battery=/your/topic"
NO_ARMS = "no arm of this vehicle tilts, or no tilt commands are known"


@dataclass(frozen=True)
class Quantity:
    """One number for each of K samples, `values` (K,) in `unit`; not a number where it has no meaning.

    A `circular` quantity is an angle in degrees that wraps at +-180.
    """

    name: str
    label: str
    unit: str
    values: Array
    circular: bool = False


@dataclass(frozen=True)
class InputGroup:
    """Inputs that belong together: names of the `columns`, unique among all groups, and `values` (K, D), SI."""

    name: str
    label: str
    columns: tuple[str, ...]
    values: Array


def quantities(data: Dataset, level_deg: float = 3.0) -> tuple[tuple[Quantity, ...], dict[str, str]]:
    """Quantities that these flights have, and why others are missing; a tilt below `level_deg` has no direction."""
    omega = _stacked(data, lambda r: r.state_kept.omega_B)
    found = [
        Quantity("thrust", "commanded |F|", "N", np.linalg.norm(data.commanded[:, :3], axis=1)),
        Quantity("rate", "body rate", "rad/s", np.linalg.norm(omega, axis=1)),
        *(Quantity(f"rate_{a}", f"omega_{a}", "rad/s", omega[:, i]) for i, a in enumerate("xyz")),
        Quantity("time", "time in flight", "s", _stacked(data, lambda r: r.time)),
    ]
    lacking: dict[str, str] = {}
    if _posed(data):
        quat = _stacked(data, lambda r: r.state_kept.quat_EB)
        up = so3.matrix(quat)[:, 2]
        tilt = np.degrees(so3.tilt_angle(quat))
        side = np.where(tilt > level_deg, np.degrees(np.arctan2(-up[:, 1], -up[:, 0])), np.nan)
        speed = np.linalg.norm(_stacked(data, lambda r: r.state_kept.velocity_E), axis=1)
        found[:0] = [
            Quantity("tilt", "tilt", "deg", tilt),
            Quantity("direction", "tilt direction", "deg", side, circular=True),
            Quantity("heading", "heading", "deg", np.degrees(heading(quat)), circular=True),
        ]
        found += [
            Quantity("speed", "speed", "m/s", speed),
            Quantity("height", "height", "m", _stacked(data, lambda r: r.state_kept.position_E)[:, 2]),
        ]
    else:
        lacking |= dict.fromkeys(("tilt", "direction", "heading", "speed", "height"), NO_POSE)
    rates = _tilt_rates(data)
    if rates is None:
        lacking["arm_rate"] = NO_ARMS
    else:
        found.append(Quantity("arm_rate", "arm tilt rate, rms", "rad/s", np.sqrt(np.mean(rates**2, axis=1))))
    if all(r.has_voltage for r in data.records):
        found.append(Quantity("voltage", "battery voltage", "V", _voltage(data)))
    else:
        lacking["voltage"] = NO_VOLTAGE
    for q in [q for q in found if not _moves(q)]:
        found.remove(q)
        lacking[q.name] = "it hardly changes in these flights"
    return tuple(found), lacking


def input_groups(data: Dataset) -> tuple[tuple[InputGroup, ...], dict[str, str]]:
    """Groups of inputs on which an error may depend, and why others are missing (name to reason)."""
    wrench_rate = _stacked(data, lambda r: _rate(r, r.commands.wrench_B))
    found = [
        InputGroup("command", "commanded wrench", tuple(f"commanded {a}" for a in AXES), data.commanded),
        InputGroup("command_rate", "rate of the command", tuple(f"d({a})/dt" for a in AXES), wrench_rate),
        InputGroup("rates", "body rates", _xyz("omega"), _stacked(data, lambda r: r.state_kept.omega_B)),
    ]
    lacking: dict[str, str] = {}
    if _posed(data):
        quat = _stacked(data, lambda r: r.state_kept.quat_EB)
        velocity = so3.rotate_inverse(quat, _stacked(data, lambda r: r.state_kept.velocity_E))
        angle = heading(quat)
        circle = np.column_stack((np.sin(angle), np.cos(angle)))
        height = _stacked(data, lambda r: r.state_kept.position_E)[:, 2:]
        found += [
            InputGroup("velocity", "velocity in B", _xyz("velocity"), velocity),
            InputGroup("attitude", "tilt and its direction", _xyz("down"), -so3.matrix(quat)[:, 2]),
            InputGroup("heading", "heading", ("sin heading", "cos heading"), circle),
            InputGroup("height", "height", ("height",), height),
        ]
    else:
        lacking |= dict.fromkeys(("velocity", "attitude", "heading", "height"), NO_POSE)
    rates = _tilt_rates(data)
    if rates is None:
        lacking["arm_rates"] = NO_ARMS
    else:
        names = tuple(f"tilt rate {a}" for a in range(1, rates.shape[1] + 1))
        found.append(InputGroup("arm_rates", "tilt rates of the arms", names, rates))
    found.append(InputGroup("time", "time in flight", ("time",), _stacked(data, lambda r: r.time)[:, None]))
    if all(r.has_voltage for r in data.records):
        found.append(InputGroup("voltage", "battery voltage", ("voltage",), _voltage(data)[:, None]))
    else:
        lacking["voltage"] = NO_VOLTAGE
    return tuple(found), lacking


def heading(quat_EB: Array) -> Array:
    """Heading [rad] in (-pi, pi] of attitudes (K, 4): the twist about the vertical."""
    angle = 2.0 * np.arctan2(quat_EB[:, 3], quat_EB[:, 0])
    return np.asarray(np.pi - (np.pi - angle) % (2.0 * np.pi))


def _posed(data: Dataset) -> bool:
    return all(r.has_pose for r in data.records)


def _xyz(name: str) -> tuple[str, ...]:
    return tuple(f"{name}_{a}" for a in "xyz")


def _stacked(data: Dataset, of: Callable[[Record], Array]) -> Array:
    return np.concatenate([of(r) for r in data.records])


def _voltage(data: Dataset) -> Array:
    return _stacked(data, lambda r: np.asarray(r.state_kept.voltage))


def _rate(record: Record, raw: Array) -> Array:
    """Derivative (K, C) of a filtered signal, of its raw samples (N, C)."""
    return derivative(low_pass(raw, record.dt, record.cutoff_hz), record.dt)[record.keep]


def _tilt_rates(data: Dataset) -> Array | None:
    """Filtered rates (K, A) [rad/s] of the arms' commanded angles that move at all; None where there is none."""
    if any(r.commands.tilt is None for r in data.records):
        return None
    rates = _stacked(data, lambda r: _rate(r, np.unwrap(np.asarray(r.commands.tilt), axis=0)))
    moving = np.ptp(rates, axis=0) > 1e-6
    return np.asarray(rates[:, moving]) if moving.any() else None


def _moves(quantity: Quantity) -> bool:
    """Whether there is anything to sort by."""
    known = quantity.values[np.isfinite(quantity.values)]
    return known.size > 0 and float(np.ptp(known)) > 1e-6 * (1.0 + float(np.abs(known).max()))
