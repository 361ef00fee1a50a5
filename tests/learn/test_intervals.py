"""Times that are asked for: intervals add up, and what is outside is everything else."""

import numpy as np
import pytest

import wrenchgap as wg
from wrenchgap.learn.data.intervals import intervals, outside


def test_one_interval_or_several():
    assert intervals(None) == ()
    assert intervals((5.0, 40.0)) == ((5.0, 40.0),)
    assert intervals([(30.0, 40.0), (5.0, 10.0), (9.0, 12.0)]) == ((5.0, 12.0), (30.0, 40.0))


def test_outside_and_inside_are_all_of_time():
    asked = [(5.0, 12.0), (30.0, np.inf)]
    gaps = [(gap.start, gap.stop) for gap in outside(asked)]
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
