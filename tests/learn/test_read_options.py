"""How logs are read: changed by name, refused by name, and as JSON that reads back."""

import doctest
import json
from dataclasses import replace

import numpy as np
import pytest

import wrenchgap as wg
from wrenchgap import open_flights
from wrenchgap.flight.errors import FitError, ModelError
from wrenchgap.learn.data import read_options
from wrenchgap.learn.data.read_options import ReadOptions, intervals, times_outside
from wrenchgap.plant import model_file


def test_the_example_of_the_docstring_runs():
    assert doctest.testmod(read_options).failed == 0


def test_an_option_that_there_is_not_is_refused_with_those_that_there_are():
    with pytest.raises(TypeError, match="cut_off: no option of reading logs; there are topics, shifts, cutoff_hz"):
        open_flights("none.mcap", model_file.load("crazyflie"), cut_off=5.0)


@pytest.mark.parametrize("hz", [0.0, -1.0, np.nan, np.inf])
def test_a_cut_off_that_is_none_is_refused(hz, logs):
    with pytest.raises(FitError, match=r"cut-off .* Hz, expected between 0 and"):
        open_flights(logs.test, model_file.load("tilt_hexarotor"), cutoff_hz=hz, accept=["rate"])


def test_the_cut_off_is_the_options_else_the_model_files_else_8_hz(logs, tmp_path):
    """Also in a file written for a model that has none."""
    usual = model_file.load("tilt_hexarotor")
    slow = model_file.loads(usual.text.replace("schema = 1", "schema = 1\ncutoff_hz = 5.0", 1))
    again = model_file.load(model_file.save(replace(slow, text=""), tmp_path / "slow.toml").path)
    for model, asked, used in ((usual, None, 8.0), (slow, None, 5.0), (again, None, 5.0), (slow, 6.0, 6.0)):
        assert open_flights(logs.test, model, cutoff_hz=asked)[0].records[0].cutoff_hz == used


def test_a_model_file_shifts_stamps_unless_an_option_or_an_earlier_reading_did(logs, tmp_path):
    """Times of the odometry against those in the log: -4 ms by the file, +1 ms by the option, each once."""
    usual = model_file.load("tilt_hexarotor")
    late = model_file.load(
        model_file.save(ReadOptions(shifts={"odometry": -0.004}).recorded_in(usual), tmp_path / "late.toml").path
    )
    again = model_file.load(model_file.save(replace(late, text=""), tmp_path / "again.toml").path)
    raw = wg.flight.load(logs.test)
    first = raw.odometry.time[0]
    for model, asked, moved in (
        (usual, {}, 0.0),
        (late, {}, -0.004),
        (again, {}, -0.004),
        (late, {"odometry": 0.001}, 0.001),
    ):
        once = open_flights(logs.test, model, shifts=asked)[0].flight
        assert once.odometry.time[0] - first == pytest.approx(moved, abs=1e-9)
        assert once.imu.time[0] == raw.imu.time[0]
        twice = open_flights(once, model)[0].flight
        assert twice.odometry.time[0] == once.odometry.time[0]
    by_topic = ReadOptions(shifts={raw.odometry.topic: 0.001}).shifted(raw, late)
    assert by_topic.odometry.time[0] - first == pytest.approx(0.001, abs=1e-9)


@pytest.mark.parametrize(("line", "expected"), [("rotors = 0.1", "a role"), ("imu = 100.0", "seconds, at most 10")])
def test_a_shift_of_a_model_file_that_is_none_is_refused(line, expected):
    text = model_file.load("tilt_hexarotor").text
    with pytest.raises(ModelError, match=expected):
        model_file.loads(text + f"\n[shifts]\n{line}\n")


def test_what_was_said_of_reading_is_kept_beside_what_the_file_says_and_its_comments():
    text = model_file.load("tilt_hexarotor").text.replace("schema = 1", 'schema = 1\nunmeasured = ["torque_z"]', 1)
    usual = model_file.loads(text.replace('odometry = "/odometry"', 'odometry = "/odometry" # of 2025', 1))
    asked = ReadOptions(topics={"imu": "/imu:frd"}, cutoff_hz=5.0, unmeasured=("force_x",))
    kept = asked.recorded_in(usual)
    read = model_file.loads(kept.text)
    for model in (kept, read):
        assert model.topics == {**usual.topics, "imu": "/imu:frd"}
        assert (model.cutoff_hz, model.unmeasured, model.shifts) == (5.0, ("force_x", "torque_z"), {})
    assert "# of 2025" in kept.text
    assert usual.vehicle.body.mass == read.vehicle.body.mass


def test_options_read_back_from_their_json():
    asked = ReadOptions(topics={"imu": "/imu"}, between=[[3.0, 9.0]], accept=["weight"], budget="8GB")
    again = ReadOptions(**json.loads(json.dumps(asked.to_json())))
    assert (again.topics, again.between, again.accept, again.budget) == (
        {"imu": "/imu"},
        [[3.0, 9.0]],
        ["weight"],
        "8GB",
    )
    assert "budget" not in ReadOptions().to_json()


def test_one_interval_or_several():
    assert intervals(None) == ()
    assert intervals((5.0, 40.0)) == ((5.0, 40.0),)
    assert intervals([(30.0, 40.0), (5.0, 10.0), (9.0, 12.0)]) == ((5.0, 12.0), (30.0, 40.0))


def test_outside_and_inside_are_all_of_time():
    asked = [(5.0, 12.0), (30.0, np.inf)]
    gaps = [(gap.start, gap.stop) for gap in times_outside(asked)]
    assert gaps == [(-np.inf, 5.0), (12.0, 30.0)]


def test_two_parts_have_the_records_of_both():
    model = wg.load_model("tilt_hexarotor")
    flown = wg.simulate(model, "hover", duration=14.0, excitation=1.0)
    first, second = (1.0, 5.0), (8.0, 13.0)
    both = wg.open_flights(flown, model, between=[second, first])[0]
    each = [wg.open_flights(flown, model, between=part)[0] for part in (first, second)]
    assert len(both.records) == 2
    for record, alone in zip(both.records, each, strict=True):
        assert np.array_equal(record.time, alone.records[0].time)
        assert np.allclose(record.measured, alone.records[0].measured)
    with pytest.raises(wg.WrenchgapError, match="less than 2 s"):
        wg.open_flights(flown, model, between=[(1.0, 2.0), (50.0, 60.0)])
