"""Picture of an explanation: the candidates, ranked by the share of the error energy that each alone takes off.

One panel. Held-out time, on top of the model as given; the named effects are dark, with their confidence.
"""

from __future__ import annotations

from typing import Any

from wrenchgap.learn.posterior.explain import Explanation
from wrenchgap.learn.posterior.table import Candidate
from wrenchgap.replay.present.figures import style
from wrenchgap.replay.present.numbers import share

MOST = 20
"""Candidates drawn at most, those that are named always."""
NAMED, ALIKE, OTHER, IMPLAUSIBLE = "tab:blue", "#8fb3dc", "0.8", "#e3b5b5"


def picture(found: Explanation) -> style.Picture:
    """Bars, the longest on top."""
    flights = ", ".join(f.records[0].flight for f in found.flights)
    return style.Picture(
        (),
        (9.0, 1.5 + 0.27 * max(1, len(_shown(found)))),
        lambda panel: _draw(found, panel),
        title=f"{found.model.name}: what each effect alone explains" + (f" of {flights}" if flights else ""),
    )


def _shown(found: Explanation) -> list[Candidate]:
    return [c for k, c in enumerate(found.ranking) if k < MOST or c.name in found.effects]


def _draw(found: Explanation, panel: Any) -> None:
    shown = _shown(found)[::-1]
    if not shown:
        style.nothing(panel, "no effect of the catalogue could be tried")
        return
    kinds = [_kind(found, c) for c in shown]
    for word, colour in (
        ("named", NAMED),
        ("indistinguishable from a named one", ALIKE),
        ("not named", OTHER),
        ("implausible: at its limit", IMPLAUSIBLE),
    ):
        rows = [k for k, kind in enumerate(kinds) if kind == word]
        if rows:
            panel.barh(rows, [100.0 * max(shown[k].score, 0.0) for k in rows], 0.75, color=colour, label=word)
    for row, c in enumerate(shown):
        sure = [f"confidence {100 * found.confidence(m):.0f} %" for m in found.members if m.name == c.name]
        words = ", ".join([share(c.score), *sure])
        place = (100.0 * max(c.score, 0.0), row)
        panel.annotate(words, place, (4, 0), textcoords="offset points", va="center", fontsize=8)
    panel.set_yticks(range(len(shown)), [c.name for c in shown], fontsize=style.SMALL)
    panel.set_ylim(-0.6, len(shown) - 0.4)
    panel.set_xlim(0.0, 125.0)
    style.labelled(panel, "error energy explained on held-out time", "%", "x")
    panel.set_xticks(range(0, 101, 20))
    style.grid(panel)
    panel.grid(visible=False, axis="y")
    style.legend(panel)


def _kind(found: Explanation, candidate: Candidate) -> str:
    if candidate.name in found.effects:
        return "named"
    if any(candidate.name in group for group in found.groups):
        return "indistinguishable from a named one"
    return "implausible: at its limit" if candidate.implausible else "not named"
