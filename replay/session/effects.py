"""Effects put into the model as it stands, taken out, set and saved, and the search for them, for the viewer."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.errors import ModelError, UsageError
from wrenchgap.flight.flight import AXES
from wrenchgap.learn.data.applicable import inapplicable
from wrenchgap.learn.data.dataset import Dataset, dataset
from wrenchgap.learn.data.errors import rms
from wrenchgap.learn.design.designer import design
from wrenchgap.learn.diagnose.timing import barred, timing_of
from wrenchgap.learn.identify.add import add_fitted
from wrenchgap.learn.identify.explain import Explanation, explain
from wrenchgap.learn.identify.fit import fit, held_out
from wrenchgap.learn.identify.search import Step
from wrenchgap.learn.parallel import cores
from wrenchgap.plant import model_file, trajectory_file
from wrenchgap.plant.effects import catalogue, find
from wrenchgap.plant.model import Model
from wrenchgap.plant.model_file import tool_version
from wrenchgap.plant.wrench_model import ModelEffect, Provenance
from wrenchgap.replay.present import addition, explanation, tables
from wrenchgap.replay.present import design as designing
from wrenchgap.replay.present.documents import atomic, claim
from wrenchgap.replay.session.worker import apart
from wrenchgap.replay.session.working_model import Bench, Stand
from wrenchgap.viewer.analysis import (
    Candidate,
    Installed,
    ModelState,
    Named,
    NextFlight,
    Ranking,
    Report,
    Stair,
    Staircase,
    Value,
)

Array = NDArray[np.float64]

BY_HAND = "set by hand in the viewer"
NEXT_SECONDS = 30.0
"""Length of a flight that is to tell effects apart [s]."""
PATH_POINTS = 600
"""Points of a designed trajectory that are drawn."""


class EffectsDesk:
    """Implements `viewer.analysis.Effects` on a bench."""

    def __init__(self, bench: Bench, folder: Path) -> None:
        self.bench, self.folder = bench, folder
        self._held_out: dict[tuple[str, ...], Array] = {}

    # ------------------------------------------------------------ the model as it stands

    def state(self, flight: str) -> ModelState:
        """The model as it stands, seen from a flight."""
        return self.bench.kept(("state", flight), lambda: self._state(flight))

    def _state(self, flight: str) -> ModelState:
        bench = self.bench
        model, records = bench.model, bench.flight(flight).records
        order = bench.stands[-1].order
        absent = [n for n in catalogue() if n not in order]
        reasons = {n: inapplicable(n, model, records) for n in absent}
        by_reason: dict[str, list[str]] = {}
        for name, reason in reasons.items():
            if reason is not None:
                words = reason.replace(f"effect {name} ", "").replace(f"{name}: ", "")
                by_reason.setdefault(words, []).append(name)
        return ModelState(
            bench.name,
            tuple(self._installed(e) for name in order if (e := model.effect(name)) is not None),
            tuple(n for n in absent if reasons[n] is None),
            tuple((reason, tuple(names)) for reason, names in by_reason.items()),
            self._staircases(flight),
            bench.undoable,
            bench.redoable,
            bench.saved,
            "" if (trial := bench.stands[-1].trial) is None else addition.verdict(trial),
        )

    def _installed(self, item: ModelEffect) -> Installed:
        model = self.bench.model
        values = tuple(
            Value(p.name, p.unit, float(v), None if item.std is None else float(item.std[k]), p.low, p.high, p.scale)
            for k, (p, v) in enumerate(zip(item.effect.parameters(model.vehicle), item.theta, strict=True))
        )
        logs = [file for file, _ in item.provenance.logs]
        source = f"fitted on {', '.join(logs)}" if logs else item.provenance.method or "as given"
        return Installed(item.name, values, source)

    # ------------------------------------------------------------ changing it

    def add(self, names: tuple[str, ...], flight: str) -> None:
        """Put effects in, fitted on the flight together with those that are in."""
        with self.bench.lock:
            self._fitted(names, flight, f"add {', '.join(names)}")

    def refit(self, flight: str) -> None:
        """Fit all that are in anew on the flight. Raises UsageError where none is."""
        with self.bench.lock:
            if not self.bench.model.effects:
                raise UsageError("there is no effect in the model to fit; add one first")
            self._fitted((), flight, f"fit on {flight}")

    def _fitted(self, names: tuple[str, ...], flight: str, words: str) -> None:
        bench = self.bench
        edited = add_fitted(bench.model, names, [bench.flight(flight)], cutoff_hz=bench.cutoff_hz)
        order = tuple(dict.fromkeys((*bench.stands[-1].order, *names)))
        bench.change(Stand(edited.model, words, order, edited.flights, edited.trial))

    def remove(self, name: str) -> None:
        """Take one out; the others keep their values."""
        with self.bench.lock:
            self.bench.checked(name)
            order = tuple(n for n in self.bench.stands[-1].order if n != name)
            self.bench.change(Stand(self.bench.model.without([name]), f"remove {name}", order))

    def set_value(self, effect: str, parameter: str, value: float) -> None:
        """Set a parameter by hand; several in a row of one effect are one change."""
        bench = self.bench
        with bench.lock:
            bench.checked(effect)
            old = bench.model.effect(effect)
            assert old is not None
            parameters = {p.name: (k, p) for k, p in enumerate(old.effect.parameters(bench.model.vehicle))}
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
            source = Provenance(
                fitted=datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ"), version=tool_version(), method=BY_HAND
            )
            new = replace(old, theta=theta, std=None, provenance=source)
            model = bench.model.with_effects((*(e for e in bench.model.effects if e.name != effect), new))
            model.wrench_model.body  # noqa: B018 - raises where no body can be like that
            words = f"set {effect} by hand"
            bench.change(Stand(model, words, bench.stands[-1].order), instead=bench.undoable == words)

    def undo(self) -> None:
        """Take the last change back."""
        self.bench.undo()

    def redo(self) -> None:
        """Do again what was taken back."""
        self.bench.redo()

    def save(self, name: str, *, overwrite: bool = False) -> str:
        """Write the model with its history, one version for every change; what was written, in words."""
        bench, path = self.bench, self._place(name)
        with bench.lock:
            if path.exists() and not overwrite:
                raise UsageError(f"{path}: exists already; choose another name or tick 'overwrite'")
            stands = bench.stands
            versioned = stands[0].model
            for stand in stands[1:]:
                versioned = model_file.next_version(
                    versioned,
                    replace(stand.model, history=versioned.history),
                    command=f"wrenchgap view: {stand.words}",
                    path=path,
                    flights=stand.flights,
                    trial=stand.trial,
                )
            saved = model_file.save(versioned, path, force=overwrite)
            bench.was_saved(saved)
            count = len(saved.history)
            return f"{path}: written" + (f", version {saved.history[-1].number}" if count else "")

    def save_trajectory(self, found: NextFlight, name: str) -> str:
        """Write a designed flight as a trajectory file; never over another one."""
        path = self._place(name)
        claim({"file": path}, force=False)
        with atomic(path) as partial:
            partial.write_text(found.text, encoding="utf-8")
        return f"{path}: written; fly it, or `wrenchgap simulate -t {path}`"

    def _place(self, name: str) -> Path:
        """Where a file of this name goes: into the session's folder and nowhere else, whoever sees the page."""
        if Path(name).name != name or not name.endswith(".toml") or name.startswith("."):
            raise UsageError(f"{name or 'file'}: expected a name that ends in .toml; it is written to {self.folder}")
        return self.folder / name

    # ------------------------------------------------------------ the staircase

    def _staircases(self, flight: str) -> tuple[Staircase, ...]:
        """Down to the model as it stands, on this flight and on those that it was not fitted to."""
        steps = self._steps()
        fitted = self._fitted_flights()
        unseen = bool(self.bench.model.effects) and flight not in fitted
        words = " (held out)" if unseen else " (fitted to it)" if flight in fitted else ""
        here = self._stairs(f"{flight}{words}", [flight], steps, held_out=unseen)
        others = [n for n in self.bench.opened if n != flight and n not in fitted]
        if others:
            named = others[0] if len(others) == 1 else f"{len(others)} other flights"
            return here, self._stairs(f"{named} (held out)", others, steps, held_out=True)
        if flight in fitted or not self.bench.model.effects:
            blocks = self._held_out_blocks(flight)
            return (here,) if blocks is None else (here, blocks)
        return (here,)

    def _steps(self) -> list[tuple[str, Model]]:
        """Nominal; with the first effect; the first two; ... as they stood when there were no more, or stand now."""
        bench = self.bench
        order, model = bench.stands[-1].order, bench.model
        out = [("nominal", model.nominal)]
        for count in range(1, len(order) + 1):
            part = order[:count]
            stood = [s.model for s in bench.stands if set(s.order) == set(part)]
            rest = model.without(order[count:])
            out.append((f"+ {order[count - 1]}", model if count == len(order) else stood[-1] if stood else rest))
        return out

    def _fitted_flights(self) -> set[str]:
        """Names of open flights to which any effect of the model was fitted."""
        used = {sha for e in self.bench.model.effects for _, sha in e.provenance.logs}
        return {name for name, one in self.bench.opened.items() if one.flight.content_hash in used}

    def _stairs(self, title: str, flights: list[str], steps: list[tuple[str, Model]], *, held_out: bool) -> Staircase:
        bench = self.bench
        weights = bench.data(flights[0]).weights
        stairs = []
        for name, model in steps:
            residual = np.concatenate([bench.left_by(model, f) for f in flights])
            stairs.append(_stair(name, rms(residual), weights))
        lengths = np.array([len(bench.data(f).measured) for f in flights], dtype=float)
        noise = np.sqrt(lengths @ np.array([bench.data(f).noise ** 2 for f in flights]) / lengths.sum())
        return Staircase(title, tuple(stairs), _stair("sensor noise", noise, weights), held_out)

    def _held_out_blocks(self, flight: str) -> Staircase | None:
        """Blocks of time of the only flight, each predicted by parameters that were fitted without it.

        None for a model that was set by hand: nothing to fit without a block.
        """
        bench = self.bench
        if any(not e.provenance.logs for e in bench.model.effects):
            return None
        data, order = bench.data(flight), bench.stands[-1].order
        rms = [self._without_blocks(data, flight, order[:k]) for k in range(len(order) + 1)]
        if any(r is None for r in rms):
            return None
        names = ["nominal", *(f"+ {n}" for n in order)]
        stairs = tuple(_stair(n, r, data.weights) for n, r in zip(names, rms, strict=True) if r is not None)
        return Staircase(
            f"{flight}, time that was not fitted", stairs, _stair("sensor noise", data.noise, data.weights), True
        )

    def _without_blocks(self, data: Dataset, flight: str, names: tuple[str, ...]) -> Array | None:
        key = (flight, *names)
        if key not in self._held_out:
            nominal = self.bench.model.nominal
            if len(np.unique(data.block)) < 2:
                return None
            self._held_out[key] = rms(held_out(data, nominal, names, fit(data, nominal, names)))
        return self._held_out[key]

    # ------------------------------------------------------------ the search

    def explain(self, flight: str, report: Report) -> Ranking:
        """Search for what is missing in the model as it stands; takes long, in a process of its own."""
        with self.bench.lock:
            model, opened, name = self.bench.model, self.bench.flight(flight), self.bench.name

        def work(tell: Report) -> Ranking:
            tell(0.0, "timing of the topics")
            reasons = barred([timing_of(opened, model)])
            found = explain(
                dataset(opened.records, model),
                model,
                barred=reasons,
                jobs=cores(),
                progress=lambda words, k, n: tell(min(1.0, k / max(n, 1)), words),
            )
            return _ranking(found, flight, name)

        return apart(work, report)

    def next_flight(self, names: tuple[str, ...], flight: str, report: Report) -> NextFlight:
        """Search for the flight that tells these effects apart; takes long, in a process of its own."""
        for name in names:
            find(name)
        with self.bench.lock:
            model, opened = self.bench.model, self.bench.flight(flight)

        def work(tell: Report) -> NextFlight:
            found = design(names, model, records=opened.records, duration=NEXT_SECONDS, progress=tell)
            file = designing.finished(found, model, [opened], "_or_".join(names))
            time = np.linspace(0.0, found.trajectory.duration, PATH_POINTS)
            r = found.trajectory.at(time)
            return NextFlight(
                tuple(names),
                found.separable,
                designing.sentence(found),
                () if found.separable else tuple(found.advice),
                ", ".join(map(str, found.segments)),
                time,
                r.position_E,
                r.quat_ED,
                trajectory_file.dumps(file),
            )

        return apart(work, report)


def _stair(name: str, rms: Array, weights: Array) -> Stair:
    return Stair(name, rms, float(np.sqrt(np.sum((weights * rms) ** 2))))


def _ranking(found: Explanation, flight: str, model: str) -> Ranking:
    """The explanation in plain data."""
    named = tuple(
        Named(
            m.name,
            found.probability(m),
            m.share,
            m.significance,
            _values(found, m.name),
            tuple(r.name for r in m.alike),
        )
        for m in found.members
    )
    alike = {name for n in named for name in n.alike}
    chosen = {n.name for n in named}

    def mark(name: str, implausible: bool) -> str:
        return "chosen" if name in chosen else "alike" if name in alike else "implausible" if implausible else ""

    candidates = tuple(
        Candidate(
            c.name,
            c.score,
            c.significance,
            c.falls,
            tables.values_of(c),
            mark(c.name, bool(c.implausible)),
        )
        for c in found.ranking
    )
    not_tried = tuple(f"{', '.join(names)}: {reason}" for reason, names in explanation.not_tried(found).items())
    return Ranking(
        flight,
        model,
        found.verdict,
        explanation.sentence(found),
        named,
        candidates,
        found.groups,
        tuple(_trace(step) for step in found.steps),
        not_tried,
    )


def _values(found: Explanation, name: str) -> tuple[Value, ...]:
    """Parameters of a named effect, as fitted together with the others."""
    fit = found.fit
    rows = zip(fit.parameters, fit.theta, fit.std, strict=True)
    return tuple(
        Value(p.name, p.unit, float(v), float(std), p.low, p.high, p.scale) for (n, p), v, std in rows if n == name
    )


def _trace(step: Step) -> str:
    on = f"on top of {', '.join(step.on)}" if step.on else "on the model as it stood"
    if step.chosen is None:
        return f"{on}: no further effect stands out"
    best = step.candidates[0]
    worst = int(np.argmax(best.falls))
    return f"{on}: {step.chosen} (t {best.significance:.1f}, {AXES[worst]} falls by {100 * best.falls[worst]:.0f} %)"
