"""Parts of a panel's HTML that can be clicked.

viser 1.1 tells of clicks on buttons, but not of clicks on plots, images or HTML. An HTML label, though, presses the
button that it is for, and viser's buttons carry their id: every link is a label for a button that is not seen. So the
page needs no script of its own.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from wrenchgap.viewer.host import Host

LAST = 1e6
"""Order of the buttons in their tab: behind everything that is seen."""
HIDDEN = "<span class='wrenchgap-links'></span>"
"""Hides whatever follows in the same tab, by the style sheet."""


class Links:
    """The links of one tab. Construct inside the tab; `start` before its HTML is written anew, then `to` for each."""

    def __init__(self, host: Host) -> None:
        self.host = host
        self.tab = host.gui.add_folder(None, order=LAST)
        with self.tab:
            host.gui.add_html(HIDDEN, order=LAST)
        self._buttons: list[Any] = []
        self._actions: list[Callable[[], None]] = []

    def start(self) -> None:
        """Forget the links that were there; their buttons are used again."""
        self._actions = []

    def to(self, action: Callable[[], None]) -> str:
        """The id for a label; a click on that calls `action` under the page's lock."""
        k = len(self._actions)
        self._actions.append(action)
        if k == len(self._buttons):
            with self.tab:
                button = self.host.gui.add_button(f"link {k}", order=LAST + 1 + k)
            button.on_click(self.host.guarded(lambda _: self.follow(k)))
            self._buttons.append(button)
        return str(self._buttons[k]._impl.uuid)  # viser has no public way to the id of an element

    def follow(self, k: int) -> None:
        """Do what the k-th link does."""
        if k < len(self._actions):
            self._actions[k]()
