"""Models drafted from what a log, an autopilot or a robot description says of a vehicle; each number has a source."""
