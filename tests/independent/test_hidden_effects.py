"""Some flights of the benchmark of hidden effects: every kind, judged as the benchmark judges."""

from dataclasses import asdict, replace
from functools import cache

import numpy as np
import pytest

import wrenchgap as wg
from benchmarks.hidden_effects import cases
from benchmarks.hidden_effects.engine import fly
from benchmarks.hidden_effects.hidden import HIDDEN
from benchmarks.hidden_effects.judge import TRUE, run
from benchmarks.hidden_effects.score import GOOD, score
from wrenchgap.plant import model_file
from wrenchgap.plant.effects import find

pytestmark = pytest.mark.usefixtures("without_limits")
CASES = {case.name: case for case in cases.fast()}


@cache
def row(name, seconds=None):
    case = CASES[name]
    return run(case if seconds is None else replace(case, seconds=seconds), model_file.load("tilt_hexarotor"))


def of(kind):
    return [name for name, case in CASES.items() if case.kind == kind]


@pytest.mark.slow
@pytest.mark.parametrize("name", of("one") + of("two"))
def test_every_hidden_effect_is_named(name):
    assert row(name)["right"] in GOOD


@pytest.mark.parametrize("seconds", [12.0, pytest.param(None, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", of("none"))
def test_nothing_is_named_where_nothing_is_missing(name, seconds):
    assert row(name, seconds)["verdict"] == "nothing"
    assert row(name, seconds)["effects"] == []


@pytest.mark.slow
@pytest.mark.parametrize("name", of("outside"))
def test_what_is_not_in_the_catalogue_is_called_unknown_and_swings(name):
    assert row(name)["verdict"] == "unknown"
    assert row(name)["swing"] is not None


@pytest.mark.parametrize(
    ("names", "seconds"),
    [(of("one")[:1], 12.0), pytest.param(of("one"), None, marks=pytest.mark.slow)],
    ids=["a centre of mass", "all of one effect"],
)
def test_error_falls_on_a_flight_of_another_kind_and_values_are_right(names, seconds):
    scores = score([row(name, seconds) for name in names])
    assert min(scores["unseen"][part]["median"] for part in ("force", "torque")) > 0.9
    assert scores["parameters"]["both"] >= 0.75


@pytest.mark.parametrize(("hidden", "named"), [*TRUE, ("tether", "tether")])
def test_what_the_benchmark_hides_is_plausible(hidden, named):
    """At every size that is flown: a range that shuts the truth out would make the benchmark unanswerable."""
    known = {p.name: p for p in find(named).parameters(model_file.load("tilt_hexarotor").vehicle)}
    for seed in range(20):
        for scale in {min(s, cases.LARGEST.get(hidden, 2.0)) for s in cases.SIZES}:
            made = asdict(HIDDEN[hidden].draw(scale * HIDDEN[hidden].size, np.random.default_rng(seed)))
            if hidden == "tether":
                away = np.array(made["anchor"]) - (0.0, 0.0, 1.6)
                true = dict(
                    zip(("force_x", "force_y", "force_z"), made["pull"] * away / np.linalg.norm(away), strict=True)
                )
            else:
                true = TRUE[hidden, named](made)
            assert all(known[name].low <= value <= known[name].high for name, value in true.items()), true


def test_arms_that_turn_further_than_the_log_says_are_no_bias_of_the_sensors():
    """Without the effect a bias of 0.4 m/s^2, a mounting of 3 deg and a mass were firm in its place."""
    model = model_file.load("tilt_hexarotor")
    flight, _ = fly("none", None, "train", 20.0, seed=8)
    arms = flight.actuators
    log = replace(flight, actuators=replace(arms, tilt=0.95 * arms.tilt), commanded=None, desired=None)
    names = ("tilt_scale", "accelerometer_bias", "imu_misalignment", "mass", "thrust_scale", "servo_lag", "com_offset")
    found = wg.explain(wg.open_flights([log], model), model, names=names, jobs=1)
    assert "tilt_scale" in found.firm
    assert set(found.firm) <= {"tilt_scale", "servo_lag"}
    assert found.fit.values("tilt_scale")[0].value == pytest.approx(1.0 / 0.95 - 1.0, abs=0.005)
