"""Every command begins with its answer: few sentences, then one table; `--details` has everything that `--json` has."""

import textwrap
from dataclasses import replace
from itertools import takewhile
from types import SimpleNamespace

import numpy as np
import pytest

import wrenchgap as wg
from wrenchgap.flight.check import Check as FlightCheck
from wrenchgap.flight.check import Finding
from wrenchgap.learn.changed.by_flight import FlightRow
from wrenchgap.learn.data.checks.vehicle import OTHER_WEIGHT
from wrenchgap.learn.diagnose.timing import FeedbackDominated
from wrenchgap.learn.posterior.discriminating_tests import Check
from wrenchgap.learn.posterior.verdict import OpenBand, Verdict
from wrenchgap.plant import model_file
from wrenchgap.replay import present
from wrenchgap.replay.present.explanation import brief
from wrenchgap.replay.present.notes import banner, doubted_mass
from wrenchgap.replay.present.tables import ANSWER_LINES, Line, Table
from wrenchgap.replay.present.what_to_inspect import beyond_these

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
    assert "To settle what is open, on the bench: weigh it." in said
    assert not any("fly it." in text for text in said)
    long = replace(checks[0], what=f"Weigh it: {'1.09 kg if com_offset; ' * 12}1.08 kg if not.")
    many = replace(found, posterior=replace(found.posterior, settle=(long,)))
    (settle,) = (part.text for part in present.parts(many, details=False) if "To settle" in getattr(part, "text", ""))
    assert settle == "To settle what is open, on the bench: Weigh it (what each explanation predicts: --details)."
    assert any(part.text.endswith(long.what) for part in present.parts(many) if isinstance(part, Line))


def test_what_explain_found_in_the_worst_case_is_eight_lines_of_a_screen(results, monkeypatch):
    """Partly explained, with two effects that are not sure, open bands, feedback, and a check of five readings."""
    found = results["explain"]
    feedback = property(lambda _: (FeedbackDominated(("torque_x", "torque_y")),))
    monkeypatch.setattr(type(found.timing[0]), "warnings", feedback)
    (member,) = found.members
    others = [replace(member, name=name, probability=0.8) for name in ("mass", "body_drag_areas")]
    check = Check("bench", f"Weigh it: {'1.09 kg if mass + com_offset; ' * 5}1.08 kg if not.", (), "weigh")
    worst = replace(
        found,
        verdict=Verdict.UNKNOWN,
        members=(member, *others),
        bands=(OpenBand(4, 2.0, 3.0, 6.6), OpenBand(0, 0.7, 1.2, 4.14)),
        posterior=replace(found.posterior, settle=(check,)),
    )
    shown = "\n".join(part.text for part in takewhile(lambda p: isinstance(p, Line) and p.text, brief(worst)))
    assert sum(len(textwrap.wrap(line, 120)) for line in shown.splitlines()) <= ANSWER_LINES, shown
    details = " ".join(part.text for part in present.parts(worst) if isinstance(part, Line))
    for words in ("torque_y at 2 to 3 Hz", "feedback-dominated", "would have been shown", "1.09 kg if mass"):
        assert words not in shown
        assert words in details


def test_missing_samples_are_one_line_until_details_are_asked_for(results):
    """What asks for nothing; a check with an option that mends it is said in full."""
    (flight,) = results["compare"].flights
    said = (("gaps", "3 gap(s).", ""), ("spikes", "24 sample(s).", ""), ("weight", "Check the mass.", ""))
    mended = ("left-out", "Half of it is left out.", "--keep held")
    notes = [Finding(flight, FlightCheck(n, "warn", words, mend)) for n, words, mend in (*said, mended)]
    result = replace(results["compare"], notes=tuple(notes))
    short, whole = ([line.text for line in banner(result, details=details)] for details in (False, True))
    assert short[-1] == "check: gaps, spikes: samples are missing or left out (--details)"
    assert any(text.endswith("Read it with --keep held") for text in short)
    assert not any("24 sample(s)" in text for text in short)
    assert len(short) == 3
    assert any("24 sample(s)" in text for text in whole)
    assert len(whole) == 4


def test_a_change_beyond_few_healthy_flights_and_not_beyond_usual_ones_is_said():
    """Three flights that agree to a hundredth of what is usual, and two that are off by twice the usual."""
    usual = np.full(6, 1e-3)

    def row(role, offset):
        return FlightRow(role, role, np.array([0.0, 0.0, 0.0, 0.0, offset, 0.0]) * 1e-3, usual, {})

    healthy = [row("healthy", x) for x in (0.0, 0.01, -0.01)]
    found = SimpleNamespace(rows=[*healthy, row("suspect", 2.0), row("suspect", 2.02)], scatter=usual)
    said = beyond_these(found)
    assert said.startswith(" Their mean M_y differs by 2e+02 times what these 3 healthy flights differ by ")
    assert not beyond_these(SimpleNamespace(rows=found.rows[1:], scatter=usual))  # two say nothing of their scatter
    wide = [row("healthy", x) for x in (0.0, 0.5, -0.5)]
    assert not beyond_these(SimpleNamespace(rows=[*wide, *found.rows[3:]], scatter=usual))


def test_a_weight_is_doubted_first_unless_it_is_what_changed():
    def told(**flights):
        notes = [Finding(name, FlightCheck("weight", "warn", words)) for name, words in flights.items()]
        return SimpleNamespace(notes=notes, healthy=("a", "b"))

    mild, other = "Median commanded force: check the mass", f"Median commanded force: {OTHER_WEIGHT}"
    assert not banner(told(suspect=mild))  # the healthy ones have it not: it is what changed
    assert len(banner(told(suspect=mild, a=mild))) == 2
    assert not doubted_mass(told(suspect=mild, a=mild))
    assert banner(told(suspect=other))
    assert doubted_mass(told(a=other))[0].text.startswith("Correct the model's mass first")
