"""A vehicle of any geometry as viser scene nodes: hull, tilting arms, rotor discs with their turning direction.

ROOT                pose of B               ROOT/arm0 ...   poses of the arms, tilted    ROOT/arm0/disc0 ...
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from wrenchgap.flight import so3
from wrenchgap.flight.flight import Array
from wrenchgap.plant.vehicle import Arms, Vehicle
from wrenchgap.viewer.colours import PALETTE, Colour

ARC = np.radians(np.linspace(20.0, 130.0, 12))
"""Angles of the arc on a disc that shows how it turns."""


def arm_pose(arms: Arms, arm: int, tilt: float) -> Array:
    """Attitude (4,) of the frame of an arm in B, tilted: z is n(alpha) = cos(alpha) n_0 + sin(alpha) (a x n_0)."""
    return so3.multiply(level_pose(arms, arm), np.array([np.cos(0.5 * tilt), np.sin(0.5 * tilt), 0.0, 0.0]))


@lru_cache(maxsize=256)
def level_pose(arms: Arms, arm: int) -> Array:
    """The same at zero tilt: z the thrust direction, x the tilt axis as far as at right angles, which a tilt turns."""
    z = arms.normal_B[arm]
    x = arms.axis_B[arm] - (arms.axis_B[arm] @ z) * z
    if np.linalg.norm(x) < 1e-6:
        x = np.cross(np.eye(3)[np.argmin(np.abs(z))], z)
    x = x / np.linalg.norm(x)
    return so3.from_matrix(np.stack((x, np.cross(z, x), z), axis=1))


def along_z(direction: Array) -> Array:
    """An attitude (4,) that takes e_z to a direction (3,), which need not be of unit length."""
    unit = direction / np.linalg.norm(direction)
    axis = np.cross([0.0, 0.0, 1.0], unit)
    sine = float(np.linalg.norm(axis))
    if sine < 1e-9:
        return np.array([1.0, 0.0, 0.0, 0.0]) if unit[2] > 0 else np.array([0.0, 1.0, 0.0, 0.0])
    return so3.exp(axis / sine * np.arctan2(sine, unit[2]))


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
