"""What a panel of the page is: a tab with controls of its own that follows flight, view and cursor."""

from __future__ import annotations

from typing import Protocol

from wrenchgap.viewer.host import Host
from wrenchgap.viewer.scene import Scene
from wrenchgap.viewer.view_state import ViewState


class Part(Protocol):
    """Whatever follows flight and view: the panels, and the controls of time above them."""

    def opened(self, scene: Scene) -> None:
        """Another flight is shown, or the same one after the model changed."""

    def possible(self, view: ViewState) -> ViewState:
        """The view with what the flight shown does not have replaced; of the entries that this part controls."""

    def viewed(self, view: ViewState) -> None:
        """Another view is shown: controls take its values."""


class Panel:
    """A tab of the page. The page constructs it once and calls it under its lock.

    A subclass adds its controls in `__init__`, inside `with host.tab("Name"):`.
    """

    def __init__(self, host: Host) -> None:
        self.host = host

    @classmethod
    def of(cls, host: Host) -> Panel | None:
        """The panel, or None where the session lacks what it asks for: then the page has no such tab."""
        return cls(host)

    def opened(self, scene: Scene) -> None:
        """See `Part`; most panels care for this only."""

    def possible(self, view: ViewState) -> ViewState:
        """See `Part`."""
        return view

    def viewed(self, view: ViewState) -> None:
        """See `Part`."""
