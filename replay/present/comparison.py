"""A comparison of models on flights: tables, JSON, samples."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from wrenchgap.flight.flight import AXES, Array
from wrenchgap.learn.data.comparison import Comparison, Stretch, Validation
from wrenchgap.learn.data.errors import force_and_torque
from wrenchgap.replay.prediction import OpenLoop
from wrenchgap.replay.present import prediction
from wrenchgap.replay.present.figures import style
from wrenchgap.replay.present.notes import sentences
from wrenchgap.replay.present.numbers import UNIT_HEADS, by_axis, number, row, share, size_in_words, unmeasured
from wrenchgap.replay.present.prediction import flights_in_words
from wrenchgap.replay.present.tables import Line, Part, Table, note_lines, reductions, styled, table


def parts(result: Comparison, *, signed: bool = False) -> list[Part]:
    """The answer, errors, by flight where there are several or `signed` asks for means, and where the last is worst."""
    last, out = result.evaluations[-1], brief(result)
    if signed or len(result.flights) > 1:
        out.append(by_flight(result, signed=signed))
    out.append(worst(last.name, last.worst))
    if isinstance(result.ahead, OpenLoop):
        out += [prediction.errors(result.ahead), Line(prediction.LEGEND, "dim")]
    return [*out, *note_lines(sentences(result.notes))]


def brief(result: Comparison) -> list[Part]:
    """What the last model leaves, beside the weight, the sensors and the first model, and the errors by axis."""
    first, last = result.evaluations[0], result.evaluations[-1]
    (force, torque), noise = force_and_torque(last.pooled.rms), force_and_torque(result.noise)
    said = f"On {flights_in_words(result.flights)} the force error of {last.name} is {share(force / result.weight)} of "
    across = float(np.sqrt(np.nansum(last.pooled.rms[3:5] ** 2)))  # about z the weight has no arm
    said += "the weight, its torque error about x and y that of a centre of mass "
    said += f"{size_in_words(across / result.weight, 'm')} off."
    sizes = f"{number(force)} N and {number(torque)} Nm rms (sensors: {number(noise[0])} N, {number(noise[1])} Nm)"
    than = ""
    if last is not first:
        falls = reductions(1.0 - np.array([force, torque]) / force_and_torque(first.pooled.rms))
        than = f", {falls[0]} and {falls[1]} against {first.name}"
    out = [Line(said, "bold"), Line(f"It leaves {sizes}{than}.")]
    if last.worst:
        one = last.worst[0]
        out.append(Line(f"Worst in {one.flight} at {one.start:.1f} s: {stretch_in_words(one)}."))
    if isinstance(result.ahead, OpenLoop):
        out += [Line(text) for text in prediction.summary(result.ahead)]
    return [*out, Line(), errors(result)]


def errors(comparison: Comparison) -> Table:
    """Errors by model and axis, and the noise floor."""
    title = f"|measured - predicted| on {flights_in_words(comparison.flights)}, {filtered(comparison)}"
    out = table(title, ("model", "", *UNIT_HEADS), left=2)
    for index, one in enumerate(comparison.evaluations):
        e = one.pooled
        out.add_row(styled(one.name, "bold"), "mean", *row(e.mean_abs))
        out.add_row("", "std", *row(e.std_abs))
        out.add_row("", "rms", *row(e.rms))
        out.add_row("", "max", *row(e.max_abs), end_section=index == 0)
        if index:
            out.add_row("", "change of rms", *reductions(comparison.reduction(one)), end_section=True)
    out.add_row(styled("sensor noise", "dim"), "rms", *row(comparison.noise))
    return out


def filtered(comparison: Comparison) -> str:
    """Behind which filter the errors are: both sides, the same."""
    return f"both filtered at {comparison.records[0].cutoff_hz:g} Hz"


def by_flight(comparison: Comparison, *, signed: bool) -> Table:
    """Root mean square by flight; `signed`: with the mean of the residual above it, and the sensors' noise below."""
    title = (
        "measured - predicted by flight: signed mean, and rms" if signed else "rms of |measured - predicted| by flight"
    )
    heads = ("flight", "model", "") if signed else ("flight", "model")
    out = table(title, (*heads, *UNIT_HEADS), left=len(heads))
    for index, flight in enumerate(comparison.flights):
        for one in comparison.evaluations:
            own = one.by_flight[index]
            names: tuple[str, ...] = ("" if one is not comparison.evaluations[0] else flight, one.name)
            if signed:
                means = [text if text.startswith(("-", "0")) else f"+{text}" for text in row(own.mean)]
                out.add_row(*names, "mean", *means)
                names = ("", "", "rms")
            out.add_row(*names, *row(own.rms), end_section=one is comparison.evaluations[-1])
    if signed:
        out.add_row(styled("sensor noise", "dim"), "", "rms", *row(comparison.noise))
    return out


def worst(name: str, stretches: Sequence[Stretch]) -> Table:
    """The worst stretches of one model."""
    rows = []
    for s in stretches:
        state = [number(v if v is None else round(v, 3), 2) for v in (s.tilt_deg, s.force, s.rate, s.speed)]
        rows.append((s.flight, f"{s.start:.1f} - {s.stop:.1f}", s.axis, *row(force_and_torque(s.rms)), *state))
    heads = ("flight", "time [s]", "largest on", "F rms [N]", "M rms [Nm]", "tilt [deg]", "|F| [N]")
    return table(f"where {name} is worst", (*heads, "|omega| [rad/s]", "speed [m/s]"), rows, left=3)


def stretch_in_words(stretch: Stretch) -> str:
    """On which axis the error is largest in a stretch, and what the vehicle was doing there."""
    known = (("tilt {:.0f} deg", stretch.tilt_deg), ("{:.2f} rad/s", stretch.rate), ("{:.2f} m/s", stretch.speed))
    return ", ".join([stretch.axis.replace("_", " "), *(form.format(v) for form, v in known if v is not None)])


def to_json(result: Comparison) -> dict[str, Any]:
    """The body of the `compare` schema."""
    return {
        "axes": list(AXES),
        "flights": list(result.flights),
        "models": [
            {
                "name": e.name,
                **vars(e.pooled),
                "fall_of_rms": result.reduction(e),
                "per_flight": [{"flight": f, **vars(own)} for f, own in zip(result.flights, e.by_flight, strict=True)],
                "worst": e.worst,
            }
            for e in result.evaluations
        ],
        "by_flight": [
            {"flight": flight, "model": e.name, "mean": e.by_flight[k].mean, "rms": e.by_flight[k].rms}
            for k, flight in enumerate(result.flights)
            for e in result.evaluations
        ],
        "noise": result.noise,
        "unmeasured": unmeasured(result.noise),
        "samples": sum(len(r) for r in result.records),
        "cutoff_hz": result.records[0].cutoff_hz,
        "ahead": prediction.to_json(result.ahead) if isinstance(result.ahead, OpenLoop) else None,
        "notes": sentences(result.notes),
    }


def of_axes(result: Comparison) -> dict[str, Array]:
    """Rms of the residual of every model, and the sensors' noise."""
    return {**{e.name: e.pooled.rms for e in result.evaluations}, "noise": result.noise}


def frame(result: Comparison) -> Any:
    """One row for each compared sample: flight, time, then `commanded.force_x`, `measured...`, `<model>...`."""
    import pandas as pd  # here: others need not wait for it

    found = []
    for index, record in enumerate(result.records):
        wrenches = {"commanded": record.commanded, "measured": record.measured}
        wrenches |= {e.name: e.predictions[index] for e in result.evaluations}
        columns = {key: column for name, v in wrenches.items() for key, column in by_axis(name, v).items()}
        found.append(pd.DataFrame({"flight": record.flight, "time": record.time, **columns}))
    return pd.concat(found, ignore_index=True)


def picture(result: Comparison) -> style.Picture:
    """Six pairs of panels with one legend, a model in one colour in both; bars where there are several flights.

    Axes are (6, 2) for one flight, (7, 2) for several: forces on the left, torques on the right; rows in
    turn wrench and residual of x, y, z. The last row, where there are several flights, is the rms by flight.
    """
    rows = 6 + (len(result.flights) > 1)
    title = f"{flights_in_words(result.flights)}: wrench measured, commanded and predicted, and residual by model; "
    title += f"filtered at {result.records[0].cutoff_hz:g} Hz"
    size, split = (14.0, 2.0 * rows), lambda figure: _split(figure, rows)
    return style.Picture((rows, 2), size, lambda axes: _draw(result, axes), title=title, split=split)


def _split(figure: Any, rows: int) -> Any:
    """Axes (rows, 2), the first six of each column with one time axis."""
    cells = figure.add_gridspec(rows, 2, height_ratios=([1.6, 1.1] * 3 + [1.6])[:rows])
    axes: Any = np.empty((rows, 2), dtype=object)
    for k, column in np.ndindex(rows, 2):
        axes[k, column] = figure.add_subplot(cells[k, column], sharex=axes[0, column] if 0 < k < 6 else None)
        axes[k, column].tick_params(labelbottom=k >= 5)
    return axes


def _draw(result: Comparison, axes: Any) -> None:
    pieces, shaded = _pieces(result), False
    for axis in range(6):
        wrench, residual = axes[2 * (axis % 3) : 2 * (axis % 3) + 2, axis // 3]
        shaded |= _wrenches(wrench, result, pieces, axis) | _residuals(residual, result, pieces, axis)
        name, unit = style.QUANTITIES[axis]
        for panel, label in ((wrench, name), (residual, "residual")):
            style.labelled(panel, label, unit)
            _flights(panel, result, pieces, named=axis % 3 == 0 and panel is wrench)
            panel.margins(x=0.005)
    for column, panel in enumerate(axes[5]):
        several = len(result.flights) > 1
        style.labelled(panel, "time, flight after flight" if several else "time", "s", "x")
        if shaded:
            panel.set_xlabel(f"{panel.get_xlabel()}; shaded: from the smallest to the largest value")
        style.legend(*axes[:6, column], above=several)
    for panel, part in zip(axes[6:].ravel(), (0, 1), strict=False):
        _bars(panel, result, part)
    style.grid(axes)
    axes[0, 0].get_figure(root=False).align_ylabels(list(axes.ravel()))


Pieces = list[tuple[Array, float]]
"""Of each record the time [s] at which it is drawn, and the part of the panel's width that it takes."""


def _pieces(result: Comparison, pause: float = 0.015) -> Pieces:
    """Flights follow one another, with a `pause` between them as a share of their time."""
    times = {name: [r.time for r in result.records if r.flight == name] for name in result.flights}
    spans = {name: (float(min(t[0] for t in own)), float(max(t[-1] for t in own))) for name, own in times.items()}
    whole = sum(stop - start for start, stop in spans.values())
    shift, end = {}, 0.0
    for index, (name, (start, stop)) in enumerate(spans.items()):
        shift[name] = 0.0 if index == 0 else end + pause * whole - start
        end = stop + shift[name]
    return [(r.time + shift[r.flight], float(r.time[-1] - r.time[0]) / max(whole, 1e-9)) for r in result.records]


def _wrenches(panel: Any, result: Comparison, pieces: Pieces, axis: int, sigmas: float = 2.0) -> bool:
    """Commanded, measured, and what every model predicts; the first is left out where it is the command.

    The prediction of a process has a band of +- `sigmas` standard deviations.
    """
    hidden = {result.evaluations[0].name} if _is_command(result) else set()
    last, shaded = result.evaluations[-1], False
    for index, (record, (time, part)) in enumerate(zip(result.records, pieces, strict=True)):
        drawn = [(record.commanded, style.COMMANDED, "commanded", 1.2)]
        drawn.append((record.measured, style.MEASURED, "measured", 1.7))
        for place, e in enumerate(result.evaluations):
            if e.name not in hidden:
                drawn.append((e.predictions[index], _colour(place), e.name, 0.9))
        for values, colour, name, width in drawn:
            if np.isnan(values[:, axis]).all():
                continue
            shaded |= style.curve(panel, time, values[:, axis], colour, "" if index else name, width, share=part)
        if last.sigma is not None and np.isfinite(last.sigma[index][:, axis]).any():
            centre, half = last.predictions[index][:, axis], sigmas * last.sigma[index][:, axis]
            words = None if index else f"± {sigmas:g} sigma of {last.name}"
            look = {"color": drawn[-1][1], "alpha": 0.15, "lw": 0, "zorder": 1}
            panel.fill_between(time, centre - half, centre + half, **look, label=words)
    return shaded


def _residuals(panel: Any, result: Comparison, pieces: Pieces, axis: int, sigmas: float = 2.0) -> bool:
    """Measured minus predicted of every model, the last on top, and `sigmas` of the sensors' noise as a band."""
    shaded = False
    for index, (record, (time, part)) in enumerate(zip(result.records, pieces, strict=True)):
        if not record.measured_axes[axis]:
            panel.text(0.01, 0.5, "not measured", fontsize=style.SMALL, color="0.35", transform=panel.transAxes)
            continue
        for place, e in enumerate(result.evaluations):
            residual = record.measured[:, axis] - e.predictions[index][:, axis]
            shaded |= style.curve(panel, time, residual, _colour(place), "" if index else e.name, share=part)
        words = "" if index else f"± {sigmas:g} sigma of the sensor noise"
        style.band(panel, [float(time[0]), float(time[-1])], sigmas * float(record.noise[axis]), words)
    return shaded


def _colour(place: int) -> str:
    """Of a model by its place; the first is the one that all others are compared with."""
    return "0.45" if place == 0 else style.MODELS[(place - 1) % len(style.MODELS)]


def _is_command(result: Comparison, same: float = 0.01) -> bool:
    """Whether the first model predicts the command: force and torque each within this share of its own size."""
    pairs = [
        (predicted[:, part], record.commanded[:, part])
        for record, predicted in zip(result.records, result.evaluations[0].predictions, strict=True)
        for part in (slice(0, 3), slice(3, 6))
    ]
    return all(np.max(np.abs(a - b)) <= same * np.max(np.abs(b)) for a, b in pairs)


def _flights(panel: Any, result: Comparison, pieces: Pieces, *, named: bool) -> None:
    """Where one flight ends and the next begins; above them the names, or where these are too long the numbers."""
    if len(result.flights) == 1:
        return
    flown = [r.flight for r in result.records]
    times = [[time for name, (time, _) in zip(flown, pieces, strict=True) if name == one] for one in result.flights]
    begins, ends = [min(t[0] for t in own) for own in times], [max(t[-1] for t in own) for own in times]
    for end, begin in zip(ends, begins[1:], strict=False):
        panel.axvline(0.5 * (end + begin), color="0.4", lw=0.8, ls="--")
    width = panel.get_position().width * panel.get_figure(root=True).get_size_inches()[0] * 72.0
    letters = width / (ends[-1] - begins[0]) / (0.6 * style.SMALL) * (np.array(ends) - begins)
    long = np.any([len(name) for name in result.flights] > letters)
    for k, begin in enumerate(begins if named else ()):
        place = {"xycoords": ("data", "axes fraction"), "va": "bottom", "fontsize": style.SMALL}
        panel.annotate(str(k + 1) if long else result.flights[k], (begin, 1.01), **place)


def _bars(panel: Any, result: Comparison, part: int) -> None:
    """Root mean square residual by flight, over the three axes of force (part 0) or torque (1), and the noise floor."""
    rows = [
        (e.name, _colour(k), [float(force_and_torque(own.rms)[part]) for own in e.by_flight])
        for k, e in enumerate(result.evaluations)
    ]
    style.bars(panel, rows, [_noise(result, flight)[part] for flight in result.flights])
    panel.set_ylim(0.0, None)
    names = [f"{k + 1}: {style.shortened(name, 24)}" for k, name in enumerate(result.flights)]
    turned = {"rotation": 20, "ha": "right"} if sum(map(len, names)) > 70 else {}
    panel.set_xticks(range(len(names)), names, fontsize=style.SMALL, **turned)
    kind, unit = (("force", "N"), ("torque", "Nm"))[part]
    style.labelled(panel, f"rms of the {kind}\nresidual, 3 axes", unit)
    style.legend(panel)


def _noise(result: Comparison, flight: str) -> Array:
    """Sensor noise (2,) of force and torque in one flight, mean over its records."""
    own = [r for r in result.records if r.flight == flight]
    squares = np.average([r.noise**2 for r in own], axis=0, weights=[len(r) for r in own])
    return force_and_torque(np.sqrt(squares))


def validation_warnings(tested: Validation) -> list[str]:
    """One sentence for axes that got worse, and for each quantity that left the fitted range."""
    out = []
    if tested.worse:
        before, after = tested.comparison.evaluations[-2].pooled.rms, tested.after
        rows = [(a, AXES.index(a)) for a in tested.worse]
        listed = ", ".join(f"{a} ({before[k]:.2g} to {after[k]:.2g})" for a, k in rows)
        out.append(f"on the unseen flights the error of {listed} grows with the named effects.")
    return out + [
        f"{flight} lies outside what was fitted: {r.quantity} {r.percentile:.3g} {r.unit} (fitted up to "
        f"{r.maximum:.3g}); the result may not carry over."
        for flight, r in tested.outside
    ]
