"""Scene nodes of viser below a body's frame: a vehicle of any geometry, and wrenches as arrows.

ROOT                pose of B               ROOT/arm0 ...   poses of the arms, tilted    ROOT/arm0/disc0 ...
ROOT/force/NAME, ROOT/torque/NAME, ROOT/thrusts, and ROOT/sigma/... for the uncertainty at the tip of a prediction
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from wrenchgap.flight import so3
from wrenchgap.flight.flight import Array
from wrenchgap.plant.vehicle import GRAVITY, Arms, Vehicle
from wrenchgap.viewer.colours import PALETTE, Colour, colour_of
from wrenchgap.viewer.session import Scene

KINDS = ("force", "torque")
THICK = {"force": 0.014, "torque": 0.022}
"""Thickness of arrows, in sizes of the vehicle."""
CLOUD = {"radius": 1.0, "opacity": 0.28, "cast_shadow": False, "receive_shadow": False, "visible": False}
ARC = np.radians(np.linspace(20.0, 130.0, 12))
"""Angles of the arc on a disc that shows how it turns."""


def arm_pose(arms: Arms, arm: int, tilt: float) -> Array:
    """Attitude (4,) of the frame of an arm in B, tilted: z is n(alpha) = cos(alpha) n_0 + sin(alpha) (a x n_0)."""
    return so3.multiply(level_pose(arms, arm), np.array([np.cos(0.5 * tilt), np.sin(0.5 * tilt), 0.0, 0.0]))


@lru_cache(maxsize=256)
def level_pose(arms: Arms, arm: int) -> Array:
    """The same at zero tilt: z the thrust direction, x the tilt axis as far as at right angles, which a tilt turns."""
    return along_z(arms.normal_B[arm], arms.axis_B[arm])


def along_z(direction: Array, x_axis: Array | None = None) -> Array:
    """An attitude (4,) that takes e_z to a direction (3,) of any length, and e_x as near to `x_axis` (3,) as can be."""
    z = direction / np.linalg.norm(direction)
    x = np.zeros(3) if x_axis is None else x_axis - (x_axis @ z) * z
    if np.linalg.norm(x) < 1e-6:
        x = np.cross(np.eye(3)[np.argmin(np.abs(z))], z)
    x = x / np.linalg.norm(x)
    return so3.from_matrix(np.stack((x, np.cross(z, x), z), axis=1))


def size_of(vehicle: Vehicle) -> float:
    """Distance [m] from the origin to the farthest hub, or three radii of gyration where the arms are unknown."""
    if vehicle.arms is not None:
        return float(np.linalg.norm(vehicle.arms.position_B, axis=1).max())
    return float(3.0 * np.sqrt(np.trace(vehicle.body.inertia) / 3.0 / vehicle.body.mass))


class VehicleShape:
    """The nodes of one vehicle below `root`. A ghost is of one colour and lets the other vehicle show through."""

    def __init__(self, scene: Any, root: str, vehicle: Vehicle, ghost: Colour | None = None) -> None:
        self._scene, self._root, self._vehicle, self._ghost = scene, root, vehicle, ghost
        self.size = size_of(vehicle)
        self.frame = scene.add_frame(root, show_axes=False, visible=ghost is None)
        self.arms: list[Any] = []
        self._hull()
        if vehicle.arms is not None:
            self._arms(vehicle.arms)

    def move(self, position_E: Array, quat_EB: Array, tilt: Array | None) -> None:
        """Set the pose of the body (3,), (4,) and the angles of the arms (A,) [rad]; nan angles stay."""
        self.frame.position, self.frame.wxyz = position_E, quat_EB
        arms = self._vehicle.arms
        if arms is None or tilt is None or not np.isfinite(tilt).all():
            return
        for arm, handle in enumerate(self.arms):
            if arms.tilts[arm]:
                handle.wxyz = arm_pose(arms, arm, float(tilt[arm]))

    def _look(self, colour: Colour, opacity: float | None = None) -> dict[str, Any]:
        """Colour and opacity of a part; a ghost casts no shadow."""
        if self._ghost is None:
            return {"color": colour, "opacity": opacity}
        return {"color": self._ghost, "opacity": 0.22, "cast_shadow": False}

    def _hull(self) -> None:
        """A flat drum with a green nose; a ball on rotor-less vehicles, of which nothing but the size is known."""
        size, name, look = self.size, f"{self._root}/hull", self._look(PALETTE.hull)
        radius = (0.5 if self._vehicle.arms is None else 0.24) * size
        if self._vehicle.arms is None:
            self._scene.add_icosphere(name, radius=radius, scale=(1.0, 1.0, 0.5), **look)
        else:
            self._scene.add_cylinder(name, radius=radius, height=0.14 * size, **look)
        nose = {"radius": 0.055 * size, "position": (radius, 0.0, 0.0), **self._look(PALETTE.body)}
        self._scene.add_icosphere(f"{self._root}/nose", **nose)

    def _arms(self, arms: Arms) -> None:
        """Tubes from the hull to the hubs, and on each hub a frame that tilts and carries the rotors."""
        for arm, place in enumerate(arms.position_B):
            length = float(np.linalg.norm(place))
            if length > 1e-6:
                self._scene.add_cylinder(
                    f"{self._root}/tube{arm}",
                    radius=0.028 * self.size,
                    height=length,
                    radial_segments=16,
                    position=0.5 * place,
                    wxyz=along_z(place),
                    **self._look(PALETTE.hull),
                )
            node = f"{self._root}/arm{arm}"
            level = arm_pose(arms, arm, 0.0)
            self.arms.append(self._scene.add_frame(node, show_axes=False, position=place, wxyz=level))
            self._rotors(node, arm)

    def _rotors(self, node: str, arm: int) -> None:
        rotors = self._vehicle.rotors
        if rotors is None:
            return
        for rotor in np.flatnonzero(rotors.arm == arm):
            offset, radius = float(rotors.offset[rotor]), float(rotors.radius[rotor])
            colour = PALETTE.spin[0 if rotors.spin[rotor] > 0 else 1]
            disc = {"radius": radius, "height": 0.012 * self.size, "position": (0.0, 0.0, offset)}
            self._scene.add_cylinder(f"{node}/disc{rotor}", **disc, **self._look(colour, 0.45))
            mast = {"radius": 0.05 * self.size, "height": max(abs(offset), 0.05 * self.size), "radial_segments": 16}
            middle = (0.0, 0.0, 0.5 * offset)
            self._scene.add_cylinder(f"{node}/motor{rotor}", **mast, position=middle, **self._look(PALETTE.hull))
            if self._ghost is None:
                self._turning(f"{node}/turning{rotor}", offset, radius, float(rotors.spin[rotor]), colour)

    def _turning(self, node: str, offset: float, radius: float, spin: float, colour: Colour) -> None:
        """Two arcs with arrow heads that say how a disc turns: counter-clockwise about its z for spin +1."""
        height = offset + np.sign(offset if offset else 1.0) * 0.02 * self.size
        dark: Colour = (int(0.6 * colour[0]), int(0.6 * colour[1]), int(0.6 * colour[2]))
        arcs, heads = [], []
        for start in (0.0, np.pi):
            angle = start + spin * ARC
            rim = 0.78 * radius * np.stack((np.cos(angle), np.sin(angle)), axis=1)
            points = np.column_stack((rim, np.full(len(rim), height)))
            arcs.append(np.stack((points[:-1], points[1:]), axis=1))
            tangent = points[-1] - points[-2]
            heads.append(np.stack((points[-1], points[-1] + tangent / np.linalg.norm(tangent) * 0.26 * radius)))
        self._scene.add_line_segments(f"{node}/arc", np.concatenate(arcs), dark, thickness=0.05 * radius)
        sizes = {"shaft_radius": 0.001 * radius, "head_radius": 0.09 * radius, "head_length": 0.26 * radius}
        self._scene.add_arrows(f"{node}/head", np.stack(heads), dark, **sizes)


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
            worth = 1e-3 * self._size < float(np.linalg.norm(vector)) < np.inf
            seen = (kind, name) in shown and worth
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
