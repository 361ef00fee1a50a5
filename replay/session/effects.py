"""Effects put into the current model, taken out, set and saved, and the search for them, for the viewer."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import wrenchgap as wg
from wrenchgap.flight.errors import ModelError, UsageError
from wrenchgap.learn.data.candidates import Untried, inapplicable
from wrenchgap.learn.identify.staircase import Basis, Staircase, Steps, staircase, steps
from wrenchgap.plant import Model, model_file
from wrenchgap.plant.effects import catalogue, find
from wrenchgap.plant.trajectory import file as trajectory_file
from wrenchgap.plant.wrench_model import ModelEffect
from wrenchgap.replay.session.saving import SaveFolder, file_name
from wrenchgap.replay.session.worker import worker_result
from wrenchgap.replay.session.working_model import Revision, WorkingModel
from wrenchgap.viewer.session import Report

if TYPE_CHECKING:
    from wrenchgap.learn import Design, Explanation
    from wrenchgap.learn.discover.discover import Discovery

BY_HAND = "set by hand in the viewer"
"""How provenance in a model file says where such a value comes from."""


class SessionEffects:
    """Effects of a working model. Whatever changes the model can be undone."""

    def __init__(self, working: WorkingModel, folder: SaveFolder | None) -> None:
        self.working, self.folder = working, folder
        self.undo, self.redo = working.undo, working.redo
        self._steps: dict[str, Steps] = {}

    @property
    def installed(self) -> tuple[ModelEffect, ...]:
        """Effects of the current model, in the order in which they came in."""
        model = self.working.model
        return tuple(effect for name in self.working.order if (effect := model.effect(name)) is not None)

    def absent(self, flight: str) -> dict[str, Untried | None]:
        """Effects that the current model lacks, by name, and why one cannot be added on a flight."""
        model, records = self.working.model, self.working.flight(flight).records
        names = [name for name in catalogue() if name not in self.working.order]
        return self.working.cached(("absent", flight), lambda: {n: inapplicable(n, model, records) for n in names})

    def staircases(self, flight: str) -> tuple[Staircase, ...]:
        """Down to the current model, on this flight and on those that it was not fitted to."""
        return self.working.cached(("staircases", flight), lambda: self._staircases(flight))

    def add(self, names: tuple[str, ...], flight: str) -> str:
        """Put effects in, fitted on the flight together with those that are in; what that did, in words."""
        from wrenchgap.replay.present.addition import verdict  # here: the page need not wait for it

        with self.working.lock:
            self._fitted(names, flight, f"add {', '.join(names)}")
            trial = self.working.revisions[-1].trial
        did = "nothing was held out to judge it by" if trial is None else f"on held-out time {verdict(trial)}"
        return f"added {', '.join(names)}: {did}"

    def refit(self, flight: str) -> None:
        """Fit all that are in anew on the flight. Raises UsageError where none is."""
        with self.working.lock:
            if not self.working.model.effects:
                raise UsageError("there is no effect in the model to fit; add one first")
            self._fitted((), flight, f"fit on {flight}")

    def _fitted(self, names: tuple[str, ...], flight: str, words: str) -> None:

        working = self.working
        added = wg.add(working.model, names, working.flight(flight))
        order = tuple(dict.fromkeys((*working.order, *names)))
        working.change(Revision(added.model, words, order, added.logs, added.trial))

    def remove(self, name: str) -> None:
        """Take one out; the others keep their values."""
        with self.working.lock:
            self.working.effect(name)
            order = tuple(n for n in self.working.order if n != name)
            self.working.change(Revision(self.working.model.without([name]), f"remove {name}", order))

    def set_value(self, effect: str, parameter: str, value: float) -> None:
        """Set a parameter by hand; several in a row of one effect are one change."""
        working = self.working
        with working.lock:
            old = working.effect(effect)
            parameters = {p.name: (k, p) for k, p in enumerate(old.effect.parameters(working.model.vehicle))}
            if parameter not in parameters:
                raise ModelError(f"effect {effect}: no parameter {parameter!r}; expected {', '.join(parameters)}")
            k, p = parameters[parameter]
            if not (np.isfinite(value) and (value == 0.0 or p.low <= value <= p.high)):
                raise ModelError(
                    f"effect {effect}: {parameter} = {value:g} {p.unit} is not plausible; expected {p.low:.3g} to "
                    f"{p.high:.3g}"
                )
            theta = old.theta.copy()
            theta[k] = value
            new = replace(old, theta=theta, std=None, provenance=model_file.provenance_now(BY_HAND))
            model = working.model.with_replaced([new])
            model.wrench_model.body  # noqa: B018 - raises where no body can be like that
            words = f"set {effect} by hand"
            working.change(Revision(model, words, working.order), instead=working.undoable == words)

    @property
    def saves(self) -> bool:
        """Whether there is a folder to save into."""
        return self.folder is not None

    def save(self, name: str) -> str:
        """Write the model with its history, one version for every change; what was written, in words."""
        folder = self._folder()
        with self.working.lock:
            versioned = self._versioned(folder.place(name))
            text = model_file.dumps(versioned)
            saved = replace(versioned, path=folder.write(name, text), text=text)
            self.working.was_saved(saved)
            return f"{name}: written" + (f", version {saved.history[-1].number}" if saved.history else "")

    def model_text(self, name: str) -> str:
        """What `save` would write into a file of this name."""
        with self.working.lock:
            return model_file.dumps(self._versioned(Path(file_name(name))))

    def downloaded(self, name: str) -> tuple[str, str]:
        """The text of `save` for a browser that keeps it under this name, and in words that it does."""
        place = Path(file_name(name))
        with self.working.lock:
            versioned = self._versioned(place)
            text = model_file.dumps(versioned)
            self.working.was_saved(replace(versioned, path=place, text=text))
        return text, f"{name}: downloaded"

    def exported(self, target: str, flight: str) -> str:
        """The current model in the terms of an autopilot, with what was set in this flight, or of a simulator."""
        from wrenchgap.plant.targets.autopilots import AUTOPILOTS  # here: the page need not wait for them

        with self.working.lock:
            model, autopilot = self.working.model, self.working.flight(flight).flight.autopilot
        same = autopilot is not None and target in AUTOPILOTS and AUTOPILOTS[target].name == autopilot.name
        before = autopilot.parameters if autopilot is not None and same else None
        return wg.export_model(model, target, parameters=before).text

    def trajectory_text(self, found: Design) -> str:
        """A designed flight as a trajectory file."""
        from wrenchgap.replay.present import design

        return trajectory_file.dumps(design.finished(found, "_or_".join(e.name for e in found.effects)))

    def save_trajectory(self, found: Design, name: str) -> str:
        """Write a designed flight as a trajectory file; what was written, in words."""
        self._folder().write(name, self.trajectory_text(found))
        return f"{name}: written; fly it, or `wrenchgap simulate -t {name}`"

    def _folder(self) -> SaveFolder:
        if self.folder is None:
            raise UsageError("this page writes no files; start it with --save-to FOLDER")
        return self.folder

    def _versioned(self, path: Path) -> Model:
        """The current model with a version in its history for every change, the last as written to `path`."""
        first, *later = self.working.revisions
        versioned = first.model
        for one in later:
            versioned = model_file.next_version(
                versioned,
                replace(one.model, history=versioned.history),
                command=f"wrenchgap view: {one.words}",
                path=path,
                flights=one.flights,
                trial=one.trial,
            )
        return versioned

    def _staircases(self, flight: str) -> tuple[Staircase, ...]:
        working, effects = self.working, self.working.model.effects
        used = {sha for e in effects for _, sha in e.provenance.logs}
        fitted = {name for name, one in working.flights.items() if one.flight.content_hash in used}
        basis = Basis.FITTED if flight in fitted else Basis.UNSEEN if effects else Basis.RAW
        here = self._raw(basis, [flight])
        others = [n for n in working.flights if n != flight and n not in fitted]
        if others:
            return here, self._raw(Basis.UNSEEN, others)
        held_out = self._held_out(flight) if flight in fitted or not effects else None
        return (here,) if held_out is None else (here, held_out)

    def _raw(self, basis: Basis, flights: list[str]) -> Staircase:
        """Nominal; with the first effect; the first two; ... as they were when there were no more, or are now."""
        working = self.working
        order, model = working.order, working.model
        models = [model.nominal]
        for count in range(1, len(order) + 1):
            earlier = [r.model for r in working.revisions if set(r.order) == set(order[:count])]
            rest = model.without(order[count:])
            models.append(model if count == len(order) else earlier[-1] if earlier else rest)
        residuals = (np.concatenate([working.model_residual(one, f) for f in flights]) for one in models)
        return staircase(basis, working.data(*flights), residuals, order)

    def _held_out(self, flight: str) -> Staircase | None:
        """Blocks of time of the only flight, each predicted by parameters that were fitted without it.

        None for a model that was set by hand (nothing to fit without a block), and for a flight of one block.
        """
        working = self.working
        data = working.data(flight)
        if any(not e.provenance.logs for e in working.model.effects) or len(np.unique(data.block)) < 2:
            return None
        made = steps(data, working.model, working.order, earlier=self._steps.get(flight))
        self._steps[flight] = made
        return staircase(Basis.HELD_OUT, data, made.left, made.names)

    def explain(self, flight: str, report: Report) -> Explanation:
        """What is missing in the current model; searched for in a process of its own, for long."""
        with self.working.lock:
            model, opened = self.working.model, self.working.flight(flight)
        found = worker_result(lambda tell: replace(wg.explain(opened, model, progress=tell), flights=()), report)
        return replace(found, flights=(opened,))

    def discover(self, flight: str, known: Explanation | None, report: Report) -> Discovery:
        """The law of what is left beside what `known` says, or a new search; looked for in its own process."""
        with self.working.lock:
            model, opened = self.working.model, self.working.flight(flight)

        def work(tell: Report) -> Discovery:
            found = wg.discover(opened, model, explanation=known, progress=tell)
            return replace(found, explanation=replace(found.explanation, flights=()))

        return worker_result(work, report)

    def next_flight(self, names: tuple[str, ...], flight: str, report: Report, seconds: float = 30.0) -> Design:
        """The flight of so many `seconds` that separates these effects; searched for in its own process, for long."""
        for name in names:
            find(name)
        with self.working.lock:
            model, opened = self.working.model, self.working.flight(flight)
        return worker_result(lambda tell: wg.design(names, model, opened, duration=seconds, progress=tell), report)
