"""The top view of a model."""

from __future__ import annotations

from wrenchgap.plant.drafts.sheet import Sheet
from wrenchgap.replay.present.figures import style, vehicle


def picture(sheet: Sheet) -> style.Picture:
    """Arms, rotors, the centre of mass, the IMU (`figures.vehicle`)."""
    return vehicle.picture(sheet.model.vehicle)
