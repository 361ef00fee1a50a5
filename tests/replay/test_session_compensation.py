"""The compensation of the viewer: the replay of the engine, gates that do what they say, a ghost that flies better."""

from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest

import wrenchgap as wg
from wrenchgap.compensate import Settings
from wrenchgap.flight.errors import UsageError
from wrenchgap.learn.process.gp import FitSettings
from wrenchgap.replay.present.counterfactual import tracking_rows
from wrenchgap.replay.session.log_session import LogSession
from wrenchgap.replay.session.panels.compensation import ghost_of

MODEL = wg.load_model("tilt_hexarotor")
silent = Mock()


@pytest.fixture(scope="module")
def gp(logs):
    settings = FitSettings(points=80, restarts=0, seed=0, pre_thin=300)
    return wg.learn_gp(wg.open_flights(logs.train, MODEL), MODEL, settings=settings, guard=False).gp


@pytest.fixture
def session(logs, gp):
    return LogSession(wg.open_flights(logs.test, MODEL), MODEL, gp, gp_name="torque.gp")


def series(session, title):
    return next((s for s in session.scene("test").series if s.title.startswith(title)), None)


def largest(found):
    return np.max(np.abs(list(found.values.values())))


def test_without_a_process_there_is_nothing_to_set(logs):
    session = LogSession(wg.open_flights(logs.test, MODEL), MODEL)
    assert session.compensations.setting is None
    with pytest.raises(UsageError, match="--gp"):
        session.compensations.replay("test", silent)
    flown = session.compensations.refly("test", 1.0, 2.0, silent, "l1")
    assert flown.change.words == ("corrected by L1, 1 Hz",)
    with pytest.raises(UsageError, match="--feedback pid"):
        session.compensations.refly("test", 1.0, 2.0, silent, "pid")


def test_replay_is_that_of_the_engine_and_joins_the_scene(session, gp):
    assert series(session, "correction") is None
    found = session.compensations.replay("test", silent)
    direct = wg.replay_compensation(session.working.flight("test"), MODEL, gp)
    drawn = series(session, "correction, torque")
    assert drawn.unit == "Nm"
    for k, axis in enumerate("xyz"):
        assert np.array_equal(drawn.values[axis], direct.steps.correction[:, 3 + k])
    assert np.array_equal(series(session, "sigma of the").values["sigma"], direct.steps.sigma)
    assert np.array_equal(series(session, "beta").values["beta"], direct.steps.beta)
    before, after = (np.mean(np.abs(m), axis=0) for m in (found.steps.mismatch_before, found.steps.mismatch_after))
    assert np.all(after < before)


def test_gates_withhold_what_they_should(session):
    desk = session.compensations
    usual = desk.setting.gate
    desk.set(replace(usual, filter_uncertain=False))
    desk.replay("test", silent)
    free = series(session, "correction, torque")
    assert np.all(series(session, "beta").values["beta"] == 0.0)
    assert "threshold" not in series(session, "sigma of the").values
    desk.set(replace(usual, filter_uncertain=True, sigma_threshold=1e-6, kappa=1e7))
    assert series(session, "correction") is None  # what was replayed with other settings is forgotten
    desk.replay("test", silent)
    assert np.all(series(session, "beta").values["beta"] > 0.99)
    held = series(session, "correction")
    assert held is None or largest(held) < 0.02 * largest(free)
    desk.set(usual, on=False)
    assert series(session, "beta") is None


def test_impossible_settings_are_refused_and_change_nothing(session):
    usual = session.compensations.setting.gate
    for wrong in ({"kappa": -1.0}, {"decay_time": 0.0}, {"sigma_threshold": np.nan}):
        with pytest.raises(UsageError, match="compensate"):
            session.compensations.set(replace(usual, **wrong))
    assert session.compensations.setting.gate == usual
    assert usual.decay_time == Settings().decay_time


def test_compensated_ghost_tracks_better_than_the_recorded_flight(session):
    flown = session.compensations.refly("test", 1.0, 4.0, silent)
    rows, drawn = tracking_rows(flown), ghost_of(flown)
    labels = [row[0] for row in rows]
    recorded, null, ghost = (np.array([float(row[i]) for row in rows]) for i in (1, 2, 3))
    attitude = [k for k, label in enumerate(labels) if label.startswith("attitude")]
    assert len(attitude) == 3
    assert np.linalg.norm(ghost[attitude]) < 0.6 * np.linalg.norm(recorded[attitude])
    assert null[attitude] == pytest.approx(recorded[attitude], abs=0.05)
    assert drawn.time[0] == pytest.approx(1.0, abs=0.02)
    assert np.diff(drawn.time).min() > 0.0
    assert drawn.tilt.shape == (len(drawn.time), 6)
    assert "torque.gp" in drawn.words
    by_feedback = session.compensations.refly("test", 1.0, 4.0, silent, "indi=8")
    alone = np.array([float(row[3]) for row in tracking_rows(by_feedback)])
    assert np.linalg.norm(alone[attitude]) < 0.6 * np.linalg.norm(recorded[attitude])
    assert ghost_of(by_feedback).words.startswith("corrected by INDI, 8 Hz")
    session.compensations.set(session.compensations.setting.gate, on=False)
    same = session.compensations.refly("test", 1.0, 4.0, silent)
    assert all(row[3] == row[2] for row in tracking_rows(same))


def test_a_process_counts_only_on_the_model_that_it_was_learnt_on(session):
    with_gp = session.scene("test")
    assert with_gp.sigma
    session.effects.add(("com_offset",), "test")
    assert not session.scene("test").sigma
    session.effects.undo()
    assert np.array_equal(session.scene("test").wrenches["predicted"], with_gp.wrenches["predicted"], equal_nan=True)
