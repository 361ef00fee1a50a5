"""Changed: what differs between the flight shown and healthy ones, and what it does when that is in the model."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from wrenchgap.flight.errors import UsageError
from wrenchgap.flight.flight import AXES
from wrenchgap.viewer import markup
from wrenchgap.viewer.differences import Comparisons, Differences, FlightMean
from wrenchgap.viewer.host import Host
from wrenchgap.viewer.html_links import Links
from wrenchgap.viewer.job_controls import JobControls
from wrenchgap.viewer.panel import Panel
from wrenchgap.viewer.scene import Scene

DARKEST = 6.0
"""Distance from the healthy flights, in what those differ by, that is drawn darkest."""
BADGES = {"changed": "changed", "nothing": "nothing", "unknown": "unknown"}


WIDEST = 18
"""Characters of a flight's name beside a box to tick that stay on one line."""


def labels(names: Sequence[str]) -> list[str]:
    """Names of flights as they fit beside a box: without the end that all have, and with a gap where they are long."""
    ends = ["".join(n.rpartition(c)[1:]) for c in "_-. " for n in names[:1]]
    end = next((e for e in ends if len(names) > 1 and e != names[0] and all(n.endswith(e) for n in names)), "")
    bare = [n.removesuffix(end) or n for n in names]
    half = (WIDEST - 1) // 2
    short = [n if len(n) <= WIDEST else f"{n[:half]}…{n[-half:]}" for n in bare]
    return short if len(set(short)) == len(short) else list(names)


class ChangedPanel(Panel):
    """The flight shown is the suspect one; others are ticked as healthy. Only where there are several flights."""

    asks = "comparisons"

    def __init__(self, host: Host, comparisons: Comparisons) -> None:
        super().__init__(host)
        self.comparisons = comparisons
        self.found: dict[str, Differences] = {}
        gui = host.gui
        with host.tab("Changed"):
            self.suspect = gui.add_html("")
            with gui.add_folder("healthy flights"):
                names = tuple(host.session.flights)
                self.healthy = {n: self._tick(n, label) for n, label in zip(names, labels(names), strict=True)}
            hint = "One flight against healthy ones; what the model is wrong by in all of them drops out."
            self.work = JobControls(host, "What changed?", self._ask, hint)
            self.answer = gui.add_html("")
            self.links = Links(host)
        host.command("Search for what changed on this flight", self._ask)

    def _tick(self, name: str, label: str) -> Any:
        return self.host.gui.add_checkbox(label, True, hint=None if label == name else name)

    def opened(self, scene: Scene) -> None:
        """Another flight, or another model."""
        words = f"suspect: {scene.name}, the flight shown; choose another one at the top"
        self.suspect.content = markup.sentences(words, look="wg-muted")
        for name, tick in self.healthy.items():
            tick.visible = name != scene.name
        self._draw()

    def _ask(self) -> None:
        suspect = self.host.scene.name
        healthy = tuple(name for name, tick in self.healthy.items() if tick.value and name != suspect)
        if not healthy:
            raise UsageError("tick at least one flight as healthy to compare with")

        def done(found: Differences) -> None:
            self.found[suspect] = found
            self._draw()

        self.work.start(lambda report: self.comparisons.of(suspect, healthy, report), done)

    def _draw(self) -> None:
        self.links.start()
        found = self.found.get(self.host.scene.name)
        if found is None:
            self.answer.content = ""
            return
        shown = [k for k in range(len(AXES)) if any(np.isfinite(row.mean[k]) for row in found.rows)]
        self.answer.content = markup.render(
            "changed",
            found=found,
            badge=BADGES.get(found.verdict, "unknown"),
            axes=[AXES[k].replace("force_", "F").replace("torque_", "M") for k in shown],
            rows=[(row, self._cells(row, shown)) for row in found.rows],
            adding=self.links.to(partial(self._add, found)) if found.effects else None,
        )

    def _cells(self, row: FlightMean, shown: Sequence[int]) -> list[dict[str, str]]:
        """Signed means on the axes that are shown, in the colours of their distance from the healthy flights."""
        out = []
        for k in shown:
            axis, mean, beyond = AXES[k], row.mean[k], row.beyond[k]
            back, front = markup.heat(float(np.clip(np.nan_to_num(beyond) / DARKEST, -1.0, 1.0)))
            title = f"{axis}: {markup.number(mean)}, {beyond:+.1f} times what healthy flights differ by"
            out.append({"back": back, "front": front, "number": markup.number(mean, 2), "title": title})
        return out

    def _add(self, found: Differences) -> None:
        self.comparisons.add(found)
        self.host.refresh()
        self.host.notify(f"in the model: what changed, {', '.join(found.effects)}; take it out under Effects")
