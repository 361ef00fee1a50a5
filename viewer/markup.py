"""HTML for the panels, from `templates/`: what comes from outside is escaped there; sizes fit a control panel."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, FileSystemLoader

from wrenchgap._escaping import html_templates
from wrenchgap.flight.flight import AXES, Array
from wrenchgap.viewer.analysis import Candidate, Value
from wrenchgap.viewer.sliders import finer

TEMPLATES = Path(__file__).parent / "templates"
HEAT = ((255, 255, 255), (255, 233, 190), (250, 160, 90), (214, 60, 50), (110, 10, 40))
"""Colours from nothing to the most, evenly spaced."""
COLD = ((255, 255, 255), (205, 226, 243), (120, 175, 220), (50, 110, 180), (15, 45, 110))
"""The same for what is negative."""


def render(template: str, **values: Any) -> str:
    """HTML of a template of `templates/`; a value that it lacks is an error."""
    return _environment().get_template(f"{template}.html").render(**values)


def sentences(*lines: str, look: str = "") -> str:
    """Sentences as HTML; the page shows no Markdown, where viser takes HTML in a name for its own."""
    return render("sentences", lines=lines, look=look)


def style() -> str:
    """The style sheet of all of them, as HTML."""
    return f"<style>{(TEMPLATES / 'page.css').read_text(encoding='utf-8')}</style>"


def banner(warnings: Sequence[str]) -> str:
    """What checks said of a flight, to stand over the page; nothing where they said nothing."""
    return render("banner", warnings=list(warnings)) if warnings else ""


@cache
def _environment() -> Environment:
    made = html_templates(FileSystemLoader(TEMPLATES))
    filters = (number, percent, norms, by_axis, value_text, about)
    made.filters.update({function.__name__: function for function in filters})
    return made


def heat(share: float) -> tuple[str, str]:
    """Background and letters (CSS colours) for 0 (nothing) to 1 (the most), or to -1."""
    scale = HEAT if share >= 0.0 else COLD
    at = min(abs(float(share)), 1.0) * (len(scale) - 1)
    k = min(int(at), len(scale) - 2)
    low, high = np.array(scale[k]), np.array(scale[k + 1])
    red, green, blue = (int(c) for c in np.round(low + (at - k) * (high - low)))
    dark = 0.3 * red + 0.6 * green + 0.1 * blue < 150
    return f"rgb({red},{green},{blue})", "#fff" if dark else "#222"


def number(value: float, digits: int = 3) -> str:
    """So many significant digits, without an exponent where a reader expects none."""
    if not np.isfinite(value):
        return "-"
    if value == 0.0:
        return "0"
    decimals = digits - 1 - int(np.floor(np.log10(abs(value))))
    return f"{value:.{decimals}f}" if 0 <= decimals <= 6 else f"{value:.{digits}g}"


def percent(share: float) -> str:
    """A share in per cent; one decimal where it is small."""
    return f"{100 * share:.0f}\u00a0%" if abs(share) >= 0.095 or share == 0 else f"{100 * share:.1f}\u00a0%"


def norms(rms: Array) -> tuple[float, float]:
    """Of the force [N] and of the torque [Nm], over the axes that were measured; nan where none was."""
    force, torque = (part[np.isfinite(part)] for part in (rms[:3], rms[3:]))
    return tuple(float(np.linalg.norm(part)) if part.size else np.nan for part in (force, torque))  # type: ignore[return-value]


def by_axis(rms: Array) -> str:
    """The rms of every axis in words."""
    return ", ".join(f"{axis} {number(value)}" for axis, value in zip(AXES, rms, strict=True))


def value_text(value: Value) -> str:
    """A parameter with its standard deviation, in the unit of its slider."""
    unit, factor = finer(value)
    spread = "" if value.std is None else f" +- {number(factor * value.std, 2)}"
    return f"{value.name} {number(factor * value.value)}{spread} {'' if unit == '1' else unit}".rstrip()


def about(candidate: Candidate) -> str:
    """Values of a candidate, and by how much it changes the rms of every axis."""
    falls = ", ".join(f"{axis} {-100 * f:+.0f} %" for axis, f in zip(AXES, candidate.falls, strict=True))
    return f"{candidate.values}; {candidate.mark + '; ' if candidate.mark else ''}rms: {falls}"
