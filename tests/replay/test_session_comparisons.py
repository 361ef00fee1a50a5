"""What changed between flights of a session of the viewer: found, put into the model, taken out again."""

import numpy as np
import pytest

from wrenchgap.flight.errors import UsageError
from wrenchgap.learn.changed.changed import changed
from wrenchgap.learn.data.opening import open_flights
from wrenchgap.plant import model_file
from wrenchgap.replay import api_flights
from wrenchgap.replay.present.what_to_inspect import sentences
from wrenchgap.replay.session.log_session import LogSession
from wrenchgap.replay.session.panels import changed as comparisons
from wrenchgap.replay.session.saving import SaveFolder

pytestmark = pytest.mark.usefixtures("without_limits")
MODEL = model_file.load("tilt_hexarotor")
TRUTH = (-0.004, 0.007, -0.005)
"""Where the centre of mass is on the flight `train` [m]; on `ideal` it is where the model has it."""


@pytest.fixture
def session(logs, tmp_path, monkeypatch):
    """In this process, and among three effects."""

    def quick(*arguments, **more):
        return changed(*arguments, **more | {"names": ("com_offset", "mass", "rotor_thrust"), "jobs": 1})

    monkeypatch.setattr(api_flights.changing, "changed", quick)
    monkeypatch.setattr(comparisons, "worker_result", lambda work, report: work(report))
    return LogSession(open_flights([logs.ideal, logs.train], MODEL), MODEL, folder=SaveFolder(tmp_path))


def compared(session):
    return session.comparisons.of("train", ("ideal",), lambda share, words: None)


def in_all(session, flight):
    return session.effects.staircases(flight)[0].stairs[-1].in_all


def test_what_changed_is_said_with_where_to_look(session):
    found = compared(session)
    assert (found.verdict, found.names) == ("changed", ("com_offset",))
    assert {c.effect for c in found.parameters} == {"com_offset"}
    assert all(c.significance > 5.0 for c in found.parameters)
    assert "centre of mass" in sentences(found)[0]
    by_name = {r.flight: r for r in found.rows}
    assert by_name["train"].role == "suspect"
    apart = by_name["train"].mean - by_name["ideal"].mean
    assert np.abs(apart[3] / found.scatter[3]) > 0.5  # an offset along y makes a torque about x
    assert (found.suspect, found.healthy) == (("train",), ("ideal",))


def test_put_into_the_model_it_takes_the_suspect_flights_error_off_and_can_be_undone(session):
    before = in_all(session, "train")
    session.comparisons.add(compared(session), session.working.name)
    effect = session.model.effect("com_offset")
    np.testing.assert_allclose(effect.theta, TRUTH, atol=5e-4)
    assert effect.provenance.method == comparisons.SOURCE
    assert in_all(session, "train") < 0.2 * before
    session.effects.undo()
    assert session.model.effect("com_offset") is None
    assert in_all(session, "train") == before


def test_it_is_removed_like_any_other(session):
    session.comparisons.add(compared(session), session.working.name)
    session.effects.remove("com_offset")
    assert not session.model.effects


def test_what_was_found_on_another_model_is_not_added(session):
    found, name = compared(session), session.working.name
    session.effects.add(("mass",), "train")
    with pytest.raises(UsageError, match="search again"):
        session.comparisons.add(found, name)


def test_one_flight_is_compared_with_nothing(logs):
    only = LogSession(open_flights([logs.train], MODEL), MODEL)
    assert only.comparisons is None
    assert len(only.capabilities.panels) == 5
