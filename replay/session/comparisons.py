"""What changed between flights of a working session, for the viewer."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from wrenchgap.flight.errors import UsageError
from wrenchgap.learn.changed.changed import Changed, Verdict
from wrenchgap.plant.effects import find
from wrenchgap.plant.model import Model
from wrenchgap.plant.wrench_model import ModelEffect
from wrenchgap.replay.session.worker import worker_result
from wrenchgap.replay.session.working_model import Revision, WorkingModel, provenance
from wrenchgap.viewer.background import Report

SOURCE = "what changed between flights, in the viewer"
"""How provenance in a model file says where such a value comes from."""


class SessionComparisons:
    """What changed between flights of a working model."""

    def __init__(self, working: WorkingModel) -> None:
        self.working = working

    def of(self, suspect: str, healthy: tuple[str, ...], report: Report) -> Changed:
        """Compare one flight with others of the same vehicle; takes long, in a process of its own."""
        from wrenchgap.replay.api_flights import changed  # here: the page stands before it is there

        with self.working.lock:
            model = self.working.model
            one, others = self.working.flight(suspect), [self.working.flight(h) for h in healthy]
        return worker_result(lambda tell: replace(changed(one, others, model, progress=tell), flights=()), report)

    def add(self, found: Changed, name: str) -> None:
        """Put what changed into the model. Raises UsageError unless the model is the one called `name` still."""
        working = self.working
        with working.lock:
            if working.name != name:
                raise UsageError(f"this was found on top of {name}; search again on the model as it stands")
            order = tuple(dict.fromkeys((*working.revisions[-1].order, *found.names)))
            words = f"add what changed: {', '.join(found.names)}"
            working.change(Revision(with_changes(working.model, found), words, order))


def with_changes(model: Model, found: Changed) -> Model:
    """The model with the effects of the likeliest set, changed by what the suspect flights show."""
    if found.verdict is Verdict.NOTHING:
        return model
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
        effects[name] = replace(made, provenance=provenance(SOURCE))
    return model.with_effects(tuple(effects.values()))
