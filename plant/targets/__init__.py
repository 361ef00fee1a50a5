"""A model in the terms of another program: parameters of autopilots, descriptions of simulators."""
