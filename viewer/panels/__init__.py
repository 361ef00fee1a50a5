"""The tabs of the page, in their order. A panel is one file here and one line in `PANELS`."""

from __future__ import annotations

from viewer.panel import Panel

PANELS: tuple[type[Panel], ...] = ()
