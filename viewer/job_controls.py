"""A button that starts long work, how far it is, and a button that ends it."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from wrenchgap.viewer import background, markup
from wrenchgap.viewer.host import Host

T = TypeVar("T")


class JobControls:
    """Controls of one kind of long work; at most one is running. `ask` is called when the button is pressed."""

    def __init__(self, host: Host, label: str, ask: Callable[[], None], hint: str | None = None):
        gui = host.gui
        self.host, self.label = host, label
        self.button = gui.add_button(label, hint=hint)
        self.button.on_click(host.guarded(lambda _: ask()))
        self.bar = gui.add_progress_bar(0.0, visible=False, animated=True)
        self.words = gui.add_html("", visible=False)
        self.stop = gui.add_button("Cancel", visible=False, color="gray")
        self.stop.on_click(host.guarded(lambda _: self.cancel()))
        self._job: background.Job | None = None

    @property
    def running(self) -> bool:
        """Whether work is under way."""
        return self._job is not None

    def start(self, function: Callable[[background.Report], T], on_done: Callable[[T], None]) -> None:
        """Run it beside the page; what was running is cancelled, the last one asked for wins."""
        self.host.make_room()
        self.cancel()
        self._showing(True)
        self._progress(0.0, "starting")

        def done(result: T) -> None:
            try:
                on_done(result)
            except Exception as error:  # what comes of it is shown; that must not end the page either
                self.host.fail(error)
            finally:
                self._ended()

        def failed(error: Exception) -> None:
            self._ended()
            self.host.fail(error)

        self._job = self.host.background(function, self._progress, done, failed)

    def cancel(self) -> None:
        """End what is running; nothing comes of it."""
        if self._job is not None:
            self._job.cancel()
            self._ended()

    def _progress(self, share: float, words: str) -> None:
        done = round(100.0 * min(max(share, 0.0), 1.0))
        if self.bar.value != done:
            self.bar.value = done
        said = markup.sentences(words)
        if self.words.content != said:
            self.words.content = said

    def _ended(self) -> None:
        self._job = None
        self._showing(False)

    def _showing(self, running: bool) -> None:
        self.button.visible = not running
        for handle in (self.bar, self.words, self.stop):
            handle.visible = running
