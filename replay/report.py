"""Everything about some flights and a model: what is missing, the error step by step, where the model fails, what next.

`report` calls the analyses one after the other and hands on what one of them has fitted to the next: the joint fit of
`explain` is the model that `add` would write and the last step of the staircase. There is no sentence and no HTML
here; `replay.present.report` writes them.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path

import numpy as np

from wrenchgap.flight import AXES, WrenchgapError
from wrenchgap.flight.arguments import Progress, check_arguments, part_of, silent
from wrenchgap.flight.repeats import refuse_seen
from wrenchgap.flight.result import Result
from wrenchgap.learn import Comparison, Design, FitSettings, GaussianProcess, OpenFlight
from wrenchgap.learn.data.candidates import Lack, inapplicable
from wrenchgap.learn.data.dataset import Dataset
from wrenchgap.learn.data.errors import rms
from wrenchgap.learn.data.opening import Flights, listed
from wrenchgap.learn.design.designer import design
from wrenchgap.learn.diagnose.timing import dataset_of
from wrenchgap.learn.diagnose.where import Source, Where, budget, examine, held_out_process
from wrenchgap.learn.identify.absorption import Absorption
from wrenchgap.learn.identify.add import Addition, add, model_of
from wrenchgap.learn.identify.learning import absorption, default_mean, learn_process
from wrenchgap.learn.identify.staircase import Process, Staircase, Steps, held_out_staircase, steps, unseen_staircase
from wrenchgap.learn.posterior.explain import Explanation, explain
from wrenchgap.learn.process.predictors import OtherFilter, OtherPhysics, check_effects
from wrenchgap.plant.history import order_of_addition
from wrenchgap.plant.model import Model
from wrenchgap.plant.model_file import content_hash
from wrenchgap.replay.prediction import OpenLoop, open_loop_beside

AT_THE_FLOOR = 1.2
"""Ratio of rms to sensor noise, by axis, below which nothing remains to be learnt."""
MOST_COMPARED = 3
"""Members of a group that a flight is designed for: each pair of them has to be separated."""
MOST_DESIGNED = 2
"""Groups that a flight is designed for; a design takes some ten seconds."""
REST_POINTS = 100
"""Training points of the process that shows what remains to be learnt."""


class Absent(StrEnum):
    """Why there is no Gaussian process on the last step."""

    NOISE = "noise"  # the residual is the noise of the sensors
    SHORT = "short"  # too little data to hold anything out
    USELESS = "useless"  # on held-out time it reduces no error


@dataclass(frozen=True)
class Rest:
    """The Gaussian process that is shown, or why there is none; what a given one absorbs; notes on it."""

    process: Process | None = None
    absent: Absent | None = None
    absorption: Absorption | None = None
    notes: tuple[object, ...] = ()


@dataclass(frozen=True)
class NextFlight:
    """Effects that are indistinguishable on these logs, and the flight that separates them.

    Without `design`: `why_not` is the error that the search for one ended with, empty where none was searched.
    """

    names: tuple[str, ...]
    design: Design | None
    why_not: str = ""


@dataclass(frozen=True, repr=False)
class Report(Result):
    """What is missing in a model, and the evidence.

    `addition` is the model as `wrenchgap add` would write it, all effects fitted to all given logs. `staircases` are on
    held-out time of these and, where there are such flights, on unseen ones; `comparison` is behind the latter.
    `before` and `after` say where the given and the fitted model fail, on the unseen flights where there are any;
    `ahead` how far they are off there when they predict the motion, `not_ahead` why that is not known.
    """

    model: Model
    explanation: Explanation
    addition: Addition
    staircases: tuple[Staircase, ...]
    comparison: Comparison | None
    rest: Rest
    before: Where
    after: Where
    next_flights: tuple[NextFlight, ...]
    unseen: tuple[OpenFlight, ...]
    ahead: OpenLoop | None = None
    not_ahead: tuple[str, ...] = ()

    def save(self, path: str | Path, *, force: bool = False) -> None:
        """Write it as one HTML page. Raises UsageError where the file exists and `force` is not given."""
        self.presentation.save_page(self, Path(path), force=force)

    @property
    def flights(self) -> tuple[OpenFlight, ...]:
        """The given flights, to which the effects were fitted."""
        return self.explanation.flights

    @property
    def unshown(self) -> tuple[str, ...]:
        """Effects that the model allows and these flights cannot show."""
        records = [r for f in self.flights for r in f.records]
        hidden = [u.effect for u in self.explanation.untried if u.lack is Lack.EXCITATION]
        return tuple(name for name in hidden if inapplicable(name, self.model, records) is None)

    @property
    def notes(self) -> tuple[object, ...]:
        """What was assumed, repaired or left out, each once."""
        every = [*self.rest.notes, *self.model.notes, *(n for f in (*self.flights, *self.unseen) for n in f.notes)]
        return tuple(dict.fromkeys([*every, *self.before.notes, *self.after.notes]))


@check_arguments
def report(
    flights: Flights,
    model: Model | Addition,
    *,
    names: Sequence[str] = (),
    validate: Flights = (),
    gp: GaussianProcess | None = None,
    progress: Progress | None = None,
) -> Report:
    """All about `flights`, which were opened for `model`, tested on `validate`; takes minutes.

    What is missing, the error step by step, where the model fails, what to fly next.

    `names` limits the effects that are tried. A `gp` was learnt on the model; without one, a process shows what remains
    to be learnt of the last residual. Raises as `explain` does, and FitError for a process of another vehicle
    or on top of other effects.
    """
    flights, model, validation = listed(flights), model_of(model), listed(validate)
    tell = progress or silent
    refuse_seen([f.flight for f in flights], [f.flight for f in validation])
    if gp is not None:
        gp.check_vehicle(model.vehicle.name)
        check_effects(gp, model)
    found = explain(flights, model, names=names, validation=validation, progress=part_of(tell, 0.0, 0.5))
    added = add(model, found.effects, flights, fitted=found.fit)
    data = replace(dataset_of(flights, model), answering=found.answering)
    tell(0.5, "error step by step")
    order = [*order_of_addition(model.history, [e.name for e in model.effects]), *found.effects]
    made = steps(data, model, order, whole=added.fit)
    tell(0.55, "what remains to be learnt")
    rest = _learnt(flights, added.model, made, data) if gp is None else _given(flights, model, gp)
    staircases, comparison = [held_out_staircase(data, model, made, rest.process)], None
    if validation:
        unseen, comparison = unseen_staircase(validation, model, made, rest.process)
        staircases.append(unseen)
    shown = list(validation) or list(flights)
    before = examine(shown, model, None, part_of(tell, 0.65, 0.8, "given model: "))
    after = examine(shown, added.model, None, part_of(tell, 0.8, 0.95, "fitted model: ")) if found.effects else before
    others, names = ([added.model], ("given", "fitted")) if found.effects else ([], ("given",))
    ahead, not_ahead = open_loop_beside(shown, model, others, gp=gp, names=names)
    return Report(
        model,
        found,
        added,
        tuple(staircases),
        comparison,
        rest,
        before,
        after,
        tuple(_next_flights(found, added.model, part_of(tell, 0.95, 1.0, "next flight: "))),
        tuple(validation),
        ahead,
        not_ahead,
    )


def _given(flights: Sequence[OpenFlight], model: Model, gp: GaussianProcess) -> Rest:
    """The given process, and what it absorbs where it was learnt on this very model and not on another version."""
    source, used = gp.provenance, flights[0].records[0].cutoff_hz
    process = Process(gp, True, bool({f.flight.content_hash for f in flights} & {log.sha256 for log in source.logs}))
    notes: list[object] = []
    if source.cutoff_hz is not None and source.cutoff_hz != used:
        notes.append(OtherFilter(source.cutoff_hz, used))
    if source.model_hash == content_hash(model):
        return Rest(process, absorption=absorption(flights, model, gp), notes=tuple(notes))
    return Rest(process, notes=(OtherPhysics(source.physics), *notes))


def _learnt(flights: Sequence[OpenFlight], fitted: Model, made: Steps, data: Dataset) -> Rest:
    """A process of what the last step leaves, of the axes on which it reduces the error on held-out time."""
    left = made.left[-1]
    if np.all((rms(left) < AT_THE_FLOOR * data.noise)[data.measured_axes]):
        return Rest(absent=Absent.NOISE)
    predicted = held_out_process(data, left)
    if predicted is None:
        return Rest(absent=Absent.SHORT)
    gained = budget(data, made.left[0], left, predicted, Source.FITTED).process > 0
    if not gained.any():
        return Rest(absent=Absent.USELESS)
    outputs = tuple(axis for axis, better in zip(AXES, gained, strict=True) if better)
    settings = FitSettings(points=REST_POINTS, restarts=0, mean=default_mean(fitted))
    learnt = learn_process(flights, fitted, outputs, settings)
    return Rest(Process(learnt.gp, False, True, left - np.where(gained, predicted, 0.0)))


def _next_flights(found: Explanation, fitted: Model, progress: Progress) -> Iterator[NextFlight]:
    """For each group the flight that separates its first few members."""
    for group in found.separable[:MOST_DESIGNED]:
        try:
            yield NextFlight(group, design(group[:MOST_COMPARED], fitted, flights=found.flights, progress=progress))
        except WrenchgapError as error:
            yield NextFlight(group, None, str(error))
    yield from (NextFlight(group, None) for group in found.separable[MOST_DESIGNED:])
