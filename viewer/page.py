"""A page in the browser: the vehicle as it flew, its wrenches as arrows and plots, a slider for time.

page = Page(session)           # serves http://127.0.0.1:8080
page.time = 12.5
page.stop()
"""

from __future__ import annotations

import io
import socket
import threading
from contextlib import redirect_stdout
from functools import partial
from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray

from flight.errors import UsageError
from viewer.drawing import Colour, Drawing, colour_of
from viewer.session import Scene, Session

Array = NDArray[np.float64]

LOOPBACK = ("127.0.0.1", "localhost", "::1")
FRAME_RATE = 25.0
"""Frames per second while playing [Hz]."""
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

    def __init__(self, session: Session, host: str = "127.0.0.1", port: int = 8080) -> None:
        self.session = session
        port = free_port(host, port)
        with redirect_stdout(io.StringIO()):  # viser announces itself
            self.server: Any = viser.ViserServer(host=host, port=port, label="wrenchgap", verbose=False)
        self.drawing = Drawing(self.server.scene, session.vehicle)
        self._over, self._lock = threading.Event(), threading.RLock()
        self._build()
        self._open(session.flights[0])
        self._player = threading.Thread(target=self._play, name="playback", daemon=True)
        self._player.start()

    @property
    def url(self) -> str:
        """Where to find it."""
        return f"http://{self.server.get_host()}:{self.server.get_port()}"

    @property
    def time(self) -> float:
        """The instant shown [s]."""
        return float(self.slider.value)

    @time.setter
    def time(self, value: float) -> None:
        self.slider.value = float(np.clip(value, self.flight.time[0], self.flight.time[-1]))

    def stop(self) -> None:
        """Stop playing and serving."""
        self._over.set()
        self._player.join(timeout=2.0)
        self.server.stop()

    def _build(self) -> None:
        """Controls that do not depend on the flight."""
        gui, names = self.server.gui, self.session.flights
        gui.configure_theme(control_width="large", show_share_button=False)
        self.choice = gui.add_dropdown("flight", names, initial_value=names[0], visible=len(names) > 1)
        self.choice.on_update(lambda _: self._open(self.choice.value))
        self.playing = gui.add_checkbox("play", False)
        self.speed = gui.add_dropdown("speed", SPEEDS, initial_value="1")
        self.forces = gui.add_checkbox("forces", True)
        self.forces.on_update(lambda _: self._show())
        self.torques = gui.add_checkbox("torques", True)
        self.torques.on_update(lambda _: self._show())
        self.content: list[Any] = []

    def _open(self, name: str) -> None:
        """Show another flight from its start."""
        with self._lock:
            self.playing.value = False
            self.flight = self.session.scene(name)
            for handle in self.content:
                handle.remove()
            self.drawing.open(self.flight)
            self._controls(self.flight)
            self._view()
            self._show()

    def _controls(self, flight: Scene) -> None:
        """Slider, legend, plots, worst stretches and notes of a flight."""
        gui, start, stop = self.server.gui, float(flight.time[0]), float(flight.time[-1])
        step = max(round((stop - start) / 5000, 3), 0.001)
        self.slider = gui.add_slider("time [s]", start, max(stop, start + step), step, start)
        self.slider.on_update(lambda _: self._show())
        names = " ".join(f'<b style="color:{_css(colour_of(n))}">{n}</b>' for n in flight.wrenches)
        legend = gui.add_html(f'<div style="padding:2px 10px">{names}</div>')
        self.plots = [self._plot(flight, k) for k in range(3)] if flight.wrenches else []
        self.content = [self.slider, legend, *self.plots]
        for stretch in flight.worst:
            button = gui.add_button(f"{stretch.start:.1f} s: {stretch.words}")
            button.on_click(partial(self._go, stretch.start))
            self.content.append(button)
        if flight.notes:
            self.content.append(gui.add_markdown("\n".join(f"- {note}" for note in flight.notes)))

    def _go(self, time: float, _: Any) -> None:
        self.time = time

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
        where, size = self.flight.position_E[0], self.drawing.size
        camera = self.server.initial_camera
        camera.position = where + size * np.array([-2.8, -2.8, 2.0])
        camera.look_at = where

    def _show(self) -> None:
        with self._lock:
            index = self.flight.index(self.slider.value + 1e-9)
            kinds = frozenset(kind for kind, box in (("force", self.forces), ("torque", self.torques)) if box.value)
            with self.server.atomic():
                self.drawing.show(self.flight, index, kinds)
                for axis, plot in enumerate(self.plots):
                    plot.data = self._data(self.flight, axis, index)

    def _play(self) -> None:
        """Move the slider while `play` is on; at the end, from the start again."""
        while not self._over.wait(1.0 / FRAME_RATE):
            if not self.playing.value:
                continue
            with self._lock:
                ahead = self.time + float(self.speed.value) / FRAME_RATE
                self.time = ahead if ahead < self.flight.time[-1] else float(self.flight.time[0])


def _css(colour: Colour) -> str:
    return f"rgb({colour[0]},{colour[1]},{colour[2]})"
