"""The tabs of the page, in their order. A panel is one file here and one line in `PANELS`."""

from __future__ import annotations

from viewer.panel import Panel
from viewer.panels.compensation import CompensationPanel
from viewer.panels.effects import EffectsPanel
from viewer.panels.failure import FailurePanel

PANELS: tuple[type[Panel], ...] = (FailurePanel, EffectsPanel, CompensationPanel)
