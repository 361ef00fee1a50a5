"""A vehicle, its reference and its wrenches as viser scene nodes. Lengths in metres, z up.

/body            pose of B            /body/arm0 ... poses of the arms, tilted    /body/arm0/rotor0 ...
/reference       pose of D            /body/force/NAME, /body/torque/NAME         arrows
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from flight import so3
from plant.vehicle import GRAVITY, Arms, Vehicle
from viewer.session import Scene

Array = NDArray[np.float64]
Colour = tuple[int, int, int]

BODY: Colour = (40, 160, 60)
REFERENCE: Colour = (210, 40, 40)
HULL: Colour = (70, 75, 85)
ROTORS: tuple[Colour, Colour] = ((90, 130, 200), (200, 150, 80))
"""Discs of rotors that turn counter-clockwise, clockwise about their thrust."""
WRENCHES: dict[str, Colour] = {"commanded": (245, 140, 20), "measured": (30, 30, 30), "predicted": (30, 110, 220)}
OTHER: Colour = (150, 60, 170)


def colour_of(name: str) -> Colour:
    """Colour of a wrench, the same in arrows and plots."""
    return WRENCHES.get(name, OTHER)


def arm_pose(arms: Arms, arm: int, tilt: float) -> Array:
    """Attitude (4,) of the frame of an arm in B: z the thrust direction, x the tilt axis as far as at right angles.

    A tilt turns it right-handed about x, so that z becomes n(alpha) = cos(alpha) n_0 + sin(alpha) (a x n_0).
    """
    z = arms.normal_B[arm]
    x = arms.axis_B[arm] - (arms.axis_B[arm] @ z) * z
    if np.linalg.norm(x) < 1e-6:
        x = np.cross(np.eye(3)[np.argmin(np.abs(z))], z)
    x = x / np.linalg.norm(x)
    level = so3.from_matrix(np.stack((x, np.cross(z, x), z), axis=1))
    return so3.multiply(level, so3.exp(np.array([tilt, 0.0, 0.0])))


def size_of(vehicle: Vehicle) -> float:
    """Distance [m] from the origin to the farthest hub, or three radii of gyration where the arms are unknown."""
    if vehicle.arms is not None:
        return float(np.linalg.norm(vehicle.arms.position_B, axis=1).max())
    return float(3.0 * np.sqrt(np.trace(vehicle.body.inertia) / 3.0 / vehicle.body.mass))


class Drawing:
    """The scene nodes of one vehicle; `show` moves them to an instant of a flight."""

    def __init__(self, scene: Any, vehicle: Vehicle) -> None:
        self._scene, self.vehicle, self.size = scene, vehicle, size_of(vehicle)
        scene.set_up_direction("+z")
        self.body = scene.add_frame("/body", show_axes=False)
        self.reference = scene.add_frame("/reference", show_axes=False, visible=False)
        self._axes("/body/axes", BODY)
        self._axes("/reference/axes", REFERENCE)
        self.arms: list[Any] = []
        self._vehicle()
        self.arrows: dict[tuple[str, str], Any] = {}
        self._newton = self.size / (0.5 * vehicle.body.mass * GRAVITY)  # m per N: the weight is twice the size
        self._newton_metre = self.size
        self.ground: Any = None

    def open(self, flight: Scene) -> None:
        """Prepare for a flight: its ground, its arrows, its scale of torques."""
        lowest = float(flight.position_E[:, 2].min()) - self.size
        self.ground = self._scene.add_grid(
            "/ground", 10.0, 10.0, cell_size=0.25, infinite_grid=True, position=(0.0, 0.0, min(0.0, lowest))
        )
        for handle in self.arrows.values():
            handle.remove()
        self.arrows = {
            (kind, name): self._arrow(f"/body/{kind}/{name}", colour_of(name), thick)
            for name in flight.wrenches
            for kind, thick in (("force", 0.018), ("torque", 0.030))
        }
        torques = [np.abs(w[:, 3:][np.isfinite(w[:, 3:])]) for w in flight.wrenches.values()]
        largest = max((float(t.max()) for t in torques if t.size), default=0.0)
        self._newton_metre = 1.5 * self.size / largest if largest > 0 else self.size

    def show(self, flight: Scene, index: int, kinds: frozenset[str] = frozenset({"force", "torque"})) -> None:
        """Move everything to instant `index`; arrows of `kinds` only."""
        self.body.position, self.body.wxyz = flight.position_E[index], flight.quat_EB[index]
        known = flight.reference_position_E is not None and flight.quat_ED is not None
        if known:
            assert flight.reference_position_E is not None
            assert flight.quat_ED is not None
            pose = np.concatenate((flight.reference_position_E[index], flight.quat_ED[index]))
            known = bool(np.isfinite(pose).all())
            if known:
                self.reference.position, self.reference.wxyz = pose[:3], pose[3:]
        self.reference.visible = known
        arms = self.vehicle.arms
        if arms is not None and flight.tilt is not None and np.isfinite(flight.tilt[index]).all():
            for arm, handle in enumerate(self.arms):
                handle.wxyz = arm_pose(arms, arm, float(flight.tilt[index, arm]))
        for (kind, name), handle in self.arrows.items():
            wrench = flight.wrenches[name][index]
            part = wrench[:3] * self._newton if kind == "force" else wrench[3:] * self._newton_metre
            shown = kind in kinds and bool(np.isfinite(part).all()) and float(np.linalg.norm(part)) > 1e-3 * self.size
            if shown:
                centre = self.vehicle.body.com_B
                handle.points = np.stack((centre, centre + part))[None].astype(np.float32)
            handle.visible = shown

    def _vehicle(self) -> None:
        """Hull, arms and rotor discs."""
        vehicle, size = self.vehicle, self.size
        hull = 0.35 * size
        self._scene.add_box("/body/hull", dimensions=(hull, hull, 0.4 * hull), color=HULL)
        self._scene.add_icosphere("/body/nose", radius=0.06 * size, color=BODY, position=(0.5 * hull, 0.0, 0.0))
        if vehicle.arms is None or vehicle.rotors is None:
            return
        tubes = np.stack((np.zeros_like(vehicle.arms.position_B), vehicle.arms.position_B), axis=1)
        self._scene.add_line_segments("/body/tubes", tubes, HULL, thickness=0.05 * size)
        for arm, place in enumerate(vehicle.arms.position_B):
            pose = arm_pose(vehicle.arms, arm, 0.0)
            handle = self._scene.add_frame(f"/body/arm{arm}", show_axes=False, position=place, wxyz=pose)
            self.arms.append(handle)
        for rotor, arm in enumerate(vehicle.rotors.arm):
            self._scene.add_cylinder(
                f"/body/arm{arm}/rotor{rotor}",
                radius=float(vehicle.rotors.radius[rotor]),
                height=0.02 * size,
                color=ROTORS[0 if vehicle.rotors.spin[rotor] > 0 else 1],
                opacity=0.6,
                position=(0.0, 0.0, float(vehicle.rotors.offset[rotor])),
            )

    def _axes(self, name: str, colour: Colour) -> None:
        """Three arrows of one colour, the x axis longest."""
        lengths = self.size * np.diag([1.6, 1.1, 1.1])
        points = np.stack((np.zeros((3, 3)), lengths), axis=1)
        self._scene.add_arrows(name, points, colour, **self._thickness(0.012))

    def _arrow(self, name: str, colour: Colour, thick: float) -> Any:
        points = np.array([[[0.0, 0.0, 0.0], [0.0, 0.0, self.size]]])
        return self._scene.add_arrows(name, points, colour, visible=False, **self._thickness(thick))

    def _thickness(self, share: float) -> dict[str, float]:
        return {
            "shaft_radius": share * self.size,
            "head_radius": 2.5 * share * self.size,
            "head_length": 6.0 * share * self.size,
        }
