"""Flights ready to be compared with models: opened, filtered, stacked, cut into blocks of time."""
