"""Parameters over flights as figures, and the health of parts: one row for each rotor and arm of a vehicle."""

import math
from itertools import pairwise
from typing import Any

import numpy as np

from wrenchgap.learn.identify.steps_and_drift import Verdict
from wrenchgap.learn.identify.trend import ParameterTrend, Trend
from wrenchgap.replay.present.figures import style
from wrenchgap.replay.present.numbers import label, number, quantity, signed
from wrenchgap.replay.present.tables import Table, table

QUANTITIES = {
    "rotor_thrust": ("thrust", 100.0, "%"),
    "drag_torque_by_rotor": ("drag torque", 100.0, "%"),
    "motor_lag_by_rotor": ("lag", 1e3, "ms"),
    "tilt_offset": ("zero", float(np.degrees(1.0)), "deg"),
    "servo_lag_by_arm": ("servo lag", 1e3, "ms"),
    "backlash_by_arm": ("play", float(np.degrees(1.0)), "deg"),
}
"""What a part has of each effect: its name, and what its values are multiplied with for its unit. Changes from the
model."""
SIGMAS = 2.0
"""Half-width of intervals and of the band of scatter, in standard deviations."""
LEGEND = (
    "changes from the model, of the flights since the last step (of a drift: the last flight), +- 2 standard errors   "
    ">: it stepped   ~: it drifts   ?: it differs between flights   -: these flights do not show it"
)


def parts_of(found: Trend) -> dict[str, dict[str, ParameterTrend]]:
    """Parameters by part, rotors first, and effect."""
    names = dict.fromkeys(p.name for p in found.parameters)
    order = sorted(names, key=lambda name: (name.startswith("arm"), int(name.rpartition("_")[2])))
    return {name: {p.effect: p for p in found.parameters if p.name == name} for name in order}


def health(found: Trend) -> Table:
    """One row for each rotor and arm: what it has now, with intervals, and whether it changed."""
    heads, rows = health_rows(found)
    return table(f"health of parts over {len(found.flights)} flights", heads, rows)


def health_rows(found: Trend) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Heads and rows of that table."""
    effects = [name for name in QUANTITIES if name in found.effects]
    heads = ("part", *(f"{QUANTITIES[name][0]} [{QUANTITIES[name][2]}]" for name in effects))
    rows = [
        (found.model.vehicle.called(part), *(_now(own.get(name)) for name in effects))
        for part, own in parts_of(found).items()
    ]
    return heads, rows


def latest(p: ParameterTrend) -> tuple[float, float]:
    """The present level of a parameter and its standard error: of the flights since its last step."""
    first = max((step.flight for step in p.course.steps), default=0)
    if p.course.verdict is Verdict.DRIFT:
        first = max(len(p.values) - 2, 0)
    last = p.values[first:]
    spread = max(p.course.scatter, float(np.sqrt(np.mean(p.errors[first:] ** 2))))
    level = float(p.course.level[-1]) if p.course.verdict is Verdict.DRIFT else float(last.mean())
    return level, spread / np.sqrt(len(last))


def _now(p: ParameterTrend | None) -> str:
    if p is None:
        return ""
    if p.course.verdict is Verdict.OPEN:
        return "-"
    _, factor, _ = QUANTITIES[p.effect]
    level, error = latest(p)
    mark = {Verdict.STEPS: "> ", Verdict.DRIFT: "~ ", Verdict.SCATTERED: "? "}.get(p.course.verdict, "")
    wide = SIGMAS * factor * error
    digits = max(0, 1 - math.floor(math.log10(max(wide, 1e-9)))) if wide < 10.0 else 0
    return f"{mark}{round(factor * level, digits) + 0.0:.{digits}f} +-{wide:.{digits}f}"  # + 0.0: no -0


def picture(found: Trend) -> style.Picture:
    """Parameters over the flights, flights from left to right, numbered from 1.

    Axes are (P, 1), one panel for each parameter that the flights show; of the health of parts (N, 3), a row for each
    rotor and arm.
    """
    if found.by_part:
        rows = len(parts_of(found))
        title = f"{found.model.name}: health of parts over {len(found.flights)} flights, changes from the model"
        size = (13.0, 1.15 * rows + 1.0)
        return style.Picture((rows, 3), size, lambda axes: _draw_parts(found, axes), title=title, share=True)
    shown = _shown(found)
    size = (max(8.0, min(16.0, 4.0 + 0.3 * len(found.flights))), 1.9 * len(shown) + (1.9 if _named(found) else 0.8))
    title = f"{found.model.name}: {', '.join(found.effects)} over {len(found.flights)} flights, each fitted by itself"
    return style.Picture((len(shown), 1), size, lambda axes: _draw(found, axes), title=title, share=True)


def _draw_parts(found: Trend, axes: Any) -> None:
    of_rotors, of_arms = list(QUANTITIES)[:3], list(QUANTITIES)[3:]
    for row, (part, own) in zip(axes, parts_of(found).items(), strict=True):
        for panel, name in zip(row, of_arms if part.startswith("arm") else of_rotors, strict=True):
            words, factor, unit = QUANTITIES[name]
            if name not in own or own[name].course.verdict is Verdict.OPEN:
                said = "not fitted" if name not in own else "not shown by these flights"
                panel.text(0.5, 0.5, said, ha="center", va="center", transform=panel.transAxes, color="0.5")
                panel.set_yticks([])
            else:
                _panel(panel, own[name], factor, unit)
            panel.set_ylabel(f"{found.model.vehicle.called(part)}\n{words} [{unit}]", fontsize=style.SMALL)
    dated = all(found.dates) and len(set(found.dates)) > 1
    for panel in axes[-1]:
        panel.set_xlabel("flight, by date" if dated else "flight, in the order given", fontsize=style.USUAL)
        panel.set_xlim(0.5, len(found.flights) + 0.5)
    if dated:
        count = len(found.flights)
        ends = np.unique(np.linspace(1, count, min(count, 3)).astype(int))
        for panel in axes[-1]:
            panel.set_xticks(ends, [found.dates[k - 1] for k in ends], fontsize=style.SMALL)
    style.grid(axes)


def _named(found: Trend, most: int = 40) -> bool:
    """Whether there is room for the names of the flights below the panels, else for their numbers."""
    return len(found.flights) <= most


def _shown(found: Trend) -> list[ParameterTrend]:
    shown = [p for p in found.parameters if p.course.verdict is not Verdict.OPEN]
    return shown or list(found.parameters)


def _draw(found: Trend, axes: Any) -> None:
    panels, shown = np.ravel(axes), _shown(found)
    for panel, p in zip(panels, shown, strict=True):
        _panel(panel, p)
        name = f"{p.effect}\n{label(p.name, found.model.vehicle)}"
        style.labelled(panel, name, "" if p.unit == "1" else p.unit)
    bottom, count = panels[-1], len(found.flights)
    if _named(found):
        names = [f"{k + 1} {style.shortened(name)}" for k, name in enumerate(found.names)]
        bottom.set_xticks(np.arange(1, count + 1), names, rotation=60, ha="right", fontsize=style.SMALL)
    bottom.set_xlabel("flight, in the order given", fontsize=style.USUAL)
    bottom.set_xlim(0.5, count + 0.5)
    style.grid(panels)
    style.legend(panels[0], *panels[1:])
    panels[0].get_figure(root=False).align_ylabels(list(panels))


def _panel(panel: Any, p: ParameterTrend, factor: float = 1.0, unit: str = "") -> None:
    """Values with intervals over the level with the scatter about it; every step a line with its size.

    Multiplied with `factor`, which gives them the `unit`.
    """
    flight = np.arange(1, len(p.values) + 1)
    ends = [0, *(step.flight for step in p.course.steps), len(flight)]
    for first, last in pairwise(ends):
        x = np.array([first + 0.5, last + 0.5])
        part = p.course.level[first:last]
        level = np.interp(x, flight[first:last], part)
        if p.course.verdict is Verdict.DRIFT and p.course.drift is not None:
            level = part[0] + p.course.drift.slope * (x - flight[first])
        level, half = factor * level, factor * SIGMAS * p.course.scatter
        words = ("level", f"± {SIGMAS:g} scatter") if first == 0 else ("", "")
        panel.fill_between(x, level - half, level + half, color=style.NOISE, alpha=0.25, lw=0, label=words[1] or None)
        panel.plot(x, level, color=style.NOISE, lw=1.6, label=words[0] or None)
    bars = {"fmt": "o", "ms": 4.0, "color": style.MEASURED, "ecolor": style.MEASURED, "elinewidth": 0.9, "capsize": 2.0}
    panel.errorbar(
        flight, factor * p.values, factor * SIGMAS * p.errors, label=f"one flight, ± {SIGMAS:g} standard errors", **bars
    )
    for step in p.course.steps:
        place = step.flight + 0.5
        panel.axvline(place, color=style.WARNING, lw=1.0, ls="--", label="step")
        size = style.written(step.size, p.unit) if p.unit in style.PREFIXED else quantity(step.size, p.unit, 2)
        size = f"{number(factor * step.size, 2)} {unit}" if unit else size
        look = {"fontsize": style.SMALL, "color": style.WARNING, "rotation": 90, "va": "top", "ha": "left"}
        panel.annotate(
            signed(step.size, size),
            (place, 1.0),
            (2, -2),
            ("data", "axes fraction"),
            textcoords="offset points",
            **look,
        )
