"""Offsets between the topics of a flight: sentences, a table, JSON, and what to do about them."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from wrenchgap.flight.offsets import Offset, Problem
from wrenchgap.learn.diagnose import timing as diagnosed
from wrenchgap.learn.diagnose.timing import FlightTiming
from wrenchgap.replay.present.numbers import by_reason, entries, number, signed
from wrenchgap.replay.present.tables import Line, Part, Table, note_lines, table

TWO_CLOCKS = "two clocks; record both with one"
LEGEND = (
    "delay: positive where the signal is later than its reference   form: of a late response   consequence: error of "
    "effects that are driven by the odometry; error that a model without the lag leaves"
)
PROBLEMS = {
    Problem.STILL: "{about} never changes",
    Problem.SLOW: "too slow a topic ({about})",
    Problem.SHORT: "less than {about} that both have without a gap",
    Problem.UNRELATED: "no significant coherence: too little motion, or too much noise",
    Problem.UNMATCHED: "the two do not match at any offset",
    Problem.AMBIGUOUS: "the motion repeats itself: several offsets match equally well",
    Problem.NARROW: "too narrow a band in common ({about})",
    Problem.UNCLEAR: "the command may follow the motion: gains fit a delay or a lag at some frequencies only",
    Problem.VAGUE: "no better than {about}: too little motion in common",
    Problem.FEEDBACK: "feedback-dominated: the command follows the motion; actuator dynamics are not identifiable here",
}
OF_RESPONSES = (diagnosed.LateResponse, diagnosed.FeedbackDominated)
PARTS = ("halves", "axes", "bands")
FORMS = {"delay": "a delay", "lag": "a lag", "either": "a lag or a delay", None: "a lag or a delay"}


def parts(found: FlightTiming) -> list[Part]:
    """Table, what cannot be estimated, warnings."""
    if not found.offsets:
        return []
    lines = [*note_lines(problems(found), "cannot be estimated"), *note_lines(warnings(found), "warning")]
    return [offsets_table(found), Line(LEGEND, "dim"), *lines]


def offsets_table(found: FlightTiming) -> Table:
    """All offsets, one a row; what cannot be estimated is listed by `problems`."""
    heads = ("signal", "reference", "delay [ms]", "drift [ms/min]", "band [Hz]", "form", "consequence")
    out = table(f"timing of {found.flight}", heads, left=2)
    errors = dict(zip(map(id, found.sensors), found.effect_error, strict=True))
    forms = {id(r.offset): r for r in found.responses}
    for o in found.offsets:
        if o.seconds is None:
            continue
        error, response, matters = errors.get(id(o)), forms.get(id(o)), "-"
        if error is not None:
            matters = f"{100 * error:.1f} %"
        elif response is not None and response.leaves is not None and response.noise:
            matters = f"{response.leaves / response.noise:.0f} x noise"
        delay, drift = "same series" if o.same else milliseconds(o), "-"
        if o.drift is not None and not o.same:
            drift = f"{_per_minute(o.drift)} +- {_per_minute(o.drift_std, sign=False)}"
        band, form = f"{o.lowest_hz:.1f}-{o.highest_hz:.1f}", "-" if response is None else response.shape or "-"
        out.add_row(o.second, o.first, delay, drift, band, form, matters, style="" if o.certain else "dim")
    return out


def sentences(found: FlightTiming) -> list[str]:
    """Every offset in words."""
    return [sentence(o) for o in found.offsets]


def sentence(offset: Offset) -> str:
    """One offset in words, e.g. "odometry attitude lags gyroscope by 12.3 +- 0.4 ms"."""
    if offset.seconds is None:
        return f"{offset.second} against {offset.first}: cannot be estimated: {problem(offset)}"
    if offset.same:
        return f"{offset.second} and {offset.first} are the same series"
    if not offset.certain:
        return f"{offset.second} and {offset.first} are aligned: {milliseconds(offset)} ms"
    verb = "lags" if offset.seconds > 0 else "leads"
    return f"{offset.second} {verb} {offset.first} by {milliseconds(offset, absolute=True)} ms"


def certain_offsets(found: FlightTiming) -> list[str]:
    """Offsets between the sensor topics, a line each where they are certain: what to look at before any physics."""
    return [f"timing, {found.flight}: {sentence(o)}" for o in found.sensors if o.certain]


def problem(offset: Offset) -> str:
    """Why there is no number."""
    return "" if offset.problem is None else PROBLEMS[offset.problem].format(about=offset.about)


def problems(found: FlightTiming) -> list[str]:
    """What cannot be estimated, by reason."""
    axes = {id(r.offset): r.axis for r in found.responses}
    reasons = by_reason(
        (problem(o), f"response on {axes[id(o)]}" if id(o) in axes else f"{o.second} against {o.first}")
        for o in found.offsets
        if o.problem is not None
    )
    return [f"{', '.join(names)}: {reason}" for reason, names in reasons.items()]


def warnings(found: FlightTiming) -> list[str]:
    """What a user should act on, each with what to do."""
    return [_warning(w) for w in found.warnings]


def in_short(flights: Sequence[FlightTiming], *, of_topics: bool = False) -> list[str]:
    """Warnings of all flights in one sentence: the first of them, and how many more there are.

    `of_topics` leaves out what is said of the response to commands, of which `explain` has the effects.
    """
    told = [w for one in flights for w in one.warnings]
    said = [_warning(w) for w in told if not (of_topics and isinstance(w, OF_RESPONSES))]
    return [f"{said[0]}{f' ({len(said) - 1} more: --details)' if len(said) > 1 else ''}"] if said else []


def _warning(warning: diagnosed.TimingWarning) -> str:
    match warning:
        case diagnosed.OdometryOffset(seconds, error):
            return (
                f"The odometry {'lags' if seconds > 0 else 'leads'} the IMU by {1e3 * abs(seconds):.1f} ms: effects "
                f"that are driven by speed or attitude come out up to {100 * error:.0f} % wrong. Read it with "
                f"--shift odometry={-seconds:.4f}."
            )
        case diagnosed.UnevenOffset(offsets):
            listed = ", ".join(f"{o.second} {1e3 * (o.seconds or 0.0):+.1f} ms" for o in offsets)
            return f"The delay differs between its signals ({listed}): an estimator's filter rather than a clock."
        case diagnosed.LateGyroscope(seconds, std):
            return (
                f"The gyroscope is {1e3 * seconds:.1f} +- {1e3 * std:.1f} ms later than the accelerometer, by "
                "the odometry: a low-pass or a clock of its own. Torques come late, and part of every lag and delay "
                "that is fitted is the gyroscope's: log both sensors with one filter."
            )
        case diagnosed.Drift(o, one_clock):
            why = "one clock stamps both, so a delay changes: an estimator's, or a link's" if one_clock else TWO_CLOCKS
            return (
                f"{o.second} against {o.first}: the offset moves by {_per_minute(o.drift)} +- "
                f"{_per_minute(o.drift_std, sign=False)} ms/min: {why}."
            )
        case diagnosed.LateResponse(responses):
            listed = ", ".join(f"{r.axis} {milliseconds(r.offset)} ms ({FORMS[r.shape]})" for r in responses)
            return (
                f"Commands take effect late: {listed}. Not removed: it may be servo_lag, motor_lag, command_delay or "
                "the clocks of commands and IMU, and `explain` ranks the first three."
            )
        case diagnosed.FeedbackDominated(axes):
            return (
                f"On {', '.join(axes)} the flight is feedback-dominated: actuator dynamics are not identifiable there, "
                "and a lag that is fitted would be the controller's own phase. To identify them, log actuator speeds "
                "and tilts, or add a known signal to the commanded wrench on these axes."
            )


def milliseconds(offset: Offset, absolute: bool = False) -> str:
    """Value and standard deviation in ms, both with the digits that the latter allows."""
    assert offset.seconds is not None
    assert offset.std is not None
    digits = int(np.clip(np.ceil(-np.log10(max(1e3 * offset.std, 1e-3)) + 0.3), 0, 2))
    value = abs(offset.seconds) if absolute else offset.seconds
    return f"{1e3 * value:.{digits}f} +- {1e3 * max(offset.std, 0.5e-3 * 10.0**-digits):.{digits}f}"


def _per_minute(slope: float | None, sign: bool = True) -> str:
    value = 6e4 * (slope or 0.0)
    return signed(value, number(value, 2)) if sign else number(value, 2)


def to_json(found: FlightTiming) -> dict[str, Any]:
    """Plain; seconds."""
    rows = zip(found.sensors, found.effect_error, strict=True)
    return {
        "sensors": [{**_offset_json(o), "effect_error": e} for o, e in rows],
        "tracking": [_offset_json(o) for o in found.tracking],
        "controller": None if found.controller is None else _offset_json(found.controller),
        "responses": [
            {**_offset_json(r.offset), **entries(r, "axis", "shape", "lag", "leaves", "residual", "noise", "matters")}
            for r in found.responses
        ],
        "warnings": warnings(found),
        "words": sentences(found),
    }


def _offset_json(offset: Offset) -> dict[str, Any]:
    numbers = ("first", "second", "seconds", "std", "drift", "drift_std", "coherence", "lowest_hz", "highest_hz")
    named = {key: [entries(p, "name", "seconds", "std") for p in getattr(offset, key)] for key in PARTS}
    own = entries(offset, *numbers, "interval_95=interval")
    return {**own, **named, "blocks": offset.blocks, "problem": problem(offset) or None}
