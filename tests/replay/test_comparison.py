"""Errors by axis, worst stretches, and which model a GP belongs to."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import wrenchgap as wg
from wrenchgap import flight
from wrenchgap.flight.check import TimeLeftOut
from wrenchgap.flight.errors import ModelError, UsageError
from wrenchgap.learn.data import comparison
from wrenchgap.learn.data.comparison import ranges
from wrenchgap.learn.data.errors import Errors
from wrenchgap.learn.data.opening import distinct, opened
from wrenchgap.learn.data.prediction import Predictor, predict
from wrenchgap.learn.process.predictors import predictors
from wrenchgap.plant import effect_values as editing
from wrenchgap.plant.model import make_effect
from wrenchgap.plant.vehicle import Body

MODEL = wg.load_model("tilt_hexarotor")


def record_of(path):
    return wg.open_flights(path, MODEL)[0].records[0]


def test_errors_are_said_in_parts_of_the_weight(logs):
    """4 % of the weight; a torque of the weight 12 mm off."""
    found = wg.compare(wg.open_flights(logs.test, MODEL), MODEL)
    (one,) = found.evaluations
    rms = found.weight * np.array([0.04, 0.0, 0.0, 0.0, 0.012, 0.0])
    known = replace(found, evaluations=(replace(one, pooled=replace(one.pooled, rms=rms)),))
    assert found.weight == pytest.approx(MODEL.vehicle.body.mass * 9.80665)
    assert "force error of nominal is 4.0 % of the weight" in str(known).splitlines()[0]
    assert "a centre of mass 12 mm off" in " ".join(str(known).split())


def test_a_motion_that_the_logs_do_not_show_is_not_predicted(logs):
    """And why is said; that where it is shown: the summary of `predict`, of the same models."""
    flights = wg.open_flights(logs.test, MODEL)
    said = str(wg.compare(flights, MODEL))
    assert "0.5 s ahead, with the logged commands alone, nominal is off by" in " ".join(said.split())
    without = [replace(flights[0], flight=replace(flights[0].flight, odometry=None))]
    found = wg.compare(without, MODEL)
    assert found.ahead is None
    assert any("Nothing was predicted ahead" in note and "odometry" in note for note in map(str, found.notes))


def test_errors_of_a_known_residual():
    residual = np.zeros((4, 6))
    residual[:, 0] = [3.0, -3.0, 5.0, -1.0]
    errors = Errors.of(residual)
    assert errors.mean_abs[0] == 3.0
    assert errors.std_abs[0] == pytest.approx(np.sqrt(2.0))
    assert errors.rms[0] == pytest.approx(np.sqrt(11.0))
    assert errors.max_abs[0] == 5.0
    assert errors.mean[0] == 1.0
    assert not errors.rms[1:].any()


def test_the_worst_stretch_is_where_the_error_was_put(logs):
    record = record_of(logs.test)
    residual = np.full((len(record), 6), 1e-3)
    inside = (record.time > 6.0) & (record.time < 7.0)
    residual[inside, 5] = 1.0
    found = comparison.worst_stretches([record], [residual], np.ones(6))
    assert found[0].start == pytest.approx(6.0, abs=0.1)
    assert found[0].stop == pytest.approx(7.0, abs=0.1)
    assert found[0].axis == "torque_z"
    starts = sorted(s.start for s in found)
    assert min(np.diff(starts)) > 0.9 * comparison.THRESHOLDS.stretch


def test_the_prediction_is_that_of_the_model_when_both_believe_in_the_same_body(logs):
    model = editing.with_values(MODEL, ["com_offset=x:0.01", "servo_lag=0.03"])
    record = record_of(logs.test)
    ours = Predictor("m", model.wrench_model).predict(record, model.vehicle.body)
    np.testing.assert_allclose(ours, predict(record, model.wrench_model), atol=1e-12)


def test_a_heavier_model_predicts_less_measured_force(logs):
    """The same thrust accelerates twice the mass half as much; processed with the nominal mass it reads half."""
    record, body = record_of(logs.test), MODEL.vehicle.body
    heavy = replace(MODEL.vehicle, body=Body(2.0 * body.mass, body.inertia, body.com_B))
    light, heavier = (
        Predictor("m", m.wrench_model).predict(record, body)[:, :3] for m in (MODEL, replace(MODEL, vehicle=heavy))
    )
    np.testing.assert_allclose(heavier, 0.5 * light, rtol=1e-9, atol=1e-9)


def test_no_flight_is_refused():
    for function in (wg.compare, wg.where, wg.learn_gp):
        with pytest.raises(UsageError, match=f"{function.__name__}: got no flights"):
            function([], MODEL)


def test_models_of_another_shape_cannot_be_compared():
    with pytest.raises(ModelError, match="one vehicle"):
        predictors(MODEL, [wg.load_model("crazyflie")])


def test_an_addition_is_labelled_by_what_it_adds(logs):
    """To the model compared with, or, where that is an addition too or lacks other effects, to the nominal vehicle."""
    opened = wg.open_flights(logs.test, MODEL)
    found = wg.add(MODEL, "com_offset", opened)
    fitted = replace(found.model, path=Path("fitted.toml"))
    more = wg.add(fitted, "mass", opened)

    alone = [replace(one, flight=replace(one.flight, odometry=None)) for one in opened]  # nothing is predicted

    def labels(*models):
        return [e.name for e in wg.compare(alone, *models, ahead=False).evaluations]

    assert labels(MODEL, found) == ["nominal", "+ com_offset"]
    assert labels(MODEL, found, more) == ["nominal", "+ com_offset", "+ com_offset + mass"]
    assert labels(fitted, more) == ["nominal", "fitted", "fitted + mass"]
    assert labels(more, found) == ["nominal", "+ com_offset + mass", "+ com_offset"]


def test_flights_with_one_name_are_kept_apart(logs):
    flights = wg.open_flights([logs.test, logs.train], MODEL)
    same = [replace(o, flight=replace(o.flight, name="a")) for o in flights]
    names = [o.records[0].flight for o in distinct(same)]
    assert names[1] == "a (2)"
    assert len({o.flight.name for o in distinct(same)}) == 2


def test_ranges_say_which_flight_went_further(logs):
    train, test = (o.records for o in wg.open_flights([logs.train, logs.test], MODEL))
    assert not any(r.outside for r in ranges([*train, *test], test))
    slow = [replace(r, state_kept=replace(r.state_kept, omega_B=0.01 * r.state_kept.omega_B)) for r in test]
    assert [r.quantity for r in ranges(slow, test) if r.outside] == ["body rate"]


def test_values_by_name_and_in_order_mean_the_same():
    by_name, in_order = (
        editing.effect_of_text(MODEL, f"com_offset={v}").theta for v in ("y:0.002,x:0.001", "0.001,0.002,0")
    )
    np.testing.assert_array_equal(by_name, in_order)


@pytest.mark.parametrize(
    "text", ["com_offset", "com_offset=", "=1", "com_offset=x:1,2", "com_offset=x:one", "com_offset=x:1,x:2"]
)
def test_values_that_are_none_are_refused(text):
    with pytest.raises(UsageError):
        editing.effect_of_text(MODEL, text)


def test_hidden_values_add_to_what_the_model_has():
    known = MODEL.with_effects([make_effect(MODEL.vehicle, "servo_lag", [0.02])])
    truth = editing.with_hidden(known, ["servo_lag=tau:0.03", "com_offset=x:0.01"])
    assert [e.name for e in truth.effects] == ["com_offset", "servo_lag"]
    assert truth.effects[1].theta[0] == pytest.approx(0.05)


def test_time_on_the_ground_is_left_out(tmp_path):
    """Two seconds with idle rotors before the flight say nothing about the model."""
    weight = 0.033 * 9.81
    time = np.arange(0, 8, 0.004)
    wrench = np.zeros((len(time), 6))
    wrench[:, 2] = np.where(time < 2.0, 0.02, weight)
    commanded = flight.WrenchSeries("/w", time, wrench)
    imu = flight.ImuSeries("/i", time, np.zeros((len(time), 3)), np.tile([0.0, 0.0, 9.81], (len(time), 1)))
    found = flight.Flight("f", tmp_path / "f.mcap", "0" * 64, 0, commanded=commanded, imu=imu)
    one = opened(found, wg.load_model("crazyflie"), accept=["constant-channel"])
    (ground,) = [n for n in one.notes if isinstance(n, TimeLeftOut) and n.why.startswith("ground")]
    assert 1.5 < ground.stop < 2.3  # a low-pass of 1 Hz decides
    assert one.records[0].time[0] > 2.0
    assert np.abs(one.records[0].measured - one.records[0].commanded).max() < 1e-3 * weight


def test_by_flight_gives_means_with_their_sign(logs):
    """A force of (0.3, -0.2, 0) N that the second flight alone has is what its mean grows by."""
    first, second = wg.open_flights([logs.ideal, logs.test], MODEL)
    push = np.array([0.3, -0.2, 0.0, 0.0, 0.0, 0.0])
    pushed = replace(second, records=tuple(replace(r, measured=r.measured + push) for r in second.records))
    before, after = (wg.compare([first, one], MODEL, ahead=False).to_json()["by_flight"] for one in (second, pushed))
    assert [(row["flight"], row["model"]) for row in after] == [("ideal", "nominal"), ("test", "nominal")]
    np.testing.assert_allclose(after[0]["mean"], before[0]["mean"])
    np.testing.assert_allclose(np.array(after[1]["mean"]) - before[1]["mean"], push, atol=1e-12)
    mean, rms = np.array(after[1]["mean"]), np.array(after[1]["rms"])
    assert np.all(np.abs(mean) <= rms)


def test_by_flight_on_the_command_line_prints_one_table_with_signs(logs, run):
    shown = run("compare", logs.ideal, logs.test, "-m", "tilt_hexarotor", "--by-flight").stdout
    assert "signed mean" in shown
    assert "rms of |measured - predicted| by flight" not in shown
    rows = [
        line.split() for line in shown.splitlines() if " mean " in line and "nominal" in line and "signed" not in line
    ]
    by_flight = [row for row in rows if row[0] in ("ideal", "test")]
    assert len(by_flight) == 2
    assert all(value[0] in "+-0" for row in by_flight for value in row[3:])
    assert wg.compare(wg.open_flights(logs.ideal, MODEL), MODEL, ahead=False).to_json()["by_flight"]
