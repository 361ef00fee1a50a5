"""Turns a learned mismatch into a correction of the commanded wrench, sample by sample."""
