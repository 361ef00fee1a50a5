"""Panels of the page: tabs with controls that follow flight, view and cursor; and their parts.

viser 1.1 tells of clicks on buttons, but not of clicks on plots, images or HTML. An HTML label, though, presses the
button that it is for, and viser's buttons carry their id: every link in HTML is a label for a button that is not seen.
So the page needs no script of its own.
"""

from collections.abc import Callable
from typing import Any, TypeVar

from wrenchgap.flight.errors import UsageError
from wrenchgap.viewer import markup
from wrenchgap.viewer.host import Host, Job, error_text
from wrenchgap.viewer.session import Report, Scene
from wrenchgap.viewer.view_state import ViewState

T = TypeVar("T")

LONG = 120.0
"""Flights longer than this [s] are evaluated in the background."""
HIDDEN = "<span class='wrenchgap-links'></span>"
"""Hides whatever follows in the same tab, by the style sheet."""


def is_long(scene: Scene) -> bool:
    """Whether evaluating a flight would block the page."""
    return bool(scene.time[-1] - scene.time[0] > LONG)


class Part:
    """A panel, or the controls of time: a part of the page that follows flight and view, under the page's lock."""

    def __init__(self, host: Host) -> None:
        self.host = host

    def opened(self, scene: Scene) -> None:
        """Another flight is shown, or the same one after the model changed."""

    def possible(self, view: ViewState) -> ViewState:
        """The view with what the flight shown does not have replaced; of the entries that this part controls."""
        return view

    def viewed(self, view: ViewState) -> None:
        """Another view is shown: the controls take its values."""


class Panel(Part):
    """A tab of the page, constructed once. A subclass adds its controls in `__init__`, `with host.tab("Name"):`."""

    _looking: Job | None = None

    def look_up(self, of: Callable[[], T], show: Callable[[T], None], *, in_background: bool) -> None:
        """Call `show(of())` now, or in the background. An earlier call that still runs is dropped."""
        if self._looking is not None:
            self._looking.cancel()
            self._looking = None
        if not in_background or self.host.crowded:
            show(of())
            return

        def look(report: Report) -> T:
            report(0.0, "")  # waits for the page, whose other parts ask the same session
            return of()

        self._looking = self.host.background(look, lambda *_: None, show)


class Links:
    """The links of one tab, constructed inside it. Call `start` before its HTML is rebuilt, then `to` for each."""

    last = 1e6
    """Order of the buttons in their tab: behind everything that is seen."""

    def __init__(self, host: Host) -> None:
        self.host = host
        self.tab = host.gui.add_folder(None, order=self.last)
        with self.tab:
            host.gui.add_html(HIDDEN, order=self.last)
        self._buttons: list[Any] = []
        self._actions: list[Callable[[], None]] = []

    def start(self) -> None:
        """Remove the links; their buttons are reused."""
        self._actions = []

    def to(self, action: Callable[[], None]) -> str:
        """The id for a label; a click on that calls `action` under the page's lock."""
        k = len(self._actions)
        self._actions.append(action)
        if k == len(self._buttons):
            with self.tab:
                button = self.host.gui.add_button(f"link {k}", order=self.last + 1 + k)
            self._buttons.append(self.host.connect(button, lambda _: self.follow(k)))
        return str(self._buttons[k]._impl.uuid)  # viser has no public way to the id of an element

    def follow(self, k: int) -> None:
        """Do what the k-th link does."""
        if k < len(self._actions):
            self._actions[k]()


class JobControls:
    """Controls of one kind of background job; at most one runs. `ask` is called when a client presses the button."""

    def __init__(self, host: Host, label: str, ask: Callable[[], None], hint: str | None = None):
        gui = host.gui
        self.host, self.label = host, label
        self.button = host.connect(gui.add_button(label, hint=hint), lambda event: self._asked(ask, event.client))
        self.bar = gui.add_progress_bar(0.0, visible=False, animated=True)
        self.words = gui.add_html("", visible=False)
        self.stop = host.connect(gui.add_button("Cancel", visible=False, color="gray"), lambda _: self.cancel())
        self.client: Any = None
        self._job: Job | None = None

    def _asked(self, ask: Callable[[], None], client: Any) -> None:
        self.client = client
        ask()

    @property
    def running(self) -> bool:
        """Whether the job runs."""
        return self._job is not None

    def start(
        self,
        function: Callable[[Report], T],
        on_done: Callable[[T], None],
        on_late: Callable[[T], None] = lambda _: None,
        *,
        then_gone: bool = False,
    ) -> None:
        """Start the job in the background; one that runs is cancelled, `on_late` gets what it had made by then.

        With `then_gone`, `on_done` removes these controls, which show the end of the job before it.
        """
        if self.host.crowded:
            raise UsageError("earlier work is still ending; try again in a moment")
        self.cancel()
        self._showing(True)
        self._progress(0.0, "starting")

        def done(result: T) -> None:
            if then_gone:
                self._ended()
            try:
                on_done(result)
            except Exception as error:  # what comes of it is shown; that must not end the page either
                self.host.fail(error)
            finally:
                if not then_gone:
                    self._ended()

        def failed(error: Exception) -> None:
            self._ended()
            self.words.content, self.words.visible = markup.sentences(error_text(error), look="wg-bad"), True
            self.host.fail(error)

        self._job = self.host.background(function, self._progress, done, failed, on_late)

    def cancel(self) -> None:
        """Cancel the running job and discard its result."""
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
