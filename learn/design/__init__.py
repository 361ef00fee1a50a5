"""Flights that separate effects."""
