"""A learnt Gaussian process: prediction beside its alternatives, calibration, conditioning, cautions."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from wrenchgap.flight.flight import AXES
from wrenchgap.learn import Comparison, Learnt
from wrenchgap.learn.data.errors import reduction
from wrenchgap.learn.identify.absorption import Absorption
from wrenchgap.learn.process.alternatives import COMPARED, Alternative, Alternatives
from wrenchgap.learn.process.gp import Caution, CautionKind
from wrenchgap.learn.process.held_out_time import Coverage
from wrenchgap.replay.compensation import compensators as compensating
from wrenchgap.replay.present import comparison, verdicts
from wrenchgap.replay.present.addition import bars_by_axis
from wrenchgap.replay.present.figures import style
from wrenchgap.replay.present.notes import sentences
from wrenchgap.replay.present.numbers import UNIT_HEADS, entries, quantity, row, share, unmeasured
from wrenchgap.replay.present.tables import Line, Part, Table, note_lines, reductions, styled, table


def parts(learnt: Learnt) -> list[Part]:
    """The answer, errors beside the alternatives, standard deviations, calibration, conditioning."""
    gp = learnt.gp
    points = f"{len(gp.inputs)} of {learnt.samples} samples ({1e3 * learnt.spacing:.0f} ms apart)"
    out = [*brief(learnt), Line(f"{points} on top of {gp.provenance.physics}")]
    out += [_prediction(title, result) for title, result in list(_tested(learnt).items())[:-1]]
    sigmas = [(name, *row(pair)) for name, *pair in zip(gp.outputs, gp.sigma_prior, gp.sigma_training, strict=True)]
    heads = ("output", "far from the data", "99 % of the training samples below")
    out += [table("standard deviation of a prediction [N, Nm]", heads, sigmas), _calibration(learnt)]
    low, middle, high = learnt.real_min
    out.append(
        Line(
            f"conditioning: smallest eigenvalue of I + dmu/dW {low:.2f} (1st percentile), {middle:.2f} (median), "
            f"{high:.2f} (largest); 1 is no mismatch, 0 cannot be inverted"
        )
    )
    out.append(Line(verdicts.margin_in_words(learnt.margin)))
    out += [Line(words) for words in (verdicts.observer_in_words(gp), *verdicts.lags_in_words(gp)) if words]
    if learnt.alternatives is not None and learnt.alternatives.tried:
        out.append(_alternatives(learnt.alternatives, gp.outputs))
    return [*out, *note_lines(_notes(learnt))]


def _notes(learnt: Learnt) -> list[str]:
    return sentences(note for one in _tested(learnt).values() for note in one.notes)


def _prediction(title: str, result: Comparison) -> Table:
    """The paper's prediction table: mean and std of absolute errors, and the change of the mean."""
    name = f"{title}: {', '.join(result.flights)}, |measured - predicted|, {comparison.filtered(result)}"
    out = table(name, ("model", "", *UNIT_HEADS), left=2)
    for e in result.evaluations:
        out.add_row(styled(e.name, "bold"), "mean", *row(e.pooled.mean_abs))
        out.add_row("", "std", *row(e.pooled.std_abs), end_section=True)
    first, last = result.evaluations[0].pooled, result.evaluations[-1].pooled
    out.add_row("", "change of mean", *reductions(reduction(first.mean_abs, last.mean_abs)))
    return out


def _alternatives(found: Alternatives, outputs: Sequence[str]) -> Table:
    rows = []
    for k, one in enumerate(found.tried):
        inputs = ", ".join(("command", *one.settings.inputs))
        judged = "chosen" if one.settings == found.best else _why_not(one) if k else ""
        rows.append((inputs, one.settings.inference, *row(one.rms), share(one.gain) if k else "asked for", judged))
    heads = ("inputs", "inference", *outputs, "reduction", "")
    return table("rms on held-out time, with other inputs", heads, rows, left=2)


def _why_not(one: Alternative) -> str:
    """Why an alternative is not chosen."""
    if one.gain <= 0.0:
        return ""
    if one.gain <= COMPARED.worth_it:
        return f"less than {share(COMPARED.worth_it)}"
    return "another is better" if one.worth_it else "within chance"


def _calibration(learnt: Learnt) -> Table:
    rows = []
    for flights, (before, after) in learnt.coverage.items():
        for k, name in enumerate(learnt.gp.outputs):
            shares = (before.within_95[k], after.within_95[k], before.within_3_sigma[k], after.within_3_sigma[k])
            words = (f"{100 * s:.1f} %" if np.isfinite(s) else "-" for s in shares)
            rows.append((flights, name, f"{learnt.gp.sigma_scale[k]:.2f}", *words))
    heads = ("flights", "output", "sigma scaled by", "in 1.96 sigma, before", "after", "in 3 sigma, before", "after")
    return table("calibration: expected 95 % within 1.96 sigma, 99.7 % within 3", heads, rows, left=2)


def caution(found: Caution) -> str:
    """What a user should know before trusting the correction."""
    rows = zip(found.axes, found.before, found.after, strict=False)
    match found.kind:
        case CautionKind.NEARLY_SINGULAR:
            return (
                f"I + dmu/dW is nearly singular on the training flights (smallest eigenvalue {found.eigenvalue:.2f}): "
                "without acceleration the mismatch is minus the command, and the GP has learnt just that; train "
                "on a flight with excitation on all axes, or add effects first."
            )
        case CautionKind.ALLOCATED:
            return (
                "No commanded wrench is logged: it was made of the logged actuators by this model's places, c_f, kappa "
                "and centre of mass. The correction is right where the autopilot allocates with the same numbers, and "
                "harms elsewhere: log the commanded wrench, or compare these numbers with the autopilot's."
            )
        case CautionKind.WORSE:
            listed = ", ".join(f"{axis} (rms {before:.2g} to {after:.2g})" for axis, before, after in rows)
            return f"on unseen flights the GP increases the error: {listed}; leave these out with --outputs."
        case CautionKind.NOT_WORTH_IT:
            return (
                f"on unseen flights the GP has no advantage on {', '.join(found.axes)}: the model without it, a "
                "constant or a straight line does as well; prefer that."
            )
        case CautionKind.SAID:
            return found.text


def of_process(caveats: Sequence[compensating.ProcessCaveat]) -> tuple[str, ...]:
    """What a user must know before compensating with a process, one sentence each."""
    return tuple(map(_caveat, caveats))


def _caveat(found: compensating.ProcessCaveat) -> str:
    match found:
        case compensating.Refused(listed):
            return " ".join(verdicts.verdict(one) for one in listed)
        case compensating.LearnWarned(warning):
            return f"when this GP was learnt: {caution(warning)}"
        case compensating.OtherVersion(model, physics):
            return (
                f"the GP was learnt on another version of {model} ({physics}): the physics that is compensated is that "
                "of the model given here."
            )
        case compensating.LearntFromThisFlight(flight):
            return f"{flight}: the GP was learnt from this very flight: the result is optimistic; use an unseen one"


def absorption_in_words(found: Absorption) -> str:
    """What the GP absorbs and what to do about it, in one sentence; empty where it absorbs nothing that has a name."""
    first = found.first
    if first is None:
        return ""
    shares = {a.name: a.share for a in found.tried}
    rest = "and learning the residual"
    if len(found.effects) == 1:
        listed = ", ".join(f"{v.name} {quantity(v.value, v.unit)}" for v in first.values)
        values = f"; {listed}" if len(first.values) <= 3 else ""
        what = f"{first.name} ({share(first.share)} of its correction{values})"
        return f"the GP absorbs {what}: consider `wrenchgap add {first.name}` {rest}."
    alike = ", ".join(f"{name} ({share(shares[name])})" for name in found.effects)
    return (
        f"the GP absorbs one of {alike}: these reproduce its correction equally well; see `wrenchgap explain`, then "
        f"consider `wrenchgap add` {rest}."
    )


def better_inputs(learnt: Learnt) -> str:
    """What would be better, in one sentence; empty where nothing is, or where it was taken."""
    found = learnt.alternatives
    if found is None or found.better is None or found.better.settings == learnt.gp.settings:
        return ""
    asked, better = found.tried[0].settings, found.better
    options = [f"--inputs {','.join(better.settings.inputs)}"] if better.settings.inputs != asked.inputs else []
    if better.settings.inference != asked.inference:
        options.append(f"--inference {better.settings.inference}")
    return f"with {' '.join(options)} the error on held-out time would be {share(better.gain)} smaller."


def to_json(learnt: Learnt) -> dict[str, Any]:
    """The body of the `learn` schema."""
    gp, margin, found = learnt.gp, learnt.margin, learnt.alternatives
    low, middle, high = learnt.real_min
    of_alternative = ("inputs=settings.inputs", "inference=settings.inference", "rms", "gain", "significance=t")
    of_fit = ("outputs", "settings", "blind=settings.blind", "sigma_prior", "sigma_training", "sigma_scale")
    of_source = ("cutoff_hz=provenance.cutoff_hz", "physics=provenance.physics", "lags_s=provenance.lags")
    return {
        "axes": list(AXES),
        "unmeasured": unmeasured(learnt.training.noise),
        **entries(gp, *of_fit, *of_source),
        **entries(learnt, "samples", "spacing_s=spacing"),
        "points": len(gp.inputs),
        "coverage": {name: {"before": before, "after": after} for name, (before, after) in learnt.coverage.items()},
        "conditioning": {"percentile_1": low, "median": middle, "maximum": high},
        "stability_margin": {"percentile_1": min(margin.least, 1e6), "lag_s": margin.lag, "delay_s": margin.delay},
        "observer": verdicts.observer_json(gp),
        "verdicts": verdicts.verdicts_json(gp),
        "training": comparison.to_json(learnt.training),
        "validation": None if learnt.validation is None else comparison.to_json(learnt.validation),
        "warnings": [caution(c) for c in learnt.cautions],
        "alternatives": [{**entries(one, *of_alternative), "best": one.settings == found.best} for one in found.tried]
        if found
        else [],
        "absorbs": None if learnt.absorption is None else absorption_json(learnt.absorption),
        "notes": _notes(learnt),
    }


def absorption_json(found: Absorption) -> dict[str, Any]:
    """The key `absorbs` of the `learn` schema."""
    return {
        "effects": list(found.effects),
        "summary": absorption_in_words(found),
        "tried": [
            entries(a, "effect=name", "cosine", "share", "significance=t", "named", "parameters=values")
            for a in found.tried
        ],
    }


def brief(learnt: Learnt) -> list[Part]:
    """The verdicts, a margin below one, what would be better, warnings, and errors on the flights kept apart."""
    title, tested = list(_tested(learnt).items())[-1]
    advice = (better_inputs(learnt), "" if learnt.absorption is None else absorption_in_words(learnt.absorption))
    unsafe = [verdicts.margin_in_words(learnt.margin)] if learnt.margin.least < 1.0 else []
    lines = [
        *note_lines(unsafe, "warning"),
        *map(Line, filter(None, advice)),
        *note_lines(map(caution, learnt.cautions), "warning"),
    ]
    return [*verdicts.verdicts(learnt.gp), *lines, Line(), _prediction(title, tested)]


def of_axes(learnt: Learnt) -> dict[str, Any]:
    """Rms of the residual of every predictor on the training flights and on unseen ones, and the sensors' noise."""
    rms = {f"{name}, {e.name}": e.pooled.rms for name, one in _tested(learnt).items() for e in one.evaluations}
    return {**rms, "noise": learnt.training.noise}


def frame(learnt: Learnt) -> list[dict[str, Any]]:
    """One row for each predictor, flights (training, unseen) and axis: mean, std, rms and maximum of the error."""
    rows = []
    for flights, result in _tested(learnt).items():
        for e in result.evaluations:
            for k, axis in enumerate(AXES):
                errors = {name: float(np.asarray(values)[k]) for name, values in vars(e.pooled).items()}
                rows.append({"flights": flights, "model": e.name, "axis": axis, **errors})
    return rows


EXPECTED = ((95.0, "within_95", "o", "1.96 sigma"), (99.7, "within_3_sigma", "s", "3 sigma"))
"""Expected share [%], its name in `Coverage`, marker, and interval."""


def picture(learnt: Learnt) -> style.Picture:
    """One or two rows of three panels.

    Axes are (R, 3): a row for the training flights and, where there are some, one for unseen flights; forces, torques,
    and the share of samples within the predicted intervals, before and after calibration.
    """
    rows = len(_tested(learnt))
    title = f"Gaussian process of {len(learnt.gp.inputs)} points for {', '.join(learnt.gp.outputs)}, "
    title += f"on top of {learnt.gp.provenance.physics}"
    return style.Picture((rows, 3), (15.0, 3.6 * rows + 0.5), lambda axes: _draw(learnt, axes), title=title)


def _tested(learnt: Learnt) -> dict[str, Comparison]:
    both = {"training": learnt.training, "unseen": learnt.validation}
    return {name: one for name, one in both.items() if one is not None}


def _draw(learnt: Learnt, axes: Any) -> None:
    for panels, (name, compared) in zip(axes, _tested(learnt).items(), strict=True):
        colours = ("0.6", *style.MODELS)
        rows = [(e.name, colours[k % len(colours)], e.pooled.rms) for k, e in enumerate(compared.evaluations)]
        bars_by_axis(panels[:2], rows, compared.noise)
        flights = style.shortened(", ".join(compared.flights), 40)
        for panel, kind in zip(panels, ("force", "torque"), strict=False):
            if not any(output.startswith(kind) for output in learnt.gp.outputs):
                panel.set_xlabel("no output of this GP: as without it", fontsize=style.SMALL, color="0.4")
            style.labelled(panel, f"{name} ({flights})\n{kind} error, rms", "N" if kind == "force" else "Nm")
        _coverage_panel(panels[2], learnt, *learnt.coverage[name])


def _coverage_panel(panel: Any, learnt: Learnt, before: Coverage, after: Coverage) -> None:
    place = np.arange(len(learnt.gp.outputs))
    for (expected, name, marker, words), colour in zip(EXPECTED, (style.MODELS[0], style.MODELS[1]), strict=True):
        panel.axhline(expected, color=colour, lw=0.9, ls="--", label=f"{expected:g} % in {words}")
        for one, shift, fill in ((before, -0.12, "none"), (after, 0.12, colour)):
            panel.plot(place + shift, 100.0 * getattr(one, name), marker, ms=6, mec=colour, mfc=fill)
    for fill, words in (("none", "before calibration"), ("0.4", "after")):
        panel.plot([], [], "o", ms=6, mec="0.4", mfc=fill, label=words)
    lowest = min(float(getattr(one, name).min()) for one in (before, after) for _, name, _, _ in EXPECTED)
    panel.set_ylim(max(0.0, min(90.0, 100.0 * lowest - 3.0)), 101.0)
    panel.set_xlim(-0.6, len(place) - 0.4)
    style.labelled(panel, "measured within the interval", "%")
    panel.set_xticks(place, [name.replace("_", " ") for name in learnt.gp.outputs], fontsize=style.SMALL)
    style.grid(panel)
    style.legend(panel)
