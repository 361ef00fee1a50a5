"""A page in the browser: the vehicle as it flew, its wrenches as arrows and plots, a slider for time.

page = Page(session)           # serves http://127.0.0.1:8080
page.cursor.go(12.5)
page.stop()
"""

from __future__ import annotations

import io
import socket
import threading
from collections.abc import Callable, Sequence
from contextlib import redirect_stdout
from functools import partial
from typing import Any, Literal, TypeVar

import numpy as np
import viser
from numpy.typing import NDArray

from flight.errors import UsageError
from viewer import background
from viewer.cursor import Cursor
from viewer.drawing import Colour, Drawing, colour_of
from viewer.panel import Panel
from viewer.panels import PANELS
from viewer.session import Scene, Session

Array = NDArray[np.float64]
T = TypeVar("T")
Kind = Literal["info", "warning", "error"]

KINDS: dict[Kind, str] = {"info": "blue", "warning": "yellow", "error": "red"}
LOOPBACK = ("127.0.0.1", "localhost", "::1")
PLOT_POINTS = 900
"""Points of a plotted line, at most."""
PORTS = 20
"""Ports that are tried, one after the other."""
SPEEDS = ("0.1", "0.25", "0.5", "1", "2", "5")
AXES = ("torque x [Nm]", "torque y [Nm]", "torque z [Nm]")


def exposed(host: str) -> bool:
    """Whether other machines could reach a page that is bound to this address."""
    return host not in LOOPBACK


def free_port(host: str, port: int) -> int:
    """`port`, or the next one of a few that nobody listens on; any free one for 0. Raises UsageError without one.

    Asked beforehand, because viser waits for ever on an address that cannot be had.
    """
    reason = ""
    for candidate in [port] if port == 0 else range(port, min(port + PORTS, 65536)):
        try:
            family, *_, address = socket.getaddrinfo(host, candidate, type=socket.SOCK_STREAM)[0]
            with socket.socket(family, socket.SOCK_STREAM) as probe:
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                probe.bind(address)
                return int(probe.getsockname()[1])
        except OSError as error:
            reason = error.strerror or str(error)
    raise UsageError(f"--host {host} --port {port}: cannot listen there: {reason}; choose others")


class Page:
    """The page of one session, served from construction to `stop`. Host and port are where it listens."""

    def __init__(
        self, session: Session, host: str = "127.0.0.1", port: int = 8080, panels: Sequence[type[Panel]] = PANELS
    ) -> None:
        self.session = session
        port = free_port(host, port)
        with redirect_stdout(io.StringIO()):  # viser announces itself
            self.server: Any = viser.ViserServer(host=host, port=port, label="wrenchgap", verbose=False)
        self.lock = threading.RLock()
        self.cursor = Cursor(self.lock)
        self.drawing = Drawing(self.server.scene, session.vehicle)
        self._jobs: list[background.Job] = []
        self._build()
        self.panels = [panel(self) for panel in panels if panel.suits(session)]
        self.cursor.listeners.append(lambda _: self._show())
        self._open(session.flights[0])
        self.cursor.run()

    @property
    def url(self) -> str:
        """Where to find it."""
        return f"http://{self.server.get_host()}:{self.server.get_port()}"

    def tab(self, label: str, icon: Any = None) -> Any:
        """A new tab of the control panel, as a context to put controls into."""
        return self._tabs.add_tab(label, icon)

    def refresh(self) -> None:
        """Ask the session for the flight again after the model changed; the cursor stays where it is."""
        with self.lock:
            self._fill(self.session.scene(self.scene.name))

    def notify(self, text: str, kind: Kind = "info", seconds: float = 8.0) -> None:
        """Tell all clients something, in a corner of the page."""
        for client in self.server.get_clients().values():
            client.add_notification("wrenchgap", text, color=KINDS[kind], auto_close_seconds=seconds)

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
        failed = on_error or (lambda error: self.notify(background.told(error), "error"))
        job = background.start(function, on_progress, on_done, failed, self.lock)
        self._jobs = [j for j in self._jobs if j.is_alive()] + [job]
        return job

    def guarded(self, callback: Callable[[Any], None]) -> Callable[[Any], None]:
        """`callback` under the page's lock; what it raises is told to the user and does not end the page."""

        def run(event: Any) -> None:
            try:
                with self.lock:
                    callback(event)
            except Exception as error:  # the boundary between the page and whatever a user may do
                self.notify(background.told(error), "error")

        return run

    def stop(self) -> None:
        """Stop playing and serving."""
        for job in self._jobs:
            job.cancel()
        self.cursor.close()
        for panel in self.panels:
            panel.closed()
        self.server.stop()

    def _build(self) -> None:
        """Controls that do not depend on the flight."""
        gui, names = self.server.gui, self.session.flights
        gui.configure_theme(control_width="large", show_share_button=False)
        self._tabs = gui.add_tab_group()
        with self.tab("Flight", viser.Icon.DRONE) as self._flight_tab:
            self.choice = gui.add_dropdown("flight", names, initial_value=names[0], visible=len(names) > 1)
            self.choice.on_update(self.guarded(lambda _: self._open(self.choice.value)))
            self.playing = gui.add_checkbox("play", False)
            self.playing.on_update(self.guarded(lambda _: setattr(self.cursor, "playing", self.playing.value)))
            self.speed = gui.add_dropdown("speed", SPEEDS, initial_value="1")
            self.speed.on_update(self.guarded(lambda _: setattr(self.cursor, "speed", float(self.speed.value))))
            self.forces = gui.add_checkbox("forces", True)
            self.forces.on_update(self.guarded(lambda _: self._show()))
            self.torques = gui.add_checkbox("torques", True)
            self.torques.on_update(self.guarded(lambda _: self._show()))
        self.content: list[Any] = []

    def _open(self, name: str) -> None:
        """Show another flight from its start."""
        with self.lock:
            scene = self.session.scene(name)
            self.cursor.open(scene.time)
            self.playing.value = False
            self._fill(scene)
            self._view()

    def _fill(self, scene: Scene) -> None:
        """Show a flight at the cursor."""
        self.scene = scene
        for handle in self.content:
            handle.remove()
        self.drawing.open(scene)
        with self._flight_tab:
            self._controls(scene)
        for panel in self.panels:
            panel.opened(scene)
        self._show()

    def _controls(self, flight: Scene) -> None:
        """Slider, legend, plots, worst stretches and notes of a flight."""
        gui, start, stop = self.server.gui, float(flight.time[0]), float(flight.time[-1])
        step = max(round((stop - start) / 5000, 3), 0.001)
        self.slider = gui.add_slider("time [s]", start, max(stop, start + step), step, self.cursor.time)
        self.slider.on_update(self.guarded(self._dragged))
        names = " ".join(f'<b style="color:{_css(colour_of(n))}">{n}</b>' for n in flight.wrenches)
        legend = gui.add_html(f'<div style="padding:2px 10px">{names}</div>')
        self.plots = [self._plot(flight, k) for k in range(3)] if flight.wrenches else []
        self.content = [self.slider, legend, *self.plots]
        for stretch in flight.worst:
            button = gui.add_button(f"{stretch.start:.1f} s: {stretch.words}")
            button.on_click(self.guarded(partial(self._go, stretch.start)))
            self.content.append(button)
        if flight.notes:
            self.content.append(gui.add_markdown("\n".join(f"- {note}" for note in flight.notes)))

    def _dragged(self, event: Any) -> None:
        """A client moved the slider; when the page did, everything has moved already."""
        if event.client_id is not None:
            self.cursor.go(self.slider.value)

    def _go(self, time: float, _: Any) -> None:
        self.cursor.go(time)

    def _plot(self, flight: Scene, axis: int) -> Any:
        """One torque over time, all wrenches, with a mark at the instant shown."""
        lines = tuple(
            viser.uplot.Series(label=name, stroke=_css(colour_of(name)), width=1.0) for name in flight.wrenches
        )
        mark = viser.uplot.Series(label="now", stroke="rgb(210,40,40)", width=1.0)
        return self.server.gui.add_uplot(
            self._data(flight, axis, 0),
            (viser.uplot.Series(label="t [s]"), *lines, mark),
            title=AXES[axis],
            scales={"x": viser.uplot.Scale(time=False)},
            cursor=viser.uplot.Cursor(sync={"key": "torques"}),
            legend=viser.uplot.Legend(show=False),
            height=150,
        )

    def _data(self, flight: Scene, axis: int, index: int) -> tuple[Array, ...]:
        """Time, the wrenches' torques where all are known, and the mark: a spike at the instant shown.

        uPlot scales nothing that holds a nan, so unknown instants are left out.
        """
        torques = np.stack([w[:, 3 + axis] for w in flight.wrenches.values()])
        known = np.flatnonzero(np.isfinite(torques).all(axis=0))
        kept = known[:: max(1, -(-len(known) // PLOT_POINTS))]
        lines = torques[:, kept]
        mark = np.full(len(kept), lines.min(initial=0.0))
        if len(kept):
            mark[np.abs(flight.time[kept] - flight.time[index]).argmin()] = lines.max(initial=0.0)
        return (flight.time[kept], *lines, mark)

    def _view(self) -> None:
        """Put the camera behind and above the vehicle, looking at it."""
        where, size = self.scene.position_E[0], self.drawing.size
        camera = self.server.initial_camera
        camera.position = where + size * np.array([-2.8, -2.8, 2.0])
        camera.look_at = where

    def _show(self) -> None:
        """Move everything to the cursor."""
        kinds = frozenset(kind for kind, box in (("force", self.forces), ("torque", self.torques)) if box.value)
        with self.lock, self.server.atomic():
            self.slider.value = self.cursor.time
            self.drawing.show(self.scene, self.cursor.index, kinds)
            for axis, plot in enumerate(self.plots):
                plot.data = self._data(self.scene, axis, self.cursor.index)
            for panel in self.panels:
                panel.moved(self.cursor.time)


def _css(colour: Colour) -> str:
    return f"rgb({colour[0]},{colour[1]},{colour[2]})"
