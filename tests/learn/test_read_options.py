"""How logs are read: changed by name, refused by name, and as JSON that reads back."""

import doctest
import json
from dataclasses import replace

import numpy as np
import pytest

import wrenchgap as wg
from wrenchgap import open_flights
from wrenchgap.flight.errors import FitError
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
