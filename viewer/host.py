"""What a panel, or any other part of the page, may ask of the page that hosts it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, Protocol, TypeVar

from wrenchgap.flight.flight import Array
from wrenchgap.viewer.background import Job, Report
from wrenchgap.viewer.cursor import Cursor
from wrenchgap.viewer.scene import Motion, Scene
from wrenchgap.viewer.session import Session
from wrenchgap.viewer.view_state import ViewState

T = TypeVar("T")
Kind = Literal["info", "warning", "error"]
Callback = Callable[[Any], None]


class Host(Protocol):
    """The page as its parts see it. All but `background`'s work happens under the page's lock.

    Callbacks of controls go through `guarded`, so that what a user typed wrong becomes a message and not a traceback.
    """

    @property
    def gui(self) -> Any:
        """Viser's controls, which has no types: new ones go where the present `with` says."""

    @property
    def session(self) -> Session:
        """Whom to ask about flights and models."""

    @property
    def scene(self) -> Scene:
        """The flight that is shown."""

    @property
    def cursor(self) -> Cursor:
        """The instant that is shown."""

    @property
    def view(self) -> ViewState:
        """What is seen of it."""

    def show(self, view: ViewState) -> None:
        """Let this be seen instead, as far as the flight has it: every part follows."""

    def view_of(self, client: Any) -> ViewState:
        """What a client sees at this moment, to be saved: with time and camera."""

    def restore(self, view: ViewState, client: Any = None) -> None:
        """Show a view that was saved."""

    def tab(self, label: str) -> Any:
        """A new tab of the control panel, as a context to put controls into."""

    def command(self, label: str, act: Callable[[], Any], hotkey: Any = None, modifier: Any = None) -> None:
        """A command of the palette (ctrl-K), with a key where one is given."""

    def guarded(self, callback: Callback) -> Callback:
        """`callback` under the page's lock; what it raises is told to the user and does not end the page."""

    def background(
        self,
        function: Callable[[Report], T],
        on_progress: Report,
        on_done: Callable[[T], None],
        on_error: Callable[[Exception], None] | None = None,
    ) -> Job:
        """Do long work beside the page: `function(report)` on a thread, the others under the page's lock."""

    def notify(self, text: str, kind: Kind = "info", seconds: float = 8.0) -> None:
        """Tell all clients something, in a corner of the page."""

    def fail(self, error: Exception) -> None:
        """Tell all clients what went wrong."""

    def refresh(self) -> None:
        """Ask the session for the flight again after the model changed; the cursor stays where it is."""

    def replot(self) -> None:
        """Make the plots anew after it changed which there are."""

    def show_ghost(self, name: str, motion: Motion) -> None:
        """Offer a second vehicle for the flight shown, under a name, and show it."""

    def curve(self, name: str, points: Array | None, colour: tuple[int, int, int]) -> None:
        """Draw a curve (N, 3) [m] in E under a name; None takes it away."""
