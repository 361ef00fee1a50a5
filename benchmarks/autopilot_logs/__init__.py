"""Logs as autopilots write them: a loop at 400 Hz whose commands are logged at 10 to 400 Hz; see `engine`."""
