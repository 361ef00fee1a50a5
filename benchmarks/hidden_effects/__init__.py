"""Flights with an effect that the model lacks, made by code that shares nothing with `plant`."""
