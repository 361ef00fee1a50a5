"""A fleet flown by an engine that shares nothing with the fit: the hidden effect is named from merged evidence."""

from dataclasses import replace

import numpy as np
import pytest

import wrenchgap as wg
from benchmarks.hidden_effects.engine import fly
from wrenchgap.learn.posterior.fleet_ranking import ranking
from wrenchgap.learn.posterior.flight_evidence import evidence

MODEL = wg.load_model("tilt_hexarotor")
NAMES = ("com_offset", "mass", "thrust_scale", "servo_lag", "motor_lag", "body_drag", "constant_wrench", "rotor_thrust")
X = 0.004


@pytest.fixture(scope="module")
def flights():
    found = []
    for k in range(4):
        flight, _ = fly(["com_offset"], [{"x": X, "y": 0.0}], "train", 6.0, seed=k)
        found.append(replace(flight, path=flight.path.with_name(f"flight{k}{flight.path.suffix}")))
    return wg.open_flights(found, MODEL)


def test_the_hidden_effect_is_named_and_predicts_flights_that_were_held_out(flights):
    points = None
    for _ in range(2):
        parts = [evidence(one, MODEL, NAMES, points) for one in flights]
        found = ranking(lambda parts=parts: iter(parts))
        points = found.points
    best = found.sets[0]
    assert found.held_out
    assert "com_offset" in best.names
    assert found.probability("com_offset") > 0.95
    assert best.theta["com_offset"][0] == pytest.approx(X, rel=0.1)
    assert best.gain > 0.0
    assert best.better == 1.0
    assert np.all(best.rms[3:] < found.rms[3:] + 1e-6)
