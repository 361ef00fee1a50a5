"""The compensation of a session's GP: replayed on a flight, and re-simulated with it in the loop, for the viewer."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from wrenchgap.flight.errors import UsageError
from wrenchgap.flight.flight import Array
from wrenchgap.learn.process.gp import GaussianProcess
from wrenchgap.plant.model import Model
from wrenchgap.replay.present.notes import sentence
from wrenchgap.replay.present.panels import compensated, reflown
from wrenchgap.replay.session.working_model import WorkingModel
from wrenchgap.viewer.analysis import Compensated, Compensation, Gating, Reflown, Report
from wrenchgap.viewer.scene import Series

if TYPE_CHECKING:
    from wrenchgap.compensate import Settings

GROUP = "Compensation"
"""Where the page shows what a replay did."""
SLOWEST = 1.0
"""Longest time constant of the fading that a slider offers [s]."""


@dataclass(frozen=True)
class _Replayed:
    """What a replay did, on `time` (K,): correction (K, 6), sigma and beta (K,); the summary of it."""

    time: Array
    correction: Array
    sigma: Array
    beta: Array
    summary: Compensated


class SessionCompensation:
    """Implements `viewer.analysis.Compensations` on a working model."""

    def __init__(self, working: WorkingModel, name: str) -> None:
        self.working = working
        self.setting = None if working.gp is None else _setting(working.gp, working.given, name)
        """The compensation as it is set, None without a GP."""
        self._replayed: dict[str, _Replayed] = {}

    def set(self, gating: Gating) -> None:
        """Change it; what was replayed with other settings is forgotten. Raises UsageError for impossible values."""
        with self.working.lock:
            known = self._known()[1]
            if gating != known.gating:
                _settings(gating, 0.01)  # or it raises
                self.setting = replace(known, gating=gating)
                self._replayed.clear()

    def series(self, flight: str) -> tuple[Series, ...]:
        """What the last replay on a flight did, as plots; nothing where there was none, or it is switched off."""
        done = self._replayed.get(flight)
        if done is None or self.setting is None or not self.setting.gating.on:
            return ()

        sigma = {"sigma": done.sigma}
        if self.setting.gating.gated:
            sigma["threshold"] = np.full(len(done.time), self.setting.gating.sigma_threshold)
        force, torque = (dict(zip("xyz", part, strict=True)) for part in (done.correction.T[:3], done.correction.T[3:]))
        plots = (
            ("correction, force", "N", force),
            ("correction, torque", "Nm", torque),
            ("sigma of the correction", self.setting.unit, sigma),
            ("beta (1: correction withheld)", "", {"beta": done.beta}),
        )
        shown = [one for one in plots if not one[0].startswith("correction") or np.any(list(one[2].values()))]
        return tuple(Series(title, unit, done.time, values, GROUP) for title, unit, values in shown)

    def replay(self, flight: str, report: Report) -> Compensated:
        """Replay the compensation on a flight; afterwards its scene has correction, sigma and beta."""
        from wrenchgap.replay.compensation.replay import replay  # here: others need not wait for them
        from wrenchgap.replay.session.worker import apart

        with self.working.lock:
            gp, setting = self._known()
            log, model = self.working.flight(flight), self.working.given
            settings = _settings(setting.gating, 0.01)  # replay takes the period of the log

        def work(tell: Report) -> _Replayed:
            done = replay(log, model, gp, settings, progress=tell)
            steps = done.steps
            return _Replayed(done.time, steps.correction, steps.sigma, steps.beta, compensated(done))

        found = apart(work, report)
        with self.working.lock:
            if setting is self.setting:  # not changed meanwhile
                self._replayed[flight] = found
        return found.summary

    def refly(self, flight: str, start: float, duration: float, report: Report) -> Reflown:
        """Re-simulate (a part of) a flight: with the compensation in the loop, or as it was where that is off."""
        from wrenchgap.learn.data.recording import read_recording  # here: others need not wait for them
        from wrenchgap.replay.compensation.compensators import compensator
        from wrenchgap.replay.counterfactual.change import Change
        from wrenchgap.replay.counterfactual.counterfactual import counterfactual
        from wrenchgap.replay.session.worker import apart

        with self.working.lock:
            gp, setting = self._known()
            log, gating = self.working.flight(flight), setting.gating
            model, given = self.working.model, self.working.given

        def work(tell: Report) -> Reflown:
            recording = read_recording(log, model.vehicle, start=start, duration=duration)
            change = Change()
            if gating.on:
                change = Change(compensator=compensator(gp, given, _settings(gating, recording.dt)), process=gp)
            return reflown(counterfactual(recording, model, change, progress=tell), setting.name)

        return apart(work, report)

    def _known(self) -> tuple[GaussianProcess, Compensation]:
        if self.working.gp is None or self.setting is None:
            raise UsageError("there is no GP to compensate with; open the page with --gp GP (see `wrenchgap learn`)")
        return self.working.gp, self.setting


def _settings(gating: Gating, dt: float) -> Settings:
    from wrenchgap.compensate import Settings  # here: others need not wait for it

    threshold, slope, decay = gating.sigma_threshold, gating.kappa, gating.decay_time
    gate = Settings(sigma_threshold=threshold, kappa=slope, decay_time=decay)
    return replace(gate, dt=dt, filter_uncertain=gating.gated)


def _setting(gp: GaussianProcess, model: Model, name: str) -> Compensation:
    """The defaults that the GP suggests, and ranges around them."""
    from wrenchgap.compensate import Settings  # here: others need not wait for them
    from wrenchgap.replay.compensation.compensators import caveats, compensator
    from wrenchgap.replay.present.learning import of_process

    made = compensator(gp, model)
    usual = made.uncertainty
    gated = bool(np.isfinite(usual.threshold))
    threshold = float(usual.threshold) if gated else float(np.max(gp.sigma_prior))
    kinds = {axis.split("_")[0] for axis in gp.outputs}
    unit = "of its range" if len(kinds) > 1 else "N" if kinds == {"force"} else "Nm"
    gating = Gating(True, gated, threshold, float(usual.kappa), Settings().decay_time)
    slow = () if made.not_compiled is None else (sentence(made.not_compiled),)
    notes = (*of_process(caveats(gp, model)), *slow)
    return Compensation(name, gating, 3.0 * threshold, 5.0 * float(usual.kappa), SLOWEST, unit, notes)
