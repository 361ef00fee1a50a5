"""A recorded flight, re-simulated with something changed."""
