"""The controls of time above the tabs: slider, play, step, speed, jumps, the marks A and B, range.

Marks A and B are two more cursors: the plots say how much each line changes between them, and playing can be kept to
the stretch that they bound.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from wrenchgap.viewer.host import Host
from wrenchgap.viewer.panel import Part
from wrenchgap.viewer.plot_board import Board, View
from wrenchgap.viewer.session import Scene, Stretch
from wrenchgap.viewer.view_state import ViewState

SPEEDS = ("0.1", "0.25", "0.5", "1", "2", "5", "10")
ZOOMS = ("whole flight", "60 s", "30 s", "10 s", "5 s", "2 s", "A to B")
PLAY, PAUSE = "\u25b6 Play", "\u275a\u275a Pause"
"""No icons of viser: each costs 40 ms to look up."""
NOWHERE = "-"
STEPS = {"-1 s": -1.0, "< step": -1, "step >": 1, "+1 s": 1.0}
"""Labels, and by how many seconds (float) or instants (int) they move."""


class Transport(Part):
    """Reads and moves the cursor of the page, and sets the range that the plots show."""

    resolution = 0.001
    """Of the slider [s]. Its box would round a finer number and send it back as if a user had typed it."""

    def __init__(self, host: Host, board: Board) -> None:
        super().__init__(host)
        self._board, self._cursor = board, host.cursor
        gui, connect = host.gui, host.connect
        self._slot = gui.add_folder(None)
        with self._slot:
            self.slider: Any = gui.add_slider("time [s]", 0.0, 1.0, self.resolution, 0.0)
        self.play = connect(gui.add_button(PLAY, hint="space"), lambda _: self.toggle())
        self.step = gui.add_button_group("move", tuple(STEPS), hint="keys J and L; with shift by a second")
        self._more = gui.add_folder("speed, jumps, marks, range", expand_by_default=False)
        with self._more:
            self.speed = gui.add_dropdown("speed", SPEEDS, initial_value="1", hint="seconds of flight per second")
            stretches = "worst stretches, gaps; N and P"
            self.jump = gui.add_dropdown("go to", (NOWHERE,), initial_value=NOWHERE, hint=stretches)
            self.mark = gui.add_button_group("mark", ("A", "B", "loop", "clear"), hint="keys I, O, R, X")
            self.zoom = gui.add_dropdown("plots show", ZOOMS, initial_value=ZOOMS[0])
        connect(self.step, lambda _: self._step(STEPS[self.step.value]))
        connect(self.speed, lambda _: host.show(replace(host.view, speed=self.speed.value)))
        connect(self.jump, lambda _: self._jump())
        connect(self.mark, lambda _: self._mark(self.mark.value))
        connect(self.zoom, lambda _: host.show(replace(host.view, zoom=self.zoom.value)))
        self._stretches: dict[str, Stretch] = {}
        self._range = (0.0, 1.0)
        self._asked: object = None
        self._keys()
        self._cursor.listeners.append(self._moved)

    def opened(self, scene: Scene) -> None:
        """Another flight, or the same one after the model changed."""
        start, stop = _rounded(float(scene.time[0])), _rounded(float(scene.time[-1]))
        self.slider.remove()
        with self._slot:
            at, end = float(np.clip(_rounded(self._cursor.time), start, stop)), max(stop, start + self.resolution)
            marks = tuple((_rounded(s.start), "") for s in scene.worst if start <= s.start <= stop)
            self.slider = self.host.gui.add_slider("time [s]", start, end, self.resolution, at, marks=marks)
        self.host.connect(self.slider, self._dragged)
        places = sorted((*scene.worst, *scene.gaps), key=lambda s: s.start)
        self._stretches = {f"{s.start:.2f} s: {s.words}": s for s in places}
        self.jump.options = (NOWHERE, *self._stretches)
        self.jump.value = NOWHERE
        self._asked = None
        for control in (self._slot, self.play, self.step, self._more):
            control.visible = not scene.is_empty

    @property
    def plotted(self) -> View:
        """Shown range of the plots."""
        marks = tuple(sorted(self.host.view.marks.items()))
        return View(*self._range, marks, self.host.scene.gaps, self._cursor.loop)

    def toggle(self) -> None:
        """Play, or pause."""
        self.playing(not self._cursor.playing)

    def playing(self, on: bool) -> None:
        """Play or not."""
        self._cursor.playing = on
        self.play.label = PAUSE if on else PLAY

    def possible(self, view: ViewState) -> ViewState:
        """Range and speed among the choices, marks within the flight, a loop only between two of them."""
        start, stop = self._cursor.start, self._cursor.stop
        marks = {name: float(np.clip(view.marks[name], start, stop)) for name in ("A", "B") if name in view.marks}
        return replace(
            view,
            zoom=view.zoom if view.zoom in ZOOMS else self.zoom.value,
            speed=view.speed if view.speed in SPEEDS else self.speed.value,
            marks=marks,
            loop=view.loop and len(set(marks.values())) == 2,
        )

    def viewed(self, view: ViewState) -> None:
        """Range, speed, marks and loop of the view."""
        if view.speed is not None:
            self.speed.value, self._cursor.speed = view.speed, float(view.speed)
        self.zoom.value = view.zoom
        self._cursor.loop = (min(view.marks.values()), max(view.marks.values())) if view.loop else None
        asked = (view.zoom, view.marks, view.loop)
        if asked != self._asked:
            self._asked = asked
            self._range = self._wanted()
            self._board.look(self.plotted)

    def set_marks(self, marks: Mapping[str, float], loop: bool) -> None:
        """Set the marks A and B [s] within the flight; with `loop`, play between them."""
        self.host.show(replace(self.host.view, marks=dict(marks), loop=loop))

    def next_stretch(self, way: int) -> None:
        """Go to the next (+1) or previous (-1) of the worst parts and gaps."""
        starts = np.array(sorted(s.start for s in self._stretches.values()))
        if starts.size:
            later = starts[starts > self._cursor.time + 1e-3] if way > 0 else starts[starts < self._cursor.time - 1e-3]
            if later.size:
                self._cursor.go(float(later[0] if way > 0 else later[-1]))

    def _wanted(self) -> tuple[float, float]:
        """The range for the chosen zoom, with the cursor in its middle where that is possible."""
        start, stop, zoom = self._cursor.start, self._cursor.stop, self.zoom.value
        both = sorted(self.host.view.marks.values())
        if zoom == "A to B" and len(both) == 2 and both[1] > both[0]:
            return both[0], both[1]
        if not zoom.endswith(" s") or float(zoom[:-2]) >= stop - start:
            return start, stop
        width = float(zoom[:-2])
        left = float(np.clip(self._cursor.time - 0.5 * width, start, stop - width))
        return left, left + width

    def _moved(self, time: float) -> None:
        """The cursor moved: turn the page of the plots if it left their range; of a page that plays, 5 % lie behind."""
        self.slider.value = _rounded(time)
        left, right = self._range
        if not left <= time <= right and self.zoom.value.endswith(" s"):
            width = right - left
            behind = 0.05 * width if self._cursor.playing else 0.5 * width
            last = max(self._cursor.stop - width, self._cursor.start)
            first = float(np.clip(time - behind, self._cursor.start, last))
            self._range = (first, first + width)
            self._board.look(self.plotted)

    def _dragged(self, event: Any) -> None:
        """A client moved the slider; a move by the page needs no action."""
        if event.client_id is not None:
            self._cursor.go(float(self.slider.value))

    def _step(self, by: float) -> None:
        if isinstance(by, int):
            self._cursor.step(by)
        else:
            self._cursor.go(self._cursor.time + by)

    def _jump(self) -> None:
        if self.jump.value in self._stretches:
            self._cursor.go(self._stretches[self.jump.value].start)
            self.jump.value = NOWHERE

    def _mark(self, what: str) -> None:
        """A and B mark the cursor; loop plays between them, or no longer does; clear takes them away."""
        if what in ("A", "B"):
            self.set_marks({**self.host.view.marks, what: self._cursor.time}, self.host.view.loop)
        elif what == "clear":
            self.set_marks({}, False)
        elif len(self.host.view.marks) < 2:
            self.host.notify("Set the marks A and B first; playing can then be kept between them.", "warning")
        else:
            self.set_marks(self.host.view.marks, not self.host.view.loop)

    def _keys(self) -> None:
        command, cursor = self.host.command, self._cursor
        command("Play or pause", self.toggle, "space")
        command("Step back", lambda: self._step(-1), "J")
        command("Step forward", lambda: self._step(1), "L")
        command("Back by a second", lambda: self._step(-1.0), "J", "shift")
        command("Forward by a second", lambda: self._step(1.0), "L", "shift")
        command("Go to the start", lambda: cursor.go(cursor.start), "home")
        command("Go to the end", lambda: cursor.go(cursor.stop), "end")
        command("Next worst stretch or gap", lambda: self.next_stretch(1), "N")
        command("Previous worst stretch or gap", lambda: self.next_stretch(-1), "P")
        command("Mark A here", lambda: self._mark("A"), "I")
        command("Mark B here", lambda: self._mark("B"), "O")
        command("Loop between A and B", lambda: self._mark("loop"), "R")
        command("Clear marks", lambda: self._mark("clear"), "X")


def _rounded(time: float) -> float:
    return round(time, 3)
