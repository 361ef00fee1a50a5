"""How logs are read: changed by name, refused by name, and as JSON that reads back."""

import doctest
import json

import pytest

from wrenchgap import open_flights
from wrenchgap.learn.data import read_options
from wrenchgap.learn.data.read_options import ReadOptions
from wrenchgap.plant import model_file


def test_the_example_of_the_docstring_runs():
    assert doctest.testmod(read_options).failed == 0


def test_an_option_that_there_is_not_is_refused_with_those_that_there_are():
    with pytest.raises(TypeError, match="cut_off: no option of reading logs; there are topics, shifts, cutoff_hz"):
        open_flights("none.mcap", model_file.load("crazyflie"), cut_off=5.0)


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
