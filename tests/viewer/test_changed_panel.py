"""The panel about what changed: which flights are compared, what it shows, and the link that adds it."""

import numpy as np
import pytest

from tests.viewer.test_analysis_panels import follow_to, listening, move, panel_of, press
from wrenchgap.learn.changed.by_flight import FlightRow
from wrenchgap.learn.changed.changed import Changed, Verdict
from wrenchgap.learn.changed.places import Place
from wrenchgap.learn.changed.sizes import Size
from wrenchgap.learn.posterior.posterior import EquivalenceClass, NamedSet
from wrenchgap.plant import model_file
from wrenchgap.replay.session.panels.changed import ChangedPanel, labels
from wrenchgap.viewer import markup

MODEL = model_file.load("tilt_hexarotor")


def answer(suspect, healthy, verdict="changed"):
    mean = np.array([0.0, 0.0, -1.2, 0.03, -0.02, np.nan])
    rows = (
        FlightRow(healthy[0], "healthy", 0 * mean, 0 * mean, {}),
        FlightRow(suspect, "suspect", mean, np.abs(mean), {}),
    )
    size = Size("rotor_thrust", "rotor_2", 0.0, 0.01, -0.17, 0.02, "1", "M<3>")
    changed = verdict == "changed"
    return Changed(
        verdict=Verdict(verdict),
        names=("rotor_thrust",) if changed else (),
        firm=(),
        nothing=0.0 if changed else 1.0,
        classes=(EquivalenceClass(1.0, (NamedSet(("rotor_thrust",), 1.0, None),)),),
        settle=(),
        parameters=(size,) if changed else (),
        places=(Place("rotor_thrust", "rotor_2", "M<3>", 1.0),) if changed else (),
        alone=(),
        odd=(),
        not_compared=(),
        rows=rows,
        scatter=np.full(6, 0.1),
        scatter_known=True,
        answering=(),
        by_means=False,
        louder=(),
        untried=(),
        model=MODEL,
    )


@pytest.fixture
def panel(page, monkeypatch):
    listening(page)
    page.open("train")
    made = panel_of(page, ChangedPanel)
    made.comparisons.working.found.clear()
    for tick in made.healthy.values():
        move(tick, True)
    made.added = []
    monkeypatch.setattr(made.comparisons, "add", lambda found, model: made.added.append((found.names, model)))
    return made


def asked(panel, monkeypatch, eventually, verdict="changed"):
    calls = []

    def of(suspect, healthy, report):
        calls.append((suspect, healthy))
        return answer(suspect, healthy, verdict)

    monkeypatch.setattr(panel.comparisons, "of", of)
    press(panel.work.button)
    eventually(lambda: not panel.work.running)
    return calls


def test_the_flight_shown_is_compared_with_those_that_are_ticked(panel, page, monkeypatch, eventually):
    assert asked(panel, monkeypatch, eventually) == [("train", ("test",))]
    assert 'wg-badge wg-changed">PERHAPS CHANGED' in panel.answer.content, "a change is no good news; nothing is firm"
    assert ".wg-badge.wg-changed, .wg-badge.wg-group { background: #b07800; }" in markup.style()
    assert not panel.healthy["train"].visible
    assert panel.healthy["test"].visible
    page.open("test")
    assert panel.healthy["train"].visible
    assert panel.answer.content == ""  # that was about the other flight
    page.open("train")
    assert "rotor_thrust of M&lt;3&gt; by -17.0 +- " in panel.answer.content


def test_health_of_parts_is_of_all_flights_and_each_rotor_and_arm(panel, page, eventually):
    press(panel.season.button)
    eventually(lambda: not panel.season.running)
    assert "2 flights: nothing can be said about steps and drifts" in panel.health.content
    assert panel.health.content.count("<tr>") == 1 + 12 + 6
    assert "servo lag [ms]" in panel.health.content


def test_it_shows_what_changed_where_and_how_far_flights_lie_apart(panel, monkeypatch, eventually):
    asked(panel, monkeypatch, eventually)
    text = panel.answer.content
    assert "at <b>M&lt;3&gt;</b>: -0.170 ± 0.020" in text  # names are the user's
    assert "its propeller for cuts" in text
    assert "-12.0 times what healthy flights differ by" in text
    assert text.count("rgb(15,45,110)") == 1  # darkest blue: far below the healthy flights
    assert "<th>Mx</th>" in text
    assert "<th>Mz</th>" not in text  # no flight measured it: the others have its room


def test_the_link_puts_it_into_the_model(panel, monkeypatch, eventually):
    asked(panel, monkeypatch, eventually)
    follow_to(panel, panel.answer.content, "put rotor_thrust into the model")
    assert panel.added == [(("rotor_thrust",), "tilt_hexarotor")]


def test_where_nothing_changed_there_is_nothing_to_add(panel, monkeypatch, eventually):
    asked(panel, monkeypatch, eventually, "nothing")
    assert "into the model" not in panel.answer.content


def test_without_a_healthy_flight_it_says_so(panel, page):
    move(panel.healthy["test"], False)
    press(panel.work.button)
    assert "tick at least one" in str(page.told[-1])


def test_long_names_fit_beside_a_box_and_stay_apart():
    """What all names end in is left out, long ones have a gap; names that would become alike stay whole."""
    long = ("normal_flight__E8_log00_con", "normal_flight__E8_log01_con", "cut_propeller_M3_2mm_43mm__E8_log01_con")
    short = labels(long)
    assert len(set(short)) == 3
    assert all(len(s) <= 18 for s in short)
    assert short[0].endswith("log00")
    assert labels(("monday", "tuesday")) == ["monday", "tuesday"]
    alike = ("a_rather_long_name_x_of_a_flight_that_ends", "a_rather_long_name_y_of_a_flight_that_ends")
    assert len(set(labels(alike))) == 2
