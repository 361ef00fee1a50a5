"""A vehicle from a tree of bodies, the common form of robot descriptions (URDF, SDF, MJCF).

Everything is in the frame of the root body at rest, which is B: x forward, y left, z up (REP 103). Mass properties are
those of all bodies together,

    m = sum m_i,   c = sum m_i c_i / m,   J = sum [J_i + m_i (|d_i|^2 I - d_i d_i^T)],   d_i = c_i - c

(parallel axes). Rotors are what a motor plugin or an actuator names, else leaf bodies on joints that turn without
limit. An arm tilts where a joint with limits lies between a rotor and the root.

Motor plugins are those of Gazebo in SDF and URDF, classic (`libgazebo_motor_model.so` of RotorS and PX4) and new
(`gz-sim-multicopter-motor-model-system`): thrust motorConstant omega^2 [N s^2] along the link's z axis, torque
momentConstant thrust [m] against the turning direction, which is seen from above the link. The speed follows with
timeConstantUp and _Down, which is a lag of the rotors, and -|omega| rotorDragCoefficient v across the rotor is
`rotor_drag`. Source: RotorS, gazebo_motor_model; gz-sim, MulticopterMotorModel.
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal
from xml.etree.ElementTree import Element

import numpy as np

from wrenchgap.flight.errors import ModelError
from wrenchgap.flight.flight import Array
from wrenchgap.plant.drafts.draft import Draft, EffectDraft, RotorDraft, Sourced, Tilt
from wrenchgap.plant.drafts.package_tables import lag_effect, notes_of
from wrenchgap.plant.vehicle import GRAVITY

Joint = Literal["fixed", "hinge", "turning", "other"]
"""How a body is joined to its parent: not, by a hinge with limits, by one without, otherwise."""


@dataclass(frozen=True, eq=False)
class Link:
    """One body: frame (`position` (3,), `rotation` (3, 3)), mass properties about its own centre, and its joint.

    All in the frame of the root; `parent` is the index of another body, -1 of the root. `axis` (3,) is the joint's,
    `limits` [rad] those of a hinge.
    """

    name: str
    parent: int
    position: Array
    rotation: Array
    mass: float
    centre: Array
    inertia: Array
    joint: Joint = "fixed"
    axis: Array | None = None
    limits: tuple[float, float] = (-np.inf, np.inf)
    joint_name: str = ""


@dataclass(frozen=True, eq=False)
class Motor:
    """A rotor as a plugin or an actuator describes it, and its place if that is not its link's frame.

    `lag` are time constants up and down [s], `drag` the coefficient of `rotor_drag`.
    """

    spin: Sourced | None = None
    kappa: Sourced | None = None
    c_f: Sourced | None = None
    speed_max: Sourced | None = None
    thrust_max: Sourced | None = None
    number: int | None = None
    position: Array | None = None
    direction: Array | None = None
    lag: tuple[float, float] | None = None
    drag: float | None = None


def draft_of(name: str, origin: str, links: Sequence[Link], motors: Mapping[int, Motor], kind: str) -> Draft:
    """A draft of bodies, the root first. `motors` are known rotors by the index of their body, `kind` the format."""
    rows = sorted(motors, key=lambda k: (motors[k].number is None, motors[k].number or 0, k))
    notes = []
    if not rows:
        parents = {one.parent for one in links}
        rows = [k for k, one in enumerate(links) if one.joint == "turning" and k not in parents]
        notes.append(
            f"{origin}: names no motors; the {len(rows)} bodies that turn without limit are taken for rotors, in "
            "the order of the file."
        )
    if not rows:
        raise ModelError(
            f"{origin}: no rotors found among {len(links)} bodies: neither motor plugins, actuators on sites, nor "
            "joints that turn without limit; describe them by hand in a model file (docs/model-file.md)"
        )
    limit = 1e9  # no mass, length or inertia of a vehicle is larger in SI
    for one in links:
        numbers = (one.position, one.rotation, one.centre, one.inertia, np.array([one.mass]))
        if not all(np.isfinite(part).all() and np.abs(part).max(initial=0.0) < limit for part in numbers):
            raise ModelError(f"{origin}: {one.name}: mass, inertia and place must be numbers below {limit:g}")
    mass, centre, inertia = combined_mass_properties(links)
    if mass <= 0.0:
        raise ModelError(f"{origin}: the bodies have no mass; say what the vehicle weighs with --mass KG and --frame")
    words = f"{len(links)} bodies of the {kind}"
    rotors = tuple(_rotor(k, number, links, motors.get(k, Motor()), kind) for number, k in enumerate(rows))
    effects, uneven = _effects([motors.get(k, Motor()) for k in rows], mass, kind)
    notes += [f"{origin}: {words}" for words in uneven] + list(notes_of(origin, (), effects))
    return Draft(
        name,
        origin,
        rotors,
        mass=Sourced(mass, f"sum of {words}"),
        inertia=Sourced(tuple(map(tuple, inertia.tolist())), f"{words} about their centre of mass, joints at rest"),
        com=Sourced(tuple(centre.tolist()), words),
        notes=tuple(notes),
        effects=effects,
    )


def _effects(motors: Sequence[Motor], mass: float, kind: str) -> tuple[tuple[EffectDraft, ...], list[str]]:
    """The lag and the drag of rotors that all say theirs, and in words what of that is not taken as it stands.

    A lag of more than 1 s, or a drag that takes the weight at 1 m/s, belongs to another vehicle: files are copied.
    """
    rows = [(*(one.lag or (np.nan, np.nan)), np.nan if one.drag is None else one.drag) for one in motors]
    values, notes = np.array(rows), []
    up, down, drag = np.nan_to_num(values.mean(axis=0)).tolist()
    names = ("timeConstantUp", "timeConstantDown", "rotorDragCoefficient")
    differ = [n for n, one in zip(names, values.T, strict=True) if np.ptp(one) > 1e-3 * np.abs(one).max()]
    if differ:
        notes.append(f"{', '.join(differ)} of motors differ; the mean is taken.")
    share = mass * GRAVITY / len(motors)
    at_rest = [np.sqrt(share / float(one.c_f.value)) for one in motors if one.c_f is not None]
    if drag and (len(at_rest) < len(motors) or drag * float(np.mean(at_rest)) > share):
        notes.append(
            f"rotorDragCoefficient {drag:g} is left out: it would take the weight at 1 m/s, or has no motorConstant."
        )
        drag = 0.0
    if max(up, down) > 1.0:
        notes.append(f"rotors that take {max(up, down):g} s to follow are not believed; the lag is left out.")
        up = down = 0.0
    source = f"motors of the {kind}"
    drags = (EffectDraft("rotor_drag", {"coefficient": drag}, source),) if drag else ()
    return (*lag_effect(up, down, source), *drags), notes


def unit_mass_inertia(d: Array) -> Array:
    """The inertia (3, 3) [m^2] of a unit mass at d (3,) [m], about the origin: |d|^2 I - d d^T."""
    return np.asarray(d @ d * np.eye(3) - np.outer(d, d))


def combined_mass_properties(links: Sequence[Link]) -> tuple[float, Array, Array]:
    """Mass [kg], centre (3,) [m] and inertia (3, 3) [kg m^2] about it of all bodies."""
    masses = np.array([one.mass for one in links])
    mass = float(masses.sum())
    centres = np.array([one.centre for one in links])
    centre = masses @ centres / mass if mass > 0.0 else np.zeros(3)
    inertia = np.zeros((3, 3))
    for one in links:
        d = one.centre - centre
        inertia += one.inertia + one.mass * unit_mass_inertia(d)
    return mass, np.asarray(centre), inertia


def _rotor(index: int, number: int, links: Sequence[Link], motor: Motor, kind: str) -> RotorDraft:
    link = links[index]
    position = link.position if motor.position is None else motor.position
    direction = link.rotation[:, 2] if motor.direction is None else motor.direction  # of Gazebo's motors
    turn = Sourced((-1) ** number, f"the {kind} does not say; taken in turn, check every one", assumed=True)
    where = f"{link.name} of the {kind}"
    place, along = (Sourced(tuple((np.round(v, 9) + 0.0).tolist()), where) for v in (position, direction))
    told = {name: getattr(motor, name) for name in ("kappa", "c_f", "speed_max", "thrust_max")}
    return RotorDraft(place, along, motor.spin or turn, **told, name=link.name, tilt=_tilt(index, links, direction))


def _tilt(index: int, links: Sequence[Link], direction: Array) -> Tilt | None:
    """The nearest hinge with limits between a rotor and the root that turns its thrust."""
    at = index if links[index].joint != "turning" else links[index].parent
    while at >= 0:
        link = links[at]
        if link.joint == "hinge" and link.axis is not None and abs(float(link.axis @ direction)) < 1e-3:
            return Tilt(np.round(link.axis, 9) + 0.0, *link.limits)
        at = link.parent
    return None


TURNS = {"ccw": 1, "cw": -1}


def motors_of(document: Element, origin: str) -> dict[str, Motor]:
    """Motors by the name of their link, or of their joint where no link is named; in the order of their numbers.

    Raises ModelError for a turning direction or a constant that is there and is none: a guess would take its place.
    """
    found: dict[str, Motor] = {}
    for plugin in document.iter("plugin"):
        turn = (plugin.findtext("turningDirection") or "").strip()
        place = (plugin.findtext("linkName") or plugin.findtext("jointName") or "").strip()
        if not turn or not place:
            continue
        if turn not in TURNS:
            raise ModelError(f"{origin}: motor plugin of {place}: turningDirection: got {turn!r}, expected ccw or cw")
        numbers = (_number(plugin, name) for name in ("motorNumber", "actuator_number"))
        source = f"motor plugin of {place}"
        found[place.rpartition("::")[2]] = Motor(
            spin=Sourced(TURNS[turn], f"turningDirection {turn} of the {source}"),
            kappa=_positive(plugin, "momentConstant", source, origin),
            c_f=_positive(plugin, "motorConstant", source, origin),
            speed_max=_positive(plugin, "maxRotVelocity", source, origin),
            number=next((int(number) for number in numbers if number is not None), None),
            lag=_lag(plugin),
            drag=_not_negative(plugin, "rotorDragCoefficient"),
        )
    return found


def refuse_negative(link: Element, origin: str) -> None:
    """Raise ModelError for a mass or a moment of inertia below zero, which MuJoCo would replace by the least it has."""
    for tag, names in (("mass", ("value",)), ("inertia", ("ixx", "iyy", "izz"))):
        element = link.find(f"inertial/{tag}")
        values = {} if element is None else {name: element.get(name, "") for name in names}
        for name, text in values.items():
            if re.fullmatch(r"\s*-\S*[1-9]\S*\s*", text):  # MuJoCo itself says what is no number
                who = f"{origin}: link {link.get('name')!r}: {tag} {name}"
                raise ModelError(f"{who}: got {text}, expected none below zero")


def _lag(plugin: Element) -> tuple[float, float] | None:
    """Time constants up and down [s]; one that is not said is the other's."""
    up, down = (_not_negative(plugin, f"timeConstant{way}") for way in ("Up", "Down"))
    up, down = down if up is None else up, up if down is None else down
    return None if up is None or down is None else (up, down)


def _not_negative(plugin: Element, name: str) -> float | None:
    value = _number(plugin, name)
    return value if value is not None and 0.0 <= value < 1e9 else None


def _number(plugin: Element, name: str) -> float | None:
    try:
        value = float(plugin.findtext(name) or "")
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _positive(plugin: Element, name: str, source: str, origin: str) -> Sourced | None:
    text, value = plugin.findtext(name), _number(plugin, name)
    if text is not None and (value is None or value <= 0.0):
        raise ModelError(f"{origin}: {source}: {name}: got {text.strip()!r}, expected a positive number")
    return None if value is None else Sourced(value, f"{name} of the {source}")
