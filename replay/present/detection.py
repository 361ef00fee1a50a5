"""What flights could have shown, in three lines, a figure and JSON."""

from collections.abc import Sequence
from typing import Any

from wrenchgap.learn.changed.changed import Changed
from wrenchgap.learn.data.candidates import Lack
from wrenchgap.learn.data.input_errors import input_error_notes
from wrenchgap.learn.health.answers import logger_settings
from wrenchgap.learn.posterior.detection_limits import DetectionLimit
from wrenchgap.learn.posterior.explain import Explanation
from wrenchgap.learn.posterior.injection import Recovery
from wrenchgap.plant.effects import family, find
from wrenchgap.plant.vehicle import Vehicle
from wrenchgap.replay.present import statements
from wrenchgap.replay.present.figures import style
from wrenchgap.replay.present.numbers import entries, listed, number, size_in_words, unit, user_name
from wrenchgap.replay.present.tables import Line


def sentences(
    found: Explanation | Changed, most_shown: int = 8, most_hidden: int = 6, most_flown: int = 3
) -> list[str]:
    """What would have been shown, what could not be, and what would show more; then what injections say of that.

    The lines name so many effects at most of each; report and JSON have all.
    """
    shown, hidden, alike, more = _said(found, most_shown, most_hidden, most_flown)
    said = [shown, " ".join(filter(None, (hidden, alike))), more]
    return [*filter(None, said), *_checked(found.recoveries, found.model.vehicle)]


def in_short(found: Explanation | Changed) -> list[str]:
    """What could not have been shown and what would show more.

    Where nothing was found, what would have been shown comes first, and what to fly for the rest last.
    """
    nothing = found.verdict == "nothing"
    shown, hidden, _, more = _said(found, 4, 3, 2 if nothing else 0)
    return [text for text in (shown if nothing else "", hidden, more) if text]


def _said(found: Explanation | Changed, most_shown: int, most_hidden: int, most_flown: int) -> tuple[str, ...]:
    """What would have been shown, what not, what is alike, what would show more: sentences, of so many effects."""
    if not found.limits:
        return ("",) * 4
    missed = {(one.effect, one.parameter): one for one in found.recoveries if one.share >= 1.0 and not one.firm}
    others = [one for one in found.limits if one.effect not in found.firm]  # what is firm was shown, at whatever size
    by_effect = _by_effect([one for one in others if (one.effect, one.parameter) not in missed])
    vehicle = found.model.vehicle
    shown = {name: own for name, own in by_effect.items() if any(one.shown for one in own)}
    hidden = {name: own for name, own in by_effect.items() if name not in shown}
    would = [_shown_in_words(name, own, vehicle) for name, own in shown.items()]
    begins = "Would surely" if found.recoveries else "By the geometry, not checked by injection, would"
    lacking = [u.effect for u in found.untried if u.lack is Lack.EXCITATION and u.effect == family(u.effect)]
    lacking = [name for name in lacking if find(name).stands_in_for not in (*by_effect, *lacking)]
    could_not = [f"{_injected(one, vehicle)} (injected as a test, and missed)" for one in missed.values()]
    alike = {name: " or ".join(dict.fromkeys(n for one in own for n in one.instead)) for name, own in hidden.items()}
    could_not += [f"{name} (too weak here)" for name, instead in alike.items() if not instead]
    could_not += [f"{name} (not excited)" for name in lacking]
    unlike = [f"{name} from {instead}" for name, instead in alike.items() if instead]
    slow = [f.flight for f in found.flights if input_error_notes(f.flight.name, f.records)]
    settings = [statements.setting(one) for f in slow[:1] if f.autopilot for one in logger_settings(f.autopilot)]
    settings += ["log the commands at the rate of the loop"] * bool(slow and not settings)
    advice = [f"{words[0].lower()}{words[1:]}" for words in settings]
    advice += [f"for {name} fly {find(name).excited_by}" for name in lacking[:most_flown]]
    return (
        f"{begins} have been shown: {listed(would, most_shown, last=', and ')}." if would else "",
        f"Could not have been shown: {listed(could_not, most_hidden, last=', and ')}." if could_not else "",
        f"Could not have been told apart: {listed(unlike, most_hidden, last=', and ')}." if unlike else "",
        f"To show more: {'; '.join(advice)}." if advice else "",
    )


def _by_effect(limits: Sequence[DetectionLimit]) -> dict[str, list[DetectionLimit]]:
    """Limits of each effect, that first of which the smallest part of what is plausible would have been shown."""
    found: dict[str, list[DetectionLimit]] = {}
    for one in limits:
        found.setdefault(one.effect, []).append(one)
    return dict(sorted(found.items(), key=lambda item: min(_part(one) for one in item[1])))


def _part(one: DetectionLimit) -> float:
    """The limit as a share of the largest plausible change."""
    return abs(one.size / one.plausible) if one.shown else float("inf")


def _shown_in_words(name: str, limits: Sequence[DetectionLimit], vehicle: Vehicle, apart: float = 1.3) -> str:
    """An effect with the size from which on any of its parameters would have been shown.

    Rotors whose sizes differ by the factor `apart` or more, as one reads it in per cent, are told by the best and the
    worst of them.
    """
    shown = [one for one in limits if one.shown]
    same_unit = len({one.unit for one in limits}) == 1
    worst = max(shown, key=_part if not same_unit else lambda one: abs(one.size))
    size = _size(name, worst.parameter, abs(worst.size), worst.unit, vehicle)
    factor = _is_factor(name, worst.parameter, vehicle)
    if len(limits) == 1 and not factor:
        return f"{name} from {size}"
    if len(shown) == len(limits) and same_unit and not factor:
        if not find(name).sparse:
            return f"{name} from {size}"
        best = min(shown, key=lambda one: abs(one.size))
        if abs(worst.size) < apart * abs(best.size):
            return f"{name} from {size} (any of {len(limits)})"
        least = _size(name, best.parameter, abs(best.size), best.unit, vehicle)
        places = [user_name(one.parameter, vehicle) for one in (best, worst)]
        return f"{name} from {least} ({places[0]}) to {size} ({places[1]})"
    names = "/".join(user_name(one.parameter, vehicle) for one in shown if one.unit == worst.unit)
    return f"{name} {names} from {size}"


def _injected(one: Recovery, vehicle: Vehicle) -> str:
    """What was put into the flights."""
    size = _size(one.effect, one.parameter, one.size, one.unit, vehicle)
    return f"{one.effect} {user_name(one.parameter, vehicle)} {size}"


def _is_factor(effect: str, parameter: str, vehicle: Vehicle) -> bool:
    """Whether a pure number is a factor, which may be above one, and no relative change, which is said in per cent."""
    own = next((p for p in find(effect).parameters(vehicle) if p.name == parameter), None)
    return own is not None and own.unit == "1" and own.high > 1.0


def _size(effect: str, parameter: str, size: float, unit_name: str, vehicle: Vehicle) -> str:
    return number(size, 2) if _is_factor(effect, parameter, vehicle) else size_in_words(size, unit_name)


def _checked(recoveries: Sequence[Recovery], vehicle: Vehicle) -> list[str]:
    """What injections say of the limits."""
    if not recoveries:
        return []
    wrong = sum(not one.as_stated for one in recoveries)
    listed = [
        f"{_injected(one, vehicle)} was {'found' if one.firm else 'missed'}"
        + (f", and {' and '.join(one.others)}, which was not injected" * bool(one.others))
        + (", as it may be at half of its limit" if one.as_stated and not one.firm else "")
        for one in recoveries
    ]
    held = f"{wrong} of {len(recoveries)} did not hold (take them as optimistic)" if wrong else "the limits held"
    return [f"Limits checked by injection into these flights, {held}: {'; '.join(listed)}."]


def lines(found: Explanation | Changed) -> list[Line]:
    """The sentences, with a heading."""
    said = sentences(found)
    return [Line("What these flights could have shown:", "bold"), *(Line(f"  {text}") for text in said)] if said else []


def to_json(found: Explanation | Changed) -> dict[str, Any]:
    """The key `sensitivity`."""
    injected = ("effect", "parameter", "unit", "size", "share", "firm", "as_stated", "others")
    return {
        "limits": [
            {
                **entries(one, "effect", "parameter", "unit", "plausible"),
                "size": one.size if one.shown else None,
                "where": dict(one.where),
                "instead": list(one.instead),
            }
            for one in found.limits
        ],
        "injected": [entries(one, *injected) for one in found.recoveries],
        "summary": sentences(found),
    }


def picture(found: Explanation) -> style.Picture:
    """One panel: of each effect the limits, from its most to its least visible parameter, over what is plausible.

    Logarithmic; effects that could not have been shown reach the end.
    """
    size = (9.0, 1.2 + 0.24 * max(1, len(_by_effect(found.limits))))
    title = f"{found.model.name}: the smallest change that would have been firm"
    return style.Picture((), size, lambda panel: _draw(found, panel), title=title)


def _draw(found: Explanation, panel: Any) -> None:
    by_effect = list(_by_effect(found.limits).items())[::-1]
    if not by_effect:
        style.nothing(panel, "no effect of the catalogue could be tried")
        return
    for row, (_, own) in enumerate(by_effect):
        parts = [min(_part(one), 1.0) for one in own]
        shown = any(one.shown for one in own)
        panel.barh(row, 1.0 - min(parts), 0.6, left=min(parts), color="tab:blue" if shown else "0.8")
        best = min(own, key=_part)
        words = f"{number(abs(best.size), 2)} {unit(best.unit)}".rstrip() if shown else "not shown"
        panel.annotate(
            words, (min(parts), row), (-4, 0), ha="right", textcoords="offset points", va="center", fontsize=8
        )
    panel.set_xscale("log")
    panel.set_xlim(1e-4, 1.0)
    panel.set_yticks(range(len(by_effect)), [name for name, _ in by_effect], fontsize=style.SMALL)
    panel.set_xlabel("smallest firm change as a share of the largest plausible one [-]")
    style.grid(panel, without="y")
