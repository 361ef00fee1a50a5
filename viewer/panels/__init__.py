"""The tabs of the page, in their order. A panel is one file here and one line in `PANELS`."""

from __future__ import annotations

from wrenchgap.viewer.panel import Panel
from wrenchgap.viewer.panels.changed import ChangedPanel
from wrenchgap.viewer.panels.compensation import CompensationPanel
from wrenchgap.viewer.panels.effects import EffectsPanel
from wrenchgap.viewer.panels.failure import FailurePanel

PANELS: tuple[type[Panel], ...] = (FailurePanel, EffectsPanel, ChangedPanel, CompensationPanel)
