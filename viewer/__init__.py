"""Shows flights, and the tabs that a session brings, through a protocol of its own; knows no learn or compensate."""

from __future__ import annotations

from typing import TYPE_CHECKING

from wrenchgap._lazy import names_of

__getattr__, __all__ = names_of(
    __name__,
    {
        "wrenchgap.viewer.page": ("Page",),
        "wrenchgap.viewer.scene": ("Motion", "Scene", "Series"),
        "wrenchgap.viewer.session": ("Capabilities", "Session"),
    },
)

if TYPE_CHECKING:
    from wrenchgap.viewer.scene import Motion as Motion
    from wrenchgap.viewer.scene import Scene as Scene
    from wrenchgap.viewer.scene import Series as Series
    from wrenchgap.viewer.session import Capabilities as Capabilities
    from wrenchgap.viewer.session import Session as Session
