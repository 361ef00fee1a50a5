"""The page in the browser: a flight in 3D, plots, and panels.

page = Page(session)           # serves page.url: http://127.0.0.1:8080/ and a token
page.cursor.go(12.5)
page.stop()

All clients see one state: controls, cursor and scene are the server's, only the camera is each client's own.
"""

import threading
from dataclasses import replace
from typing import Any

import numpy as np

from wrenchgap.flight.flight import Array
from wrenchgap.viewer import markup
from wrenchgap.viewer.channels import ChannelPicker
from wrenchgap.viewer.colours import css
from wrenchgap.viewer.cursor import Cursor
from wrenchgap.viewer.host import Host
from wrenchgap.viewer.panel import Panel, Part
from wrenchgap.viewer.panels.export import ExportPanel
from wrenchgap.viewer.panels.notes import NotesPanel
from wrenchgap.viewer.panels.scene import ScenePanel
from wrenchgap.viewer.plot_board import Board
from wrenchgap.viewer.plots import GROUPS, plots_of
from wrenchgap.viewer.scene_drawing import Drawing
from wrenchgap.viewer.serving import serve
from wrenchgap.viewer.session import Motion, Scene, Session
from wrenchgap.viewer.transport import ZOOMS, Transport
from wrenchgap.viewer.view_state import ViewState


class Page(Host):
    """The page of one session, served from construction to `stop`."""

    def __init__(self, session: Session, host: str = "127.0.0.1", port: int = 8080) -> None:
        self.server, self.gate, self.drops = serve(host, port)
        self.gui = self.server.gui
        self.lock = threading.RLock()
        self.cursor = Cursor(self.lock)
        self._jobs = []
        self._waiting = threading.BoundedSemaphore(self.max_waiting)
        self._start(session)
        self.server.on_client_disconnect(self._left)
        self.cursor.run()

    def replace(self, session: Session) -> None:
        """Show another session on the same page; work for the one before is cancelled."""
        with self.lock, self.server.atomic():
            for job in self._jobs:
                job.cancel()
            self.cursor.listeners.clear()
            for drop in self.drops.values():
                drop.close()
            self.gui.reset()
            self.drops.clear()
            self.server.scene.reset()
            self._start(session)

    def _start(self, session: Session) -> None:
        self.session = session
        self.view = ViewState(zoom=ZOOMS[0], speed="1")
        self.scene = session.scene(session.flights[0])
        with self.lock, self.server.atomic():
            self.drawing = Drawing(self.server.scene, session.vehicle)
            self.drawing.open(self.scene)
            self._build()
            self.cursor.listeners.append(lambda _: self._show())
            self.open(session.flights[0])
            self.scene_panel.look("oblique")

    @property
    def url(self) -> str:
        """The link to the page, for a browser on this machine; it gives full access."""
        return self.gate.url(self.port)

    @property
    def port(self) -> int:
        """The port on which the page listens."""
        return int(self.server.get_port())

    def open(self, name: str) -> None:
        """Show another flight from its start; switches, plots, range and speed stay."""
        with self.lock, self.server.atomic():
            scene = self.session.scene(name)
            self.transport.playing(False)
            self.cursor.open(scene.time)
            self.view = replace(self.view, flight=name, marks={}, loop=False)
            self._fill(scene)

    def refresh(self) -> None:
        """Ask the session for the flight again after the model changed; the cursor stays where it is."""
        with self.lock, self.server.atomic():
            self._fill(self.session.scene(self.scene.name))

    def show(self, view: ViewState) -> None:
        """Show this view, as far as the flight has it; all parts follow."""
        with self.lock, self.server.atomic():
            for part in self._parts:
                view = part.possible(view)
            if view != self.view:
                self.view = view
                self._follow_view()

    def restore(self, view: ViewState, client: Any = None) -> None:
        """Show a saved view; its flight may be one that is not open here, the layout then goes to the flight shown."""
        with self.lock, self.server.atomic():
            if view.flight in self.session.flights and view.flight != self.scene.name:
                self.open(str(view.flight))
            elif view.flight is not None and view.flight != self.scene.name:
                self.notify(f"The view is of {view.flight}, which is not open here; its layout is used.", "warning")
            if view.time is not None:
                self.cursor.go(view.time)
            self.show(replace(view, flight=self.scene.name, time=None, camera=None))
            if view.camera is not None:
                position, look_at = (np.array(point) for point in view.camera)
                self.scene_panel.cameras.place(position, look_at, None if client is None else [client])

    def view_of(self, client: Any = None) -> ViewState:
        """The present view with the time, and the camera of a client where one is given, to be saved."""
        camera = None
        if client is not None:
            (a, b, c), (d, e, f) = (map(float, p) for p in (client.camera.position, client.camera.look_at))
            camera = ((a, b, c), (d, e, f))
        return replace(self.view, flight=self.scene.name, time=self.cursor.time, camera=camera)

    def replot(self) -> None:
        """Rebuild the plots after their selection changed."""
        with self.lock, self.server.atomic():
            self.board.fill([*plots_of(self.scene), *self.channels.plots()], self.transport.plotted)
            self.board.move(self.cursor.time)

    def show_ghost(self, name: str, motion: Motion) -> None:
        """Offer a second vehicle under a name for the present flight, and show it."""
        with self.lock, self.server.atomic():
            self.scene_panel.offer_ghost(name, motion)
            self.show(replace(self.view, ghost=name, ghost_shift=0.0))
            self._draw()

    def curve(self, name: str, points: Array | None, colour: tuple[int, int, int]) -> None:
        """Draw a curve (N, 3) [m] in E under a name; None removes it."""
        self.drawing.curve(name, points, colour)

    def stop(self, patience: float = 2.0) -> None:
        """Stop playing and serving; wait `patience` [s] for each piece of cancelled work."""
        for job in self._jobs:
            job.cancel()
        for job in self._jobs:
            job.join(patience)
        self.cursor.close()
        self.server.stop()

    def _build(self) -> None:
        """Controls that do not depend on the flight: time above, tabs below, plots on the left, legend in the scene."""
        gui, names = self.gui, self.session.flights
        gui.configure_theme(show_logo=False, show_share_button=False, brand_color=(25, 105, 220))
        gui.set_panel_label("wrenchgap")
        gui.add_html(markup.style())
        self._banner = gui.add_html("")
        choice = gui.add_dropdown("flight", names, initial_value=names[0], visible=len(names) > 1)
        self.choice = self.connect(choice, self._chosen)
        self.board = Board(gui)
        self.transport = Transport(self, self.board)
        for group in GROUPS if self.scene.wrenches else dict.fromkeys(s.group for s in self.scene.series):
            self.board.tab(group)
        self.channels = ChannelPicker(self, self.board, self.session.capabilities.channels)
        self.tabs = gui.add_tab_group()
        first = self.session.capabilities.first
        before = [] if first is None else [first(self)]
        self.scene_panel = ScenePanel(self, self.drawing)
        of_session = [*before, *(make(self) for make in self.session.capabilities.panels)]
        last = (ExportPanel(self, self.board, self.scene_panel.legend_parts), NotesPanel(self))
        self.panels: list[Panel] = [self.scene_panel, *of_session, *last]
        self._parts: tuple[Part, ...] = (self.transport, *self.panels, self.channels)
        self.legend = gui.add_panel()
        with self.legend.add_tab("Legend"):
            self._legend = gui.add_html("")
        gui.main_panel.dock_right()
        gui.main_panel.set_width(350)
        self.board.panel.dock_left()
        self.board.panel.set_width(505)
        self.legend.float(x=14, y=14, width=190)

    def _chosen(self, event: Any) -> None:
        if self.choice.value != self.scene.name:
            self.open(self.choice.value)

    def _fill(self, scene: Scene) -> None:
        """Show a flight at the cursor: another one, or the same one after the model changed."""
        self.scene = scene
        self.drawing.open(scene)
        self._banner.content = markup.banner(scene.warnings)
        if self.choice.value != scene.name:
            self.choice.value = scene.name
        for part in self._parts:
            part.opened(scene)
        for part in self._parts:
            self.view = part.possible(self.view)
        self._follow_view()
        self.replot()
        self._show()

    def _follow_view(self) -> None:
        for part in self._parts:
            part.viewed(self.view)
        self._draw()

    def _show(self) -> None:
        with self.lock, self.server.atomic():
            self._draw()
            self.board.move(self.cursor.time, quick=self.cursor.playing)

    def _draw(self) -> None:
        self.drawing.show(self.cursor.index, self.view.shown)
        rows, lengths = self.scene_panel.legend_parts()
        kinds = self.view.shown.force and self.view.shown.torque
        colours = [(name, css(colour)) for name, colour in rows]
        legend = markup.render("legend", rows=colours, kinds=kinds, lengths=lengths)
        if self._legend.content != legend:
            self._legend.content = legend

    def _left(self, client: Any) -> None:
        """Pause after the last client has left."""
        if not self.server.get_clients():
            self.transport.playing(False)
