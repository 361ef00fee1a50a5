"""Thrust that falls with time."""

from dataclasses import replace

import numpy as np
import pytest

from wrenchgap.plant.effects import find
from wrenchgap.plant.effects.effect import Context
from wrenchgap.plant.state import rows


def flown(bench, first, last, voltage=None):
    """A hover between two times, ten samples a second."""
    time = np.arange(first, last, 0.1)
    return replace(bench.state(len(time)), time=time, voltage=voltage)


def test_two_per_cent_a_minute_is_three_after_a_minute_and_a_half(bench):
    _, u = bench.moving(8)
    x = replace(bench.state(), time=np.array([90.0]))
    nominal = bench.model().wrench(u, bench.state())[0]
    np.testing.assert_allclose(bench.added("thrust_fade", {"rate": 0.02}, u, x), -0.03 * nominal, atol=1e-9)


def test_is_battery_sag_while_the_voltage_falls_steadily(bench):
    """25.2 V at the start, 0.2 V less every minute, thrust with the square of it: to first order in the sag."""
    for seconds in (0.0, 60.0, 180.0):
        now = replace(bench.state(volts=25.2 - 0.2 * seconds / 60), time=np.array([seconds]))
        sag = bench.added("battery_sag", {"sensitivity": 2.0, "per_volt": 2.0 / 25.2}, x=now)
        np.testing.assert_allclose(bench.added("thrust_fade", {"rate": 2 * 0.2 / 25.2}, x=now), sag, atol=1e-9)


def test_pieces_of_a_flight_go_on_where_the_last_ended(bench):
    """A gap in the log starts no new battery: what counts is the time since the log's first sample."""
    x = flown(bench, 0.0, 100.0)
    u = rows(bench.wandering(len(x.time)), slice(None))
    model = bench.model("thrust_fade", {"rate": 0.05})
    whole, late = model.wrench(u, x), slice(600, None)
    np.testing.assert_array_equal(model.wrench(u.take(late), x.take(late)), whole[late])


@pytest.mark.parametrize(
    ("first", "last", "voltage", "why"),
    [
        (0.0, 200.0, 22.0, "battery_sag"),
        (0.0, 18.0, None, "until 18 s"),
        (300.0, 310.0, None, "flown for 10 s"),
        (0.0, 200.0, None, None),
        (300.0, 360.0, None, None),
    ],
)
def test_is_tried_on_long_flights_without_a_voltage(bench, first, last, voltage, why):
    x = flown(bench, first, last)
    x = x if voltage is None else replace(x, voltage=np.full(len(x.time), voltage))
    reason = find("thrust_fade").unexcited(Context(bench.vehicle, x))
    assert reason is None if why is None else why in reason
