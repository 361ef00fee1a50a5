"""Turns a learned mismatch into a correction of the commanded wrench, sample by sample."""

from compensate.compensator import Compensator, Result, Settings
from compensate.observer import DisturbanceObserver
from compensate.physics import PhysicsMismatch

__all__ = ["Compensator", "DisturbanceObserver", "PhysicsMismatch", "Result", "Settings"]
