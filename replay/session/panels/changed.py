"""Changed: what differs between the flight shown and healthy ones, and what it does when that is in the model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

import wrenchgap as wg
from wrenchgap.flight.errors import UsageError
from wrenchgap.flight.flight import AXES, Array
from wrenchgap.learn.changed.changed import Changed, Verdict
from wrenchgap.learn.changed.sizes import Size
from wrenchgap.plant.effects import find
from wrenchgap.plant.model import Model
from wrenchgap.plant.model_file import provenance_now
from wrenchgap.plant.wrench_model import ModelEffect
from wrenchgap.replay.present import changed as words
from wrenchgap.replay.present.numbers import capitalised, number, unit
from wrenchgap.replay.present.what_to_inspect import sentences as what_to_inspect
from wrenchgap.replay.session.panels import html
from wrenchgap.replay.session.worker import worker_result
from wrenchgap.replay.session.working_model import Found, Revision, WorkingModel
from wrenchgap.viewer.host import Host
from wrenchgap.viewer.markup import sentences
from wrenchgap.viewer.panel import JobControls, Links, Panel
from wrenchgap.viewer.session import Report, Scene

if TYPE_CHECKING:
    from wrenchgap.learn.identify.trend import Trend

SOURCE = "what changed between flights, in the viewer"
"""How provenance in a model file says where such a value comes from."""


class SessionComparisons:
    """What changed between flights of a working model."""

    def __init__(self, working: WorkingModel) -> None:
        self.working = working

    def of(self, suspect: str, healthy: tuple[str, ...], report: Report) -> Changed:
        """Compare one flight with others of the same vehicle; takes long, in a process of its own."""
        with self.working.lock:
            model = self.working.model
            one, others = self.working.flight(suspect), [self.working.flight(h) for h in healthy]
        return worker_result(lambda tell: replace(wg.changed(one, others, model, progress=tell), flights=()), report)

    def add(self, found: Changed, name: str) -> None:
        """Put what changed into the model. Raises UsageError unless the model is the one called `name` still."""
        working = self.working
        with working.lock:
            if working.name != name:
                raise UsageError(f"this was found on top of {name}; search again on the model as it stands")
            order = tuple(dict.fromkeys((*working.order, *found.names)))
            words = f"add what changed: {', '.join(found.names)}"
            working.change(Revision(with_changes(working.model, found), words, order))


def with_changes(model: Model, found: Changed) -> Model:
    """The model with the effects of the likeliest set, changed by what the suspect flights show."""
    if found.verdict is Verdict.NOTHING:
        return model
    effects = {e.name: e for e in model.effects}
    for name in found.names:
        effect = find(name)
        parameters = effect.parameters(model.vehicle)
        own = effects.get(name) or ModelEffect(effect, np.zeros(len(parameters)), None)
        changes = {size.name: size.change for size in found.parameters if size.effect == name}
        theta = own.theta.copy()
        for k, p in enumerate(parameters):
            if p.name in changes:
                theta[k] = np.clip(theta[k] + changes[p.name], p.low, p.high)
        effects[name] = replace(own, theta=theta, std=None, provenance=provenance_now(SOURCE))
    return model.with_effects(tuple(effects.values()))


def labels(names: Sequence[str], widest: int = 18) -> list[str]:
    """Names of flights as they fit beside a box: without the end that all have, and with a gap where they are long."""
    ends = ["".join(n.rpartition(c)[1:]) for c in "_-. " for n in names[:1]]
    end = next((e for e in ends if len(names) > 1 and e != names[0] and all(n.endswith(e) for n in names)), "")
    bare = [n.removesuffix(end) or n for n in names]
    half = (widest - 1) // 2
    short = [n if len(n) <= widest else f"{n[:half]}…{n[-half:]}" for n in bare]
    return short if len(set(short)) == len(short) else list(names)


class ChangedPanel(Panel):
    """The flight shown is the suspect one; others are ticked as healthy. Only where there are several flights."""

    def __init__(self, host: Host, comparisons: SessionComparisons) -> None:
        super().__init__(host)
        self.comparisons = comparisons
        self._followed = ""
        gui = host.gui
        with host.tab("Changed"):
            self.suspect = gui.add_html("")
            with gui.add_folder("healthy flights"):
                names = host.session.flights  # which of several are healthy only the user knows
                self.healthy = {
                    name: gui.add_checkbox(label, len(names) == 2, hint=None if label == name else name)
                    for name, label in zip(names, labels(names), strict=True)
                }
            hint = "One flight against healthy ones; what the model is wrong by in all of them drops out."
            self.work = JobControls(host, "What changed?", self._ask, hint)
            self.answer = gui.add_html("")
            self.links = Links(host)
            hint = "Thrust, drag torque, lag, zero and play of each, every flight fitted by itself; in order of date."
            self.season = JobControls(host, "Health of rotors, servos and arms", self._ask_health, hint)
            self.health = gui.add_html("")
        host.command("Search for what changed on this flight", self._ask)
        host.command("Health of parts over all flights", self._ask_health)

    def opened(self, scene: Scene) -> None:
        """Another flight, or another model."""
        said = f"suspect: {scene.name}, the flight shown; choose another one at the top"
        self.suspect.content = sentences(said, look="wg-muted")
        for name, tick in self.healthy.items():
            tick.visible = name != scene.name
        if self._followed != self.comparisons.working.name:  # another model
            self.health.content = ""
        self._draw()

    def _ask(self) -> None:
        suspect = self.host.scene.name
        healthy = tuple(name for name, tick in self.healthy.items() if tick.value and name != suspect)
        if not healthy:
            raise UsageError("tick at least one flight as healthy to compare with")

        working = self.comparisons.working
        model, name = working.model, working.name

        def done(found: Changed) -> None:
            working.found["changed", suspect] = Found(found, model, name)
            self._draw()

        self.work.start(lambda report: self.comparisons.of(suspect, healthy, report), done)

    def _ask_health(self) -> None:
        working = self.comparisons.working
        with working.lock:
            model, flights, self._followed = working.model, list(working.flights.values()), working.name

        def followed(report: Report) -> Trend:

            return worker_result(lambda tell: wg.trend(flights, model, parts=True, progress=tell), report)

        def done(found: Trend) -> None:
            from wrenchgap.replay.present import season, trend

            heads, rows = season.health_rows(found)
            said = [*trend.summary(found), season.LEGEND]
            self.health.content = html.render("health", sentences=said, heads=heads, rows=rows)

        self.season.start(followed, done)

    def _draw(self) -> None:
        self.links.start()
        was = self.comparisons.working.found.get(("changed", self.host.scene.name))
        if was is None:
            self.answer.content = ""
            return
        found, model = was.result, was.name
        something = found.verdict is not Verdict.NOTHING
        shown = [k for k in range(len(AXES)) if any(np.isfinite(row.mean[k]) for row in found.rows)]
        usual = np.mean([r.mean for r in found.rows if r.role == "healthy"], axis=0)
        beyond = [(row.mean - usual) / np.maximum(found.scatter, 1e-12) for row in found.rows]
        self.answer.content = html.render(
            "changed",
            found=found,
            model=model,
            healthy=[row.flight for row in found.rows if row.role != "suspect"],
            summary=words.summary(found),
            notes=[
                capitalised(text)
                for text in (
                    *words.outliers(found, "ticked"),
                    words.baseline(found),
                    *words.feedback(found),
                    *words.not_compared(found),
                )
                if text
            ],
            changes=[(p, _change_in_words(p)) for p in found.parameters if something],
            inspect=what_to_inspect(found),
            axes=[AXES[k].replace("force_", "F").replace("torque_", "M") for k in shown],
            rows=[(row, _cells(row.mean, far, shown)) for row, far in zip(found.rows, beyond, strict=True)],
            adding=self.links.to(partial(self._add, found, model)) if something and found.names else None,
        )

    def _add(self, found: Changed, model: str) -> None:
        self.comparisons.add(found, model)
        self.host.refresh()
        self.host.notify(f"in the model: what changed, {', '.join(found.names)}; take it out under Effects")


def _change_in_words(size: Size) -> str:
    """The parameter's own name, but of a rotor or an arm, whose name the user has; its change."""
    own = "" if size.name.split("_")[0] in ("rotor", "arm") else f"{size.name} "
    change = f"{own}{number(size.change)} ± {number(size.std, 2)} {unit(size.unit)}"
    return f"{change} (scatter of healthy flights {number(size.scatter, 2)})"


def _cells(mean: Array, beyond: Array, shown: Sequence[int]) -> list[dict[str, str]]:
    """Signed means (6,) on the axes that are shown, in the colours of their distance from the healthy flights.

    `beyond` (6,) is that distance in what healthy flights differ by; six times that is darkest.
    """
    out = []
    for k in shown:
        back, front = html.heat(float(np.clip(np.nan_to_num(beyond[k]) / 6.0, -1.0, 1.0)))
        title = f"{AXES[k]}: {number(mean[k])}, {beyond[k]:+.1f} times what healthy flights differ by"
        out.append({"back": back, "front": front, "number": number(mean[k], 2), "title": title})
    return out
