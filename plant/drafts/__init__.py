"""Drafts of models from a log, an autopilot's parameters or a robot description; each number has a source."""
