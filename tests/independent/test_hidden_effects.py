"""Some flights of the benchmark of hidden effects: every kind, judged as the benchmark judges."""

from functools import cache

import pytest

from benchmarks.hidden_effects import cases
from benchmarks.hidden_effects.judge import run
from benchmarks.hidden_effects.score import GOOD, score
from wrenchgap.plant import model_file

CASES = {case.name: case for case in cases.fast()}


@cache
def row(name):
    return run(CASES[name], model_file.load("tilt_hexarotor"))


def of(kind):
    return [name for name, case in CASES.items() if case.kind == kind]


@pytest.mark.parametrize("name", of("one") + of("two"))
def test_every_hidden_effect_is_named(name):
    assert row(name)["right"] in GOOD


@pytest.mark.parametrize("name", of("none"))
def test_nothing_is_named_where_nothing_is_missing(name):
    assert row(name)["verdict"] == "nothing"
    assert row(name)["effects"] == []


@pytest.mark.parametrize("name", of("outside"))
def test_what_is_not_in_the_catalogue_is_called_unknown_and_swings(name):
    assert row(name)["verdict"] == "unknown"
    assert row(name)["swing"] is not None


def test_error_falls_on_a_flight_of_another_kind_and_values_are_right():
    scores = score([row(name) for name in of("one")])
    assert min(scores["unseen"][part]["median"] for part in ("force", "torque")) > 0.9
    assert scores["parameters"]["both"] >= 0.75
