"""Wrenches in the scene as arrows or frames, with the uncertainty of a prediction at its tip."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from wrenchgap.flight.flight import Array
from wrenchgap.plant.vehicle import GRAVITY, Vehicle
from wrenchgap.viewer.colours import PALETTE, Colour, colour_of
from wrenchgap.viewer.scene import Scene

KINDS = ("force", "torque")
THICK = {"force": 0.014, "torque": 0.022}
"""Thickness of arrows, in sizes of the vehicle."""
CLOUD = {"radius": 1.0, "opacity": 0.28, "cast_shadow": False, "receive_shadow": False, "visible": False}


@dataclass(frozen=True)
class Scale:
    """Lengths of arrows: metres per newton, per newton metre, and per newton of the thrust of one rotor."""

    force: float
    torque: float
    thrust: float

    def times(self, factors: tuple[float, float, float]) -> Scale:
        """Longer or shorter, kind by kind."""
        return Scale(self.force * factors[0], self.torque * factors[1], self.thrust * factors[2])

    def words(self) -> str:
        """For the legend: the force and torque of 10 cm in the scene."""
        force, torque, thrust = (0.1 / scale for scale in (self.force, self.torque, self.thrust))
        return f"10 cm: {force:.3g} N force, {torque:.3g} Nm torque, {thrust:.3g} N rotor thrust"


def scale_for(scene: Scene, vehicle: Vehicle, size: float) -> Scale:
    """Scale for a vehicle of `size` [m] on a flight.

    The weight is 1.7 sizes, the largest torque (99th percentile) 1.4 sizes, a rotor's share of the weight half a size.
    """
    weight = vehicle.body.mass * GRAVITY
    torques = [np.abs(w[:, 3:][np.isfinite(w[:, 3:])]) for w in scene.wrenches.values()]
    largest = max((float(np.percentile(t, 99.0)) for t in torques if t.size), default=0.0)
    rotors = 1 if vehicle.rotors is None else len(vehicle.rotors)
    return Scale(1.7 * size / weight, 1.4 * size / largest if largest > 0 else size, 0.5 * size * rotors / weight)


def component_arrows(vector: Array, spread: float) -> Array:
    """A vector (3,) as a frame: three arrows (3, 2, 3) along x, y and z, moved aside by `spread` [m].

    The spread keeps the frames of several wrenches, whose arrows lie along the same axes, side by side.
    """
    aside = spread * np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    return np.stack((aside, aside + np.diag(vector)), axis=1)


def single_arrow(vector: Array, spread: float) -> Array:
    """A vector (3,) as one arrow (1, 2, 3), moved aside by `spread` [m], so that arrows that agree can be compared."""
    other = np.eye(3)[0 if abs(vector[0]) < 0.9 * np.linalg.norm(vector) else 1]
    across = np.cross(vector, other)
    aside = spread * across / max(float(np.linalg.norm(across)), 1e-12)
    return np.stack((aside, aside + vector))[None]


class Arrows:
    """One node per wrench and kind below the body's frame, and one for the thrusts of all rotors."""

    ellipsoid_sigmas, spread = 3.0, 0.055
    """Half axes of the ellipsoid at the tip of a prediction, in standard deviations; distance between the arrows of
    different wrenches, in sizes of the vehicle."""

    def __init__(self, scene: Any, root: str, vehicle: Vehicle, size: float) -> None:
        self._scene, self._root, self._vehicle, self._size = scene, root, vehicle, size
        self.handles: dict[tuple[str, str], Any] = {}
        self.clouds: dict[tuple[str, str], Any] = {}
        self.thrusts: Any = None

    def open(self, flight: Scene) -> None:
        """Nodes for the wrenches of a flight."""
        for handle in (*self.handles.values(), *self.clouds.values(), *([self.thrusts] if self.thrusts else [])):
            handle.remove()
        wrenches = [(kind, name) for name in flight.wrenches for kind in KINDS]
        self.handles = {
            (kind, name): self._arrows(f"{kind}/{name}", colour_of(name), THICK[kind]) for kind, name in wrenches
        }
        self.clouds = {
            (kind, name): self._scene.add_icosphere(f"{self._root}/sigma/{kind}/{name}", color=colour_of(name), **CLOUD)
            for kind, name in wrenches
            if name in flight.sigma
        }
        self.thrusts = None if flight.thrust is None else self._arrows("thrusts", PALETTE.thrust, 0.010)

    def show(self, flight: Scene, index: int, scale: Scale, shown: frozenset[tuple[str, str]], frames: bool) -> None:
        """Draw instant `index`; `shown` are the (kind, wrench) to be seen, and ("thrust", "") for the rotors'."""
        for rank, ((kind, name), handle) in enumerate(self.handles.items()):
            part = slice(0, 3) if kind == "force" else slice(3, 6)
            vector = flight.wrenches[name][index, part] * (scale.force if kind == "force" else scale.torque)
            seen = (kind, name) in shown and self._worth(vector)
            if seen:
                spread = self.spread * self._size * (rank // len(KINDS))
                points = component_arrows(vector, spread) if frames else single_arrow(vector, spread)
                handle.points = (points + self._vehicle.body.com_B).astype(np.float32)
            set_visible(handle, seen)
            if (kind, name) in self.clouds:
                sigma = flight.sigma[name][index, part] * (scale.force if kind == "force" else scale.torque)
                self._cloud(self.clouds[kind, name], vector, sigma, seen and ("sigma", "") in shown)
        if self.thrusts is not None and flight.thrust is not None:
            self._thrust(flight, index, scale, ("thrust", "") in shown)

    def _cloud(self, handle: Any, tip: Array, sigma: Array, seen: bool) -> None:
        """The ellipsoid at the tip of a prediction; flat along axes whose sigma is unknown."""
        seen = seen and bool(np.isfinite(sigma).any())
        if seen:
            handle.position = self._vehicle.body.com_B + tip
            handle.scale = tuple(
                float(s) for s in np.maximum(np.nan_to_num(self.ellipsoid_sigmas * sigma), 0.01 * self._size)
            )
        set_visible(handle, seen)

    def _thrust(self, flight: Scene, index: int, scale: Scale, seen: bool) -> None:
        """One arrow per rotor from its hub along its thrust direction."""
        assert flight.thrust is not None
        arms, rotors = self._vehicle.geometry()
        thrust = flight.thrust[index]
        seen = seen and bool(np.isfinite(thrust).all())
        if seen:
            tilt = np.zeros(len(arms)) if flight.tilt is None else np.nan_to_num(flight.tilt[index])
            normal = (np.cos(tilt)[:, None] * arms.normal_B + np.sin(tilt)[:, None] * arms.lateral_B)[rotors.arm]
            hub = arms.position_B[rotors.arm] + rotors.offset[:, None] * normal
            tip = hub + normal * (thrust * scale.thrust)[:, None]
            self.thrusts.points = np.stack((hub, tip), axis=1).astype(np.float32)
        set_visible(self.thrusts, seen)

    def _worth(self, vector: Array) -> bool:
        """Whether an arrow is finite and longer than a thousandth of the vehicle."""
        return bool(np.isfinite(vector).all()) and float(np.linalg.norm(vector)) > 1e-3 * self._size

    def _arrows(self, name: str, colour: Colour, thick: float) -> Any:
        points = np.array([[[0.0, 0.0, 0.0], [0.0, 0.0, self._size]]])
        size = thickness(self._size, thick)
        return self._scene.add_arrows(f"{self._root}/{name}", points, colour, visible=False, **size)


def thickness(size: float, share: float) -> dict[str, float]:
    """Shaft and head of arrows on a vehicle of `size` [m]."""
    return {"shaft_radius": share * size, "head_radius": 2.4 * share * size, "head_length": 6.5 * share * size}


def set_visible(handle: Any, seen: bool) -> None:
    """Set `visible` only where it changes: every assignment sends a message."""
    if handle.visible != seen:
        handle.visible = seen
