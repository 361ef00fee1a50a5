"""A weighed vehicle: what the model file knows decides what no IMU can tell apart, on flights of another engine."""

from dataclasses import replace

import numpy as np
import pytest

import wrenchgap as wg
from benchmarks.hidden_effects.engine import fly
from wrenchgap.learn.data.candidates import Lack, candidates
from wrenchgap.plant.vehicle import Tolerances

MODEL = wg.load_model("tilt_hexarotor")
MISSING = 0.06
"""Of the air's density, and with it of thrust and torque."""
TOGETHER = ("thrust_scale", "mass", "inertia")
"""Scaled together they change nothing that an IMU measures."""


def weighed(mass, inertia):
    told = inertia * np.sqrt(np.outer(np.diag(MODEL.vehicle.body.inertia), np.diag(MODEL.vehicle.body.inertia)))
    return replace(MODEL, vehicle=replace(MODEL.vehicle, tolerances=Tolerances(mass=mass, inertia=told)))


@pytest.fixture(scope="module")
def flown(once):
    return once("thin air", lambda: fly("thin_air", {"missing": MISSING}, "train", 15.0, seed=4)[0])


def fitted(model, flown):
    found = wg.add(model, TOGETHER, wg.open_flights(flown, model)).fit
    value = {f"{e}.{p.name}": (v, s) for (e, p), v, s in zip(found.parameters, found.theta, found.std, strict=True)}
    return value["thrust_scale.scale"], value["mass.added"]


def test_a_weighed_mass_leaves_thin_air_as_the_answer(flown):
    (thrust, std), (mass, _) = fitted(weighed(0.005, 0.005), flown)
    assert thrust == pytest.approx(-MISSING, abs=0.01)
    assert abs(thrust + MISSING) < 2.0 * std
    assert abs(mass) < 0.015


def test_without_it_the_direction_stays_open(flown):
    """The interval of the thrust is as wide as what is typical of a mass, and narrow once the mass is known."""
    (_, loose), _ = fitted(MODEL, flown)
    (_, tight), _ = fitted(weighed(0.005, 0.005), flown)
    assert loose > 3.0 * tight
    assert loose > 0.015


def test_what_is_known_is_not_tried_and_the_reason_is_said(flown):
    model = weighed(0.005, 0.2)
    records = [r for f in wg.open_flights(flown, model) for r in f.records]
    found = candidates(records, model)
    assert "mass" not in found.tried
    assert "inertia" in found.tried  # 20 % is an estimate
    (why,) = [u for u in found.untried if u.effect == "mass"]
    assert why.lack is Lack.KNOWN
    assert why.reason == "the model file knows the mass to 0.005 kg"
