"""What is known of a vehicle before there is a model file: values, each with where it comes from.

Frames as in `plant.vehicle`: B is x forward, y left, z up. `completed` fills in what a model file must have and nobody
said, each of it marked as assumed; nothing is filled in silently.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from wrenchgap.flight.errors import ModelError
from wrenchgap.flight.flight import Array
from wrenchgap.flight.result import Result
from wrenchgap.plant.model import Model
from wrenchgap.plant.vehicle import GRAVITY

KAPPA = 0.016
"""Drag torque per thrust [m] of a propeller of which nothing is known: between 0.006 m (4 cm) and 0.05 m (50 cm)."""
COEFFICIENT, DENSITY = 0.012, 1.225
"""Thrust coefficient C_T = T / (rho A (Omega R)^2) of small propellers at rest, and the air's density [kg/m^3]."""
ROOM = 0.45
"""Radius of a rotor, relative to the distance of the nearest one, where nobody said it."""
LOADING = (8.0, 800.0)
"""Weight over the rotors' area [N/m^2] of multirotors from 20 g to 100 kg, with room on both sides."""
HEADROOM = 2.0
"""Thrust at full throttle over that in hover, where nobody said it."""


@dataclass(frozen=True, eq=False)
class Sourced:
    """A value, and where it comes from in a few words; `assumed` where nobody said it. `tolerance`: one sigma."""

    value: Any
    source: str
    assumed: bool = False
    tolerance: Any = None


@dataclass(frozen=True, eq=False)
class Tilt:
    """How the arm of a rotor tilts: its axis (3,) in B and its limits [rad], infinite where there are none."""

    axis_B: Array
    low: float = -np.inf
    high: float = np.inf


@dataclass(frozen=True, eq=False)
class RotorDraft:
    """One rotor: hub (3,) [m] and thrust direction (3,) in B, the rest as in `plant.vehicle.Rotors`, if it was said."""

    position_B: Sourced
    direction_B: Sourced
    spin: Sourced
    kappa: Sourced | None = None
    c_f: Sourced | None = None
    radius: Sourced | None = None
    speed_max: Sourced | None = None
    thrust_max: Sourced | None = None
    name: str = ""
    tilt: Tilt | None = None


@dataclass(frozen=True, eq=False)
class CommandDraft:
    """[command]: its keys with their values, `unit` first. `hover` is the share of full thrust that carries the weight.

    `thrust_max` [N] is known, or follows from mass and `hover`.
    """

    keys: Mapping[str, Sourced]
    hover: Sourced | None = None
    thrust_max: Sourced | None = None


@dataclass(frozen=True, eq=False)
class Draft:
    """A vehicle as far as it is known; `origin` says in a line what it was drafted from."""

    name: str
    origin: str
    rotors: tuple[RotorDraft, ...] = ()
    mass: Sourced | None = None
    inertia: Sourced | None = None
    com: Sourced | None = None
    imu_position: Sourced | None = None
    command: CommandDraft | None = None
    notes: tuple[str, ...] = ()
    topics: Mapping[str, str] = field(default_factory=dict)


def completed(draft: Draft) -> Draft:
    """The draft with everything that a model file needs. Raises ModelError where the mass or the rotors are missing."""
    if draft.mass is None:
        raise ModelError(f"{draft.origin}: does not say what the vehicle weighs; weigh it and say --mass KG")
    if not draft.rotors:
        raise ModelError(
            f"{draft.origin}: does not say where the rotors are; say --frame quad_x --arm METRES, or describe them by "
            "hand in a model file (docs/model-file.md)"
        )
    hubs = np.array([r.position_B.value for r in draft.rotors])
    filled = replace(
        draft,
        com=draft.com or Sourced((0.0, 0.0, 0.0), "the point from which the rotors are given", assumed=True),
        imu_position=draft.imu_position or Sourced((0.0, 0.0, 0.0), "not said: at the origin", assumed=True),
        inertia=draft.inertia or _estimated(float(draft.mass.value), hubs),
    )
    radii = _radii(hubs)
    rotors = tuple(_filled(r, radii[k]) for k, r in enumerate(draft.rotors))
    return _with_thrust(replace(filled, rotors=rotors, notes=(*draft.notes, *_doubts(draft.mass, rotors))))


def _doubts(mass: Sourced, rotors: Sequence[RotorDraft]) -> list[str]:
    """What is hardly possible of mass and size: another unit, most likely."""
    area = sum(np.pi * float(r.radius.value) ** 2 for r in rotors if r.radius is not None)
    loading = GRAVITY * float(mass.value) / area
    if LOADING[0] < loading < LOADING[1]:
        return []
    return [
        f"the rotors would carry {loading:.3g} N per square metre of disc, where {LOADING[0]:g} to {LOADING[1]:g} are "
        "usual: is the mass in kilograms, are arms and rotors in metres?"
    ]


def _estimated(mass: float, hubs: Array) -> Sourced:
    moments = inertia_of_mass(mass, hubs)
    words = (
        f"estimated from mass and geometry: {100 * SHARE:.0f} % of the mass at the rotors, the rest in the middle; "
        f"+-{100 * UNCERTAINTY:.0f} % (one sigma)"
    )
    return Sourced(tuple(moments), words, assumed=True, tolerance=tuple(UNCERTAINTY * moments))


def _radii(hubs: Array) -> Array:
    """A radius (R,) [m] for each rotor that leaves room to its nearest neighbour beside it."""
    out = np.empty(len(hubs))
    for k, hub in enumerate(hubs):
        beside = np.linalg.norm(hubs[:, :2] - hub[:2], axis=1)
        near = beside[beside > 1e-3]
        out[k] = ROOM * (near.min() if near.size else 2.0 * max(float(np.linalg.norm(hub)), 0.05))
    return out


def _filled(rotor: RotorDraft, radius: float) -> RotorDraft:
    room = Sourced(float(radius), f"{100 * ROOM:.0f} % of the distance to the nearest rotor", assumed=True)
    kappa = Sourced(KAPPA, "typical of propellers; `wrenchgap calibrate` fits it (drag_torque)", assumed=True)
    return replace(rotor, radius=rotor.radius or room, kappa=rotor.kappa or kappa)


def _with_thrust(draft: Draft) -> Draft:
    """The draft with thrust coefficients and speed limits, and the level of the curve of [command]."""
    up = np.array([r.direction_B.value for r in draft.rotors])[:, 2]
    assert draft.mass is not None
    share = GRAVITY * float(draft.mass.value) / max(float(np.abs(up).sum()), 1e-9)
    command, full = draft.command, None
    if command is not None:
        full = command.thrust_max
        if full is None and command.hover is not None:
            hover = command.hover
            full = Sourced(share / float(hover.value), f"weight over {len(up)} rotors, {hover.source}", hover.assumed)
        draft = replace(draft, command=replace(command, thrust_max=full))
    rotors = tuple(_powered(r, full, share) for r in draft.rotors)
    return replace(draft, rotors=rotors)


def _powered(rotor: RotorDraft, full: Sourced | None, share: float) -> RotorDraft:
    assert rotor.radius is not None
    estimate = COEFFICIENT * DENSITY * np.pi * float(rotor.radius.value) ** 4
    words = f"estimated from the radius, C_T = {COEFFICIENT:g}" + ("; names the thrust of [command]" if full else "")
    c_f = rotor.c_f or Sourced(estimate, words, assumed=True)
    limit = "full throttle" if full else f"{HEADROOM:g} times the thrust of hover"
    full = full or rotor.thrust_max or Sourced(HEADROOM * share, "", assumed=True)
    words = f"speed at {rotor.thrust_max.source if rotor.thrust_max else limit}"
    top = Sourced(float(np.sqrt(float(full.value) / float(c_f.value))), words, assumed=rotor.thrust_max is None)
    return replace(rotor, c_f=c_f, speed_max=rotor.speed_max or top)


def assumptions(draft: Draft) -> list[str]:
    """What nobody said, in words: for the user to check."""
    found = [f"{k}: {s.source}" for k in ("inertia", "com", "imu_position") if (s := getattr(draft, k)).assumed]
    for key in ("spin", "kappa", "c_f", "radius", "speed_max"):
        values: Sequence[Sourced] = [getattr(r, key) for r in draft.rotors]
        if any(v.assumed for v in values):
            found.append(f"{key}: {next(v.source for v in values if v.assumed)}")
    if draft.command is not None:
        every = {**draft.command.keys, **({"thrust_max": draft.command.thrust_max} if draft.command.thrust_max else {})}
        found += [f"command.{key}: {said.source}" for key, said in every.items() if said.assumed]
    return found


SHARE, UNCERTAINTY = 0.5, 0.3
"""Share of the mass at the rotors; relative standard deviation of what comes out."""
LEAST = 0.05
"""Smallest moment, relative to the largest: where all rotors are in one line, arms and hull still are not."""


def inertia_of_mass(mass: float, hubs_B: Array) -> Array:
    """Moments (3,) [kg m^2] about B's axes of a mass [kg] with rotors at `hubs_B` (R, 3) [m]."""
    away = hubs_B - hubs_B.mean(axis=0)
    square = (away**2).mean(axis=0)
    moments = SHARE * mass * np.array([square[1] + square[2], square[0] + square[2], square[0] + square[1]])
    return np.asarray(np.maximum(moments, LEAST * moments.max()))


@dataclass(frozen=True, repr=False)
class Sheet(Result):
    """A model to look at: `assumed` is what nobody said, in words, `notes` what its source said besides."""

    model: Model
    assumed: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
