"""What changed between flights of a working session, for the viewer."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime

import numpy as np

from wrenchgap.flight.errors import UsageError
from wrenchgap.learn.changed import changed as changing
from wrenchgap.learn.changed.changed import Changed, Verdict
from wrenchgap.learn.changed.sizes import Size
from wrenchgap.plant.effects import find
from wrenchgap.plant.model import Model
from wrenchgap.plant.model_file import tool_version
from wrenchgap.plant.wrench_model import ModelEffect, Provenance
from wrenchgap.replay.present import changed as words
from wrenchgap.replay.present import what_to_inspect
from wrenchgap.replay.present.numbers import number, unit
from wrenchgap.replay.session.worker import apart
from wrenchgap.replay.session.working_model import Revision, WorkingModel
from wrenchgap.viewer.analysis import Report
from wrenchgap.viewer.differences import Change, Differences, FlightMean

SOURCE = "what changed between flights, in the viewer"
"""How provenance in a model file says where such a value comes from."""


class SessionComparisons:
    """Implements `viewer.differences.Comparisons` on a working model."""

    def __init__(self, working: WorkingModel) -> None:
        self.working = working
        self._changed: dict[tuple[str, tuple[str, ...], str], Model] = {}

    def of(self, suspect: str, healthy: tuple[str, ...], report: Report) -> Differences:
        """Compare one flight with others; takes long, in a process of its own."""
        with self.working.lock:
            model, name = self.working.model, self.working.name
            one, others = self.working.flight(suspect), [self.working.flight(h) for h in healthy]

        def work(tell: Report) -> tuple[Differences, Model]:
            found = changing.changed([one], others, model.untold, progress=tell)
            return shown(found, suspect, healthy, name), with_changes(model, found)

        differences, changed = apart(work, report)
        with self.working.lock:
            self._changed[suspect, healthy, name] = changed
        return differences

    def add(self, found: Differences) -> None:
        """Put what changed into the model. Raises UsageError where the model is another one by now."""
        working = self.working
        with working.lock:
            changed = self._changed.get((found.suspect, found.healthy, found.model))
            if changed is None or working.name != found.model:
                raise UsageError(f"this was found on top of {found.model}; search again on the model as it stands")
            order = tuple(dict.fromkeys((*working.revisions[-1].order, *found.effects)))
            working.change(Revision(changed, f"add what changed: {', '.join(found.effects)}", order))


def with_changes(model: Model, found: Changed) -> Model:
    """The model with the effects of the likeliest set, changed by what the suspect flights show."""
    if found.verdict is Verdict.NOTHING:
        return model
    stamp = Provenance(fitted=datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ"), version=tool_version(), method=SOURCE)
    effects = {e.name: e for e in model.effects}
    for name in found.names:
        effect = find(name)
        parameters = effect.parameters(model.vehicle)
        own = effects.get(name)
        theta = np.zeros(len(parameters)) if own is None else own.theta.copy()
        index = {p.name: k for k, p in enumerate(parameters)}
        for size in found.parameters:
            if size.effect == name:
                k = index[size.name]
                theta[k] = np.clip(theta[k] + size.change, parameters[k].low, parameters[k].high)
        made = ModelEffect(effect, theta, None) if own is None else replace(own, theta=theta, std=None)
        effects[name] = replace(made, provenance=stamp)
    return model.with_effects(tuple(effects.values()))


def _own_name(size: Size) -> str:
    """Of a rotor or an arm nothing: the user's name of it is there already."""
    return "" if size.name.split("_")[0] in ("rotor", "arm") else f"{size.name} "


def shown(found: Changed, suspect: str, healthy: tuple[str, ...], model: str) -> Differences:
    """The answer as the panel takes it."""
    something = found.verdict is not Verdict.NOTHING
    usual = np.mean([r.mean for r in found.rows if r.role == "healthy"], axis=0)
    scatter = np.maximum(found.scatter, 1e-12)
    odd = [f"{o.flight} was ticked as healthy and is not: {o.effect} ({words.odds(o.odds)})." for o in found.odd]
    lacking = [f"not compared, {n.quantity}: {n.reason}." for n in found.not_compared]
    changes = [
        Change(
            p.effect,
            p.where,
            f"{_own_name(p)}{number(p.change)} ± {number(p.std, 2)} {unit(p.unit)} (scatter of healthy flights "
            f"{number(p.scatter, 2)})",
            p.significance,
        )
        for p in found.parameters
    ]
    return Differences(
        suspect,
        healthy,
        model,
        found.verdict.value,
        (words.summary(found), *odd, words.baseline(found), *words.feedback(found), *lacking),
        tuple(changes) if something else (),
        tuple(FlightMean(r.flight, r.role, r.mean, (r.mean - usual) / scatter) for r in found.rows),
        tuple(what_to_inspect.sentences(found)),
        found.names if something else (),
    )
