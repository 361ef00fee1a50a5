"""The interface of the page for its panels and other parts; its background jobs, one thread each."""

from __future__ import annotations

import logging
import re
import threading
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any, ClassVar, Literal, Protocol, TypeVar

from wrenchgap.flight.errors import WrenchgapError
from wrenchgap.flight.flight import Array
from wrenchgap.viewer.cursor import Cursor
from wrenchgap.viewer.session import Motion, Report, Scene, Session
from wrenchgap.viewer.view_state import ViewState

T = TypeVar("T")
Kind = Literal["info", "warning", "error"]
Callback = Callable[[Any], None]
KINDS: dict[Kind, str] = {"info": "blue", "warning": "yellow", "error": "red"}
FOLDERS = re.compile(r"(?<![\w./])(?:[A-Za-z]:)?(?:[/\\][^/\\\s:'\"]+)+[/\\](?=[^/\\\s:'\"]+\.\w)")
"""The folders of an absolute path of a file; names of topics have no suffix."""


class Job(threading.Thread):
    """A running job. `cancel` makes its next report raise `Cancelled`, which ends it; its result is discarded."""

    def __init__(self, name: str, run: Callable[[Job], None]) -> None:
        super().__init__(target=run, args=(self,), name=name, daemon=True)
        self.cancelled = False

    def cancel(self) -> None:
        """Request the end at the next report."""
        self.cancelled = True


class Cancelled(Exception):
    """Raised inside a cancelled job."""


class Host(Protocol):
    """The page as its parts see it. All but `background`'s work happens under the page's lock.

    `gui` are viser's controls (new ones go where the present `with` says), `session` is whom to ask about flights and
    models, `scene`, `cursor` and `view` are the flight that is shown, its instant, and what is seen of it. Callbacks of
    controls go through `guarded`, so that what a user typed wrong becomes a message and not a traceback.
    """

    server: Any
    lock: AbstractContextManager[Any]
    gui: Any
    tabs: Any
    session: Session
    scene: Scene
    cursor: Cursor
    view: ViewState
    drops: dict[str, Any]
    """`viewer.file_drop.FileDrop` by the id of their button."""
    max_waiting: ClassVar[int] = 16
    """Callbacks that wait for the page at most: viser calls them on 32 threads, and a flood must not take all."""
    max_jobs: ClassVar[int] = 8
    """Background jobs that may run, or still be ending, at once."""
    _jobs: list[Job]
    _waiting: threading.BoundedSemaphore

    def show(self, view: ViewState) -> None:
        """Show this view, as far as the flight has it; all parts follow."""

    def view_of(self, client: Any) -> ViewState:
        """The present view of a client with time and camera, to be saved."""

    def restore(self, view: ViewState, client: Any = None) -> None:
        """Show a view that was saved."""

    def refresh(self) -> None:
        """Ask the session for the flight again after the model changed; the cursor stays where it is."""

    def replace(self, session: Session) -> None:
        """Show another session on the same page; work for the one before is cancelled."""

    def replot(self) -> None:
        """Rebuild the plots after their selection changed."""

    def show_ghost(self, name: str, motion: Motion) -> None:
        """Offer a second vehicle under a name for the present flight, and show it."""

    def curve(self, name: str, points: Array | None, colour: tuple[int, int, int]) -> None:
        """Draw a curve (N, 3) [m] in E under a name; None removes it."""

    def tab(self, label: str) -> Any:
        """A new tab of the control panel, as a context to put controls into."""
        return self.tabs.add_tab(label)

    def command(self, label: str, act: Callable[[], Any], hotkey: Any = None, modifier: Any = None) -> None:
        """A command of the palette (ctrl-K), with a key where one is given."""
        handle = self.gui.add_command(label, hotkey=hotkey, modifier=modifier)
        handle.on_trigger(self.guarded(lambda _: act()))

    def connect(self, control: Any, act: Callback) -> Any:
        """The control, which calls `act(event)`, guarded, when it is pressed or gets another value."""
        (control.on_click if hasattr(control, "on_click") else control.on_update)(self.guarded(act))
        return control

    def guarded(self, callback: Callback) -> Callback:
        """`callback` under the page's lock; an error is reported to the client that caused it.

        What comes while too much waits is dropped: a click then does nothing, and a slider has a later value to give.
        """

        def run(event: Any) -> None:
            if not self._waiting.acquire(blocking=False):
                return
            try:
                with self.lock, self.server.atomic():
                    callback(event)
            except Exception as error:  # the boundary between the page and whatever a user may do
                self.fail(error, getattr(event, "client", None))
            finally:
                self._waiting.release()

        return run

    def background(
        self,
        function: Callable[[Report], T],
        on_progress: Report,
        on_done: Callable[[T], None],
        on_error: Callable[[Exception], None] | None = None,
        on_late: Callable[[T], None] = lambda _: None,
    ) -> Job:
        """Start a background job: `function(report)` on a thread, the other functions under the page's lock.

        `function` may call `report(share, words)`; `on_done` gets its result, `on_error` what it raised (default: the
        user is told). `cancel()` of the job ends it at its next report; `on_late` gets what comes all the same.
        """

        def run(job: Job) -> None:
            def report(share: float, words: str = "") -> None:
                with self.lock:
                    if job.cancelled:
                        raise Cancelled
                    on_progress(share, words)

            try:
                result = function(report)
            except Cancelled:
                return
            except Exception as error:  # whatever it is, the page must live on and say so
                with self.lock:
                    if not job.cancelled:
                        (on_error or self.fail)(error)
                return
            with self.lock, self.server.atomic():  # clients get no last value of a control that goes with it
                (on_late if job.cancelled else on_done)(result)

        job = Job(getattr(function, "__name__", "work"), run)
        job.start()
        self._jobs = [j for j in self._jobs if j.is_alive()] + [job]
        return job

    @property
    def crowded(self) -> bool:
        """Whether `max_jobs` background jobs run or are still ending."""
        return sum(job.is_alive() for job in self._jobs) >= self.max_jobs

    def notify(self, text: str, kind: Kind = "info", seconds: float = 8.0, client: Any = None) -> None:
        """Show a message in a corner of the page, to one client or to all."""
        for one in self.server.get_clients().values() if client is None else [client]:
            one.add_notification("wrenchgap", text, color=KINDS[kind], auto_close_seconds=seconds)

    def fail(self, error: Exception, client: Any = None) -> None:
        """Show an error, to one client or to all."""
        self.notify(error_text(error), "error", 15.0, client)


def download(client: Any, name: str, content: bytes) -> None:
    """Let the browser of this client save a file."""
    client.send_file_download(name, content, save_immediately=True)


def error_text(error: Exception, longest: int = 1000) -> str:
    """An error in one line for whoever sees the page: files by their name, and only the kind of an internal one.

    No more of it than `longest` characters, as `FOLDERS` takes time with their square.
    What an internal error says stands in the terminal: it may hold paths and values that are not a visitor's.
    """
    if isinstance(error, WrenchgapError):
        return FOLDERS.sub("", str(error)[:longest])
    said = WrenchgapError(f"the page goes on after an internal error, please report it: {error!r}")
    logging.getLogger(__name__).error("%s", said)
    return f"internal error ({type(error).__name__}); the page goes on, the terminal says more; please report it"
