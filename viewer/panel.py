"""What a panel of the page is: a tab with controls of its own that follows flight, view and cursor."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from wrenchgap.viewer.background import Job, Report
from wrenchgap.viewer.host import Host
from wrenchgap.viewer.scene import Scene
from wrenchgap.viewer.view_state import ViewState

T = TypeVar("T")

LONG = 120.0
"""Flights longer than this are looked at beside the page [s]."""


def is_long(scene: Scene) -> bool:
    """Whether looking at a flight would keep the page waiting."""
    return bool(scene.time[-1] - scene.time[0] > LONG)


class Part:
    """Whatever follows flight and view: the panels and the controls of time. Called under the page's lock."""

    def __init__(self, host: Host) -> None:
        self.host = host

    def opened(self, scene: Scene) -> None:
        """Another flight is shown, or the same one after the model changed."""

    def possible(self, view: ViewState) -> ViewState:
        """The view with what the flight shown does not have replaced; of the entries that this part controls."""
        return view

    def viewed(self, view: ViewState) -> None:
        """Another view is shown: controls take its values."""


class Panel(Part):
    """A tab of the page, constructed once. A subclass adds its controls in `__init__`, `with host.tab("Name"):`."""

    _looking: Job | None = None

    def look_up(self, of: Callable[[], T], show: Callable[[T], None], *, beside: bool) -> None:
        """`show(of())` at once, or `beside` the page as soon as it stands. What was asked before is given up."""
        if self._looking is not None:
            self._looking.cancel()
            self._looking = None
        if not beside or self.host.crowded:
            show(of())
            return

        def look(report: Report) -> T:
            report(0.0, "")  # waits for the page, whose other parts ask the same session
            return of()

        self._looking = self.host.background(look, lambda *_: None, show)
