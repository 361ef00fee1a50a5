"""Predictions without correction: how far off each model is at each horizon."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from wrenchgap.replay.prediction import LIMIT, NAIVE, QUANTITIES, OpenLoop, PredictionErrors
from wrenchgap.replay.present.figures import style
from wrenchgap.replay.present.notes import sentences
from wrenchgap.replay.present.numbers import number, share, size_in_words
from wrenchgap.replay.present.tables import Line, Part, Table, first_only, note_lines, table

WORDS = {"rate": "body rates"}
"""What a quantity is called in a sentence, where it is not its name."""
SHOWN = {"attitude": (180.0 / np.pi, "deg")}
"""What is said in another unit than the result has."""
LEGEND = "mean and rms of the length of the error"
WITHIN = (
    f"within: share of predictions that are off by no more than {LIMIT:.0%} should be, by what the model leaves on "
    "these flights and the standard deviations of its values"
)


def parts(found: OpenLoop) -> list[Part]:
    """The answer, the errors, and notes."""
    return [*brief(found), Line(f"{LEGEND}   {WITHIN}", "dim"), *note_lines(sentences(found.notes))]


def brief(found: OpenLoop) -> list[Part]:
    """How far off the last model is at the middle horizon, beside no model, and the errors."""
    return [*(Line(text, "bold") for text in summary(found)), Line(), errors(found)]


def summary(found: OpenLoop) -> list[str]:
    """Two sentences: the errors of the last model, and of what it is worse than no model."""
    at, naive, last = len(found.horizons) // 2, found.models[0], found.models[-1]
    said, plain = (", ".join(_sizes(one, at)) for one in (last, naive))
    out = [
        f"{found.horizons[at]:g} s ahead, with the logged commands alone, {last.name} is off by {said} on average; "
        f"{NAIVE} by {plain}."
    ]
    worse = [WORDS.get(q, q) for k, q in enumerate(QUANTITIES) if last.mae[at, k] > naive.mae[at, k]]
    if worse:
        first = "That" if len(worse) == len(QUANTITIES) else f"For {', '.join(worse)} that"
        out.append(
            f"{first} is worse than {NAIVE}, which is hard to beat while a controller holds the vehicle: here none "
            "answers, and what the model lacks or has wrong adds up. `wrenchgap explain` looks for it."
        )
    return out


def _sizes(one: PredictionErrors, at: int) -> list[str]:
    return [size_in_words(float(one.mae[at, k]), unit) for k, unit in enumerate(QUANTITIES.values())]


def _shown(quantity: str) -> tuple[float, str]:
    """Factor and unit in which a quantity is printed."""
    return SHOWN.get(quantity, (1.0, QUANTITIES[quantity]))


def errors(found: OpenLoop) -> Table:
    """Three rows for each horizon and model: mean, rms, and the share within what is expected."""
    heads = [f"{WORDS.get(q, q)} [{_shown(q)[1]}]" for q in QUANTITIES]
    factors = np.array([_shown(q)[0] for q in QUANTITIES])
    title = f"errors of {found.starts:,} predictions of {flights_in_words(found.flights)}"
    out = table(title, ("ahead", "model", "", *heads), left=3)
    for at, horizon in enumerate(found.horizons):
        for first, one in zip(first_only(f"{horizon:g} s" for _ in found.models), found.models, strict=True):
            ends = one is found.models[-1]
            rows = [("mean", [number(x) for x in factors * one.mae[at]])]
            rows += [("rms", [number(x) for x in factors * one.rmse[at]])]
            rows += [] if one.within is None else [("within", [share(x) for x in one.within[at]])]
            for k, (name, texts) in enumerate(rows):
                own = (first, one.name) if k == 0 else ("", "")
                out.add_row(*own, name, *texts, end_section=ends and k == len(rows) - 1)
    return out


def flights_in_words(names: Sequence[str]) -> str:
    """The one flight by its name, or how many there are."""
    return names[0] if len(names) == 1 else f"{len(names)} flights"


def to_json(found: OpenLoop) -> dict[str, Any]:
    """The body of the `predict` schema."""
    return {
        "summary": summary(found),
        "flights": list(found.flights),
        "starts": found.starts,
        "horizons_s": found.horizons,
        "quantities": [{"name": name, "unit": unit} for name, unit in QUANTITIES.items()],
        "models": [vars(one) for one in found.models],
        "notes": sentences(found.notes),
    }


def frame(found: OpenLoop) -> list[dict[str, Any]]:
    """One row for each model, horizon and quantity."""
    return [
        {
            "model": one.name,
            "horizon_s": float(horizon),
            "quantity": name,
            "unit": unit,
            **{
                key: None if (v := getattr(one, key)) is None else float(v[at, k])
                for key in ("mae", "rmse", "limit", "within")
            },
        }
        for one in found.models
        for at, horizon in enumerate(found.horizons)
        for k, (name, unit) in enumerate(QUANTITIES.items())
    ]


def picture(found: OpenLoop) -> style.Picture:
    """Axes (1, 4): the rms of each quantity over the horizon, a line for each model."""
    title = f"{flights_in_words(found.flights)}: rms of predictions without correction"
    return style.Picture((1, len(QUANTITIES)), (14.0, 3.6), lambda axes: _draw(found, axes), title=title)


def _draw(found: OpenLoop, axes: Any) -> None:
    for k, (panel, name) in enumerate(zip(np.ravel(axes), QUANTITIES, strict=True)):
        factor, unit = _shown(name)
        for index, one in enumerate(found.models):
            colour = style.NOISE if index == 0 else f"C{index - 1}"
            panel.plot(found.horizons, factor * one.rmse[:, k], "o-", ms=4.0, color=colour, label=one.name)
        style.labelled(panel, WORDS.get(name, name), unit)
        style.labelled(panel, "ahead", "s", "x")
        panel.set_ylim(bottom=0.0)
    style.grid(axes)
    style.legend(*np.ravel(axes)[:1])
