"""A draft of a vehicle, before there is a model file: values, each with its source.

Frames as in `plant.vehicle`: B is x forward, y left, z up. `completed` estimates what a model file must have and no
source states; every estimate is marked as assumed. Its text as a model file: `model_text`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from wrenchgap.flight.errors import ModelError
from wrenchgap.flight.flight import Array
from wrenchgap.flight.result import Result
from wrenchgap.plant.model import Model
from wrenchgap.plant.vehicle import GRAVITY


@dataclass(frozen=True)
class TypicalVehicle:
    """Numbers of multirotors that stand in for what no source states.

    The inertia is estimated as if the share `mass_at_rotors` of the mass sat at the rotors (motors, propellers, outer
    arms) and the rest at their mean. Published moments about the vertical give J_zz / (m mean d^2) of 0.51 (Crazyflie
    2: Foerster, ETH 2015), 0.60 (3DR Iris) and 0.33 (Holybro X500, both PX4's Gazebo models), 0.58 (AscTec Hummingbird)
    and 0.42 (the omnidirectional hexarotor, both RotorS): 0.49 on average with a standard deviation of 0.11.
    """

    kappa: float = 0.016  # drag torque per thrust [m] of a propeller: 0.006 m (4 cm) to 0.05 m (50 cm)
    thrust_coefficient: float = 0.012  # C_T = T / (rho A (Omega R)^2) of small propellers at rest
    air_density: float = 1.225  # rho [kg/m^3]
    radius_share: float = 0.45  # radius of a rotor, relative to the distance of the nearest one
    disc_loading: tuple[float, float] = (8.0, 800.0)  # weight per rotor area [N/m^2]: 20 g to 100 kg, with a margin
    thrust_ratio: float = 2.0  # thrust at full throttle over that in hover
    mass_at_rotors: float = 0.5  # share of the mass
    inertia_std: float = 0.3  # relative standard deviation of the estimated moments of inertia
    thrust_std: float = 0.1  # of all rotors together: another battery, air, a law of thrust by throttle from one hover
    thrust_axis_std: float = 1.0  # of each motor in its mount [deg]
    min_moment: float = 0.05  # relative to the largest: of rotors in one line, arms and hull still have width


TYPICAL = TypicalVehicle()


@dataclass(frozen=True, eq=False)
class Sourced:
    """A value and its source in a few words; `assumed`: no source states it; `tolerance`: one standard deviation."""

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
    """One rotor: hub (3,) [m] and thrust direction (3,) in B, the rest as in `plant.vehicle.Rotors`, None: unknown."""

    position_B: Sourced
    direction_B: Sourced
    spin: Sourced
    kappa: Sourced | None = None
    c_f: Sourced | None = None
    radius: Sourced | None = None
    speed_max: Sourced | None = None
    thrust_max: Sourced | None = None
    speed_min: Sourced | None = None
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


@dataclass(frozen=True)
class EffectDraft:
    """An effect of the catalogue that a source states: its name, the values of all its parameters, their source."""

    name: str
    values: Mapping[str, float]
    source: str


@dataclass(frozen=True, eq=False)
class Draft:
    """A vehicle as far as it is known; `origin` names in a line what it was drafted from.

    `slowest_hz` is the rate of the slower of IMU and rotor commands in its log, `cutoff_hz` what that allows.
    """

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
    slowest_hz: float | None = None
    cutoff_hz: Sourced | None = None
    effects: tuple[EffectDraft, ...] = ()


def parameter(parameters: Mapping[str, float], name: str, usual: float, low: float, high: float) -> float:
    """An autopilot's parameter, or its default; raises ModelError, which names it, outside of what it can be."""
    value = float(parameters.get(name, usual))
    if not low <= value <= high:
        raise ModelError(
            f"the log's parameter {name} is {value:g}, expected {low:g} to {high:g}; write the model by hand "
            "(docs/model-file.md)"
        )
    return value


def completed(draft: Draft) -> Draft:
    """The draft with everything that a model file needs.

    Raises ModelError where mass or rotors are missing, or belong together in no unit.
    """
    if draft.mass is None:
        raise ModelError(f"{draft.origin}: does not say what the vehicle weighs; weigh it and say --mass KG")
    if not draft.rotors:
        raise ModelError(
            f"{draft.origin}: does not say where the rotors are; say --frame quad_x --arm METRES, or describe them by "
            "hand in a model file (docs/model-file.md)"
        )
    mass, hubs = float(draft.mass.value), np.array([r.position_B.value for r in draft.rotors])
    rotors = _with_radius_and_kappa(draft.rotors, hubs)
    filled = replace(
        draft,
        com=draft.com or Sourced((0.0, 0.0, 0.0), "the point from which the rotors are given", assumed=True),
        imu_position=draft.imu_position or Sourced((0.0, 0.0, 0.0), "not said: at the origin", assumed=True),
        inertia=draft.inertia or _estimated_inertia(mass, hubs),
        rotors=rotors,
    )
    area = sum(np.pi * float(r.radius.value) ** 2 for r in rotors if r.radius is not None)
    loading, (least, most) = GRAVITY * mass / area, TYPICAL.disc_loading
    if not least < loading < most:  # most likely the mass or a length is in another unit
        if not 0.1 * least < loading < 10.0 * most:
            raise ModelError(
                f"{draft.origin}: with {mass:g} kg the rotors would carry {loading:.3g} N per square metre of disc, "
                f"where {least:g} to {most:g} are usual; say the mass in kilograms, arms and rotors in metres"
            )
        note = (
            f"the rotors would carry {loading:.3g} N per square metre of disc, where {least:g} to {most:g} are usual: "
            "is the mass in kilograms, are arms and rotors in metres?"
        )
        filled = replace(filled, notes=(*draft.notes, note))
    return _with_thrust(filled, mass)


def _estimated_inertia(mass: float, hubs_B: Array) -> Sourced:
    moments = inertia_of_mass(mass, hubs_B)
    words = (
        f"estimated from mass and geometry: {100 * TYPICAL.mass_at_rotors:.0f} % of the mass at the rotors, the rest "
        f"in the middle; +-{100 * TYPICAL.inertia_std:.0f} % (one sigma)"
    )
    return Sourced(tuple(moments), words, assumed=True, tolerance=tuple(TYPICAL.inertia_std * moments))


def inertia_of_mass(mass: float, hubs_B: Array) -> Array:
    """Moments (3,) [kg m^2] about B's axes of a mass [kg] with rotors at `hubs_B` (R, 3) [m].

    J = share m mean_r (|d_r|^2 I - d_r d_r^T), d_r from the mean of the hubs to hub r.
    """
    square = ((hubs_B - hubs_B.mean(axis=0)) ** 2).mean(axis=0)
    moments = TYPICAL.mass_at_rotors * mass * (square[[1, 0, 0]] + square[[2, 2, 1]])
    return np.asarray(np.maximum(moments, TYPICAL.min_moment * moments.max()))


def _with_radius_and_kappa(rotors: Sequence[RotorDraft], hubs: Array) -> tuple[RotorDraft, ...]:
    """The rotors with radii that leave a gap to the nearest rotor, and a typical kappa, where these are unknown."""
    kappa = Sourced(TYPICAL.kappa, "typical of propellers; `wrenchgap calibrate` fits it (drag_torque)", assumed=True)
    words = f"{100 * TYPICAL.radius_share:.0f} % of the distance to the nearest rotor"
    out = []
    for rotor, hub in zip(rotors, hubs, strict=True):
        distance = np.linalg.norm(hubs[:, :2] - hub[:2], axis=1)
        others = distance[distance > 1e-3]
        free = others.min() if others.size else 2.0 * max(float(np.linalg.norm(hub)), 0.05)
        radius = Sourced(float(TYPICAL.radius_share * free), words, assumed=True)
        out.append(replace(rotor, radius=rotor.radius or radius, kappa=rotor.kappa or kappa))
    return tuple(out)


def _with_thrust(draft: Draft, mass: float) -> Draft:
    """The draft with thrust coefficients and speed limits, and the level of the curve of [command]."""
    up = np.array([r.direction_B.value for r in draft.rotors])[:, 2]
    hover_thrust = GRAVITY * mass / max(float(np.abs(up).sum()), 1e-9)
    command, full = draft.command, None
    if command is not None:
        full = command.thrust_max
        hover = command.hover
        if full is None and hover is not None and 0.0 < float(hover.value) <= 1.0:  # others were never learnt
            words = f"weight over {len(up)} rotors, {hover.source}"
            full = Sourced(hover_thrust / float(hover.value), words, hover.assumed)
        draft = replace(draft, command=replace(command, thrust_max=full))
    return replace(draft, rotors=tuple(_with_speed_limit(r, full, hover_thrust) for r in draft.rotors))


def _with_speed_limit(rotor: RotorDraft, full: Sourced | None, hover_thrust: float) -> RotorDraft:
    """The rotor with c_f and the speed that makes its full thrust [N]."""
    assert rotor.radius is not None
    c_t, ratio = TYPICAL.thrust_coefficient, TYPICAL.thrust_ratio
    estimate = c_t * TYPICAL.air_density * np.pi * float(rotor.radius.value) ** 4
    words = f"estimated from the radius, C_T = {c_t:g}" + ("; names the thrust of [command]" if full else "")
    c_f = rotor.c_f or Sourced(estimate, words, assumed=True)
    limit = "full throttle" if full else f"{ratio:g} times the thrust of hover"
    full = full or rotor.thrust_max or Sourced(ratio * hover_thrust, "", assumed=True)
    words = f"speed at {rotor.thrust_max.source if rotor.thrust_max else limit}"
    top = Sourced(float(np.sqrt(float(full.value) / float(c_f.value))), words, assumed=rotor.thrust_max is None)
    return replace(rotor, c_f=c_f, speed_max=rotor.speed_max or top)


def assumptions(draft: Draft) -> list[str]:
    """The assumed values, in words: for the user to check."""
    found = [f"{k}: {s.source}" for k in ("inertia", "com", "imu_position") if (s := getattr(draft, k)).assumed]
    for key in ("spin", "kappa", "c_f", "radius", "speed_max"):
        values: Sequence[Sourced] = [getattr(r, key) for r in draft.rotors]
        if any(v.assumed for v in values):
            found.append(f"{key}: {next(v.source for v in values if v.assumed)}")
    if draft.command is not None:
        every = {**draft.command.keys, **({"thrust_max": draft.command.thrust_max} if draft.command.thrust_max else {})}
        found += [f"command.{key}: {sourced.source}" for key, sourced in every.items() if sourced.assumed]
    return found


@dataclass(frozen=True, repr=False)
class Sheet(Result):
    """A model to look at: `assumed` lists the assumed values in words, `notes` further statements of its source."""

    model: Model
    assumed: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
