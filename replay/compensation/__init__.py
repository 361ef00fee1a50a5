"""The compensation of a recorded flight, step by step."""
