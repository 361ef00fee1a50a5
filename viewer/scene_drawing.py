"""Drawing of the scene. Lengths in metres, z up.

/world                      where the flight is; with the following camera it moves and the body stays
/world/body                 pose of B, vehicle and arrows: see `viewer.vehicle_nodes`
/world/reference            pose of D
/world/path, /world/trail   where the flight leads, where it just was
/world/ahead                where the model leads in the next second
/world/along                frames or arrows at many instants, batched
/world/ghost                a second vehicle
/world/curve/NAME           curves that panels add
"""

from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from wrenchgap.flight import so3
from wrenchgap.flight.flight import Array
from wrenchgap.plant.reader import Flag, Positive, Text, expected, stored
from wrenchgap.plant.vehicle import Vehicle
from wrenchgap.viewer.colours import PALETTE, Colour, colour_of
from wrenchgap.viewer.session import Motion, Scene
from wrenchgap.viewer.vehicle_nodes import KINDS, Arrows, Scale, VehicleShape, scale_for, set_visible, thickness

NOTHING = "nothing"


@stored
@dataclass(frozen=True)
class Shown:
    """Switches of the page for the parts of the scene. `hidden` are names of wrenches.

    `along` is what stands along the path: "nothing", "frames", or "force NAME", "torque NAME"; every `spacing` [s].
    `factors` multiply the lengths of forces, torques and thrusts.
    """

    force: Flag = True
    torque: Flag = True
    hidden: Annotated[frozenset[Text], expected("a list of names")] = frozenset()
    frames: Flag = False
    thrust: Flag = True
    uncertainty: Flag = True
    reference: Flag = True
    path: Flag = True
    ahead: Flag = False
    shadows: Flag = False
    along: Text = NOTHING
    spacing: Positive = 0.5
    follow: Flag = True
    factors: Annotated[tuple[Positive, Positive, Positive], expected("three positive numbers")] = (1.0, 1.0, 1.0)

    def arrows(self, wrenches: tuple[str, ...]) -> frozenset[tuple[str, str]]:
        """Kinds and names of the arrows to be seen, for `Arrows.show`."""
        kinds = [kind for kind, on in zip(KINDS, (self.force, self.torque), strict=True) if on]
        seen = {(kind, name) for kind in kinds for name in wrenches if name not in self.hidden}
        extra = {("thrust", "")} if self.thrust else set()
        return frozenset(seen | extra | ({("sigma", "")} if self.uncertainty else set()))


class Drawing:
    """The scene of the page; `show` moves it to an instant of the flight that was opened last."""

    max_points = 3000
    """Points of a drawn path, and frames or arrows along it, at most: batched, they cost one node."""
    trail_points = 40
    """Points of the path of the last two seconds."""

    def __init__(self, scene: Any, vehicle: Vehicle) -> None:
        self._scene, self.vehicle = scene, vehicle
        scene.set_up_direction("+z")
        self.world = scene.add_frame("/world", show_axes=False)
        self.craft = VehicleShape(scene, "/world/body", vehicle)
        self.ghost = VehicleShape(scene, "/world/ghost", vehicle, PALETTE.ghost)
        self.size = self.craft.size
        self.reference = scene.add_frame("/world/reference", show_axes=False, visible=False)
        self._axes("/world/body/axes", PALETTE.body, 0.011)
        self._axes("/world/reference/axes", PALETTE.reference, 0.008)
        self.arrows = Arrows(scene, "/world/body", vehicle, self.size)
        self.scale = self._suited = Scale(1.0, 1.0, 1.0)
        self.flight: Scene | None = None
        self.motion: Motion | None = None
        self._along: list[Any] = []
        self._along_key: object = None
        self._paths: list[Any] = []
        self._trail: Any = None
        self._ahead: list[Any] = []
        self._curves: dict[str, Any] = {}
        self._shadows: bool | None = None

    def open(self, flight: Scene) -> None:
        """Prepare for a flight: its ground, its path, its arrows."""
        self._along_key = None
        self._suited = scale_for(flight, self.vehicle, self.size)
        lowest, cell = float(np.nanmin(flight.position_E[:, 2])) - 1.2 * self.size, tidy(self.size)
        self._scene.add_grid(
            "/world/ground",
            infinite_grid=True,
            cell_size=cell,
            section_size=5.0 * cell,
            cell_color=(214, 217, 222),
            section_color=(178, 183, 192),
            fade_distance=60.0 * self.size,
            fade_strength=1.5,
            position=(0.0, 0.0, min(0.0, lowest)),
        )
        self.arrows.open(flight)
        for handle in self._paths:
            handle.remove()
        self._trail = self._line("/world/trail", np.zeros((self.trail_points - 1, 2, 3)), PALETTE.body, 4.0)
        self._paths = [self._path("/world/path", flight.time, flight.position_E, PALETTE.path, 1.5), self._trail]
        if flight.reference_position_E is not None:
            pink: Colour = (226, 140, 140)
            self._paths.append(self._path("/world/reference_path", flight.time, flight.reference_position_E, pink, 1.0))
        self.flight = flight  # at last: until then the page goes on with the one before

    def show(self, index: int, shown: Shown) -> None:
        """Move all objects to instant `index`."""
        flight = self.flight
        assert flight is not None
        position = flight.position_E[index]
        self.craft.move(position, flight.quat_EB[index], None if flight.tilt is None else flight.tilt[index])
        self.world.position = -position if shown.follow else np.zeros(3)
        self._reference(flight, index, shown.reference)
        self.scale = self._suited.times(shown.factors)
        self.arrows.show(flight, index, self.scale, shown.arrows(tuple(flight.wrenches)), shown.frames)
        self._show_path(flight, index, shown.path)
        self._show_ahead(flight, index, shown.ahead)
        self._show_along(flight, shown)
        self._show_ghost(float(flight.time[index]))
        if shown.shadows != self._shadows:
            self._shadows = shown.shadows
            self._scene.configure_default_lights(cast_shadow=shown.shadows)

    def curve(self, name: str, points: Array | None, colour: Colour = (20, 160, 150)) -> None:
        """Draw or replace a curve (N, 3) [m] in E under a name; None removes it."""
        old = self._curves.pop(name, None)
        if old is not None:
            old.remove()
        if points is not None and len(points) > 1:
            kept = points[:: max(1, -(-len(points) // self.max_points))]
            self._curves[name] = self._line(f"/world/curve/{name}", _segments(kept), colour, 3.0)

    def _reference(self, flight: Scene, index: int, wanted: bool) -> None:
        known = False
        if wanted and flight.reference_position_E is not None and flight.quat_ED is not None:
            pose = np.concatenate((flight.reference_position_E[index], flight.quat_ED[index]))
            known = bool(np.isfinite(pose).all())
            if known:
                self.reference.position, self.reference.wxyz = pose[:3], pose[3:]
        set_visible(self.reference, known)

    def _show_path(self, flight: Scene, index: int, wanted: bool) -> None:
        for handle in self._paths:
            set_visible(handle, wanted)
        if wanted:
            first = flight.index(float(flight.time[index]) - 2.0)
            rows = np.linspace(first, index, self.trail_points).round().astype(int)
            self._trail.points = _segments(flight.position_E[rows]).astype(np.float32)

    def _show_ahead(self, flight: Scene, index: int, wanted: bool) -> None:
        """The model's path into the next second, and thinner those by which it may be off."""
        paths = found.at(float(flight.time[index])) if wanted and (found := flight.ahead()) else None
        for k, own in enumerate((slice(0, 1), slice(1, None))):
            if paths is not None:
                segments = np.concatenate([_segments(path) for path in paths[own]])
                if len(self._ahead) == k:
                    name, width = f"/world/ahead/{k}", (5.0, 1.5)[k]
                    self._ahead.append(self._line(name, segments, colour_of("predicted"), width))
                self._ahead[k].points = segments.astype(np.float32)
            if len(self._ahead) > k:
                set_visible(self._ahead[k], paths is not None)

    def _show_along(self, flight: Scene, shown: Shown) -> None:
        """Draw frames or arrows along the path, again only when the settings change."""
        key = (shown.along, shown.spacing, self.scale)
        if key == self._along_key:
            return
        self._along_key = key
        for handle in self._along:
            handle.remove()
        self._along = []
        if shown.along == NOTHING:
            return
        grid = np.arange(flight.time[0], flight.time[-1], max(shown.spacing, 1e-3))
        rows = np.unique(np.searchsorted(flight.time, grid[:: max(1, -(-len(grid) // self.max_points))]))
        position, quat = flight.position_E[rows], flight.quat_EB[rows]
        if shown.along == "frames":
            axes = {"axes_length": 0.5 * self.size, "axes_radius": 0.012 * self.size}
            self._along = [self._scene.add_batched_axes("/world/along", quat, position, **axes)]
            return
        kind, _, name = shown.along.partition(" ")
        if name not in flight.wrenches:
            return
        part, scale = (slice(3, 6), self.scale.torque) if kind == "torque" else (slice(0, 3), self.scale.force)
        vector = flight.wrenches[name][rows, part] * scale
        known = np.isfinite(vector).all(axis=1)
        start = position[known]
        points = np.stack((start, start + so3.rotate(quat[known], vector[known])), axis=1)
        self._along = [self._scene.add_arrows("/world/along", points, colour_of(name), **thickness(self.size, 0.008))]

    def _show_ghost(self, time: float) -> None:
        seen, motion = False, self.motion
        if motion is not None and motion.time[0] - 1e-6 <= time <= motion.time[-1] + 1e-6:
            seen, k = True, max(int(np.searchsorted(motion.time, time + 1e-9, side="right")) - 1, 0)
            self.ghost.move(motion.position_E[k], motion.quat_EB[k], None if motion.tilt is None else motion.tilt[k])
        set_visible(self.ghost.frame, seen)

    def _path(self, name: str, time: Array, position: Array, colour: Colour, width: float) -> Any:
        """A path, broken where the log has a gap."""
        step = max(1, -(-len(time) // self.max_points))
        segments = _segments(position[::step])
        whole = np.diff(time[::step]) < 5.0 * step * float(np.median(np.diff(time)))
        known = whole & np.isfinite(segments).all(axis=(1, 2))
        return self._line(name, segments[known], colour, width)

    def _line(self, name: str, segments: Array, colour: Colour, width: float) -> Any:
        return self._scene.add_line_segments(name, segments, colour, thickness=width, thickness_units="screen")

    def _axes(self, name: str, colour: Colour, share: float) -> None:
        """Three arrows of one colour, the x axis longest."""
        lengths = self.size * np.diag([1.6, 1.1, 1.1])
        points = np.stack((np.zeros((3, 3)), lengths), axis=1)
        self._scene.add_arrows(name, points, colour, **thickness(self.size, share))


def _segments(points: Array) -> Array:
    """Points (N, 3) as N - 1 segments (N - 1, 2, 3)."""
    return np.stack((points[:-1], points[1:]), axis=1)


def tidy(step: float) -> float:
    """1, 2 or 5 times a power of ten, at most `step`."""
    power = 10.0 ** np.floor(np.log10(step))
    return float(max(m for m in (1.0, 2.0, 5.0) if m * power <= step * 1.0001) * power)
