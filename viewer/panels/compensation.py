"""The compensation: its gate, what it would have done on this flight, and the flight re-simulated with it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from wrenchgap.viewer import markup
from wrenchgap.viewer.analysis import Compensated, Compensation, Compensations, Gating, Reflown
from wrenchgap.viewer.host import Host
from wrenchgap.viewer.job_controls import JobControls
from wrenchgap.viewer.panel import Panel
from wrenchgap.viewer.scene import Scene
from wrenchgap.viewer.scene_drawing import tidy

NO_PROCESS = (
    "There is no Gaussian process to compensate with. Learn one and open the page with it:",
    "wrenchgap learn LOG -m MODEL -o torque.gp",
    "wrenchgap view LOG -m MODEL --gp torque.gp",
)
GHOST = "re-simulated"
"""Name of the ghost in the scene."""
SECONDS = 20.0
"""Length of a re-flight unless the user says otherwise [s]."""


class CompensationPanel(Panel):
    """Switch and sliders of the compensation, its replay, and the counterfactual."""

    asks = "compensations"

    def __init__(self, host: Host, compensations: Compensations) -> None:
        super().__init__(host)
        self.compensations = compensations
        setting = compensations.setting
        self.ready = setting is not None
        with host.tab("Compensation"):
            if setting is None:
                host.gui.add_html(markup.sentences(*NO_PROCESS))
                return
            self._settings(setting)
            self._replay()
            self._refly()

    def _settings(self, setting: Compensation) -> None:
        gui, gating = self.host.gui, setting.gating
        self.usual = gating
        title = f"process: {setting.name}"
        gui.add_html(markup.render("table", heading=title, head=(), rows=(), sentences=setting.notes, look="wg-warn"))
        self.on = gui.add_checkbox("compensate", gating.on)
        self.gated = gui.add_checkbox(
            "withhold where uncertain", gating.gated, hint="beta = 1 / (1 + exp(-kappa (sigma - sigma_th)))"
        )
        step, first = tidy(setting.sigma_threshold_max / 300.0), tidy(setting.kappa_max / 300.0)
        hint = "Standard deviation at which half of the correction is withheld."
        most, name = step * round(setting.sigma_threshold_max / step), f"sigma_th [{setting.unit}]"
        self.threshold = gui.add_slider(name, step, most, step, gating.sigma_threshold, hint=hint)
        hint = "Gate slope: how sharply the correction fades around sigma_th."
        most, name = first * round(setting.kappa_max / first), f"kappa [1/{setting.unit}]"
        self.kappa = gui.add_slider(name, first, most, first, gating.kappa, hint=hint)
        hint = "Time constant with which a withheld correction fades; a = exp(-dt / tau_d) per step."
        self.decay = gui.add_slider("tau_d [s]", 0.01, setting.decay_time_max, 0.01, gating.decay_time, hint=hint)
        self._controls = (self.on, self.gated, self.threshold, self.kappa, self.decay)
        for handle in self._controls:
            handle.on_update(self.host.guarded(self._moved))
        reset = gui.add_button("Defaults of the process", color="gray")
        reset.on_click(self.host.guarded(lambda _: self._reset()))

    def _replay(self) -> None:
        gui = self.host.gui
        with gui.add_folder("Replay on this flight"):
            hint = "Steps the compensator through the logged wrenches; the plots then show correction, sigma and beta."
            self.work = JobControls(self.host, "Replay", self.replay, hint)
            self.done = gui.add_html("")

    def _refly(self) -> None:
        gui = self.host.gui
        with gui.add_folder("Re-simulate"):
            self.start = gui.add_number("from [s]", 0.0, min=0.0, step=0.1)
            self.seconds = gui.add_number("for [s]", SECONDS, min=1.0, step=1.0)
            hint = "Re-simulates the flight from its recorded state, with the compensation in the loop; shown as ghost."
            self.again = JobControls(self.host, "Re-simulate", self.refly, hint)
            self.flown = gui.add_html("")

    def opened(self, scene: Scene) -> None:
        """Another flight, or another model."""
        if self.ready and scene.name != getattr(self, "flight", None):
            self.flight = scene.name
            self.work.cancel()
            self.again.cancel()
            self.done.content, self.flown.content = "", ""
            self.start.value = float(scene.time[0])
            self.seconds.value = min(SECONDS, float(scene.time[-1] - scene.time[0]))

    @property
    def gating(self) -> Gating:
        """The settings as the controls have them."""
        return Gating(*(handle.value for handle in self._controls))

    def _moved(self, event: Any) -> None:
        """A client changed a setting: what was replayed is replayed anew, the last change wins."""
        if event.client_id is not None:
            self._changed()

    def _changed(self) -> None:
        replayed = bool(self.done.content) or self.work.running
        self.compensations.set(self.gating)
        if replayed and self.on.value:
            self.replay()
        else:
            self.host.refresh()

    def _reset(self) -> None:
        for handle, usual in zip(self._controls, vars(self.usual).values(), strict=True):
            handle.value = usual
        self._changed()

    def replay(self) -> None:
        """Replay the compensation on the flight shown."""
        flight = self.host.scene.name

        def done(found: Compensated) -> None:
            title = "mean absolute error of the wrench, as the process predicts it"
            self.done.content = _table(title, ("", "before", "after"), found.rows, found.sentences)
            self.host.refresh()

        self.work.start(lambda report: self.compensations.replay(flight, report), done)

    def refly(self) -> None:
        """Fly the flight shown again, in a ghost."""
        flight, start, seconds = self.host.scene.name, float(self.start.value), float(self.seconds.value)

        def done(found: Reflown) -> None:
            head = ("", "recorded", "null run", GHOST)
            self.flown.content = _table(f"tracking error: {found.motion.words}", head, found.rows, found.sentences)
            self.host.show_ghost(GHOST, found.motion)

        self.again.start(lambda report: self.compensations.refly(flight, start, seconds, report), done)


def _table(heading: str, head: Sequence[str], rows: Sequence[Sequence[str]], sentences: Sequence[str]) -> str:
    return markup.render("table", heading=heading, head=head, rows=rows, sentences=sentences, look="wg-muted")
