"""What a panel of the page is: a tab with controls of its own that follows the flight and the cursor."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from wrenchgap.viewer.page import Page
    from wrenchgap.viewer.session import Scene


class Panel:
    """A tab of the page. The page constructs it once and calls it under its lock.

    A subclass adds its controls in `__init__`, inside `with page.tab("Name"):`. Callbacks of controls go through
    `page.guarded`, so that what a user typed wrong becomes a message and not a traceback.
    """

    def __init__(self, page: Page) -> None:
        self.page = page

    @classmethod
    def suits(cls, session: Any) -> bool:
        """Whether a session can do what this panel asks for; where not, the page has no such tab."""
        return True

    def opened(self, scene: Scene) -> None:
        """Another flight is shown, or the same one after the model changed."""

    def moved(self, time: float) -> None:
        """The cursor stands at `time` [s]; called many times a second, must be cheap."""

    def closed(self) -> None:
        """The page stops."""
