"""The compensation: its gate, what it would have done on this flight, and the flight re-simulated with it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

import wrenchgap as wg
from wrenchgap.flight import AXES, UsageError
from wrenchgap.learn.process.gp import GaussianProcess
from wrenchgap.plant.model import Model
from wrenchgap.replay.present.notes import sentence
from wrenchgap.replay.present.numbers import row, share, unit_of
from wrenchgap.replay.session.worker import worker_result
from wrenchgap.replay.session.working_model import WorkingModel
from wrenchgap.viewer import markup
from wrenchgap.viewer.host import Host
from wrenchgap.viewer.panel import JobControls, Panel
from wrenchgap.viewer.scene_drawing import tidy
from wrenchgap.viewer.session import Motion, Report, Scene, Series

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


AS_SET, NOTHING = "the process, as set here", "nothing changed"
LAWS = {"disturbance observer": "observer", "INDI": "indi", "L1 adaptive": "l1"}
"""What the re-simulation flies with, and the name of each feedback on the command line."""

GROUP = "Correction"
"""Where the page shows what a replay did."""


@dataclass(frozen=True)
class Compensation:
    """The compensation as it is set, for a GP called `name`: on or off, and its gate, whose sigma is in `unit`."""

    name: str
    gate: Settings
    unit: str
    notes: tuple[str, ...]
    on: bool = True


class SessionCompensation:
    """The compensation of a working model; without a GP there is none."""

    def __init__(self, working: WorkingModel, name: str) -> None:
        self.working = working
        self.setting = None if working.gp is None else _setting(working.gp, working.opened_model, name)
        """The compensation as it is set, None without a GP."""
        self._replayed: dict[str, Replay] = {}

    def set(self, gate: Settings, on: bool = True) -> None:
        """Change it; what was replayed with other settings is forgotten."""
        with self.working.lock:
            setting = replace(self._known()[1], gate=gate, on=on)
            if setting != self.setting:
                self.setting = setting
                self._replayed.clear()

    def series(self, flight: str) -> tuple[Series, ...]:
        """What the last replay on a flight did, as plots; nothing where there was none, or it is switched off."""
        done = self._replayed.get(flight)
        if done is None or self.setting is None or not self.setting.on:
            return ()

        sigma = {"sigma": done.steps.sigma}
        if self.setting.gate.filter_uncertain:
            sigma["threshold"] = np.full(len(done.time), self.setting.gate.sigma_threshold)
        wrench = done.steps.correction.T
        force, torque = (dict(zip("xyz", part, strict=True)) for part in (wrench[:3], wrench[3:]))
        plots = (
            ("correction, force", "N", force),
            ("correction, torque", "Nm", torque),
            ("sigma of the correction", self.setting.unit, sigma),
            ("beta (1: correction withheld)", "", {"beta": done.steps.beta}),
        )
        shown = [one for one in plots if not one[0].startswith("correction") or np.any(list(one[2].values()))]
        return tuple(Series(title, unit, done.time, values, GROUP) for title, unit, values in shown)

    def replay(self, flight: str, report: Report) -> Replay:
        """Replay the compensation on a flight; afterwards its scene has correction, sigma and beta."""
        with self.working.lock:
            gp, setting = self._known()
            log, model = self.working.flight(flight), self.working.opened_model
        found = worker_result(lambda tell: wg.replay_compensation(log, model, gp, setting.gate, progress=tell), report)
        found = replace(found, flight=log.flight, model=model, gp=gp)  # in place of the copies of the other process
        with self.working.lock:
            if setting is self.setting:  # not changed meanwhile
                self._replayed[flight] = found
        return found

    def refly(
        self, flight: str, start: float, duration: float, report: Report, feedback: str | None = None
    ) -> Counterfactual:
        """Re-simulate (a part of) a flight: with the compensation in the loop, or as it was where that is off.

        With `feedback` in its place where that is a text such as "indi=8" (`compensators.feedback`).
        """
        from wrenchgap.learn.data.recording import read_recording  # here: others need not wait for them
        from wrenchgap.replay.compensation import compensators
        from wrenchgap.replay.counterfactual.change import Change
        from wrenchgap.replay.counterfactual.counterfactual import counterfactual

        with self.working.lock:
            gp, setting = self.working.gp, self.setting
            log, model, given = self.working.flight(flight), self.working.model, self.working.opened_model

        def work(tell: Report) -> Counterfactual:
            recording = read_recording(log, model.vehicle, start=start, duration=duration)
            change = Change()
            if feedback is not None:
                name, law = compensators.feedback(feedback, given, recording.dt, gp)
                change = Change(compensator=law, words=(f"corrected by {name}",))
            elif setting is not None and gp is not None and setting.on:
                gate = replace(setting.gate, dt=recording.dt)
                words = (f"compensated by {setting.name}",)
                change = Change(compensator=compensators.compensator(gp, given, gate), process=gp, words=words)
            return counterfactual(recording, model, change, progress=tell)

        return worker_result(work, report)

    def _known(self) -> tuple[GaussianProcess, Compensation]:
        if self.working.gp is None or self.setting is None:
            raise UsageError("there is no GP to compensate with; open the page with --gp GP (see `wrenchgap learn`)")
        return self.working.gp, self.setting


def _setting(gp: GaussianProcess, model: Model, name: str) -> Compensation:
    """The defaults that the GP suggests."""
    from wrenchgap.compensate import Settings  # here: others need not wait for them
    from wrenchgap.replay.compensation.compensators import caveats, compensator
    from wrenchgap.replay.present.learning import of_process

    made = compensator(gp, model)
    usual = made.uncertainty
    gated = bool(np.isfinite(usual.threshold))
    threshold = float(usual.threshold) if gated else float(np.max(gp.sigma_prior))
    kinds = {axis.split("_")[0] for axis in gp.outputs}
    unit = "of its range" if len(kinds) > 1 else "N" if kinds == {"force"} else "Nm"
    gate = Settings(filter_uncertain=gated, sigma_threshold=threshold, kappa=float(usual.kappa))
    slow = () if made.not_compiled is None else (sentence(made.not_compiled),)
    return Compensation(name, gate, unit, (*of_process(caveats(gp, model)), *slow))


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
            else:
                self._settings(setting)
                with host.gui.add_folder("Replay on this flight"):
                    hint = (
                        "Steps the compensator through the logged wrenches; the plots then show correction, sigma "
                        "and beta."
                    )
                    self.work = JobControls(host, "Replay", self.replay, hint)
                    self.done = host.gui.add_html("")
            self._resimulation()

    def _resimulation(self) -> None:
        """What flies, from when and for how long."""
        gui = self.host.gui
        with gui.add_folder("Re-simulate"):
            first = AS_SET if self.ready else NOTHING
            hint = "What corrects the wrench in the re-simulation: the process as it is set here, or feedback alone."
            self.law = gui.add_dropdown("with", (first, *LAWS), hint=hint)
            self.cutoff = gui.add_number(
                "cut-off [Hz]", 0.0, min=0.0, step=0.5, hint="Of the feedback; 0: its default (docs: Compensation)."
            )
            self.start = gui.add_number("from [s]", 0.0, min=0.0, step=0.1)
            self.seconds = gui.add_number("for [s]", self.flown_seconds, min=1.0, step=1.0)
            hint = "Re-simulates the flight from its recorded state, with this in the loop; shown as ghost."
            self.again = JobControls(self.host, "Re-simulate", self.refly, hint)
            self.flown = gui.add_html("")

    @property
    def feedback(self) -> str | None:
        """The feedback that is chosen, as `compensators.feedback` takes it; None for the process, or nothing."""
        law = LAWS.get(self.law.value)
        return f"{law}={self.cutoff.value:g}" if law and self.cutoff.value > 0 else law

    def _settings(self, setting: Compensation) -> None:
        gui, gate = self.host.gui, setting.gate
        threshold, kappa = float(gate.sigma_threshold or 0.0), float(gate.kappa or 0.0)
        self.usual = setting.on, gate.filter_uncertain, threshold, kappa, gate.decay_time
        title = f"process: {setting.name}"
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
            self.host.connect(handle, self._moved)
        self.host.connect(gui.add_button("Defaults of the process", color="gray"), lambda _: self._reset())

    def _slider(self, label: str, usual: float, largest: float, hint: str) -> Any:
        """A slider of about 300 round steps."""
        step = tidy(largest / 300.0)
        return self.host.gui.add_slider(label, step, step * round(largest / step), step, usual, hint=hint)

    def opened(self, scene: Scene) -> None:
        """Another flight, or another model."""
        if scene.name != getattr(self, "flight", None):
            self.flight = scene.name
            if self.ready:
                self.work.cancel()
                self.done.content = ""
            self.again.cancel()
            self.flown.content = ""
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
        feedback = self.feedback

        def done(found: Counterfactual) -> None:
            from wrenchgap.replay.present import counterfactual  # here: the page stands before it is there

            ghost = ghost_of(found)
            self.flown.content = markup.render(
                "table",
                heading=f"tracking error: {ghost.words}",
                head=("", "recorded", "null run", GHOST),
                rows=counterfactual.tracking_rows(found),
                sentences=(counterfactual.null_run_in_words(found), *counterfactual.notes(found)),
                look="wg-muted",
            )
            self.host.show_ghost(GHOST, ghost)

        self.again.start(lambda report: self.compensations.refly(flight, start, seconds, report, feedback), done)


def _replay_html(found: Replay) -> str:
    """The mismatch of each output before and after the correction, how much was withheld, and what went wrong."""
    from wrenchgap.replay.present import replay  # here: the page stands before it is there

    steps = found.steps
    before, after = (row(np.mean(np.abs(m), axis=0)) for m in (steps.mismatch_before, steps.mismatch_after))
    axes = [f"{axis} [{unit_of(AXES.index(axis))}]" for axis in found.outputs]
    withheld, fading = share(float(np.mean(steps.beta > 0.5))), np.exp(-found.dt / found.settings.decay_time)
    sentences = [
        f"{len(found)} steps of {1e3 * found.dt:.3g} ms; more than half of the correction is withheld in {withheld} "
        f"of them. a = exp(-dt / tau_d) = {fading:.3f}.",
        *(f"{count} steps: {words}" for words, count in steps.trouble.items()),
        *replay.notes(found),
    ]
    return markup.render(
        "table",
        heading="mean absolute error of the wrench, as the process predicts it",
        head=("", "before", "after"),
        rows=list(zip(axes, before, after, strict=True)),
        sentences=sentences,
        look="wg-muted",
    )


def ghost_of(found: Counterfactual, rate_hz: float = 50.0) -> Motion:
    """The re-simulated flight as it is drawn, at about `rate_hz` instants a second."""
    state, commands = found.changed.flown.state, found.changed.flown.commands
    every = max(1, round(1.0 / (rate_hz * found.inference.recording.dt)))
    return Motion(
        state.time[::every],
        state.position_E[::every],
        state.quat_EB[::every],
        None if commands.tilt is None else commands.tilt[::every],
        "; ".join(found.change.words) or "re-simulated, nothing changed",
    )
