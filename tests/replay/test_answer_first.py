"""Every command begins with its answer: few sentences, then one table; `--details` has everything that `--json` has."""

from dataclasses import replace
from itertools import takewhile

import numpy as np
import pytest

import wrenchgap as wg
from wrenchgap.learn.posterior.discriminating_tests import Check
from wrenchgap.plant import model_file
from wrenchgap.replay import present
from wrenchgap.replay.present.tables import ANSWER_LINES, Line, Table

MODEL = model_file.load("tilt_hexarotor")
HIDDEN = ["com_offset=x:-0.004,y:0.007,z:-0.005"]


@pytest.fixture(scope="module")
def results(tmp_path_factory, small_processes):
    """Of flights whose centre of mass is off: one to fit, one to test."""
    folder = tmp_path_factory.mktemp("logs")
    flown = [wg.simulate(MODEL, "multi_axis", duration=8.0, seed=k, excitation=1.0, hide=HIDDEN) for k in (1, 2)]
    logs = [wg.save_log(flight, folder / f"{k}.mcap") for k, flight in enumerate(flown)]
    train, test = (wg.open_flights([log], MODEL) for log in logs)
    added = wg.add(MODEL, ["com_offset"], train)
    return {
        "check": wg.check(logs),
        "compare": wg.compare(test, MODEL, added),
        "predict": wg.predict(test, MODEL, added, horizons=[0.1, 0.2]),
        "where": wg.where(train, MODEL),
        "explain": wg.explain(train, MODEL, names=["mass", "com_offset"], validate=test),
        "add": added,
        "calibrate": wg.calibrate(train, MODEL),
        "changed": wg.changed(test, train, MODEL, names=["mass", "com_offset"]),
        "trend": wg.trend([*train, *test], MODEL, ["com_offset"]),
    }


def test_the_answer_is_short_and_one_table_follows(results):
    for name, result in results.items():
        shown = present.parts(result, details=False)
        answer = list(takewhile(lambda part: isinstance(part, Line) and part.text, shown))
        assert 1 <= len(answer) <= ANSWER_LINES, name
        assert sum(isinstance(part, Table) for part in shown) <= 1, name


def test_details_begin_with_the_same_answer_and_have_more(results):
    for name, result in results.items():
        short, whole = present.parts(result, details=False), present.parts(result)
        assert [p.text for p in short if isinstance(p, Line)][:1] == [p.text for p in whole if isinstance(p, Line)][:1]
        assert sum(isinstance(p, Table) for p in whole) >= sum(isinstance(p, Table) for p in short), name
        assert len(whole) > len(short), name


def test_explain_says_where_to_look_and_what_it_brings_on_a_flight_it_never_saw(results):
    said = [part.text for part in present.parts(results["explain"], details=False) if isinstance(part, Line)]
    (look,) = (text for text in said if text.startswith("Inspect"))
    assert "back left" in look  # of the body, x ahead and y to the left: x -4 mm, y 7 mm
    tested = results["explain"].validation
    force, torque = (np.linalg.norm(tested.after[axes]) for axes in (slice(0, 3), slice(3, 6)))
    (unseen,) = (text for text in said if text.startswith("On flights it never saw"))
    assert f"to {force:.3g} N" in unseen
    assert f"to {torque:.3g} Nm" in unseen


def test_a_command_prints_the_tables_when_they_are_asked_for(run):
    train = ("train.mcap", "-m", "tilt_hexarotor")
    assert run("simulate", *train[1:], "-t", "multi_axis", "--duration", 8, "-o", "train.mcap").exit_code == 0
    short, long = run("compare", *train), run("compare", *train, "--details")
    assert short.exit_code == long.exit_code == 0
    assert short.stdout.splitlines()[0] == long.stdout.splitlines()[0]
    assert "--details" in short.stdout
    assert "where nominal is worst" not in short.stdout
    assert "where nominal is worst" in long.stdout


def test_of_what_would_settle_it_the_cheapest_is_in_the_answer(results):
    found = results["explain"]
    checks = (Check("bench", "weigh it.", (), "weigh"), Check("flight", "fly it.", (), "flight"))
    open_one = replace(found, posterior=replace(found.posterior, settle=checks))
    said = [part.text for part in present.parts(open_one, details=False) if isinstance(part, Line)]
    assert "To settle it, on the bench: weigh it." in said
    assert not any("fly it." in text for text in said)
