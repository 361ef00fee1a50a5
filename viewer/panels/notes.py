"""The tab of notes: the parts of the flight with the largest error, and the notes of the reader."""

from collections.abc import Sequence
from functools import partial
from typing import Any

from wrenchgap.viewer import markup
from wrenchgap.viewer.host import Host
from wrenchgap.viewer.panel import Panel
from wrenchgap.viewer.session import Scene

KEYS = (
    ("space", "play, pause"),
    ("J, L", "step back, forward; with shift by a second"),
    ("home, end", "start, end"),
    ("N, P", "next, previous worst stretch or gap"),
    ("I, O, R, X", "mark A, mark B, loop between them, clear"),
    ("F", "follow the vehicle, or stay"),
    ("1 to 5", "look obliquely, from the top, side, front, at all of it"),
    ("ctrl-K", "all commands"),
)


class NotesPanel(Panel):
    """Checks of the log, buttons to the worst parts, notes, keys."""

    def __init__(self, host: Host) -> None:
        super().__init__(host)
        with host.tab("Notes") as self._tab:
            pass
        self._content: list[Any] = []

    def opened(self, scene: Scene) -> None:
        """Show the notes of the flight."""
        for handle in self._content:
            handle.remove()
        gui = self.host.gui
        with self._tab:
            self._content = []
            if scene.warnings:
                self._content.append(gui.add_html(_listed("Checks of the log", scene.warnings, "wg-warn")))
            if scene.worst:
                self._content.append(gui.add_html(_listed("Where the model is worst")))
            for stretch in scene.worst:
                button = gui.add_button(f"{stretch.start:.1f} s: {stretch.words}")
                self._content.append(self.host.connect(button, partial(self._go, stretch.start)))
            if scene.notes:
                self._content.append(gui.add_html(_listed("Notes", scene.notes)))
            self._content.append(gui.add_html(_listed("Keys", rows=KEYS)))

    def _go(self, time: float, event: Any) -> None:
        self.host.cursor.go(time)


def _listed(heading: str, sentences: Sequence[str] = (), look: str = "", rows: Sequence[tuple[str, ...]] = ()) -> str:
    return markup.render("table", heading=heading, head=(), rows=rows, sentences=sentences, look=look)
