"""What a calibration did to the error: as of effects that were added."""

from __future__ import annotations

from wrenchgap.flight.errors import UsageError
from wrenchgap.learn.identify.calibrate import Calibration
from wrenchgap.replay.present.figures import addition, style


def picture(found: Calibration) -> style.Picture:
    """The error by axis before and after; raises UsageError where nothing was changed."""
    if found.added is None:
        raise UsageError("calibrate: nothing helped on held-out time, so there is nothing to draw; leave out --figure")
    return addition.picture(found.added)
