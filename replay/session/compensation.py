"""The compensation of a session's GP: replayed on a flight, and flown again with it in the loop, for the viewer."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrenchgap.compensate import Settings
from wrenchgap.flight.errors import UsageError
from wrenchgap.learn.process.gp import GaussianProcess
from wrenchgap.plant.model import Model
from wrenchgap.replay.compensation.compensators import caveats, compensator
from wrenchgap.replay.compensation.replay import replay
from wrenchgap.replay.counterfactual.counterfactual import Change, Counterfactual, counterfactual, read_recording
from wrenchgap.replay.present import tables
from wrenchgap.replay.present.compensation import sentences
from wrenchgap.replay.present.counterfactual import notes
from wrenchgap.replay.present.replay import notes as replay_notes
from wrenchgap.replay.session.worker import apart
from wrenchgap.replay.session.working_model import Bench
from wrenchgap.viewer.analysis import Compensated, Compensation, Gating, Reflown, Report
from wrenchgap.viewer.scene import Motion, Series

Array = NDArray[np.float64]

GROUP = "Compensation"
"""Where the page shows what a replay did."""
GHOST_RATE = 50.0
"""Instants per second of a ghost [Hz], about."""
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


class CompensationDesk:
    """Implements `viewer.analysis.Compensations` on a bench."""

    def __init__(self, bench: Bench, name: str) -> None:
        self.bench = bench
        self._setting = None if bench.gp is None else _setting(bench.gp, bench.given, name)
        self._replayed: dict[str, _Replayed] = {}

    @property
    def setting(self) -> Compensation | None:
        """The compensation as it is set, None without a GP."""
        return self._setting

    def set(self, gating: Gating) -> None:
        """Change it; what was replayed with other settings is forgotten. Raises UsageError for impossible values."""
        with self.bench.lock:
            known = self._known()[1]
            if gating != known.gating:
                _settings(gating, 0.01)  # or it raises
                self._setting = replace(known, gating=gating)
                self._replayed.clear()

    def series(self, flight: str) -> tuple[Series, ...]:
        """What the last replay on a flight did, as plots; nothing where there was none, or it is switched off."""
        done = self._replayed.get(flight)
        if done is None or self._setting is None or not self._setting.gating.on:
            return ()

        def plot(title: str, unit: str, values: dict[str, Array]) -> Series:
            return Series(title, unit, done.time, values, GROUP)

        parts = [
            ("correction, force", "N", done.correction[:, :3]),
            ("correction, torque", "Nm", done.correction[:, 3:]),
        ]
        out = [
            plot(title, unit, dict(zip("xyz", values.T, strict=True)))
            for title, unit, values in parts
            if np.any(values)
        ]
        threshold = np.full(len(done.time), self._setting.gating.sigma_threshold)
        sigma = {"sigma": done.sigma} | ({"threshold": threshold} if self._setting.gating.gated else {})
        out.append(plot("sigma of the correction", self._setting.unit, sigma))
        out.append(plot("beta (1: correction withheld)", "", {"beta": done.beta}))
        return tuple(out)

    def replay(self, flight: str, report: Report) -> Compensated:
        """Replay the compensation on a flight; afterwards its scene has correction, sigma and beta."""
        with self.bench.lock:
            gp, setting = self._known()
            log, model = self.bench.flight(flight), self.bench.given
            settings = _settings(setting.gating, 0.01)  # replay takes the period of the log

        def work(tell: Report) -> _Replayed:
            done = replay(log, model, gp, settings, progress=tell)
            steps = done.steps
            return _Replayed(done.time, steps.correction, steps.sigma, steps.beta, _summary(done))

        found = apart(work, report)
        with self.bench.lock:
            if setting is self._setting:  # not changed meanwhile
                self._replayed[flight] = found
        return found.summary

    def refly(self, flight: str, start: float, duration: float, report: Report) -> Reflown:
        """Fly (a part of) a flight again: with the compensation in the loop, or as it was where that is off."""
        with self.bench.lock:
            gp, setting = self._known()
            log, gating = self.bench.flight(flight), setting.gating
            model, given = self.bench.model, self.bench.given

        def work(tell: Report) -> Reflown:
            recording = read_recording(log, model.vehicle, start=start, duration=duration)
            helper = compensator(gp, given, _settings(gating, recording.dt)) if gating.on else None
            found = counterfactual(recording, model, Change(compensator=helper), progress=tell)
            return _reflown(found, gp if gating.on else None, setting.name)

        return apart(work, report)

    def _known(self) -> tuple[GaussianProcess, Compensation]:
        if self.bench.gp is None or self._setting is None:
            raise UsageError("there is no GP to compensate with; open the page with --gp GP (see `wrenchgap learn`)")
        return self.bench.gp, self._setting


def _settings(gating: Gating, dt: float) -> Settings:
    return Settings(
        dt=dt,
        filter_uncertain=gating.gated,
        sigma_threshold=gating.sigma_threshold,
        kappa=gating.kappa,
        decay_time=gating.decay_time,
    )


def _setting(gp: GaussianProcess, model: Model, name: str) -> Compensation:
    """The defaults that the GP suggests, and ranges around them."""
    usual = compensator(gp, model).uncertainty
    gated = bool(np.isfinite(usual.threshold))
    threshold = float(usual.threshold) if gated else float(np.max(gp.sigma_prior))
    kinds = {axis.split("_")[0] for axis in gp.outputs}
    unit = "of its range" if len(kinds) > 1 else "N" if kinds == {"force"} else "Nm"
    gating = Gating(True, gated, threshold, float(usual.kappa), Settings().decay_time)
    return Compensation(
        name, gating, 3.0 * threshold, 5.0 * float(usual.kappa), SLOWEST, unit, sentences(caveats(gp, model))
    )


def _summary(done: Any) -> Compensated:
    """The mismatch of each output before and after the correction, and how much was withheld."""
    before, after = (np.mean(np.abs(m), axis=0) for m in (done.steps.mismatch_before, done.steps.mismatch_after))
    rows = tuple(
        (f"{axis} [{'N' if axis.startswith('force') else 'Nm'}]", tables.number(b), tables.number(a))
        for axis, b, a in zip(done.outputs, before, after, strict=True)
    )
    steps = done.steps
    withheld = float(np.mean(steps.beta > 0.5))
    fading = np.exp(-done.dt / done.settings.decay_time)
    sentences = [
        f"{len(done)} steps of {1e3 * done.dt:.3g} ms; more than half of the correction is withheld in "
        f"{100 * withheld:.1f} % of them. a = exp(-dt / tau_d) = {fading:.3f}.",
        *(f"{count} steps: {words}" for words, count in steps.trouble.items()),
        *replay_notes(done),
    ]
    return Compensated(rows, tuple(sentences))


def _reflown(found: Counterfactual, gp: GaussianProcess | None, name: str) -> Reflown:
    state, commands = found.changed.flown.state, found.changed.flown.commands
    every = max(1, round(1.0 / (GHOST_RATE * found.inference.recording.dt)))
    words = f"compensated by {name}" if gp is not None else "flown again, nothing changed"
    motion = Motion(
        state.time[::every],
        state.position_E[::every],
        state.quat_EB[::every],
        None if commands.tilt is None else commands.tilt[::every],
        words,
    )
    runs = [found.tracking[key] for key in ("recorded", "null_run", "counterfactual")]
    attitude = np.degrees(np.arcsin(np.clip([r.attitude_rms for r in runs], 0.0, 1.0)))
    rows = [(f"attitude {axis}, rms [deg]", *(f"{v:.2f}" for v in attitude[:, k])) for k, axis in enumerate("xyz")]
    rows.append(("position, rms [cm]", *(f"{100 * r.position_rms:.2f}" for r in runs)))
    rows.append(("position, max [cm]", *(f"{100 * r.position_max:.2f}" for r in runs)))
    null = found.null_run
    trust = (
        f"With nothing changed the re-flight is at most {null.attitude_deg_max:.2f} deg and "
        f"{100 * null.position_m_max:.1f} cm off the recorded flight: believe the rest as far as that."
    )
    return Reflown(motion, tuple(_four(r) for r in rows), (trust, *notes(found, gp)))


def _four(row: tuple[str, ...]) -> tuple[str, str, str, str]:
    label, recorded, null, flown = row
    return label, recorded, null, flown
