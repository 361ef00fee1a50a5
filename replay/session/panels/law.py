"""A law for what no effect of the catalogue explains: a button beside the search, what was found, and its file."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from wrenchgap.replay.session.effects import SessionEffects
from wrenchgap.replay.session.panels import html
from wrenchgap.viewer.host import Host, download
from wrenchgap.viewer.panel import JobControls

if TYPE_CHECKING:
    from wrenchgap.learn import Explanation
    from wrenchgap.learn.discover.discover import Discovery


class LawControls:
    """`last` is the search whose rest is looked at: what `explain` said of the flight that is shown, or None."""

    def __init__(self, host: Host, effects: SessionEffects, last: Callable[[], Explanation | None]) -> None:
        self.host, self.effects, self.last = host, effects, last
        self.source = ""
        hint = "Tries hundreds of laws on what the named effects leave, and on residuals of chance."
        self.work = JobControls(host, "Look for a law of the rest", self.look, hint)
        self.answer = host.gui.add_html("")
        self.save = host.connect(host.gui.add_button("Download the law", visible=False, color="gray"), self._saved)

    def forget(self) -> None:
        """Another flight, or another model: what was found is not said of it."""
        self.answer.content, self.source, self.save.visible = "", "", False

    def look(self) -> None:
        """Search, in a process of its own."""
        flight, known = self.host.scene.name, self.last()
        self.work.start(lambda report: self.effects.discover(flight, known, report), self._found)

    def _found(self, found: Discovery) -> None:
        from wrenchgap.replay.present import discovery  # here: the page stands before it is there

        self.answer.content = html.render("law", sentences=discovery.summary(found), found=found)
        self.source, self.save.visible = found.source, bool(found.source)

    def _saved(self, event: Any) -> None:
        download(event.client, "law.py", self.source.encode())
