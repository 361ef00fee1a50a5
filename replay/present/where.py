"""Where a model fails: sentences, tables, JSON."""

from typing import Any

import numpy as np

from wrenchgap.flight.flight import AXES, Array
from wrenchgap.learn.data.errors import length
from wrenchgap.learn.diagnose.failure_map import Dependence, FailureMap
from wrenchgap.learn.diagnose.relevance import Relevance
from wrenchgap.learn.diagnose.where import PARTS, Budget, Source, Where
from wrenchgap.learn.diagnose.whiteness import WHITENESS, Autocorrelation, CrossCorrelation, Whiteness
from wrenchgap.replay.present import numbers
from wrenchgap.replay.present.comparison import worst
from wrenchgap.replay.present.figures import style
from wrenchgap.replay.present.figures import where as panels
from wrenchgap.replay.present.notes import sentences, too_short
from wrenchgap.replay.present.numbers import by_axis, entries, row, share
from wrenchgap.replay.present.tables import Line, Part, Table, note_lines, table


def parts(result: Where) -> list[Part]:
    """Summary, budget, the quantities that the error depends on most, worst stretches, whiteness, relevant inputs."""
    out = brief(result)
    out += [_map(d) for d in main_dependences(result.failure_map)]
    out += [quantities(result), worst(result.name, result.worst), whiteness(result), relevance(result)]
    out += [Line(f"not mapped: {name}: {why}", "dim") for name, why in result.failure_map.lacking.items()]
    return [*out, *note_lines(sentences(result.notes))]


def summary(where: Where) -> tuple[str, ...]:
    """The result in a few sentences, most important first."""
    shares = where.budget.whole()
    process = {
        Source.FITTED: "a Gaussian process of the commands, constant errors included, would explain",
        Source.GIVEN: "the GP explains",
    }
    listed = [f"{share(shares['noise'])} is sensor noise"]
    if shares["physics"] != 0.0:
        listed.append(f"the effects of {where.name.removesuffix('+GP')} explain {share(shares['physics'])}")
    if where.budget.source is not Source.NONE:
        listed.append(f"{process[where.budget.source]} {share(shares['process'])}")
    listed.append(f"{share(shares['unexplained'])} stays unexplained")
    first = f"Of the nominal model's error energy {', '.join(listed)}."
    coloured = [a.axis for a in where.whiteness.autocorrelation if not a.white]
    named = "any axis" if len(coloured) == len(AXES) else ", ".join(coloured)
    every = "all axes" if len(where.whiteness.autocorrelation) == len(AXES) else "all measured axes"
    last = f"The residual is not white on {named}: there is structure left to explain."
    if not coloured:
        last = f"The residual is as white as filtered sensor noise on {every}."
    return first, depends_on(where.failure_map), _relevant(where.relevance), last


def main_dependences(mapped: FailureMap, least: float = 0.05) -> list[Dependence]:
    """The three quantities on which the error depends most, each for a share of it of `least` or more."""
    return [d for d in mapped.significant if d.score >= least][:3]


def depends_on(mapped: FailureMap) -> str:
    """On which quantities the error depends most, in a sentence."""
    found = main_dependences(mapped)
    if not found:
        return "The error has no significant dependence on any of the quantities."
    return f"The error depends on: {'; '.join(f'{d.label} ({dependence_in_words(d)})' for d in found)}."


def dependence_in_words(dependence: Dependence) -> str:
    """In what way, and on which axes, the error depends on a quantity."""
    if dependence.of_mean < dependence.of_size:
        return f"{share(dependence.of_size)} of its size"
    return f"{share(dependence.of_mean)} of its mean{_on_axes(', mostly', dependence.axes_mean)}"


def _on_axes(words: str, shares: Array, least: float = 0.2) -> str:
    """Axes with more than `least` of something, the largest first and three at most, behind `words`."""
    axes = [AXES[k] for k in np.argsort(-shares)[:3] if shares[k] > least]
    return f"{words} {', '.join(axes)}" if axes else ""


def _relevant(relevant: Relevance) -> str:
    """What each group of inputs explains, and on which axes it is missed."""
    if not relevant.chosen:
        return "No input predicts the residual on held-out time."
    listed = ", then ".join(
        f"{g.label} ({share(g.alone)} alone, {share(g.lost)} lost without{_on_axes(', on', g.lost_axes)})"
        for g in relevant.chosen
    )
    changes = "of the residual's changes about its mean"
    return f"On held-out time {share(relevant.explained)} {changes} are predicted by {listed}."


def _autocorrelation(auto: Autocorrelation) -> str:
    """Whether one axis is white, and at which lag it is least."""
    if auto.white:
        return "as white as filtered noise"
    k = int(np.argmin(np.abs(auto.lags - auto.worst)))
    return f"not white: {auto.value[k]:+.2f} at {auto.worst:.2f} s, noise {auto.expected[k]:+.2f} +- {auto.band[k]:.2f}"


def _crosscorrelation(cross: CrossCorrelation | None) -> str:
    """What one axis follows most, and how late."""
    if cross is None:
        return "no input that varies enough"
    if not cross.outside or abs(cross.peak) < WHITENESS.worth:
        return "no significant correlation with an input"
    late = "at once" if cross.lag == 0 else f"{abs(cross.lag):.2f} s {'after' if cross.lag > 0 else 'before'}"
    return f"{cross.peak:+.2f} with {cross.input} {late} (significant above {cross.band:.2f})"


def span(name: str, low: float, high: float) -> str:
    """A bin in words, with digits enough that its ends differ."""
    if not np.isfinite(low):
        return "level" if name == "direction" else "elsewhere"
    if name == "direction":
        return numbers.direction(0.5 * (low + high))
    digits = 3
    while digits < 6 and abs(high - low) < 0.02 * max(abs(low), abs(high)) * 10.0 ** (3 - digits):
        digits += 1
    return f"{low:.{digits}g} to {high:.{digits}g}"


def budget_table(budget: Budget) -> Table:
    """Root mean square of the nominal error, and its parts in per cent."""
    out = table("error budget: parts of the nominal model's mean square error", ("", *numbers.UNIT_HEADS, "whole"))
    out.add_row("nominal rms", *row(np.sqrt(budget.nominal)), "", end_section=True)
    names = {"physics": "effects", "process": f"Gaussian process ({budget.source})", "noise": "sensor noise"}
    shares, whole = budget.shares(), budget.whole()
    for part in PARTS:
        if part != "physics" or budget.has_physics:
            out.add_row(names.get(part, part), *map(share, [*shares[part], whole[part]]))
    return out


def _map(dependence: Dependence) -> Table:
    """The bins of one quantity: how long, how large the error, and the share of it that sits there."""
    b = dependence.binned
    heads = ("", "time", "F rms [N]", "noise", "M rms [Nm]", "noise", "error", "share of all error above the noise")
    longest = max(float(b.whole_share.max()), 1e-9)
    rows = []
    for i in range(len(b)):
        sizes = [float(length(v[i, part])) for part in (slice(0, 3), slice(3, 6)) for v in (b.rms, b.noise)]
        bar = "#" * round(24 * float(b.whole_share[i]) / longest)
        words = span(dependence.name, float(b.low[i]), float(b.high[i]))
        rows.append((words, share(b.time_share[i]), *row(sizes), share(b.whole_share[i]), bar))
    return table(f"{dependence.label} [{dependence.unit}]: {panels.explains(dependence)}", heads, rows, texts=(-1,))


def quantities(result: Where) -> Table:
    """One row for each quantity: the share of the error that depends on it."""
    rows = [
        (
            *(d.label, share(d.of_mean), share(d.of_size), f"{d.p:.3f}", "yes" if d.significant else "no"),
            *map(share, d.axes_mean),
        )
        for d in result.failure_map.dependences
    ]
    heads = ("quantity", "of mean", "of size", "p", "significant", *numbers.AXIS_HEADS)
    return table("share of the error that depends on each quantity, in excess of chance", heads, rows)


def whiteness(result: Where) -> Table:
    """Of each axis: its name, autocorrelation, and strongest correlation with an input."""
    white = result.whiteness
    known = {a.axis: (_autocorrelation(a), _crosscorrelation(white.strongest(a.axis))) for a in white.autocorrelation}
    heads = ("axis", "autocorrelation", "strongest correlation with an input")
    rows = [(axis, *known.get(axis, ("-", "-"))) for axis in AXES]
    return table("whiteness of the residual", heads, rows, left=3)


def relevance(result: Where) -> Table:
    """One row for each group of inputs: what it predicts of the residual."""
    relevant = result.relevance
    rows = [
        (g.step or "", g.label, share(g.alone), share(g.lost), f"{g.significance:.1f}", *map(share, g.alone_axes))
        for g in relevant.groups
    ]
    heads = ("step", "inputs", "alone", "lost without", "t", *numbers.AXIS_HEADS)
    title = f"inputs that predict the residual on held-out time (chosen: {share(relevant.explained)} of it)"
    return table(title, heads, rows, left=2)


def to_json(where: Where) -> dict[str, Any]:
    """The body of the `where` schema."""
    of_quantity = ("quantity=name", "label", "unit", "of_mean", "of_size", "axes_mean", "p", "significant", "axes")
    return {
        "axes": list(AXES),
        **entries(where, "model=name", "flights", "seconds", "samples", "cutoff_hz", "rms", "noise"),
        "unmeasured": numbers.unmeasured(where.noise),
        "budget": {
            "mean_square": entries(where.budget, "nominal", *PARTS),
            "whole_shares": where.budget.whole(),
            "process_source": str(where.budget.source),
        },
        "failure_map": {
            "quantities": [entries(d, *of_quantity, "bins=binned") for d in where.failure_map.dependences],
            "grid": where.failure_map.grid,
            "lacking": numbers.reasons_json("quantity", where.failure_map.lacking),
        },
        "whiteness": _whiteness_json(where.whiteness),
        "relevance": relevance_json(where.relevance),
        "worst": where.worst,
        "summary": list(summary(where)),
        "notes": sentences(where.notes),
    }


def _whiteness_json(white: Whiteness) -> dict[str, Any]:
    strongest = [c for axis in AXES if (c := white.strongest(axis)) is not None]
    peaks = [{**vars(c), "outside": c.outside} for c in white.crosscorrelation]
    return {
        "autocorrelation": [{**vars(a), "white": a.white} for a in white.autocorrelation],
        "strongest": [{**vars(c), "outside": c.outside} for c in strongest],
        "peaks": [{k: v for k, v in peak.items() if k not in ("lags", "value")} for peak in peaks],
    }


def relevance_json(relevant: Relevance) -> dict[str, Any]:
    """Groups of inputs by name."""
    return {
        "groups": [{**vars(g), "chosen": g.chosen} for g in relevant.groups],
        **entries(relevant, "explained", "explained_axes"),
        "lacking": numbers.reasons_json("input", relevant.lacking),
    }


def brief(result: Where) -> list[Part]:
    """The summary and the error budget."""
    said = [Line(text, "bold") for text in summary(result)]
    return [*said, *note_lines(too_short(result.seconds), "warning"), Line(), budget_table(result.budget)]


def of_axes(where: Where) -> dict[str, Array]:
    """Residual and sensors, and the parts of the nominal error."""
    shares = {f"share of {part}": values for part, values in where.budget.shares().items()}
    return {**entries(where, "rms", "noise"), **shares}


def frame(where: Where) -> list[dict[str, Any]]:
    """One row for each bin of each quantity: low, high, time, rms and noise by axis, share of the error."""
    rows = []
    for d in where.failure_map.dependences:
        b, own = d.binned, entries(d, "quantity=name", "unit", "significant")
        for i in range(len(b)):
            bounds = {"low": b.low[i], "high": b.high[i], "time_share": b.time_share[i], "share": b.whole_share[i]}
            rows.append({**own, **bounds, **by_axis("rms", b.rms[i]), **by_axis("noise", b.noise[i])})
    return rows


def picture(where: Where) -> style.Picture:
    """Error budget, map over two quantities, failure maps and correlations with their bands, on one page.

    Axes are (3 + Q + 12,) in this order: the budget, the map over two quantities for force and torque, one for each of
    the Q quantities (`panels.shown`), autocorrelations of the six axes, and their correlations with the
    strongest input.
    """
    count = len(panels.shown(where))
    rows = max(1, -(-count // 4))

    def split(figure: Any) -> Any:
        heights = (3.6, 2.9 * rows, 5.4)
        top, middle, bottom = figure.subfigures(3, 1, height_ratios=heights)
        left, right = top.subfigures(1, 2, width_ratios=[1.0, 1.15])
        maps = middle.subplots(rows, 4, squeeze=False).ravel()
        for spare in maps[count:]:
            spare.set_axis_off()
        parts = ([left.subplots()], right.subplots(1, 2), maps[:count], bottom.subplots(2, 6, squeeze=False).ravel())
        return np.concatenate([np.asarray(part, dtype=object) for part in parts])

    def draw(axes: Any) -> None:
        panels.draw_budget(axes[0], where)
        panels.draw_grid(axes[1:3], where)
        panels.draw_maps(axes[3 : 3 + count], where)
        panels.draw_correlations(axes[3 + count :].reshape(2, 6), where)

    title = f"where {where.name} fails: {', '.join(where.flights)}"
    return style.Picture((15 + count,), (15.0, 9.0 + 2.9 * rows), draw, title=title, split=split)
