"""The compensation: its gate, what it would have done on this flight, and the flight re-simulated with it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from wrenchgap.flight.flight import AXES
from wrenchgap.replay.present.numbers import row, share, unit_of
from wrenchgap.replay.session.compensation import Compensation, SessionCompensation
from wrenchgap.viewer import markup
from wrenchgap.viewer.host import Host
from wrenchgap.viewer.panel import JobControls, Panel
from wrenchgap.viewer.scene import Motion, Scene
from wrenchgap.viewer.scene_drawing import tidy

if TYPE_CHECKING:
    from wrenchgap.compensate import Settings
    from wrenchgap.replay.compensation.replay import Replay
    from wrenchgap.replay.counterfactual.counterfactual import Counterfactual

NO_PROCESS = (
    "There is no Gaussian process to compensate with. Learn one and open the page with it:",
    "wrenchgap learn LOG -m MODEL -o torque.gp",
    "wrenchgap view LOG -m MODEL --gp torque.gp",
)
GHOST = "re-simulated"
"""Name of the ghost in the scene."""


class CompensationPanel(Panel):
    """Switch and sliders of the compensation, its replay, and the counterfactual."""

    flown_seconds = 20.0
    """Length of a re-flight unless the user says otherwise [s]: it takes some seconds."""

    def __init__(self, host: Host, compensations: SessionCompensation) -> None:
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
        gui, gate = self.host.gui, setting.gate
        threshold, kappa = float(gate.sigma_threshold or 0.0), float(gate.kappa or 0.0)
        self.usual = setting.on, gate.filter_uncertain, threshold, kappa, gate.decay_time
        self.name = setting.name
        title = f"process: {self.name}"
        gui.add_html(markup.render("table", heading=title, head=(), rows=(), sentences=setting.notes, look="wg-warn"))
        self.on = gui.add_checkbox("compensate", setting.on)
        self.gated = gui.add_checkbox(
            "withhold where uncertain", gate.filter_uncertain, hint="beta = 1 / (1 + exp(-kappa (sigma - sigma_th)))"
        )
        hint = "Standard deviation at which half of the correction is withheld."
        self.threshold = self._slider(f"sigma_th [{setting.unit}]", threshold, 3.0 * threshold, hint)
        hint = "Gate slope: how sharply the correction fades around sigma_th."
        self.kappa = self._slider(f"kappa [1/{setting.unit}]", kappa, 5.0 * kappa, hint)
        hint = "Time constant with which a withheld correction fades; a = exp(-dt / tau_d) per step."
        self.decay = gui.add_slider("tau_d [s]", 0.01, 1.0, 0.01, gate.decay_time, hint=hint)
        self._controls = (self.on, self.gated, self.threshold, self.kappa, self.decay)
        for handle in self._controls:
            handle.on_update(self.host.guarded(self._moved))
        reset = gui.add_button("Defaults of the process", color="gray")
        reset.on_click(self.host.guarded(lambda _: self._reset()))

    def _slider(self, label: str, usual: float, largest: float, hint: str) -> Any:
        """A slider of about 300 round steps."""
        step = tidy(largest / 300.0)
        return self.host.gui.add_slider(label, step, step * round(largest / step), step, usual, hint=hint)

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
            self.seconds = gui.add_number("for [s]", self.flown_seconds, min=1.0, step=1.0)
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
            self.seconds.value = min(self.flown_seconds, float(scene.time[-1] - scene.time[0]))

    @property
    def gate(self) -> Settings:
        """The settings as the controls have them. Raises UsageError for impossible values."""
        from wrenchgap.compensate import Settings

        gated, threshold, kappa, decay = (handle.value for handle in self._controls[1:])
        return Settings(filter_uncertain=gated, sigma_threshold=threshold, kappa=kappa, decay_time=decay)

    def _moved(self, event: Any) -> None:
        """A client changed a setting: what was replayed is replayed anew, the last change wins."""
        if event.client_id is not None:
            self._changed()

    def _changed(self) -> None:
        replayed = bool(self.done.content) or self.work.running
        self.compensations.set(self.gate, self.on.value)
        if replayed and self.on.value:
            self.replay()
        else:
            self.host.refresh()

    def _reset(self) -> None:
        for handle, usual in zip(self._controls, self.usual, strict=True):
            handle.value = usual
        self._changed()

    def replay(self) -> None:
        """Replay the compensation on the flight shown."""
        flight = self.host.scene.name

        def done(found: Replay) -> None:
            self.done.content = _replay_html(found)
            self.host.refresh()

        self.work.start(lambda report: self.compensations.replay(flight, report), done)

    def refly(self) -> None:
        """Fly the flight shown again, in a ghost."""
        flight, start, seconds = self.host.scene.name, float(self.start.value), float(self.seconds.value)

        def done(found: Counterfactual) -> None:
            ghost = ghost_of(found, self.name)
            self.flown.content = _tracking_html(found, ghost.words)
            self.host.show_ghost(GHOST, ghost)

        self.again.start(lambda report: self.compensations.refly(flight, start, seconds, report), done)


def _replay_html(found: Replay) -> str:
    """The mismatch of each output before and after the correction, and how much of it was withheld."""
    from wrenchgap.replay.present import replay  # here: the page stands before it is there

    steps = found.steps
    before, after = (row(np.mean(np.abs(m), axis=0)) for m in (steps.mismatch_before, steps.mismatch_after))
    axes = [f"{axis} [{unit_of(AXES.index(axis))}]" for axis in found.outputs]
    return markup.render(
        "table",
        heading="mean absolute error of the wrench, as the process predicts it",
        head=("", "before", "after"),
        rows=list(zip(axes, before, after, strict=True)),
        sentences=(*withheld_in_words(found), *replay.notes(found)),
        look="wg-muted",
    )


def _tracking_html(found: Counterfactual, words: str) -> str:
    """Tracking errors of the re-simulated flight beside those of the recorded one."""
    from wrenchgap.replay.present import counterfactual  # here: the page stands before it is there

    return markup.render(
        "table",
        heading=f"tracking error: {words}",
        head=("", "recorded", "null run", GHOST),
        rows=counterfactual.tracking_rows(found),
        sentences=(counterfactual.null_run_in_words(found), *counterfactual.notes(found)),
        look="wg-muted",
    )


def ghost_of(found: Counterfactual, name: str, rate_hz: float = 50.0) -> Motion:
    """The re-simulated flight as it is drawn, at about `rate_hz` instants a second; `name` of the GP."""
    state, commands = found.changed.flown.state, found.changed.flown.commands
    every = max(1, round(1.0 / (rate_hz * found.inference.recording.dt)))
    return Motion(
        state.time[::every],
        state.position_E[::every],
        state.quat_EB[::every],
        None if commands.tilt is None else commands.tilt[::every],
        f"compensated by {name}" if found.change.process is not None else "re-simulated, nothing changed",
    )


def withheld_in_words(replay: Replay) -> list[str]:
    """How much of the correction was withheld, how it fades, and steps in which something went wrong."""
    withheld = share(float(np.mean(replay.steps.beta > 0.5)))
    fading = np.exp(-replay.dt / replay.settings.decay_time)
    return [
        f"{len(replay)} steps of {1e3 * replay.dt:.3g} ms; more than half of the correction is withheld in {withheld} "
        f"of them. a = exp(-dt / tau_d) = {fading:.3f}.",
        *(f"{count} steps: {words}" for words, count in replay.steps.trouble.items()),
    ]
