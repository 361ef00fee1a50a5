"""All that a report says: the search for missing effects, the staircase, where the model fails, how to repeat it.

Nothing here is HTML; `replay.present.report.page` writes it down.
"""

from __future__ import annotations

import platform
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrenchgap.flight.errors import WrenchgapError
from wrenchgap.flight.flight import AXES
from wrenchgap.learn.data.applicable import inapplicable
from wrenchgap.learn.data.comparison import Comparison
from wrenchgap.learn.data.dataset import Dataset, dataset
from wrenchgap.learn.data.opening import OpenFlight
from wrenchgap.learn.design.designed import Design
from wrenchgap.learn.design.designer import design
from wrenchgap.learn.diagnose.budget import budget, held_out_process
from wrenchgap.learn.diagnose.timing import Timing, barred, timing_of
from wrenchgap.learn.diagnose.where import Where, examine
from wrenchgap.learn.identify.absorption import Absorption
from wrenchgap.learn.identify.add import Edited, add_fitted
from wrenchgap.learn.identify.explain import Explanation, explain
from wrenchgap.learn.identify.fit import held_out
from wrenchgap.learn.identify.staircase import Process, Staircase, Steps, held_out_staircase, steps, unseen_staircase
from wrenchgap.learn.parallel import cores
from wrenchgap.learn.process import learning
from wrenchgap.learn.process.gp import FitSettings, GaussianProcess
from wrenchgap.plant import trajectory_file
from wrenchgap.plant.effects import sources
from wrenchgap.plant.history import order_of
from wrenchgap.plant.model import Model
from wrenchgap.plant.model_file import content_hash, dumps, next_version, tool_version
from wrenchgap.replay.present import explanation
from wrenchgap.replay.present.explanation import Validation

Array = NDArray[np.float64]
Report = Callable[[float, str], None]

PACKAGES = ("numpy", "scipy", "GPy", "matplotlib", "mcap", "rosbags", "tomlkit", "kmedoids")
"""Packages whose versions may change numbers."""
AT_THE_FLOOR = 1.2
"""Ratio of rms to sensor noise below which nothing is left to learn."""
MOST_APART = 3
"""Members of a group that a flight is designed for: each pair of them has to be told apart."""
MOST_DESIGNED = 2
"""Groups that a flight is designed for; a design takes some ten seconds."""
REST_POINTS = 100
"""Training points of the process that shows what is left to learn."""


@dataclass(frozen=True)
class Input:
    """A file that went in."""

    role: str
    file: str
    sha256: str


@dataclass(frozen=True)
class Apart:
    """Effects that the logs cannot tell apart, and the flight that would; `why_not` where there is none."""

    names: tuple[str, ...]
    design: Design | None
    why_not: str = ""

    def to_json(self) -> dict[str, Any]:
        """Plain."""
        if self.design is None:
            return {"effects": list(self.names), "trajectory": None, "why_not": self.why_not}
        d = self.design
        return {
            "effects": list(self.names),
            "trajectory": trajectory_file.dumps(d.file),
            "segments": [str(s) for s in d.segments],
            "separable": d.separable,
            "separation_before": d.before.separation,
            "separation_expected": d.expected.separation,
            "advice": list(d.advice),
        }


@dataclass(frozen=True)
class Contents:
    """What the page is made of.

    `fitted` is the model as `wrenchgap add` would write it, with all effects fitted to all given logs; `fitted_text`
    its file. `before` and `after` say where the given and the fitted model fail, on `where_on`. `together` are groups
    of effects that the logs cannot tell apart, each with the flight that would; `unshown` are effects that these
    flights cannot show.
    """

    title: str
    date: str
    model: Model
    fitted: Edited
    fitted_text: str
    found: Explanation
    validation: Validation | None
    staircases: tuple[Staircase, ...]
    unseen: Comparison | None
    process: Process | None
    no_process: str
    absorbs: Absorption | None
    before: Where
    after: Where
    where_on: str
    together: tuple[Apart, ...]
    unshown: tuple[str, ...]
    inputs: tuple[Input, ...]
    commands: tuple[str, ...]
    options: tuple[tuple[str, str], ...]
    versions: tuple[tuple[str, str], ...]
    notes: tuple[str, ...]
    timing: tuple[Timing, ...]

    def to_json(self) -> dict[str, Any]:
        """The body of the `report` schema."""
        return {
            "axes": list(AXES),
            "summary": explanation.sentence(self.found),
            "explain": explanation.to_json(self.found, self.validation),
            "staircases": [s.to_json() for s in self.staircases],
            "absorbs": None if self.absorbs is None else learning.absorption_json(self.absorbs),
            "where": {"on": self.where_on, "before": self.before.to_json(), "after": self.after.to_json()},
            "next_flights": [a.to_json() for a in self.together],
            "fitted_model": self.fitted_text,
            "commands": list(self.commands),
            "options": dict(self.options),
            "packages": dict(self.versions),
            "notes": list(self.notes),
            "timing": [t.to_json() for t in self.timing],
        }


def gather(
    flights: Sequence[OpenFlight],
    tests: Sequence[OpenFlight],
    model: Model,
    *,
    model_name: str,
    gp: GaussianProcess | None = None,
    gp_file: Path | None = None,
    command: str = "",
    common: str = "",
    options: Mapping[str, str] | None = None,
    cutoff_hz: float = 8.0,
    progress: Report | None = None,
) -> Contents:
    """Find everything out; `progress` is called with the fraction done.

    `model_name` is what the user called the model, `command` the command that asks for this, and `common` those of its
    options that other commands need as well to come to the same numbers.
    """
    report = progress or (lambda fraction, words: None)
    data = dataset([r for f in flights for r in f.records], model)
    offsets = tuple(timing_of(f, model) for f in flights)
    found = explain(
        data,
        model,
        barred=barred(offsets),
        jobs=cores(),
        progress=lambda words, k, n: report(0.05 + 0.4 * k / max(n, 1), words),
    )
    report(0.45, "fitting all together")
    fitted = add_fitted(model, found.effects, flights, cutoff_hz=cutoff_hz)
    names = [*order_of(model.history, [e.name for e in model.effects]), *found.effects]
    report(0.5, "staircase")
    made = steps(data, model, names)
    process, absorbs, said = _process(flights, model, fitted.model, made, data, gp, report)
    staircases = [held_out_staircase(data, model, made, process)]
    unseen = None
    if tests:
        stairs, unseen = unseen_staircase(tests, model, made, process)
        staircases.append(stairs)
    shown = list(tests) or list(flights)
    before = examine(shown, model, None, lambda f, w: report(0.65 + 0.17 * f, f"before: {w}"))
    after = before
    if found.effects:
        after = examine(shown, fitted.model, None, lambda f, w: report(0.82 + 0.17 * f, f"after: {w}"))
    written = next_version(
        model, fitted.model, command=command, path=Path("fitted.toml"), flights=fitted.flights, trial=fitted.trial
    )
    every = [*flights, *tests]
    notes = [said] if said else []
    learnt_at = None if gp is None else gp.provenance.cutoff_hz
    if learnt_at is not None and learnt_at != cutoff_hz:
        notes.append(f"the GP was learnt behind a filter of {learnt_at:g} Hz, this report uses {cutoff_hz:g} Hz.")
    notes += [*model.notes, *(note for f in every for note in f.notes), *before.notes, *after.notes]
    return Contents(
        title=f"{model.name}: {', '.join(f.records[0].flight for f in flights)}",
        date=datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        model=model,
        fitted=fitted,
        fitted_text=dumps(written if found.effects else model),
        found=found,
        validation=explanation.validate(tests, flights, model, fitted.model) if tests else None,
        staircases=tuple(staircases),
        unseen=unseen,
        process=process,
        no_process=said if process is None else "",
        absorbs=absorbs,
        before=before,
        after=after,
        where_on="the unseen flights" if tests else "the given logs, to which the effects were fitted",
        together=tuple(_apart(found, fitted.model, data, report)),
        unshown=tuple(n for n in found.inapplicable if inapplicable(n, model, data.records) is None),
        inputs=tuple(_inputs(flights, tests, model, gp_file)),
        commands=tuple(_commands(flights, tests, model_name, found, gp_file, command, common)),
        options=tuple({"cut-off": f"{cutoff_hz:g} Hz", **(options or {})}.items()),
        versions=tuple(_versions()),
        notes=tuple(dict.fromkeys(notes)),
        timing=offsets,
    )


def _process(
    flights: Sequence[OpenFlight],
    model: Model,
    fitted: Model,
    made: Steps,
    data: Dataset,
    gp: GaussianProcess | None,
    report: Report,
) -> tuple[Process | None, Absorption | None, str]:
    """The given process, or one of what is left; what it absorbs; a sentence on it."""
    if gp is not None:
        gp.check_vehicle(model.vehicle.name)
        known = {f.flight.content_hash for f in flights} & {log.sha256 for log in gp.provenance.logs}
        if gp.provenance.model_hash != content_hash(model):
            note = f"the GP was learnt on another model than the given one ({gp.provenance.physics}); see its sum"
            if gp.provenance.model_hash == content_hash(model.nominal):
                note = "the GP was learnt on the nominal vehicle; on top of the given effects it counts them twice"
            return Process(gp, True, bool(known)), None, f"{note}."
        report(0.55, "what the GP absorbs")
        return Process(gp, True, bool(known)), learning.guard(flights, model, gp), ""
    report(0.55, "a Gaussian process on what is left")
    nominal, left = (held_out(data, made.nominal, made.names[:k], made.fits[k]) for k in (0, -1 % len(made.fits)))
    if np.all(np.sqrt(np.mean(left**2, axis=0)) < AT_THE_FLOOR * data.noise):
        return None, None, "What is left is the noise of the sensors: a Gaussian process has nothing to learn."
    predicted = held_out_process(data, left)
    if predicted is None:
        return None, None, "Too little data to hold anything out for a Gaussian process."
    parts = budget(data, nominal, left, predicted, "fitted")
    outputs = tuple(axis for axis, gained in zip(AXES, parts.process, strict=True) if gained > 0)
    if not outputs:
        return None, None, "A Gaussian process finds nothing more in what is left, on held-out time."
    settings = FitSettings(points=REST_POINTS, restarts=0, mean=learning.default_mean(fitted))
    learnt = learning.learn(flights, fitted, outputs, settings)
    rows = [AXES.index(axis) for axis in outputs]
    rest = left.copy()
    rest[:, rows] -= predicted[:, rows]
    return Process(learnt.gp, False, True, rest), None, ""


def _apart(found: Explanation, fitted: Model, data: Dataset, report: Report) -> Iterator[Apart]:
    """For each group the flight that tells its first few members apart."""
    for number, group in enumerate(found.groups):
        if number >= MOST_DESIGNED:
            yield Apart(group, None, f"not tried for this page; see wrenchgap design {' '.join(group)}.")
            continue
        names = group[:MOST_APART]
        try:
            told = design(names, fitted, records=data.records, progress=lambda f, w: report(0.97, f"next flight: {w}"))
            yield Apart(group, told)
        except WrenchgapError as error:
            yield Apart(group, None, str(error).removeprefix("design: "))


def _inputs(
    flights: Sequence[OpenFlight], tests: Sequence[OpenFlight], model: Model, gp_file: Path | None
) -> list[Input]:
    from wrenchgap.replay.present.documents import sha256

    listed = [Input("log", str(f.flight.path), f.flight.content_hash) for f in flights]
    listed += [Input("unseen log", str(f.flight.path), f.flight.content_hash) for f in tests]
    if model.path is not None:
        listed.append(Input("model", str(model.path), sha256(model.path)))
    if gp_file is not None:
        listed.append(Input("GP", str(gp_file), sha256(gp_file)))
    listed += [Input(f"effect {name}", source.file, source.sha256) for name, source in sources().items()]
    return listed


def _commands(
    flights: Sequence[OpenFlight],
    tests: Sequence[OpenFlight],
    model: str,
    found: Explanation,
    gp_file: Path | None,
    command: str,
    common: str,
) -> list[str]:
    """The commands that lead to the same numbers one by one."""
    import shlex

    logs, unseen = (shlex.join(str(f.flight.path) for f in group) for group in (flights, tests))
    target = shlex.quote(model)
    listed = [command] if command else []
    listed.append(f"wrenchgap explain {logs} -m {target}" + (f" --validate {unseen}" if unseen else ""))
    fitted = target
    if found.effects:
        fitted = "fitted.toml"
        listed.append(f"wrenchgap add {' '.join(found.effects)} -m {target} --from {logs} -o {fitted}")
        listed.append(f"wrenchgap compare {unseen or logs} -m {target} --against {fitted}")
    listed.append(f"wrenchgap where {unseen or logs} -m {fitted}")
    if gp_file is None:
        listed.append(f"wrenchgap learn {logs} -m {fitted} -o rest.gp")
    return [*listed[:1], *(f"{line}{common}" for line in listed[1:])] if command else listed


def _versions() -> list[tuple[str, str]]:
    listed = [("wrenchgap", tool_version()), ("Python", platform.python_version()), ("system", platform.platform())]
    for name in PACKAGES:
        try:
            listed.append((name, version(name)))
        except PackageNotFoundError:
            continue
    return listed


__all__ = ["Contents", "Input", "gather"]
