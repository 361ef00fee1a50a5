"""`--between`: only a part of each flight."""

import numpy as np
import pytest

from wrenchgap.flight.errors import UsageError
from wrenchgap.learn.data.opening import open_flight
from wrenchgap.plant import model_file
from wrenchgap.replay.cli.options import parse_between


def test_only_the_part_between_the_times_is_used(logs):
    model = model_file.load("tilt_hexarotor")
    whole, part = open_flight(logs.test, model), open_flight(logs.test, model, between=(3.0, 9.0))
    time = part.records[0].time
    assert time[0] >= 3.0
    assert time[-1] <= 9.0
    rows = np.searchsorted(whole.records[0].time, time[5:-5])
    near = whole.records[0].time[np.minimum(rows, len(whole.records[0]) - 1)]
    assert np.abs(near - time[5:-5]).max() < 0.03


@pytest.mark.parametrize(
    ("text", "expected"), [("5:40", (5.0, 40.0)), (":40", (-np.inf, 40.0)), ("5:", (5.0, np.inf)), (None, None)]
)
def test_either_side_may_be_left_open(text, expected):
    assert parse_between(text) == expected


@pytest.mark.parametrize("text", ["5", "a:b", "9:3", "3:3", "nan:4", ""])
def test_anything_else_is_refused(text):
    with pytest.raises(UsageError, match="T0:T1"):
        parse_between(text)
