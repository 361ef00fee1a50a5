"""Predictions without correction: closed forms of a body, an independent quadrotor, and what the command says."""

import tracemalloc
import warnings
from dataclasses import replace

import numpy as np
import pytest

import wrenchgap as wg
from tests.independent.flown_quadrotor import MODEL, Case, fly
from wrenchgap.flight import so3
from wrenchgap.flight.errors import LogError, ModelError, UsageError
from wrenchgap.flight.flight import GRAVITY
from wrenchgap.learn.data.prediction import Predictor
from wrenchgap.plant.model import make_effect
from wrenchgap.plant.rigid_body import unpack
from wrenchgap.plant.state import Commands
from wrenchgap.replay.prediction import NAIVE, Ahead, RecordedStretch, lengths, paths_ahead, stretches_of
from wrenchgap.replay.session.log_session import LogSession

DT = 0.01
STEPS = np.array([10, 50])
HORIZONS = [0.1, 0.5]
PUSH, MASS = np.array([0.3, -0.2, 0.5]), wg.load_model("variable_tilt_hexacopter").vehicle.body.mass


@pytest.fixture(scope="module")
def pushed():
    """A body that does not turn, under a constant acceleration for two seconds, and its model (mass and inertia)."""
    time = DT * np.arange(200)[:, None]
    y = np.zeros((200, 13))
    y[:, :3], y[:, 3], y[:, 7:10] = 0.5 * PUSH * time**2, 1.0, PUSH * time
    force = np.tile(MASS * (PUSH + np.array([0.0, 0.0, GRAVITY])), (200, 1))
    commands = Commands(np.concatenate((force, np.zeros((200, 3))), axis=1))
    state = unpack(time[:, 0], y)
    return Ahead(RecordedStretch(y, state, None, commands, DT, None), STEPS), wg.load_model(
        "variable_tilt_hexacopter"
    ).wrench_model


def test_a_body_under_a_constant_force_is_where_newton_says(pushed):
    ahead, model = pushed
    found = ahead.errors(ahead.states(model, np.zeros((200, 6)), ahead.starts))
    assert found.shape == (2, 150, 4)
    assert found.max() < 1e-9


def test_without_a_model_the_acceleration_is_what_is_missing(pushed):
    ahead, _ = pushed
    found, time = ahead.errors(ahead.naive()), DT * STEPS
    assert found[:, :, 0] == pytest.approx(np.outer(0.5 * np.linalg.norm(PUSH) * time**2, np.ones(150)))
    assert found[:, :, 1] == pytest.approx(np.outer(np.linalg.norm(PUSH) * time, np.ones(150)))
    assert np.abs(found[:, :, 2:]).max() < 1e-9


def test_a_wrench_besides_acts_where_it_is_put(pushed):
    """Half a newton along x more: velocity off by F t / m; as one that follows on other samples likewise."""
    ahead, model = pushed
    more = np.zeros((200, 6))
    more[:, 0] = 0.5
    for states in (
        ahead.states(model, more, ahead.starts),
        ahead.states(model, 0.0 * more, ahead.starts, more, ahead.starts[::-1]),
    ):
        assert ahead.errors(states)[:, 7, 1] == pytest.approx(0.5 * DT * STEPS / MASS)


def test_a_path_ahead_begins_where_the_vehicle_is_and_follows_newton(flown):
    """Half a second in 5 steps of a drone that the model knows: the paths by which it may be off lie around the one
    that was flown.
    """
    flights, known = flown
    stretches = stretches_of(flights[0], known.vehicle)
    start, paths = paths_ahead(stretches, Predictor("model", known.wrench_model), horizon=0.5, points=5)
    time, y = stretches[0].state.time, stretches[0].y
    there = np.array([np.interp(start[:, None] + np.linspace(0.0, 0.5, 6), time, y[:, k]) for k in range(3)])
    off = np.linalg.norm(paths - there.transpose(1, 2, 0)[:, None], axis=3)
    assert off[:, :, 0] == pytest.approx(0.0, abs=1e-9)
    spread = np.linalg.norm(paths[:, 1:] - paths[:, :1], axis=3)[:, :, -1]
    assert 0.1 < np.median(off[:, 0, -1]) / np.median(spread) < 2.0
    assert paths_ahead(stretches, Predictor("model", known.wrench_model), horizon=300.0) is None


def test_the_page_gets_paths_of_its_current_model(flown):
    flights, known = flown
    ahead = LogSession(flights[:1], known).scene("still").ahead()
    time = float(ahead.start[3])
    assert ahead.at(time).shape == (9, 21, 3)
    assert ahead.at(ahead.start[0] - 0.1) is None
    assert ahead.at(ahead.start[-1] + 1.1) is None
    without = [replace(flights[0], flight=replace(flights[0].flight, odometry=None))]
    assert LogSession(without, known).scene("still").ahead() is None


def test_the_error_of_an_attitude_is_an_angle():
    one, other = np.zeros((2, 1, 13))
    one[:, 3], other[:, 3:7] = 1.0, so3.exp(np.array([[0.0, 0.3, 0.0]]))
    assert lengths(one, other) == pytest.approx(np.array([[0.0, 0.0, 0.3, 0.0]]))


@pytest.fixture(scope="module")
def flown():
    """Still and gusty flights of a quadrotor with a lag of 20 ms, and a model that knows it."""
    how = {"excited": 0.6, "seconds": 9.0, "motor_hz": 125.0, "imu_hz": 125.0}
    cases = [Case("still", seed=1, drag=0.0, **how), Case("gusts", seed=2, gusts=1.0, **how)]
    lag = make_effect(MODEL.vehicle, "motor_lag", {"tau": 0.02})
    return wg.open_flights(fly(cases), MODEL), MODEL.with_effects([lag])


@pytest.fixture(scope="module")
def predicted(flown):
    flights, known = flown
    return [wg.predict(one, MODEL, known, horizons=HORIZONS) for one in flights]


def test_a_model_that_is_right_predicts_another_engines_flight(predicted):
    """Better than no model in everything, the more so the more it knows; half a second on by centimetres."""
    naive, nominal, known = predicted[0].models
    assert naive.name == NAIVE
    assert (nominal.mae[1] < naive.mae[1]).all()
    assert (known.mae[0] < nominal.mae[0])[2:].all()
    assert known.mae[1, 0] < 0.02
    assert known.mae[1, 2] < 0.05


def test_as_many_predictions_as_stated_are_off_by_no_more_than_is_said(predicted):
    """In gusts; in still air the model leaves hardly more than the noise of the sensors, and the share is rougher."""
    (_, nominal, known), (_, *gusty) = (found.models for found in predicted)
    for one in gusty:
        assert one.within == pytest.approx(np.full((2, 4), 0.95), abs=0.05)
    assert (nominal.within > 0.9).all()
    assert (known.within > 0.88).all()


def test_gusts_widen_what_is_said(predicted):
    still, gusty = (found.models[-1] for found in predicted)
    assert (gusty.limit[1] > 1.5 * still.limit[1])[:2].all()


def test_values_that_are_not_sure_widen_what_is_said(flown):
    flights, _ = flown
    sure = make_effect(MODEL.vehicle, "thrust_scale", {"scale": 0.0})
    unsure = wg.predict(flights[0], MODEL, MODEL.with_effects([_with_std(sure, 0.1)]), horizons=HORIZONS)
    nominal, drawn = unsure.models[1:]
    assert drawn.limit[1, 1] > 2.0 * nominal.limit[1, 1]


def _with_std(effect, std):
    return replace(effect, std=np.array([std]))


def test_what_is_worse_than_no_model_is_said(flown):
    flights, _ = flown
    off = MODEL.with_effects([make_effect(MODEL.vehicle, "com_offset", {"x": 0.02, "y": 0.0, "z": 0.0})])
    found = wg.predict(flights[0], off, horizons=HORIZONS)
    assert found.to_json()["summary"][1].startswith("That is worse than constant velocity")
    last, at = found.models[-1], len(HORIZONS) // 2
    mae = np.zeros_like(last.mae)
    mae[at, 2] = last.mae[at, 2]
    some = replace(found, models=(*found.models[:-1], replace(last, mae=mae)))
    assert some.to_json()["summary"][1].startswith("For attitude that is worse than constant velocity")


def test_a_flight_without_a_pose_or_too_short_is_refused(flown):
    flights, _ = flown
    with pytest.raises(LogError, match="no topic plays the role 'odometry'"):
        wg.predict(replace(flights[0], flight=replace(flights[0].flight, odometry=None)), MODEL)
    with pytest.raises(LogError, match="predicted 30 s ahead; ask for shorter ones with --horizon"):
        wg.predict(flights[0], MODEL, horizons=[30.0])
    with pytest.raises(UsageError, match="expected positive numbers of seconds"):
        wg.predict(flights[0], MODEL, horizons=[0.1, -1.0])


def test_horizons_that_no_step_of_the_log_is_are_refused(flown):
    """They were once answered with one step, or ended in a traceback."""
    flights, _ = flown
    for horizons in ([1e300], [0.1, 1e18]):
        with pytest.raises(LogError, match=r"predicted 1e.* s ahead; ask for shorter ones"):
            wg.predict(flights[0], MODEL, horizons=horizons)
    with pytest.raises(UsageError, match=r"--horizon 0\.001: expected seconds from the sample period of the log"):
        wg.predict(flights[0], MODEL, horizons=[0.001, 0.5])
    with pytest.raises(UsageError, match="names 2000 horizons; expected 100 at most"):
        wg.predict(flights[0], MODEL, horizons=np.linspace(0.1, 1.0, 2000))


def test_a_motion_that_grows_beyond_all_numbers_is_refused_without_warnings(flown):
    """It was once answered with NaN, and was not worse than no model."""
    flights, _ = flown
    body = MODEL.vehicle.body
    light = replace(MODEL.vehicle, body=replace(body, inertia=1e-9 * body.inertia))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(ModelError, match="grows beyond all numbers; check mass, inertia"):
            wg.predict(flights[0], replace(MODEL, vehicle=light))
        lost = Predictor("model", replace(MODEL, vehicle=light).wrench_model)
        assert paths_ahead(stretches_of(flights[0], light), lost, most=3) is None  # the page drew it, and warned


@pytest.mark.slow
def test_the_wrenches_of_long_predictions_are_not_kept(flown):
    """Of 4,000 predictions over 5 s at 125 Hz they would be 120 MB, of 60 s at 250 Hz 2.9 GB."""
    flights, _ = flown
    tracemalloc.start()
    wg.predict(flights[0], MODEL, horizons=[5.0])
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most < 60e6


def test_a_table_has_a_row_for_each_number_and_the_picture_a_panel_for_each_quantity(predicted):
    table = predicted[0].to_frame()
    assert len(table) == 3 * len(HORIZONS) * 4
    assert set(table["quantity"]) == {"position", "velocity", "attitude", "rate"}
    assert len(np.ravel(predicted[0].plot())) == 4
    assert "0.5 s ahead" in str(predicted[0])
