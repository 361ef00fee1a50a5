"""Effects: what is missing, or a law for it; put it in, watch the error fall, take it out, set it by hand, save it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from wrenchgap.flight.errors import UsageError
from wrenchgap.learn.identify.staircase import Staircase
from wrenchgap.plant.effects.effect import Parameter
from wrenchgap.plant.targets import TARGETS
from wrenchgap.plant.wrench_model import ModelEffect
from wrenchgap.replay.present.notes import not_tried
from wrenchgap.replay.session.effects import SessionEffects
from wrenchgap.replay.session.panels import html
from wrenchgap.replay.session.panels.html import finer
from wrenchgap.replay.session.working_model import Found
from wrenchgap.viewer.host import Host, download
from wrenchgap.viewer.markup import sentences
from wrenchgap.viewer.panel import JobControls, Links, Panel, is_long
from wrenchgap.viewer.scene_drawing import tidy
from wrenchgap.viewer.session import Motion, Scene

if TYPE_CHECKING:
    from wrenchgap.learn import Design, Explanation
    from wrenchgap.learn.discover.discover import Discovery

VERDICTS = {
    "effect": "missing",
    "group": "one of several",
    "unknown": "not in the catalogue",
    "nothing": "nothing missing",
}
SAVES = "Written into the folder of --save-to, never over a file that this page did not write."
DOWNLOADS = "Downloaded by the browser; start the page with --save-to FOLDER to write it there."
NEXT = "next flight"
"""Name of the designed trajectory in the scene."""


class EffectsPanel(Panel):
    """The model as it stands, the search for what it lacks, and the staircase of errors down to the noise."""

    path_rgb = (120, 60, 190)
    """Colour of the designed trajectory in the scene."""

    def __init__(self, host: Host, effects: SessionEffects) -> None:
        super().__init__(host)
        self.effects = effects
        self.available: tuple[str, ...] = ()
        self._flight: str | None = None
        self.designed: Design | None = None
        gui, connect = host.gui, host.connect
        with host.tab("Effects"):
            with gui.add_folder("What is missing?"):
                hint = "Tries every effect of the catalogue on held-out time of this flight; the page stays usable."
                self.work = JobControls(host, "Search", self._explain, hint)
                self.found = gui.add_html("")
                self.law = LawControls(host, effects, self._last)
                self.choice = gui.add_dropdown("by name", ("-",))
                self.put = connect(gui.add_button("Add effect"), lambda _: self.add(self.choice.value))
                self.lacking = gui.add_html("")
            self.stairs = gui.add_html("")
            self.back = gui.add_button("Undo", color="gray", visible=False)
            connect(self.back, lambda _: self._change(effects.undo))
            self.again = gui.add_button("Redo", color="gray", visible=False)
            connect(self.again, lambda _: self._change(effects.redo))
            with gui.add_folder("In the model"):
                self.inside = gui.add_html("")
                self.sliders = EffectSliders(
                    host,
                    lambda *given: self._change(partial(effects.set_value, *given)),
                    lambda name: self._change(partial(effects.remove, name)),
                )
                self.refit = gui.add_button("Fit all again on this flight", color="gray")
                connect(self.refit, lambda _: self._change(partial(effects.refit, host.scene.name)))
            self._next()
            with gui.add_folder("Save the model"):
                self.path = gui.add_text("file", "fitted.toml", hint=SAVES if effects.saves else DOWNLOADS)
                self.save = connect(gui.add_button("Save model" if effects.saves else "Download model"), self._saved)
                hint = "Autopilots get what was identified, simulators the whole vehicle; see docs/write.md."
                self.target = gui.add_dropdown("for", tuple(TARGETS), hint=hint)
                self.export = connect(gui.add_button("Download for it", color="gray"), self._exported)
            self.links = Links(host)
        host.command("Undo the last change of the model", lambda: self._change(effects.undo))
        host.command("Redo what was undone of the model", lambda: self._change(effects.redo))
        host.command("Search for what is missing", self._explain)

    def _next(self) -> None:
        host, gui, connect = self.host, self.host.gui, self.host.connect
        with gui.add_folder("What to fly next") as self.next_folder:
            self.pair = gui.add_text("effects", "", hint="Two or more effects to separate, with commas between.")
            hint = "Searches for the reference, flies it in simulation and draws it in the scene; takes half a minute."
            self.design = JobControls(host, "Find the flight that separates them", self._tell_named_apart, hint)
            self.plan = gui.add_html("")
            self.plan_path = gui.add_text("file", "separate.toml", visible=False)
            words = f"{'Save' if self.effects.saves else 'Download'} the trajectory"
            self.plan_save = connect(gui.add_button(words, visible=False, color="gray"), self._save_plan)
            self.plan_clear = gui.add_button("Take it out of the scene", visible=False, color="gray")
            connect(self.plan_clear, lambda _: self._draw_plan(None))

    def opened(self, scene: Scene) -> None:
        """Another flight, or another model. The errors on a long flight are worked out beside the page at first."""
        working, installed, absent = self.effects.working, self.effects.installed, self.effects.absent(scene.name)
        self.links.start()
        self.back.label, self.back.visible = f"Undo: {working.undoable}", bool(working.undoable)
        self.again.label, self.again.visible = f"Redo: {working.redoable}", bool(working.redoable)
        self.available = tuple(name for name, why in absent.items() if why is None)
        self.choice.options = self.available or ("-",)
        reasons = not_tried([why for why in absent.values() if why is not None])
        lacking = [f"{', '.join(names)}: {reason}" for reason, names in reasons.items()]
        self.lacking.content = sentences(*lacking, look="wg-pale", under="what cannot be added on this flight")
        self.inside.content = html.render("installed", effects=installed, vehicle=self.host.session.vehicle)
        self.sliders.show(installed)
        self.refit.visible = bool(installed)
        found = working.found.get(("explain", scene.name))
        self.found.content = "" if found is None else self._search_html(found.result, found.name)
        self.law.forget()
        beside, self._flight = is_long(scene) and scene.name != self._flight, scene.name
        if beside:
            self._climb((), f"looking at {scene.name} ...")
        self.look_up(partial(self.effects.staircases, scene.name), self._climb, in_background=beside)

    def _climb(self, staircases: tuple[Staircase, ...], words: str = "") -> None:
        self.stairs.content = html.render("model", working=self.effects.working, staircases=staircases, words=words)

    def _search_html(self, found: Explanation, model: str) -> str:
        """Verdict and candidates, with links that add effects and lead to the flight that separates a group."""
        from wrenchgap.replay.present import answer, detection, explanation  # here: the page stands before it is there

        inside = {i.name for i in self.effects.installed}
        names = dict.fromkeys([*found.effects, *(c.name for c in found.ranking)])
        rest = [n for n in found.effects if n not in inside]
        fit, vehicle = found.fit, self.host.session.vehicle
        fitted = zip(fit.parameters, fit.theta, fit.std, strict=True)
        values = [(name, html.parameter_in_words(p, value, std, vehicle)) for (name, p), value, std in fitted]
        return html.render(
            "search",
            found=found,
            summary=answer.in_full(found).replace(" (--details)", " (below)"),
            evidence=answer.evidence(found),
            values=values,
            open=explanation.open_in_words(found),
            shown=detection.sentences(found),
            how_sure=explanation.how_sure,
            alike={r.name for m in found.members for r in m.alike},
            vehicle=vehicle,
            searched_on=model,
            model=self.effects.working.name,
            inside=inside,
            meaning=VERDICTS.get(found.verdict, ""),
            adding={name: self.links.to(partial(self.add, name)) for name in names if name not in inside},
            rest=rest if len(rest) > 1 else [],
            adding_rest=self.links.to(partial(self.add, *rest)),
            groups=[(group, self.links.to(partial(self.tell_apart, group))) for group in found.separable],
        )

    def _last(self) -> Explanation | None:
        """What was found of the flight that is shown, if on top of the model as it stands, values and all."""
        working = self.effects.working
        found = working.found.get(("explain", self.host.scene.name))
        return found.result if found is not None and found.model is working.model else None

    def add(self, *names: str) -> None:
        """Put effects into the model, fitted on the flight shown."""
        if any(n not in self.available for n in names):
            raise UsageError(f"{', '.join(names)}: cannot be added on this flight; choose an effect of the list")
        said = self.effects.add(tuple(names), self.host.scene.name)
        self.host.refresh()
        self.host.notify(said)

    def tell_apart(self, names: tuple[str, ...]) -> None:
        """Search for the flight that tells these effects apart."""
        names = tuple(dict.fromkeys(names))
        if len(names) < 2:
            raise UsageError("name at least two effects, e.g. servo_lag, command_delay")
        flight = self.host.scene.name
        self.pair.value = ", ".join(names)
        self.design.start(lambda report: self.effects.next_flight(names, flight, report), self._draw_plan)

    def _tell_named_apart(self) -> None:
        self.tell_apart(tuple(n.strip() for n in self.pair.value.split(",") if n.strip()))

    def _change(self, do: Any) -> None:
        do()
        self.host.refresh()

    def _explain(self) -> None:
        flight, working = self.host.scene.name, self.effects.working
        model, name = working.model, working.name

        def done(found: Explanation) -> None:
            working.found["explain", flight] = Found(found, model, name)
            self.opened(self.host.scene)

        self.work.start(lambda report: self.effects.explain(flight, report), done)

    def _draw_plan(self, plan: Design | None) -> None:
        """Show a designed flight: in words, as a curve in the scene, and as a ghost that flies it from the start."""
        from wrenchgap.replay.present import design  # here: the page stands before it is there

        self.designed = plan
        self.plan_path.visible = self.plan_save.visible = plan is not None and plan.separable
        self.plan_clear.visible = plan is not None
        if plan is None:
            self.host.curve(NEXT, None, self.path_rgb)
            self.plan.content = ""
            return
        time = np.linspace(0.0, plan.trajectory.duration, 600)
        reference = plan.trajectory.at(time)
        self.host.curve(NEXT, reference.position_E, self.path_rgb)
        words = f"to separate {' from '.join(e.name for e in plan.effects)}"
        start = float(self.host.scene.time[0])
        self.host.show_ghost(NEXT, Motion(start + time, reference.position_E, reference.quat_ED, None, words))
        advice = () if plan.separable else design.advice(plan)
        self.plan.content = html.render("next_flight", found=plan, sentence=design.sentence(plan), advice=advice)

    def _save_plan(self, event: Any) -> None:
        name = self.plan_path.value.strip()
        if self.designed is None:
            return
        if self.effects.saves:
            self.host.notify(self.effects.save_trajectory(self.designed, name))
        else:
            download(event.client, name, self.effects.trajectory_text(self.designed).encode())

    def _exported(self, event: Any) -> None:
        text = self.effects.exported(self.target.value, self.host.scene.name)
        download(event.client, f"{self.target.value}{TARGETS[self.target.value]}", text.encode())

    def _saved(self, event: Any) -> None:
        name = self.path.value.strip()
        if self.effects.saves:
            words = self.effects.save(name)
        else:
            text, words = self.effects.downloaded(name)
            download(event.client, name, text.encode())
        self.host.refresh()
        self.host.notify(words)


class LawControls:
    """`last` is the search whose rest is looked at: what `explain` said of the flight that is shown, or None."""

    def __init__(self, host: Host, effects: SessionEffects, last: Callable[[], Explanation | None]) -> None:
        self.host, self.effects, self.last = host, effects, last
        self.source = ""
        hint = "Tries hundreds of laws on what the named effects leave, and on residuals of chance."
        self.work = JobControls(host, "Look for a law of the rest", self.look, hint)
        self.answer = host.gui.add_html("")
        self.save = host.connect(host.gui.add_button("Download the law", visible=False, color="gray"), self._saved)

    def forget(self) -> None:
        """Another flight, or another model: what was found is not said of it."""
        self.answer.content, self.source, self.save.visible = "", "", False

    def look(self) -> None:
        """Search, in a process of its own."""
        flight, known = self.host.scene.name, self.last()
        self.work.start(lambda report: self.effects.discover(flight, known, report), self._found)

    def _found(self, found: Discovery) -> None:
        from wrenchgap.replay.present import discovery  # here: the page stands before it is there
        from wrenchgap.replay.present.report.sections import Image

        drawn = Image.of(discovery.picture(found), "", "", form="svg").src if found.laws else ""
        self.answer.content = html.render("law", sentences=discovery.summary(found), found=found, drawn=drawn)
        self.source, self.save.visible = found.source, bool(found.source)

    def _saved(self, event: Any) -> None:
        download(event.client, "law.py", self.source.encode())


class EffectSliders:
    """One folder an effect: a slider a parameter and a button that takes the effect out.

    `on_set(effect, parameter, value)` and `on_remove(effect)` are called under the page's lock. While a slider is
    dragged its values come faster than they can be evaluated: only the newest counts.
    """

    def __init__(self, host: Host, on_set: Callable[[str, str, float], None], on_remove: Callable[[str], None]) -> None:
        self.host, self.on_set, self.on_remove = host, on_set, on_remove
        self.place = host.gui.add_folder(None)
        self._folders: dict[str, Any] = {}
        self.handles: dict[tuple[str, str], tuple[Any, float]] = {}
        """Sliders by effect and parameter, and the factor from SI to what they show."""
        self._wanted: dict[tuple[str, str], float] = {}

    def show(self, installed: Sequence[ModelEffect]) -> None:
        """Show these effects; what is there already only moves."""
        names = {i.name for i in installed}
        for name in [n for n in self._folders if n not in names]:
            self._folders.pop(name).remove()
            self.handles = {key: h for key, h in self.handles.items() if key[0] != name}
        for item in installed:
            if item.name not in self._folders:
                self._make(item)
            for parameter, value in self._values(item):
                handle, factor = self.handles[item.name, parameter.name]
                shown = _on(handle.step, factor * value, handle.min, handle.max)
                if abs(handle.value - shown) > 0.5 * handle.step:
                    handle.value = shown

    def _values(self, item: ModelEffect) -> list[tuple[Parameter, float]]:
        parameters = item.effect.parameters(self.host.session.vehicle)
        return [(p, float(value)) for p, value in zip(parameters, item.theta, strict=True)]

    def _make(self, item: ModelEffect) -> None:
        gui, values = self.host.gui, self._values(item)
        with self.place:
            folder = self._folders[item.name] = gui.add_folder(item.name, expand_by_default=len(values) <= 6)
        with folder:
            for parameter, value in values:
                self._slider(item.name, parameter, value)
            remove = gui.add_button(f"Remove {item.name}", color="gray")
            self.host.connect(remove, lambda _: self.on_remove(item.name))

    def _slider(self, effect: str, parameter: Parameter, value: float, reach: float = 4.0) -> None:
        """About 400 steps, over `reach` typical sizes on either side of zero and of the value, where plausible."""
        unit, factor = finer(parameter)
        low = factor * max(parameter.low, min(0.0, value) - reach * parameter.scale)
        high = factor * min(parameter.high, max(0.0, value) + reach * parameter.scale)
        step = tidy((high - low) / 400)
        low, high = step * np.ceil(low / step - 1e-9), step * np.floor(high / step + 1e-9)
        label = parameter.name if unit == "1" else f"{parameter.name} [{unit}]"
        shown = _on(step, factor * value, float(low), float(high))
        handle = self.host.gui.add_slider(label, float(low), float(high), step, shown)
        handle.on_update(partial(self._moved, effect, parameter.name))
        self.handles[effect, parameter.name] = handle, factor

    def _moved(self, effect: str, parameter: str, event: Any) -> None:
        """A client moved a slider; when the page did, the model is there already."""
        if event.client_id is None or (effect, parameter) not in self.handles:  # removed meanwhile
            return
        handle, factor = self.handles[effect, parameter]
        self._wanted[effect, parameter] = float(handle.value) / factor

        def apply(_: Any) -> None:
            value = self._wanted.pop((effect, parameter), None)
            if value is not None:  # else a later call has seen to it
                self.on_set(effect, parameter, value)

        self.host.guarded(apply)(event)


def _on(step: float, value: float, low: float, high: float) -> float:
    """The place of a slider that is nearest to a value."""
    return float(np.clip(step * round(value / step), low, high))
