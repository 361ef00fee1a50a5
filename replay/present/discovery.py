"""What hides behind "not in the catalogue": the law, how sure it is, what is like it, and what to do with it."""

import shlex
from typing import Any

import numpy as np

from wrenchgap.flight.flight import AXES
from wrenchgap.learn.discover.discover import Discovery, Outcome
from wrenchgap.learn.discover.residual import Law
from wrenchgap.replay.present.figures import style
from wrenchgap.replay.present.numbers import entries, listed, number, quantity, share
from wrenchgap.replay.present.tables import Line, Part, Table, table

UNITS = {"speed": "m/s", "rate": "rad/s", "height": "m", "thrust": "N", "time": "s", "voltage_excess": ""}
WORDS = {"rate": "body rate", "voltage_excess": "(V/V0)^2 - 1"}
LEGEND = (
    "chance: share of residuals that have nothing to do with the flights in which as much was found; found again: in "
    "so many halves of the time; left: rms on time that the law was not fitted to"
)


def parts(found: Discovery) -> list[Part]:
    """The answer; the laws' coefficients; what is left by axis."""
    if found.outcome is Outcome.NOTHING and not found.tried:
        return brief(found)
    return [*brief(found), Line(), *([_laws(found)] if found.laws else []), _axes(found), Line(LEGEND, "dim")]


def brief(found: Discovery) -> list[Part]:
    """The answer in a few sentences."""
    first, *others = summary(found)
    return [Line(first, "bold"), *map(Line, others)]


def summary(found: Discovery) -> list[str]:
    """What is said, the answer first."""
    named = ", ".join(found.explanation.effects) or "no effect"
    if found.outcome is Outcome.NOTHING and not found.tried:
        return [f"Nothing is left for a law: with {named} what remains is noise, or too little to look at."]
    if not found.laws:
        return _without(found, named)
    out = [f"{'A law' if len(found.laws) == 1 else 'Laws'} beside {named}: {'; '.join(map(written, found.laws))}."]
    subject = "It takes" if len(found.laws) == 1 else "They take"
    out.append(
        f"{subject} off {share(found.energy_reduction)} of the energy above the sensors' noise on {found.held_out}."
    )
    for law in found.laws:
        out += said_of(law)
    return out


def _without(found: Discovery, named: str) -> list[str]:
    out = [f"No law: this log carries none for what {named} leave{'s' if len(found.explanation.effects) < 2 else ''}."]
    if found.depends:
        out.append(
            f"What is left depends on {' and '.join(found.depends)}: regressions on that take off "
            f"{share(found.regression_reduction)} of it on held-out time."
        )
    out.append(f"{found.tried} laws were tried; chance finds as much in more than one residual of twenty.")
    if found.rejected:
        out[-1] = (
            f"{found.tried} laws were tried. Found and not held, as they were not found again, differed between parts "
            f"of the flights, or left most of it: {'; '.join(found.rejected)}."
        )
    return out


def written(law: Law) -> str:
    """A law with its numbers."""
    several = len(law.coefficients) > 1
    each = (f"{number(c.value)} +- {number(c.std, 2)} {c.unit}".removesuffix(" 1") for c in law.coefficients)
    values = ", ".join(f"k{j if several else ''} = {value}" for j, value in enumerate(each, 1))
    return f"{law.formula}, {values}"


def said_of(law: Law) -> list[str]:
    """Chance, aliases, the nearest effect, energy, range."""
    causes = f" It depends on {' and '.join(law.causes)}." if law.causes else ""
    out = [f"{law.name}: chance finds as much in {share(law.p_value)} of residuals at most.{causes}"]
    if set(law.causes) == {"time"}:
        out.append(
            "A sensor that drifts, as an accelerometer's bias does while it warms up, grows with time too: calibrate "
            "it warm and fly again, before this is taken for a force."
        )
    if law.equivalents:
        others = listed([formula for _, formula in law.equivalents], 3, "; ")
        out.append(f"These flights cannot tell it from {others}.")
    if law.nearest is not None and law.nearest[1] > 0.3:
        name, cosine = law.nearest
        out.append(f"Nearest in the catalogue: {name}, which predicts {share(cosine**2)} of it.")
    if np.isfinite(law.mean_power):
        size = quantity(abs(law.mean_power), "W", 2)
        feeds = f"feeds {size} into the motion" if law.mean_power > 0.0 else f"takes {size} out of the motion"
        out.append(f"On average it {'does no work' if 0.4 < law.feeding_share < 0.6 else feeds}.")
    seen = [f"{WORDS.get(n, n)} {number(a, 2)} to {quantity(b, UNITS[n], 2)}" for n, a, b in law.flown_ranges]
    if seen:
        out.append(f"It was seen at {', '.join(seen)}; beyond that its quantities are held, not extrapolated.")
    return out


def what_next(
    found: Discovery, model: str, logs: list[str], file: str | None, options: str = "", own: str = ""
) -> list[Line]:
    """Commands that use the law, or look further where there is none; nothing where nothing is left.

    `options` are those with which the logs were read, `own` those of them that name effects; with a space before them.
    """
    if found.outcome is Outcome.NOTHING and not found.tried:
        return []
    read = f"-m {shlex.quote(model)} {shlex.join(logs)}{options}"
    if not found.laws:
        return [Line(f"next: wrenchgap where {read}")]
    if file is None:
        return [Line(f"next: wrenchgap discover {read} -o law.py")]
    model, file, first = shlex.quote(model), shlex.quote(file), found.laws[0]
    names = " ".join([*found.explanation.effects, *(law.name for law in found.laws)])
    out = [f"next: wrenchgap add {names} -m {model} --from {shlex.join(logs)}{options} --effects {file} -o fitted.toml"]
    if first.equivalents:
        pair = f"{first.name} {first.equivalents[0][0]}"
        out.append(f"to separate them: wrenchgap design {pair} -m {model}{own} --effects {file} -o separate.toml")
    return [Line(text) for text in out]


def _laws(found: Discovery) -> Table:
    rows = []
    for law in found.laws:
        for k, c in enumerate(law.coefficients):
            own = (law.name, share(law.p_value), share(law.stability)) if k == 0 else ("", "", "")
            rows.append((own[0], c.symbol, number(c.value), number(c.std, 2), c.unit, *own[1:]))
    return table("laws", ("law", "times", "coefficient", "+-", "unit", "chance", "found again"), rows, left=2)


def _axes(found: Discovery) -> Table:
    rows = [
        (axis, number(found.rms_before[k]), number(found.rms_after[k]), number(found.noise[k]))
        for k, axis in enumerate(AXES)
    ]
    return table("rms left [N, Nm]", ("axis", "named effects", "with the law", "sensor noise"), rows)


def to_json(found: Discovery) -> dict[str, Any]:
    """The body of the `discover` schema."""
    laws = [
        {
            **vars(law),
            "coefficients": [vars(c) for c in law.coefficients],
            "equivalents": [{"name": n, "formula": f} for n, f in law.equivalents],
            "parts": [{"part": n, "value": v, "std": s} for n, v, s in law.parts],
            "nearest": None if law.nearest is None else {"name": law.nearest[0], "cosine": law.nearest[1]},
            "flown_ranges": [{"quantity": n, "low": a, "high": b} for n, a, b in law.flown_ranges],
        }
        for law in found.laws
    ]
    body = entries(found, "rejected", "depends", "rms_before", "rms_after", "noise", "energy_reduction")
    body |= entries(found, "regression_reduction", "held_out", "tried")
    named = {"verdict": found.explanation.verdict, "effects": found.explanation.effects}
    return {"summary": summary(found), "outcome": found.outcome, **named, "laws": laws, **body}


def frame(found: Discovery) -> list[dict[str, Any]]:
    """A row for each coefficient."""
    return [
        {"law": law.name, "formula": law.formula, "times": c.symbol, "value": c.value, "std": c.std, "unit": c.unit}
        for law in found.laws
        for c in law.coefficients
    ]


def picture(found: Discovery) -> style.Picture:
    """One panel: what named effects leave by axis, what the laws leave, and the sensors' noise."""
    return style.Picture((1, 1), (8.0, 3.6), lambda axes: _draw(found, axes), title=summary(found)[0])


def _draw(found: Discovery, axes: Any) -> None:
    panel, at = np.ravel(axes)[0], np.arange(6)
    noise = np.maximum(found.noise, 1e-12)
    panel.bar(at - 0.2, found.rms_before / noise, 0.4, label="named effects", color=style.NOISE)
    panel.bar(at + 0.2, found.rms_after / noise, 0.4, label="with the law", color="C0")
    panel.axhline(1.0, color="0.2", lw=1.0, ls="--")
    panel.set_yscale("log")
    panel.set_xticks(at, AXES)
    panel.set_ylabel("rms left, in sensor noise")
    style.grid(axes)
    style.legend(panel)
