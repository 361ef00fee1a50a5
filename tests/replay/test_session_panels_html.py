"""HTML of the panels that show results: colours grow darker, numbers read well."""

import re

import numpy as np
import pytest

import wrenchgap as wg
from wrenchgap.plant.effects import find
from wrenchgap.plant.effects.effect import Parameter
from wrenchgap.replay.session.panels import html


def brightness(colour):
    """Mean of the channels of an rgb(...)."""
    return np.mean([int(v) for v in re.findall(r"\d+", colour)])


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_heat_grows_darker_and_letters_stay_readable(sign):
    shades = [html.heat(sign * share) for share in np.linspace(0.0, 1.0, 30)]
    levels = np.array([brightness(back) for back, _ in shades])
    assert levels[0] == 255
    assert np.all(np.diff(levels) < 0.0)
    for back, front in shades:
        letters = 255.0 if front == "#fff" else 34.0
        assert abs(brightness(back) - letters) > 80.0


def test_heat_has_two_signs_and_ends():
    assert html.heat(0.5)[0] != html.heat(-0.5)[0]
    assert html.heat(7.0) == html.heat(1.0)
    assert html.heat(-7.0) == html.heat(-1.0)


def test_bars_are_as_wide_as_their_parts():
    parts = [(0.25, "#111", "a"), (0.0, "#222", "b"), (0.5, "#333", "c")]
    shares = {"physics": 1.0, "unexplained": 0.5}
    made = html.render("budget", legend=[], rows=[("all", "N", 1.0, parts, shares)])
    assert [float(w) for w in re.findall(r"width:([\d.]+)%;background", made)] == [25.0, 50.0]  # those that are there


def test_a_share_stays_on_one_line_and_zero_is_said_of_zero_only():
    assert [html.percent(share) for share in (0.25, 0.0, 1e-5)] == ["25\u00a0%", "0\u00a0%", "<\u00a00.1\u00a0%"]


def test_a_parameter_is_in_the_unit_of_its_slider():
    length = Parameter("x", "m", -0.1, 0.1, 0.01)
    assert html.parameter_in_words(length, 0.007, 0.0002) == "x 7.00 +- 0.20 mm"
    assert html.parameter_in_words(length, 0.007, None) == "x 7.00 mm"
    vehicle = wg.load_model("crazyflie").vehicle
    loss = find("rotor_thrust").parameters(vehicle)[3]
    assert html.parameter_in_words(loss, -0.15, None, vehicle) == "M4 -0.150"
    assert html.parameter_in_words(Parameter("scale", "1", -1.0, 1.0, 0.6), -0.04, None) == "scale -0.0400"
