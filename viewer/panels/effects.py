"""Effects: what is missing, put it in, watch the error fall, take it out again, set it by hand, save the model."""

from __future__ import annotations

from functools import partial
from typing import Any

from wrenchgap.flight.errors import UsageError
from wrenchgap.viewer import markup, search_results
from wrenchgap.viewer.analysis import Effects, ModelState, NextFlight, Ranking, Staircase
from wrenchgap.viewer.host import Host
from wrenchgap.viewer.html_links import Links
from wrenchgap.viewer.job_controls import JobControls
from wrenchgap.viewer.panel import Panel
from wrenchgap.viewer.scene import Motion, Scene
from wrenchgap.viewer.sliders import EffectSliders

NEXT = "next flight"
"""Name of the designed trajectory in the scene."""
PATH = (120, 60, 190)


class EffectsPanel(Panel):
    """The model as it stands, the search for what it lacks, and the staircase of errors down to the noise."""

    def __init__(self, host: Host, effects: Effects) -> None:
        super().__init__(host)
        self.effects = effects
        self.state: ModelState | None = None
        self.rankings: dict[str, Ranking] = {}
        self.designed: NextFlight | None = None
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
        gui, host = self.host.gui, self.host
        with gui.add_folder("What is missing?"):
            self.work = JobControls(
                host,
                "Search",
                self._explain,
                "Tries every effect of the catalogue on held-out time of this flight; the page stays usable.",
            )
            self.found = gui.add_html("")
            self.choice = gui.add_dropdown("by name", ("-",))
            self.put = gui.add_button("Add effect")
            self.put.on_click(host.guarded(lambda _: self.add(self.choice.value)))
            self.lacking = gui.add_html("")

    def _installed(self) -> None:
        gui, host = self.host.gui, self.host
        with gui.add_folder("In the model"):
            self.inside = gui.add_html("")
            self.sliders = EffectSliders(host, self._set, lambda name: self._change(partial(self.effects.remove, name)))
            self.refit = gui.add_button("Fit all again on this flight", color="gray")
            self.refit.on_click(host.guarded(lambda _: self._change(partial(self.effects.refit, self.host.scene.name))))

    def _next(self) -> None:
        gui, host = self.host.gui, self.host
        with gui.add_folder("What to fly next") as self.next_folder:
            self.pair = gui.add_text("effects", "", hint="Two or more effects to be told apart, with commas between.")
            self.design = JobControls(
                host,
                "Find the flight that tells them apart",
                lambda: self.tell_apart(tuple(n.strip() for n in self.pair.value.split(",") if n.strip())),
                "Searches for the reference, flies it in simulation and draws it in the scene; takes half a minute.",
            )
            self.plan = gui.add_html("")
            self.plan_path = gui.add_text("file", "separate.toml", visible=False)
            self.plan_save = gui.add_button("Save the trajectory", visible=False, color="gray")
            self.plan_save.on_click(host.guarded(lambda _: self._save_plan()))
            self.plan_clear = gui.add_button("Take it out of the scene", visible=False, color="gray")
            self.plan_clear.on_click(host.guarded(lambda _: self._draw_plan(None)))

    def _save(self) -> None:
        gui, host = self.host.gui, self.host
        with gui.add_folder("Save the model"):
            self.path = gui.add_text(
                "file", "fitted.toml", hint="Written into the folder in which the page was started."
            )
            self.overwrite = gui.add_checkbox("overwrite", False, hint="Replace the file if it is there.")
            self.save = gui.add_button("Save model")
            self.save.on_click(host.guarded(lambda _: self._saved()))

    @classmethod
    def of(cls, host: Host) -> Panel | None:
        """The panel of a session that can do this."""
        found = host.session.capabilities.effects
        return None if found is None else cls(host, found)

    # ------------------------------------------------------------ what is shown

    def opened(self, scene: Scene) -> None:
        """Another flight, or another model."""
        self.state = state = self.effects.state(scene.name)
        self.links.start()
        self.stairs.content = self._staircases(state)
        self.back.label, self.back.visible = f"Undo: {state.undo}", bool(state.undo)
        self.again.label, self.again.visible = f"Redo: {state.redo}", bool(state.redo)
        self.choice.options = state.available or ("-",)
        self.lacking.content = search_results.lacking(state)
        self.inside.content = search_results.inside(state)
        self.sliders.show(state.installed)
        self.refit.visible = bool(state.installed)
        found = self.rankings.get(scene.name)
        names = {i.name for i in state.installed}
        self.found.content = "" if found is None else search_results.page(found, state.model, names, self.links, self)

    def _staircases(self, state: ModelState) -> str:
        """The number that matters, large, and the steps that led there."""
        dot = "" if state.saved else ' <span style="color:#c77700" title="not in a file yet">not saved</span>'
        parts = [markup.heading(f"model: {markup.text(state.model)}{dot}")]
        for stairs in state.staircases:
            parts.append(self._one(stairs))
        if state.words:
            parts.append(markup.paragraph(f"last fit, on time that was not fitted: {markup.text(state.words)}"))
        return markup.box(*parts)

    def _one(self, stairs: Staircase) -> str:
        last, first, noise = stairs.stairs[-1], stairs.stairs[0], stairs.noise
        most = max(s.in_all for s in stairs.stairs)
        colour = "#2a7d2e" if last.in_all < 1.5 * noise.in_all else "inherit"
        change = last.in_all / first.in_all - 1.0 if len(stairs.stairs) > 1 else 0.0
        fall = f" ({100 * change:+.0f} %)" if len(stairs.stairs) > 1 else ""
        top = (
            f'<div style="margin-top:8px">{markup.text(stairs.title)}</div>'
            f'<div style="font-size:20px;font-weight:600;color:{colour}">{markup.number(last.in_all)} N'
            f'<span style="font-size:12px;font-weight:400;color:#666"> rms in all{fall}; noise '
            f"{markup.number(noise.in_all, 2)} N</span></div>"
        )
        rows = [
            (
                f'<span style="white-space:nowrap" title="{search_results.by_axis(s.rms)}">{markup.text(s.name)}</span>',
                markup.bar([(s.in_all / most, "#b9b9b9" if s is noise else "#3b82c4", f"{s.in_all:.3g} N")]),
                markup.number(s.in_all),
                *(markup.number(v, 2) for v in search_results.norms(s.rms)),
            )
            for s in (*stairs.stairs, noise)
        ]
        return top + markup.table(("", markup.wide(60), "all [N]", "F [N]", "M [Nm]"), rows, left=2)

    # ------------------------------------------------------------ what is done

    def add(self, *names: str) -> None:
        """Put effects into the model, fitted on the flight shown."""
        if self.state is None or any(n not in self.state.available for n in names):
            raise UsageError(f"{', '.join(names)}: cannot be added on this flight; choose an effect of the list")
        self._change(partial(self.effects.add, tuple(names), self.host.scene.name))

    def tell_apart(self, names: tuple[str, ...]) -> None:
        """Search for the flight that tells these effects apart."""
        if len(set(names)) < 2:
            raise UsageError("name at least two effects, e.g. servo_lag, command_delay")
        flight = self.host.scene.name
        self.pair.value = ", ".join(names)
        self.design.start(lambda report: self.effects.next_flight(names, flight, report), self._draw_plan)

    def _change(self, do: Any) -> None:
        do()
        self.host.refresh()

    def _set(self, effect: str, parameter: str, value: float) -> None:
        self._change(partial(self.effects.set_value, effect, parameter, value))

    def _explain(self) -> None:
        flight = self.host.scene.name

        def done(found: Ranking) -> None:
            self.rankings[flight] = found
            self.opened(self.host.scene)

        self.work.start(lambda report: self.effects.explain(flight, report), done)

    def _draw_plan(self, plan: NextFlight | None) -> None:
        """Show a designed flight: in words, as a curve in the scene, and as a ghost that flies it from the start."""
        self.designed = plan
        self.host.curve(NEXT, None if plan is None else plan.position_E, PATH)
        if plan is not None:
            start = float(self.host.scene.time[0])
            motion = Motion(
                plan.time + start, plan.position_E, plan.quat_ED, None, f"to tell {' from '.join(plan.names)}"
            )
            self.host.show_ghost(NEXT, motion)
        self.plan.content = "" if plan is None else search_results.plan(plan)
        shown = plan is not None
        self.plan_path.visible = self.plan_save.visible = shown and plan is not None and plan.separable
        self.plan_clear.visible = shown

    def _save_plan(self) -> None:
        if self.designed is not None:
            self.host.notify(self.effects.save_trajectory(self.designed, self.plan_path.value.strip()))

    def _saved(self) -> None:
        words = self.effects.save(self.path.value.strip(), overwrite=self.overwrite.value)
        self.overwrite.value = False
        self.host.refresh()
        self.host.notify(words)
