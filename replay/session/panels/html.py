"""HTML of the panels that show results, from `templates/`: colours of cells, and numbers as `present` writes them."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment

from wrenchgap.plant.effects.effect import Parameter
from wrenchgap.replay.present.numbers import number, share
from wrenchgap.replay.session.panels.sliders import finer
from wrenchgap.viewer import markup

HEAT = ((255, 255, 255), (255, 233, 190), (250, 160, 90), (214, 60, 50), (110, 10, 40))
"""Colours from nothing to the most, evenly spaced."""
COLD = ((255, 255, 255), (205, 226, 243), (120, 175, 220), (50, 110, 180), (15, 45, 110))
"""The same for what is negative."""


def render(template: str, **values: Any) -> str:
    """HTML of a template of `templates/`; a value that it lacks is an error."""
    return _environment().get_template(f"{template}.html").render(**values)


@cache
def _environment() -> Environment:
    made = markup.environment(Path(__file__).parent / "templates")
    made.filters.update(number=number, percent=percent)
    return made


def percent(value: float) -> str:
    """A share in per cent that stays on one line."""
    return share(value).replace(" ", "\u00a0")


def heat(share: float) -> tuple[str, str]:
    """Background and letters (CSS colours) for 0 (nothing) to 1 (the most), or to -1."""
    scale = HEAT if share >= 0.0 else COLD
    at = min(abs(float(share)), 1.0) * (len(scale) - 1)
    k = min(int(at), len(scale) - 2)
    low, high = np.array(scale[k]), np.array(scale[k + 1])
    red, green, blue = (int(c) for c in np.round(low + (at - k) * (high - low)))
    dark = 0.3 * red + 0.6 * green + 0.1 * blue < 150
    return f"rgb({red},{green},{blue})", "#fff" if dark else "#222"


def parameter_in_words(parameter: Parameter, value: float, std: float | None) -> str:
    """A parameter with its standard deviation, in the unit of its slider."""
    unit, factor = finer(parameter)
    spread = "" if std is None else f" +- {number(factor * std, 2)}"
    return f"{parameter.name} {number(factor * value)}{spread} {'' if unit == '1' else unit}".rstrip()
