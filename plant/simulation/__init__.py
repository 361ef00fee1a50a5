"""Closed loops stepped in time: stages, flight computer, rigid body; from a flight plan to a flight."""
