"""Flights of the independent engine (MuJoCo), which shares no formula with the code under test."""

import pytest

import flight
from learn.fit import dataset
from learn.measurement import prepare
from plant import model_file


@pytest.fixture(scope="session")
def hexarotor():
    return model_file.load("tilt_hexarotor")


@pytest.fixture(scope="session")
def fly(hexarotor):
    """Dataset of a flight with a hidden effect: fly("com_offset", size, "train", seed=..., seconds=...)."""
    from benchmarks.hidden_effects import engine

    cache = {}

    def made(*args, **kwargs):
        key = (repr(args), tuple(sorted(kwargs.items())))
        if key not in cache:
            found, truth = engine.fly(*args, **kwargs)
            records = [prepare(s, hexarotor.vehicle) for s in flight.uniform(found)]
            cache[key] = (dataset(records, hexarotor), truth)
        return cache[key]

    return made
