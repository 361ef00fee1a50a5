"""Turns a learned mismatch into a correction of the commanded wrench, sample by sample."""

from __future__ import annotations

from typing import TYPE_CHECKING

from wrenchgap._lazy import names_of

__getattr__, __all__ = names_of(
    __name__,
    {
        "wrenchgap.compensate.combined": ("Combined",),
        "wrenchgap.compensate.compensator": ("Compensator", "Result", "Settings"),
        "wrenchgap.compensate.observer": ("DisturbanceObserver",),
        "wrenchgap.compensate.physics": ("PhysicsMismatch",),
    },
)

if TYPE_CHECKING:
    from wrenchgap.compensate.combined import Combined as Combined
    from wrenchgap.compensate.compensator import Compensator as Compensator
    from wrenchgap.compensate.compensator import Result as Result
    from wrenchgap.compensate.compensator import Settings as Settings
    from wrenchgap.compensate.observer import DisturbanceObserver as DisturbanceObserver
    from wrenchgap.compensate.physics import PhysicsMismatch as PhysicsMismatch
