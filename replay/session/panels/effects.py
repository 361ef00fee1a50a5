"""Effects: what is missing, put it in, watch the error fall, take it out again, set it by hand, save the model."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from wrenchgap.flight.errors import UsageError
from wrenchgap.learn.identify.staircase import Staircase
from wrenchgap.replay.present.notes import not_tried
from wrenchgap.replay.session.effects import ModelState, SessionEffects
from wrenchgap.replay.session.panels import html
from wrenchgap.replay.session.panels.sliders import EffectSliders
from wrenchgap.viewer.host import Host, download
from wrenchgap.viewer.markup import sentences
from wrenchgap.viewer.panel import JobControls, Links, Panel, is_long
from wrenchgap.viewer.scene import Motion, Scene

if TYPE_CHECKING:
    from wrenchgap.learn import Design, Explanation

VERDICTS = {
    "effect": "this is missing",
    "group": "one of these is missing; they are indistinguishable on this flight",
    "unknown": "something is missing that no effect of the catalogue explains",
    "nothing": "nothing is missing that this flight can show",
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
        self.state: ModelState | None = None
        self._flight: str | None = None
        self.searches: dict[str, tuple[Explanation, str]] = {}
        """What was found to be missing, by flight, and on top of which model."""
        self.designed: Design | None = None
        gui = host.gui
        with host.tab("Effects"):
            self.stairs = gui.add_html("")
            self.back = gui.add_button("Undo", color="gray", visible=False)
            self.back.on_click(host.guarded(lambda _: self._change(self.effects.undo)))
            self.again = gui.add_button("Redo", color="gray", visible=False)
            self.again.on_click(host.guarded(lambda _: self._change(self.effects.redo)))
            self._search()
            self._installed()
            self._next()
            self._save()
            self.links = Links(host)
        host.command("Undo the last change of the model", lambda: self._change(self.effects.undo))
        host.command("Redo what was undone of the model", lambda: self._change(self.effects.redo))
        host.command("Search for what is missing", self._explain)

    def _search(self) -> None:
        host, gui = self.host, self.host.gui
        with gui.add_folder("What is missing?"):
            hint = "Tries every effect of the catalogue on held-out time of this flight; the page stays usable."
            self.work = JobControls(host, "Search", self._explain, hint)
            self.found = gui.add_html("")
            self.choice = gui.add_dropdown("by name", ("-",))
            self.put = gui.add_button("Add effect")
            self.put.on_click(host.guarded(lambda _: self.add(self.choice.value)))
            self.lacking = gui.add_html("")

    def _installed(self) -> None:
        host, gui = self.host, self.host.gui
        with gui.add_folder("In the model"):
            self.inside = gui.add_html("")
            self.sliders = EffectSliders(host, self._set, lambda name: self._change(partial(self.effects.remove, name)))
            self.refit = gui.add_button("Fit all again on this flight", color="gray")
            self.refit.on_click(host.guarded(lambda _: self._change(partial(self.effects.refit, self.host.scene.name))))

    def _next(self) -> None:
        host, gui = self.host, self.host.gui
        with gui.add_folder("What to fly next") as self.next_folder:
            self.pair = gui.add_text("effects", "", hint="Two or more effects to separate, with commas between.")
            hint = "Searches for the reference, flies it in simulation and draws it in the scene; takes half a minute."
            self.design = JobControls(host, "Find the flight that separates them", self._tell_named_apart, hint)
            self.plan = gui.add_html("")
            self.plan_path = gui.add_text("file", "separate.toml", visible=False)
            words = f"{'Save' if self.effects.saves else 'Download'} the trajectory"
            self.plan_save = gui.add_button(words, visible=False, color="gray")
            self.plan_save.on_click(host.guarded(self._save_plan))
            self.plan_clear = gui.add_button("Take it out of the scene", visible=False, color="gray")
            self.plan_clear.on_click(host.guarded(lambda _: self._draw_plan(None)))

    def _save(self) -> None:
        host, gui = self.host, self.host.gui
        with gui.add_folder("Save the model"):
            self.path = gui.add_text("file", "fitted.toml", hint=SAVES if self.effects.saves else DOWNLOADS)
            self.save = gui.add_button("Save model" if self.effects.saves else "Download model")
            self.save.on_click(host.guarded(self._saved))

    def opened(self, scene: Scene) -> None:
        """Another flight, or another model. The errors on a long flight are worked out beside the page at first."""
        self.state = state = self.effects.state(scene.name)
        self.links.start()
        self.back.label, self.back.visible = f"Undo: {state.undo}", bool(state.undo)
        self.again.label, self.again.visible = f"Redo: {state.redo}", bool(state.redo)
        self.choice.options = state.available or ("-",)
        lacking = [f"not here: {', '.join(names)}: {reason}" for reason, names in not_tried(state.untried).items()]
        self.lacking.content = sentences(*lacking, look="wg-pale")
        self.inside.content = html.render("installed", effects=state.installed, vehicle=self.host.session.vehicle)
        self.sliders.show(state.installed)
        self.refit.visible = bool(state.installed)
        found = self.searches.get(scene.name)
        self.found.content = "" if found is None else self._search_html(*found, state)
        beside, self._flight = is_long(scene) and scene.name != self._flight, scene.name
        if beside:
            self._climb((), f"looking at {scene.name} ...")
        self.look_up(partial(self.effects.staircases, scene.name), self._climb, in_background=beside)

    def _climb(self, staircases: tuple[Staircase, ...], words: str = "") -> None:
        self.stairs.content = html.render("model", state=self.state, staircases=staircases, words=words)

    def _search_html(self, found: Explanation, model: str, state: ModelState) -> str:
        """Verdict and candidates, with links that add effects and lead to the flight that separates a group."""
        from wrenchgap.replay.present import detection, explanation  # here: the page stands before it is there

        inside = {i.name for i in state.installed}
        names = dict.fromkeys([*found.effects, *(c.name for c in found.ranking)])
        rest = [n for n in found.effects if n not in inside]
        fitted = zip(found.fit.parameters, found.fit.theta, found.fit.std, strict=True)
        return html.render(
            "search",
            found=found,
            summary=explanation.summary(found),
            values=[(name, html.parameter_in_words(parameter, v, std)) for (name, parameter), v, std in fitted],
            open=explanation.open_in_words(found),
            shown=detection.sentences(found),
            alike={r.name for m in found.members for r in m.alike},
            vehicle=self.host.session.vehicle,
            searched_on=model,
            model=state.name,
            inside=inside,
            meaning=VERDICTS.get(found.verdict, ""),
            most=12,
            adding={name: self.links.to(partial(self.add, name)) for name in names if name not in inside},
            rest=rest if len(rest) > 1 else [],
            adding_rest=self.links.to(partial(self.add, *rest)),
            groups=[(group, self.links.to(partial(self.tell_apart, group))) for group in found.separable],
        )

    def add(self, *names: str) -> None:
        """Put effects into the model, fitted on the flight shown."""
        if self.state is None or any(n not in self.state.available for n in names):
            raise UsageError(f"{', '.join(names)}: cannot be added on this flight; choose an effect of the list")
        self._change(partial(self.effects.add, tuple(names), self.host.scene.name))

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

    def _set(self, effect: str, parameter: str, value: float) -> None:
        self._change(partial(self.effects.set_value, effect, parameter, value))

    def _explain(self) -> None:
        flight, model = self.host.scene.name, self.effects.working.name

        def done(found: Explanation) -> None:
            self.searches[flight] = found, model
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

    def _saved(self, event: Any) -> None:
        name = self.path.value.strip()
        if not self.effects.saves:
            download(event.client, name, self.effects.model_text(name).encode())
            return
        words = self.effects.save(name)
        self.host.refresh()
        self.host.notify(words)
