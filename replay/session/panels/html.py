"""HTML of the panels that show results: templates take the results, filters are the words of `replay.present`."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jinja2 import Environment

from wrenchgap.flight.flight import AXES, Array
from wrenchgap.learn.data.errors import force_and_torque
from wrenchgap.plant.effects.effect import Parameter
from wrenchgap.plant.vehicle import Vehicle
from wrenchgap.plant.wrench_model import ModelEffect
from wrenchgap.replay.present.addition import verdict
from wrenchgap.replay.present.comparison import stretch_in_words
from wrenchgap.replay.present.notes import not_tried
from wrenchgap.replay.present.numbers import change, number, parameters_in_words, share, user_name
from wrenchgap.replay.present.staircase import heading, label
from wrenchgap.replay.present.where import depends_on
from wrenchgap.viewer import markup

if TYPE_CHECKING:
    from wrenchgap.learn.posterior.single_effects import Candidate

HEAT = ((255, 255, 255), (255, 233, 190), (250, 160, 90), (214, 60, 50), (110, 10, 40))
"""Colours from nothing to the most, evenly spaced."""
COLD = ((255, 255, 255), (205, 226, 243), (120, 175, 220), (50, 110, 180), (15, 45, 110))
"""The same for what is negative."""


FINER: dict[str, tuple[str, float]] = {
    "m": ("mm", 1e3),
    "s": ("ms", 1e3),
    "kg": ("g", 1e3),
    "rad": ("deg", float(np.degrees(1.0))),
    "Nm": ("mNm", 1e3),
    "N": ("mN", 1e3),
    "kg m^2": ("g m^2", 1e3),
    "N s^2/(m rad)": ("uN s^2/(m rad)", 1e6),
}


def render(template: str, **values: Any) -> str:
    """HTML of a template of `templates/`; a value that it lacks is an error."""
    return _environment().get_template(f"{template}.html").render(**values)


@cache
def _environment() -> Environment:
    made = markup.environment(Path(__file__).parent / "templates")
    numbers = (number, percent, by_axis, force_and_torque, values_of, candidate_title)
    words = (source, verdict, heading, label, not_tried, depends_on, stretch_in_words)
    made.filters.update({function.__name__: function for function in numbers + words})
    return made


def percent(value: float) -> str:
    """A share in per cent that stays on one line."""
    return share(value).replace(" ", "\u00a0")


def heat(share: float) -> tuple[str, str]:
    """Background and letters (CSS colours) for 0 (nothing) to 1 (the most), or to -1."""
    scale = HEAT if share >= 0.0 else COLD
    stops = np.linspace(0.0, 1.0, len(scale))
    red, green, blue = (round(float(np.interp(abs(share), stops, part))) for part in zip(*scale, strict=True))
    dark = 0.3 * red + 0.6 * green + 0.1 * blue < 150
    return f"rgb({red},{green},{blue})", "#fff" if dark else "#222"


def finer(parameter: Parameter) -> tuple[str, float]:
    """The unit in which a parameter is shown, and the factor from SI to it; finer for angles and small sizes."""
    if parameter.unit == "rad" or parameter.scale < 0.5:
        return FINER.get(parameter.unit, (parameter.unit, 1.0))
    return parameter.unit, 1.0


def parameter_in_words(parameter: Parameter, value: float, std: float | None, vehicle: Vehicle | None = None) -> str:
    """A parameter with its standard deviation, in the unit of its slider; that of a rotor with the rotor's name."""
    unit, factor = finer(parameter)
    spread = "" if std is None else f" +- {number(factor * std, 2)}"
    return (
        f"{user_name(parameter.name, vehicle)} {number(factor * value)}{spread} {'' if unit == '1' else unit}".rstrip()
    )


def values_of(effect: ModelEffect, vehicle: Vehicle) -> list[str]:
    """Its parameters, each in words."""
    parameters = effect.effect.parameters(vehicle)
    std = [None] * len(parameters) if effect.std is None else effect.std
    return [parameter_in_words(*row, vehicle) for row in zip(parameters, effect.theta, std, strict=True)]


def source(effect: ModelEffect) -> str:
    """Where the values of an effect come from, in a few words."""
    logs = [file for file, _ in effect.provenance.logs]
    return f"fitted on {', '.join(logs)}" if logs else effect.provenance.method or "as given"


def by_axis(rms: Array) -> str:
    """The rms of every axis in words."""
    return ", ".join(f"{axis} {number(value)}" for axis, value in zip(AXES, rms, strict=True))


def candidate_title(candidate: Candidate, mark: str, vehicle: Vehicle) -> str:
    """Values of a candidate, and by how much it changes the rms of every axis."""
    changes = ", ".join(f"{axis} {change(-f)}" for axis, f in zip(AXES, candidate.reduction, strict=True))
    return f"{parameters_in_words(candidate.values, vehicle)}; {mark + '; ' if mark else ''}rms: {changes}"
