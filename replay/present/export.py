"""An exported compensation: what is in it, and what a step costs."""

import math
from typing import Any

from wrenchgap.learn.identify.observer import OBSERVER
from wrenchgap.replay.export.c_lines import KINDS
from wrenchgap.replay.export.export import Export
from wrenchgap.replay.present.learning import of_process
from wrenchgap.replay.present.numbers import entries, share
from wrenchgap.replay.present.tables import Line, Part, note_lines, table

HEADS = {
    "add": "+ -",
    "multiply": "x",
    "divide": "/",
    "sqrt": "sqrt",
    "exp": "exp, log",
    "trig": "sin, cos, atan2",
    "other": "comparisons",
}


def parts(made: Export) -> list[Part]:
    """Contents, operations, memory."""
    cost = made.cost
    inputs = ", ".join(("command", *made.inputs))
    process = [f"process of {made.points} points on {inputs}"] if made.has_process else []
    effects = [f"effects {', '.join(made.effects)}"] if made.effects else []
    observer = []
    if (judged := made.judged) is not None:
        told = f", told a lag of {1e3 * judged.observer.lag:.0f} ms" if judged.observer.lag else ""
        observer = [f"observer of {judged.observer.hz:.2g} Hz{told} (M_s {judged.peak:.2f})"]
    contents = [*process, *effects, "gate" if made.has_process else "no gate", "search", *observer]
    out: list[Part] = [
        Line(f"{made.model.vehicle.name}: corrects {made.corrected}, every {made.dt:g} s in {made.precision}"),
        Line(f"in it: {'; '.join(contents)}"),
    ]
    rows = [
        ("usual", *(str(cost.usual[k]) for k in KINDS), f"{cost.evaluations_usual:.1f}"),
        ("at worst", *(str(cost.at_worst[k]) for k in KINDS), str(cost.evaluations_worst)),
    ]
    out.append(table("operations of one step", ("", *(HEADS[k] for k in KINDS), "evaluations"), rows))
    sizes = {"constants (read-only)": cost.tables, "state (wg_memory)": cost.memory, "stack, at most": cost.stack}
    out.append(table("memory", ("", "bytes"), sizes.items()))
    if made.solved < 1.0:
        text = (
            f"the search solves {share(made.solved)} of the steps recorded for the self-test, which ends before the "
            "first that it does not solve: the mismatch cannot be inverted there"
        )
        out += note_lines([text], "warning")
    left = [f"{name} is not in it: {why}" for name, why in made.left_out.items()]
    return [*out, *note_lines([*of_process(made.caveats), *_too_fast(made), *left], "warning")]


def to_json(made: Export) -> dict[str, Any]:
    """See docs/json.md."""
    names = ("outputs", "effects", "corrected", "left_out", "precision", "dt", "points", "further_inputs=inputs")
    return {
        **entries(made, "vehicle=model.vehicle.name", *names, "solved"),
        "observer": _observer(made),
        "files": sorted(made.files),
        "warnings": [*of_process(made.caveats), *_too_fast(made)],
        "operations": entries(made.cost, "usual", "at_worst"),
        "evaluations": entries(made.cost, "usual=evaluations_usual", "at_worst=evaluations_worst"),
        "bytes": entries(made.cost, "constants=tables", "state=memory", "stack"),
    }


def _observer(made: Export) -> dict[str, Any] | None:
    judged = made.judged
    if judged is None:
        return None
    return {
        "hz": made.observer_hz,
        "lag_s": judged.observer.lag,
        "torque_max_nm": list(made.observer_max),
        "sensitivity_peak": judged.peak if math.isfinite(judged.peak) else None,
        "loop": {"lag_s": judged.loop.lag, "delay_s": judged.loop.delay},
    }


def _too_fast(made: Export) -> list[str]:
    """Where the attitude loop with the observer is not as far from instability as it should be."""
    judged = made.judged
    if judged is None or judged.peak <= OBSERVER.most_sensitive:
        return []
    what = f"has a peak of the sensitivity of {judged.peak:.1f}" if math.isfinite(judged.peak) else "is unstable"
    return [
        f"the attitude loop with an observer of {judged.observer.hz:.2g} Hz, behind a lag of "
        f"{1e3 * judged.loop.lag:.0f} ms, {what}, more than {OBSERVER.most_sensitive:g}: it rings; choose a "
        "lower --observer"
    ]


def frame(made: Export) -> Any:
    """Operations of a step, one row each for the usual step and the worst."""
    import pandas as pd  # here: others need not wait for it

    return pd.DataFrame([made.cost.usual, made.cost.at_worst], index=["usual", "at worst"])
