"""A page in the browser: a flight in 3D, plots over one time, and panels that ask what the model lacks.

page = Page(session)           # serves http://127.0.0.1:8080
page.cursor.go(12.5)
page.stop()

All clients see one state: controls, cursor and scene are the server's, only the camera is each client's own.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from wrenchgap.viewer import background
from wrenchgap.viewer.board import Board
from wrenchgap.viewer.camera import Cameras
from wrenchgap.viewer.channels import ChannelPicker
from wrenchgap.viewer.cursor import Cursor
from wrenchgap.viewer.drawing import Drawing
from wrenchgap.viewer.lines import GROUPS, plots_of
from wrenchgap.viewer.panel import Panel
from wrenchgap.viewer.panels import PANELS
from wrenchgap.viewer.panels.notes import NotesPanel
from wrenchgap.viewer.panels.out import OutPanel
from wrenchgap.viewer.panels.scene import ScenePanel
from wrenchgap.viewer.saved_view import SavedView
from wrenchgap.viewer.serving import exposed, serve
from wrenchgap.viewer.session import Motion, Scene, Session
from wrenchgap.viewer.transport import Transport

__all__ = ["Page", "exposed"]

Array = NDArray[np.float64]
T = TypeVar("T")
Kind = Literal["info", "warning", "error"]

KINDS: dict[Kind, str] = {"info": "blue", "warning": "yellow", "error": "red"}
CONTROLS, PLOTS = 350, 505
"""Widths of the panels on the right and on the left [px]."""


class Page:
    """The page of one session, served from construction to `stop`. Host and port are where it listens."""

    def __init__(
        self, session: Session, host: str = "127.0.0.1", port: int = 8080, panels: Sequence[type[Panel]] = PANELS
    ) -> None:
        self.session: Any = session  # at least a Session; panels ask for more
        self.server: Any = serve(host, port)
        self.lock = threading.RLock()
        self.cursor = Cursor(self.lock)
        self.ghosts: dict[str, dict[str, Motion]] = {}
        self._jobs: list[background.Job] = []
        with self.server.atomic():
            self.drawing = Drawing(self.server.scene, session.vehicle)
            self.cameras = Cameras(self.server, self.drawing.size)
            self._build([panel for panel in panels if panel.suits(session)])
            self.cursor.listeners.append(lambda _: self._show())
            self.open(session.flights[0])
            self.scene_panel.look("oblique")
        self.server.on_client_disconnect(self._left)
        self.cursor.run()

    @property
    def url(self) -> str:
        """Where to find it."""
        return f"http://{self.server.get_host()}:{self.server.get_port()}"

    def tab(self, label: str, icon: Any = None) -> Any:
        """A new tab of the control panel, as a context to put controls into."""
        return self._tabs.add_tab(label, icon)

    def command(self, label: str, act: Callable[[], Any], hotkey: Any = None, modifier: Any = None) -> None:
        """A command of the palette (ctrl-K), with a key where one is given."""
        handle = self.server.gui.add_command(label, hotkey=hotkey, modifier=modifier)
        handle.on_trigger(self.guarded(lambda _: act()))

    def open(self, name: str) -> None:
        """Show another flight from its start; switches, plots, range and speed stay."""
        with self.lock, self.server.atomic():
            scene = self.session.scene(name)
            self.transport.playing(False)
            self.cursor.open(scene.time)
            if self.choice.value != name:
                self.choice.value = name
            self._fill(scene)

    def refresh(self) -> None:
        """Ask the session for the flight again after the model changed; the cursor stays where it is."""
        with self.lock, self.server.atomic():
            self._fill(self.session.scene(self.scene.name), keep=True)

    def redraw(self) -> None:
        """Draw the scene anew after switches changed."""
        with self.lock, self.server.atomic():
            self._draw()

    def replot(self) -> None:
        """Make the plots anew after it changed which there are."""
        with self.lock, self.server.atomic():
            self.board.fill([*plots_of(self.scene), *self.channels.plots()], self.transport.view)
            self.board.move(self.cursor.time)

    def ghost_names(self) -> tuple[str, ...]:
        """What can be shown as a second vehicle beside the flight: what panels made, and the other flights."""
        others = [name for name in self.session.flights if name != self.scene.name]
        return (*self.ghosts.get(self.scene.name, {}), *others)

    def ghost(self, name: str) -> Motion | None:
        """One of them; another flight begins when this one does."""
        made = self.ghosts.get(self.scene.name, {}).get(name)
        if made is not None or name not in self.session.flights:
            return made
        motion: Motion = self.session.scene(name).motion
        return replace(motion, time=motion.time - motion.time[0] + self.scene.time[0])

    def show_ghost(self, name: str, motion: Motion) -> None:
        """Offer a second vehicle for the flight shown, under a name, and show it."""
        with self.lock:
            self.ghosts.setdefault(self.scene.name, {})[name] = motion
            self.scene_panel.offer_ghosts()
            self.scene_panel.choose_ghost(name)
            self.redraw()

    def notify(self, text: str, kind: Kind = "info", seconds: float = 8.0) -> None:
        """Tell all clients something, in a corner of the page."""
        for client in self.server.get_clients().values():
            client.add_notification("wrenchgap", text, color=KINDS[kind], auto_close_seconds=seconds)

    def fail(self, error: Exception) -> None:
        """Tell all clients what went wrong."""
        self.notify(background.told(error), "error", 15.0)

    def background(
        self,
        function: Callable[[background.Report], T],
        on_progress: background.Report,
        on_done: Callable[[T], None],
        on_error: Callable[[Exception], None] | None = None,
    ) -> background.Job:
        """Do long work beside the page: `function(report)` on a thread, the others under the page's lock.

        `function` may call `report(share, words)`; `on_done` gets its result, `on_error` what it raised (default: the
        user is told). `cancel()` of the job ends it at its next report.
        """
        job = background.start(function, on_progress, on_done, on_error or self.fail, self.lock)
        self._jobs = [j for j in self._jobs if j.is_alive()] + [job]
        return job

    def guarded(self, callback: Callable[[Any], None]) -> Callable[[Any], None]:
        """`callback` under the page's lock; what it raises is told to the user and does not end the page."""

        def run(event: Any) -> None:
            try:
                with self.lock, self.server.atomic():
                    callback(event)
            except Exception as error:  # the boundary between the page and whatever a user may do
                self.fail(error)

        return run

    def saved_view(self, client: Any = None) -> SavedView:
        """What is seen at this moment, with the camera of a client where one is given."""
        camera = None
        if client is not None:
            position, look_at = (tuple(float(v) for v in p) for p in (client.camera.position, client.camera.look_at))
            camera = (position, look_at)
        return SavedView(
            flight=self.scene.name,
            time=self.cursor.time,
            marks=dict(self.transport.marks),
            loop=self.cursor.loop is not None,
            zoom=self.transport.zoom.value,
            speed=self.transport.speed.value,
            shown=self.scene_panel.shown,
            channels=tuple(self.channels.names),
            ghost=self.scene_panel.ghost.value,
            ghost_shift=float(self.scene_panel.shift.value),
            camera=camera,  # type: ignore[arg-type]
        )

    def restore(self, view: SavedView, client: Any = None) -> None:
        """Show a saved view; its flight may be one that is not open here, the layout then goes to the flight shown."""
        with self.lock, self.server.atomic():
            if view.flight in self.session.flights and view.flight != self.scene.name:
                self.open(str(view.flight))
            elif view.flight is not None and view.flight != self.scene.name:
                self.notify(f"The view is of {view.flight}, which is not open here; its layout is used.", "warning")
            self.transport.choose(view.zoom, view.speed)
            if view.time is not None:
                self.cursor.go(view.time)
            self.transport.set_marks(dict(view.marks), view.loop)
            self.channels.plot(list(view.channels))
            self.scene_panel.shown = view.shown
            self.scene_panel.choose_ghost(view.ghost, view.ghost_shift)
            if view.camera is not None:
                position, look_at = (np.array(point) for point in view.camera)
                self.cameras.place(position, look_at, None if client is None else [client])
            self._show()

    def stop(self) -> None:
        """Stop playing and serving."""
        for job in self._jobs:
            job.cancel()
        self.cursor.close()
        for panel in self.panels:
            panel.closed()
        self.server.stop()

    def _build(self, panels: Sequence[type[Panel]]) -> None:
        """Controls that do not depend on the flight: time above, tabs below, plots on the left, legend in the scene."""
        gui, names = self.server.gui, self.session.flights
        gui.configure_theme(show_logo=False, show_share_button=False, brand_color=(25, 105, 220))
        gui.set_panel_label("wrenchgap")
        self.choice = gui.add_dropdown("flight", names, initial_value=names[0], visible=len(names) > 1)
        self.choice.on_update(self.guarded(self._chosen))
        self.transport = Transport(self)
        self.board = Board(gui)
        for group in GROUPS:
            self.board.tab(group)
        self.channels = ChannelPicker(self)
        self._tabs = gui.add_tab_group()
        self.scene_panel = ScenePanel(self)
        self.panels: list[Panel] = [self.scene_panel, *(panel(self) for panel in panels), OutPanel(self)]
        self.panels.append(NotesPanel(self))
        self.legend = gui.add_panel()
        with self.legend.add_tab("Legend"):
            self._legend = gui.add_html("")
        gui.main_panel.dock_right()
        gui.main_panel.set_width(CONTROLS)
        self.board.panel.dock_left()
        self.board.panel.set_width(PLOTS)
        self.legend.float(x=14, y=14, width=190)

    def _chosen(self, event: Any) -> None:
        if self.choice.value != self.scene.name:
            self.open(self.choice.value)

    def _fill(self, scene: Scene, *, keep: bool = False) -> None:
        """Show a flight at the cursor; with `keep`, it is the one that was shown before."""
        self.scene = scene
        self.transport.open(scene, keep=keep)
        self.drawing.open(scene)
        for panel in self.panels:
            panel.opened(scene)
        self.channels.opened()
        self.replot()
        self._show()

    def _show(self) -> None:
        """Move everything to the cursor."""
        with self.lock, self.server.atomic():
            self._draw()
            self.board.move(self.cursor.time, quick=self.cursor.playing)
            for panel in self.panels:
                panel.moved(self.cursor.time)

    def _draw(self) -> None:
        self.drawing.show(self.cursor.index, self.scene_panel.shown)
        legend = self.scene_panel.legend()
        if self._legend.content != legend:
            self._legend.content = legend

    def _left(self, client: Any) -> None:
        """The last client has gone: nobody watches, so nothing plays."""
        if not self.server.get_clients():
            self.transport.playing(False)
