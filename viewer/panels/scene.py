"""The tab of the scene: what is drawn, how long arrows are, from where it is looked at, and beside which ghost."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from html import escape
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrenchgap.viewer.align import delay_between
from wrenchgap.viewer.camera import DIRECTIONS
from wrenchgap.viewer.colours import BODY, GHOST, REFERENCE, THRUST, Colour, colour_of, css
from wrenchgap.viewer.drawing import NOTHING, Shown
from wrenchgap.viewer.panel import Panel
from wrenchgap.viewer.session import Motion, Scene

Array = NDArray[np.float64]

ALONG = (NOTHING, "frames")
FOLLOWING, FIXED = "follow", "stay"


class ScenePanel(Panel):
    """Switches of the scene. `shown` is what they say; assigning to it sets them."""

    def __init__(self, page: Any) -> None:
        super().__init__(page)
        self._hidden: set[str] = set()
        gui = page.server.gui
        with page.tab("Scene"):
            self._camera(gui)
            with gui.add_folder("arrows"):
                self._wrenches_slot = gui.add_folder(None)
                self.force = self._box("forces", True)
                self.torque = self._box("torques", True)
                self.frames = self._box("as frames", False, "components along the body's axes in place of one arrow")
                self.uncertainty = self._box(
                    "3 sigma", True, "ellipsoids at the tips of predictions whose uncertainty is known"
                )
                self.thrust = self._box("rotor thrusts", True)
                self.lengths = [self._length(name) for name in ("force length", "torque length", "thrust length")]
            with gui.add_folder("flight"):
                self.reference = self._box("reference", True)
                self.path = self._box("path", True)
                self.shadows = self._box("shadows", False, "slow without a graphics card")
                self.along = gui.add_dropdown("along the path", ALONG, initial_value=NOTHING)
                self.along.on_update(page.guarded(self._changed))
                self.spacing = gui.add_number("every [s]", 0.5, min=0.01, max=60.0, step=0.1)
                self.spacing.on_update(page.guarded(self._changed))
            with gui.add_folder("ghost"):
                self.ghost = gui.add_dropdown("second vehicle", (NOTHING,), initial_value=NOTHING)
                self.ghost.on_update(page.guarded(self._ghost_changed))
                self.shift = gui.add_number("later by [s]", 0.0, step=0.01, hint="moves the ghost on the time axis")
                self.shift.on_update(page.guarded(self._ghost_changed))
                self.align = gui.add_button("Align in time", hint="by when the two turned and climbed alike")
                self.align.on_click(page.guarded(lambda _: self._align()))
        self.boxes: dict[str, Any] = {}
        self._follows = True

    @property
    def shown(self) -> Shown:
        """What the switches say."""
        return Shown(
            force=self.force.value,
            torque=self.torque.value,
            hidden=frozenset(self._hidden),
            frames=self.frames.value,
            thrust=self.thrust.value,
            uncertainty=self.uncertainty.value,
            reference=self.reference.value,
            path=self.path.value,
            shadows=self.shadows.value,
            along=self.along.value,
            spacing=float(self.spacing.value),
            follow=self._follows,
            factors=tuple(float(slider.value) for slider in self.lengths),  # type: ignore[arg-type]
        )

    @shown.setter
    def shown(self, wanted: Shown) -> None:
        for name in ("force", "torque", "frames", "thrust", "uncertainty", "reference", "path", "shadows"):
            getattr(self, name).value = getattr(wanted, name)
        self._hidden = set(wanted.hidden)
        for name, box in self.boxes.items():
            box.value = name not in self._hidden
        if wanted.along in self.along.options:
            self.along.value = wanted.along
        self.spacing.value = wanted.spacing
        for slider, factor in zip(self.lengths, wanted.factors, strict=True):
            slider.value = factor
        self.follow(wanted.follow)
        self.page.redraw()

    def opened(self, scene: Scene) -> None:
        """One switch per wrench; what is hidden stays hidden."""
        gui = self.page.server.gui
        for box in self.boxes.values():
            box.remove()
        self.boxes = {}
        with self._wrenches_slot:
            for name in scene.wrenches:
                self.boxes[name] = gui.add_checkbox(name, name not in self._hidden)
                self.boxes[name].on_update(self.page.guarded(lambda event: self._hide()))
        options = (*ALONG, *(f"{kind} {name}" for name in scene.wrenches for kind in ("force", "torque")))
        kept = self.along.value
        self.along.options = options
        self.along.value = kept if kept in options else NOTHING
        self.offer_ghosts()

    def offer_ghosts(self) -> None:
        """Offer the ghosts that there are for the flight; the chosen one stays if it can."""
        kept = self.ghost.value
        names = (NOTHING, *self.page.ghost_names())
        self.ghost.options = names
        self.ghost.value = kept if kept in names else NOTHING
        self._ghost_changed(None)

    def choose_ghost(self, name: str | None, shift: float = 0.0) -> None:
        """Show the ghost of this name, later by `shift` [s]; none where there is none of that name."""
        self.ghost.value = name if name in self.ghost.options else NOTHING
        self.shift.value = shift

    def follow(self, on: bool) -> None:
        """Let the camera follow the body or stay; what is seen at this moment does not jump."""
        if on != self._follows:
            self._follows = on
            position = self.page.scene.position_E[self.page.cursor.index]
            with self.page.server.atomic():
                self.page.cameras.shift(-position if on else position)
                self.page.redraw()
            self.mode.value = FOLLOWING if on else FIXED

    def look(self, direction: str, clients: Any = None) -> None:
        """Look at the vehicle from one of the directions, or at the whole path."""
        scene = self.page.scene
        body = np.zeros(3) if self._follows else scene.position_E[self.page.cursor.index]
        if direction != "all":
            self.page.cameras.look(direction, body, clients=clients)
            return
        self.follow(False)
        low, high = np.nanmin(scene.position_E, axis=0), np.nanmax(scene.position_E, axis=0)
        extent = max(0.45 * float(np.linalg.norm(high - low)), self.page.drawing.size)
        self.page.cameras.look("oblique", 0.5 * (low + high), extent, clients)

    def legend_rows(self) -> list[tuple[str, Colour]]:
        """Names and colours of what is to be seen."""
        shown, scene = self.shown, self.page.scene
        rows = [("body frame", BODY)]
        rows += [("reference frame", REFERENCE)] if self.page.drawing.reference.visible else []
        arrows = [name for name in scene.wrenches if name not in shown.hidden] if shown.force or shown.torque else []
        rows += [(name, colour_of(name)) for name in arrows]
        rows += [("rotor thrusts", THRUST)] if shown.thrust and scene.thrust is not None else []
        return rows + ([(f"ghost: {self.ghost.value}", GHOST)] if self.ghost.value != NOTHING else [])

    def legend(self) -> str:
        """The same as HTML, with the lengths."""
        shown = self.shown
        swatch = "display:inline-block;width:11px;height:11px;border-radius:3px;margin-right:7px;vertical-align:-1px"
        lines = "".join(
            f'<div><span style="{swatch};background:{css(colour)}"></span>{escape(name)}</div>'
            for name, colour in self.legend_rows()
        )
        kinds = "thin: force, thick: torque<br>" if shown.force and shown.torque else ""
        words = self.page.drawing.scale.words().replace(", ", "<br>&emsp;&emsp;&emsp;")
        return (
            f'<div style="font-size:12px;line-height:1.55;padding:4px 12px 10px">{lines}'
            f'<div style="color:#868e96;margin-top:4px;font-size:11px;line-height:1.35">{kinds}{words}</div></div>'
        )

    def _camera(self, gui: Any) -> None:
        guarded, command = self.page.guarded, self.page.command
        self.mode = gui.add_button_group("camera", (FOLLOWING, FIXED), hint="key F")
        self.mode.on_click(guarded(lambda _: self.follow(self.mode.value == FOLLOWING)))
        self.view = gui.add_button_group("look from", (*DIRECTIONS, "all"), hint="keys 1 to 5")
        self.view.on_click(guarded(lambda event: self.look(self.view.value, _only(event.client))))
        command("Follow the vehicle, or stay", lambda: self.follow(not self._follows), "F")
        for key, direction in enumerate((*DIRECTIONS, "all"), start=1):
            command(f"Look from: {direction}", partial(self.look, direction), str(key))

    def _box(self, label: str, value: bool, hint: str | None = None) -> Any:
        box = self.page.server.gui.add_checkbox(label, value, hint=hint)
        box.on_update(self.page.guarded(self._changed))
        return box

    def _length(self, label: str) -> Any:
        slider = self.page.server.gui.add_slider(label, 0.1, 10.0, 0.1, 1.0, hint="times the length that suits")
        slider.on_update(self.page.guarded(self._changed))
        return slider

    def _changed(self, event: Any) -> None:
        """A client moved a switch."""
        if event.client_id is not None:
            self.page.redraw()

    def _hide(self) -> None:
        for name, box in self.boxes.items():
            (self._hidden.discard if box.value else self._hidden.add)(name)
        self.page.redraw()

    def _ghost_changed(self, event: Any) -> None:
        motion = self.page.ghost(self.ghost.value)
        self.page.drawing.motion = None if motion is None else _later(motion, float(self.shift.value))
        if event is not None:
            self.page.redraw()

    def _align(self) -> None:
        """Shift the ghost so that it does what the vehicle does when the vehicle does it."""
        motion = self.page.ghost(self.ghost.value)
        if motion is None:
            self.page.notify("Choose a second vehicle first.", "warning")
            return
        delay = delay_between(motion, self.page.scene.motion)
        if delay is None:
            self.page.notify("The two flights never move alike, so they cannot be aligned.", "warning")
            return
        self.shift.value = round(delay, 3)
        self.page.redraw()


def _only(client: Any) -> Any:
    return None if client is None else [client]


def _later(motion: Motion, seconds: float) -> Motion:
    return motion if seconds == 0.0 else replace(motion, time=motion.time + seconds)
