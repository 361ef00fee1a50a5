"""Turns a learned mismatch into a correction of the commanded wrench, sample by sample."""

from compensate.compensator import Compensator, Result, Settings

__all__ = ["Compensator", "Result", "Settings"]
