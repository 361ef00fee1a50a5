"""The tab of the scene: its contents, lengths of arrows, camera, and ghost."""

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from wrenchgap.flight import so3
from wrenchgap.flight.flight import Array
from wrenchgap.flight.stamps import interpolated
from wrenchgap.viewer.colours import PALETTE, Colour, colour_of
from wrenchgap.viewer.host import Host
from wrenchgap.viewer.panel import Panel
from wrenchgap.viewer.scene_drawing import NOTHING, Drawing
from wrenchgap.viewer.session import Motion, Scene
from wrenchgap.viewer.view_state import ViewState

ALONG = (NOTHING, "frames")
SWITCHES = ("force", "torque", "frames", "thrust", "uncertainty", "reference", "path", "ahead", "shadows")
FOLLOWING, FIXED = "follow", "stay"
DIRECTIONS: dict[str, tuple[float, float, float]] = {
    "oblique": (-3.5, -4.0, 2.5),
    "top": (-0.001, 0.0, 6.6),
    "side": (0.0, -6.6, 0.4),
    "front": (6.6, 0.0, 0.4),
}
"""From what is looked at to the camera, in sizes of the vehicle (of the path, for the whole of it)."""


class Cameras:
    """Places the cameras of all present and later clients around a vehicle of `size` [m].

    `fov` is their vertical field of view [rad], narrower than viser's, so that frames are not distorted.
    """

    def __init__(self, server: Any, size: float, fov: float = 0.75) -> None:
        self._server, self._size, self._fov = server, size, fov
        server.initial_camera.fov = fov
        server.initial_camera.near = 0.02 * size

    def look(self, direction: str, focus: Array, extent: float | None = None, clients: Any = None) -> None:
        """Look at `focus` (3,) from one of `DIRECTIONS`, from so far away that `extent` [m] (the vehicle) is seen."""
        size = extent or self._size
        self.place(focus + size * np.array(DIRECTIONS[direction]), focus, clients)

    def place(self, position: Array, look_at: Array, clients: Any = None) -> None:
        """Put the cameras at `position` (3,), looking at `look_at` (3,); of `clients`, or of everybody."""
        initial = self._server.initial_camera
        initial.position, initial.look_at = position, look_at
        for client in self._server.get_clients().values() if clients is None else clients:
            with client.atomic():
                client.camera.position = position
                client.camera.look_at = look_at
                client.camera.fov = self._fov

    def shift(self, by: Array) -> None:
        """Move all cameras by `by` (3,) [m], as they look."""
        initial = self._server.initial_camera
        initial.position, initial.look_at = initial.position + by, initial.look_at + by
        for client in self._server.get_clients().values():
            client.camera.position = client.camera.position + by  # takes what it looks at along


class ScenePanel(Panel):
    """Switches of the scene, and the second vehicles that other panels offer."""

    def __init__(self, host: Host, drawing: Drawing) -> None:
        super().__init__(host)
        self._drawing, self.cameras = drawing, Cameras(host.server, drawing.size)
        self._ghosts: dict[str, dict[str, Motion]] = {}
        self._follows = True
        gui, connect = host.gui, host.connect
        with host.tab("Scene"):
            self._camera()
            with gui.add_folder("arrows"):
                self._wrenches_slot = gui.add_folder(None)
                self.force = self._box("forces", "force")
                self.torque = self._box("torques", "torque")
                self.frames = self._box("as frames", "frames", "components along the body's axes, not one arrow")
                hint = "ellipsoids at the tips of predictions whose uncertainty is known"
                self.uncertainty = self._box("3 sigma", "uncertainty", hint)
                self.thrust = self._box("rotor thrusts", "thrust")
                kinds = ("force", "torque", "thrust")
                self.lengths = [self._length(k, f"{name} length") for k, name in enumerate(kinds)]
            with gui.add_folder("flight"):
                self.reference = self._box("reference", "reference")
                self.path = self._box("path", "path")
                hint = "where the model leads from here by the logged commands alone, and how far it may be off"
                self.ahead = self._box("next second, predicted", "ahead", hint)
                self.shadows = self._box("shadows", "shadows", "slow without a graphics card")
                self.along = gui.add_dropdown("along the path", ALONG, initial_value=NOTHING)
                connect(self.along, lambda _: self._switch(along=self.along.value))
                self.spacing = gui.add_number("every [s]", 0.5, min=0.01, max=60.0, step=0.1)
                connect(self.spacing, lambda _: self._switch(spacing=float(self.spacing.value)))
            with gui.add_folder("ghost"):
                self.ghost = gui.add_dropdown("second vehicle", (NOTHING,), initial_value=NOTHING)
                connect(self.ghost, lambda _: self._see(ghost=self.ghost.value))
                self.shift = gui.add_number("later by [s]", 0.0, step=0.01, hint="moves the ghost on the time axis")
                connect(self.shift, lambda _: self._see(ghost_shift=float(self.shift.value)))
                self.align = gui.add_button("Align in time", hint="by when the two turned and climbed alike")
                connect(self.align, lambda _: self._align())
        self.boxes: dict[str, Any] = {}

    def opened(self, scene: Scene) -> None:
        """One switch per wrench; hidden wrenches stay hidden."""
        for box in self.boxes.values():
            box.remove()
        self.boxes = {}
        with self._wrenches_slot:
            for name in scene.wrenches:
                box = self.host.gui.add_checkbox(name, name not in self.host.view.shown.hidden)
                self.boxes[name] = self.host.connect(box, partial(self._hide, name))
        self.along.options = (*ALONG, *(f"{kind} {name}" for name in scene.wrenches for kind in ("force", "torque")))
        self._offer_ghosts()

    def possible(self, view: ViewState) -> ViewState:
        """The view with only the wrenches and ghosts of this flight."""
        along = view.shown.along if view.shown.along in self.along.options else NOTHING
        ghost = view.ghost if view.ghost in self.ghost.options else NOTHING
        return replace(view, shown=replace(view.shown, along=along), ghost=ghost)

    def viewed(self, view: ViewState) -> None:
        """Take the switches, ghost and camera of the view."""
        shown = view.shown
        for name in SWITCHES:
            getattr(self, name).value = getattr(shown, name)
        for name, box in self.boxes.items():
            box.value = name not in shown.hidden
        self.along.value, self.spacing.value = shown.along, shown.spacing
        for slider, factor in zip(self.lengths, shown.factors, strict=True):
            slider.value = factor
        self.ghost.value, self.shift.value = view.ghost, view.ghost_shift
        motion = self.ghost_of(view.ghost)
        self._drawing.motion = motion and replace(motion, time=motion.time + view.ghost_shift)
        if shown.follow != self._follows:
            self._follows = shown.follow
            position = self.host.scene.position_E[self.host.cursor.index]
            self.cameras.shift(-position if shown.follow else position)  # what is seen at this moment does not jump
            self.mode.value = FOLLOWING if shown.follow else FIXED

    def _see(self, **changes: Any) -> None:
        self.host.show(replace(self.host.view, **changes))

    def _switch(self, **changes: Any) -> None:
        self._see(shown=replace(self.host.view.shown, **changes))

    def _hide(self, name: str, event: Any) -> None:
        hidden = self.host.view.shown.hidden
        self._switch(hidden=hidden - {name} if self.boxes[name].value else hidden | {name})

    def _offer_ghosts(self) -> None:
        """The second vehicles: those that panels offer, and the other flights."""
        shown = self.host.scene.name
        others = (name for name in self.host.session.flights if name != shown)
        self.ghost.options = (NOTHING, *self._ghosts.get(shown, {}), *others)

    def ghost_of(self, name: str) -> Motion | None:
        """The motion of a ghost; another flight starts with this one."""
        scene = self.host.scene
        made = self._ghosts.get(scene.name, {}).get(name)
        if made is not None or name not in self.host.session.flights:
            return made
        motion = self.host.session.scene(name).motion
        return replace(motion, time=motion.time - motion.time[0] + scene.time[0])

    def offer_ghost(self, name: str, motion: Motion) -> None:
        """Add or replace a ghost of the present flight."""
        self._ghosts.setdefault(self.host.scene.name, {})[name] = motion
        self._offer_ghosts()
        self.viewed(self.host.view)

    def follow(self, on: bool) -> None:
        """Let the camera follow the body or stay."""
        self._switch(follow=on)

    def look(self, direction: str, clients: Any = None) -> None:
        """Look at the vehicle from one of the directions, or at the whole path."""
        scene = self.host.scene
        body = np.zeros(3) if self._follows else scene.position_E[self.host.cursor.index]
        if direction != "all":
            self.cameras.look(direction, body, clients=clients)
            return
        self.follow(False)
        low, high = np.nanmin(scene.position_E, axis=0), np.nanmax(scene.position_E, axis=0)
        extent = max(0.45 * float(np.linalg.norm(high - low)), self._drawing.size)
        self.cameras.look("oblique", 0.5 * (low + high), extent, clients)

    def legend_parts(self) -> tuple[list[tuple[str, Colour]], list[str]]:
        """Names and colours of the visible parts, and the scales of the arrows in words."""
        view, scene = self.host.view, self.host.scene
        shown = view.shown
        rows = [("body frame", PALETTE.body)]
        rows += [("reference frame", PALETTE.reference)] if self._drawing.reference.visible else []
        arrows = [name for name in scene.wrenches if name not in shown.hidden] if shown.force or shown.torque else []
        rows += [(name, colour_of(name)) for name in arrows]
        rows += [("rotor thrusts", PALETTE.thrust)] if shown.thrust and scene.thrust is not None else []
        rows += [(f"ghost: {view.ghost}", PALETTE.ghost)] if view.ghost != NOTHING else []
        return rows, self._drawing.scale.words().split(", ")

    def _camera(self) -> None:
        gui, connect, command = self.host.gui, self.host.connect, self.host.command
        self.mode = gui.add_button_group("camera", (FOLLOWING, FIXED), hint="key F")
        connect(self.mode, lambda _: self.follow(self.mode.value == FOLLOWING))
        self.view = gui.add_button_group("look from", (*DIRECTIONS, "all"), hint="keys 1 to 5")
        connect(self.view, lambda event: self.look(self.view.value, event.client and [event.client]))
        command("Follow the vehicle, or stay", lambda: self.follow(not self._follows), "F")
        for key, direction in enumerate((*DIRECTIONS, "all"), start=1):
            command(f"Look from: {direction}", partial(self.look, direction), str(key))

    def _box(self, label: str, name: str, hint: str | None = None) -> Any:
        box = self.host.gui.add_checkbox(label, bool(getattr(self.host.view.shown, name)), hint=hint)
        return self.host.connect(box, lambda _: self._switch(**{name: box.value}))

    def _length(self, k: int, label: str) -> Any:
        slider = self.host.gui.add_slider(label, 0.1, 10.0, 0.1, 1.0, hint="times the length that suits")

        def changed(_: Any) -> None:
            factors = list(self.host.view.shown.factors)
            factors[k] = float(slider.value)
            self._switch(factors=tuple(factors))

        return self.host.connect(slider, changed)

    def _align(self) -> None:
        """Shift the ghost in time to align its motion with that of the vehicle."""
        motion = self.ghost_of(self.host.view.ghost)
        if motion is None:
            self.host.notify("Choose a second vehicle first.", "warning")
        elif (delay := delay_between(motion, self.host.scene.motion)) is None:
            self.host.notify("The two flights never move alike, so they cannot be aligned.", "warning")
        else:
            self._see(ghost_shift=round(delay, 3))


def delay_between(late: Motion, fixed: Motion, least: float = 0.5, step: float = 0.02) -> float | None:
    """Shift [s] of `late` for which it moves as `fixed` does; None below a correlation of `least`.

    The delay at which the products of the two motions' features (body z axis in E, height, each without its mean)
    correlate best, among those at which the shorter one overlaps by half or more. They are compared every `step` [s].
    """
    a, b = _features(fixed, step), _features(late, step)
    if not (a.any() and b.any()):
        return None
    size = 1 << (len(a) + len(b) - 2).bit_length()
    spectrum = np.fft.rfft(a, size, axis=0) * np.conj(np.fft.rfft(b, size, axis=0))
    products = np.fft.irfft(spectrum.sum(axis=1), size)
    lags = np.arange(-(len(b) - 1), len(a))
    energy_a, energy_b = (np.concatenate(([0.0], np.cumsum((x**2).sum(axis=1)))) for x in (a, b))  # up to each sample
    first, last = np.maximum(0, lags), np.minimum(len(a), lags + len(b))
    in_a = energy_a[last] - energy_a[first]
    in_b = energy_b[last - lags] - energy_b[first - lags]
    score = products[lags % size] / np.sqrt(np.maximum(in_a * in_b, 1e-30))
    score[last - first < 0.5 * min(len(a), len(b))] = -np.inf
    best = int(np.argmax(score))
    if score[best] < least:
        return None
    return float(lags[best] * step + fixed.time[0] - late.time[0])


def _features(motion: Motion, step: float) -> Array:
    """Body x and z axes in E and the height (N, 7), on a uniform clock, each without its mean."""
    clock = np.arange(motion.time[0], motion.time[-1], step)
    x = so3.rotate(motion.quat_EB, np.array([1.0, 0.0, 0.0]))
    z = so3.rotate(motion.quat_EB, np.array([0.0, 0.0, 1.0]))
    raw = np.column_stack((x, z, motion.position_E[:, 2]))
    out = interpolated(clock, motion.time, raw)
    out = out - out.mean(axis=0)
    out[:, 6] /= max(float(np.abs(out[:, 6]).max()), 1e-3)
    return np.asarray(out)
