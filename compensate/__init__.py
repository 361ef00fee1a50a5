"""Turns a learned mismatch into a correction of the commanded wrench, sample by sample."""

from wrenchgap.compensate.combined import Combined
from wrenchgap.compensate.compensator import Compensator, Result, Settings
from wrenchgap.compensate.observer import DisturbanceObserver
from wrenchgap.compensate.physics import PhysicsMismatch

__all__ = ["Combined", "Compensator", "DisturbanceObserver", "PhysicsMismatch", "Result", "Settings"]
