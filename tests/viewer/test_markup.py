"""HTML of the panels: nothing from outside becomes markup, colours grow darker, numbers read well."""

import re
from types import SimpleNamespace

import numpy as np
import pytest
from jinja2 import UndefinedError

from wrenchgap.viewer import markup


def brightness(colour):
    """Mean of the channels of an rgb(...)."""
    return np.mean([int(v) for v in re.findall(r"\d+", colour)])


def test_text_is_safe_in_html_and_in_attributes():
    made = markup.render("table", heading='<b onclick="x">&', head=(), rows=(), sentences=(), look="")
    assert "&lt;b onclick=&#34;x&#34;&gt;&amp;" in made


def test_a_template_that_is_given_too_little_is_an_error():
    with pytest.raises(UndefinedError):
        markup.render("table", heading="")


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_heat_grows_darker_and_letters_stay_readable(sign):
    shades = [markup.heat(sign * share) for share in np.linspace(0.0, 1.0, 30)]
    levels = np.array([brightness(back) for back, _ in shades])
    assert levels[0] == 255
    assert np.all(np.diff(levels) < 0.0)
    for back, front in shades:
        letters = 255.0 if front == "#fff" else 34.0
        assert abs(brightness(back) - letters) > 80.0


def test_heat_has_two_signs_and_ends():
    assert markup.heat(0.5)[0] != markup.heat(-0.5)[0]
    assert markup.heat(7.0) == markup.heat(1.0)
    assert markup.heat(-7.0) == markup.heat(-1.0)


def test_bars_are_as_wide_as_their_parts():
    parts = [(0.25, "#111", "a"), (0.0, "#222", "b"), (0.5, "#333", "c")]
    row = SimpleNamespace(view="all", physics=1.0, rms=1.0, unit="N")
    made = markup.render("budget", legend=[], rows=[(row, parts, 0.5)])
    assert [float(w) for w in re.findall(r"width:([\d.]+)%;background", made)] == [25.0, 50.0]  # those that are there


NUMBERS = {2.6519: "2.65", 0.04301: "0.0430", 0.0: "0", 123.4: "123", 12345.0: "1.23e+04", 4e-9: "4e-09", np.nan: "-"}


@pytest.mark.parametrize(("value", "said"), NUMBERS.items())
def test_numbers_have_three_digits_and_what_is_unknown_is_a_dash(value, said):
    assert markup.number(value) == said
