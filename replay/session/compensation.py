"""The compensation of a session's GP: replayed on a flight, and re-simulated with it in the loop, for the viewer."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from wrenchgap.flight.errors import UsageError
from wrenchgap.learn.process.gp import GaussianProcess
from wrenchgap.plant.model import Model
from wrenchgap.replay.present.notes import sentence
from wrenchgap.replay.session.worker import worker_result
from wrenchgap.replay.session.working_model import WorkingModel
from wrenchgap.viewer.background import Report
from wrenchgap.viewer.scene import Series

if TYPE_CHECKING:
    from wrenchgap.compensate import Settings
    from wrenchgap.replay.compensation.replay import Replay
    from wrenchgap.replay.counterfactual.counterfactual import Counterfactual

GROUP = "Compensation"
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
        from wrenchgap.replay import api  # here: others need not wait for them

        with self.working.lock:
            gp, setting = self._known()
            log, model = self.working.flight(flight), self.working.opened_model
        found = worker_result(lambda tell: api.replay_compensation(log, model, gp, setting.gate, progress=tell), report)
        found = replace(found, flight=log.flight, model=model, gp=gp)  # in place of the copies of the other process
        with self.working.lock:
            if setting is self.setting:  # not changed meanwhile
                self._replayed[flight] = found
        return found

    def refly(self, flight: str, start: float, duration: float, report: Report) -> Counterfactual:
        """Re-simulate (a part of) a flight: with the compensation in the loop, or as it was where that is off."""
        from wrenchgap.learn.data.recording import read_recording  # here: others need not wait for them
        from wrenchgap.replay.compensation.compensators import compensator
        from wrenchgap.replay.counterfactual.change import Change
        from wrenchgap.replay.counterfactual.counterfactual import counterfactual

        with self.working.lock:
            gp, setting = self._known()
            log, model, given = self.working.flight(flight), self.working.model, self.working.opened_model

        def work(tell: Report) -> Counterfactual:
            recording = read_recording(log, model.vehicle, start=start, duration=duration)
            change = Change()
            if setting.on:
                gate = replace(setting.gate, dt=recording.dt)
                change = Change(compensator=compensator(gp, given, gate), process=gp)
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
