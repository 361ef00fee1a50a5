"""The methods that every table compares, and what each knows: one training log, never the truth."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from wrenchgap.compensate import INDI, L1, Compensator, DisturbanceObserver, PhysicsMismatch, Settings
from wrenchgap.flight.filters import butterworth, filtered, steady_state
from wrenchgap.flight.flight import Array
from wrenchgap.learn.data.measurement import Record
from wrenchgap.learn.data.opening import OpenFlight
from wrenchgap.learn.data.prediction import Predictor
from wrenchgap.learn.identify.learning import TORQUE, learn_process, samples
from wrenchgap.learn.posterior.explain import Explanation, explain
from wrenchgap.learn.process.gp import FitSettings, GaussianProcess
from wrenchgap.learn.process.train import fit_linear
from wrenchgap.plant.effects.lag import first_order
from wrenchgap.plant.mismatch import LinearMismatch
from wrenchgap.plant.model import Model
from wrenchgap.replay.compensation.compensators import combined, compensator

LEAD = 0.1
"""Horizon over which physics leads the lags [s]; shorter pushes the actuators harder."""
OBSERVER_HZ = 4.0
"""Bandwidth of the disturbance observer [Hz]: of 0.5, 1, 2, 4, 6, 8 and 12 the best on the figure-8. With 6 the vehicle
rings, with 12 control is lost."""

CUTOFFS_HZ = {"INDI, told the lag": 16.0, "INDI, told no lag": 2.0, "L1": 2.0}
"""Of INDI and L1 [Hz], chosen on other vehicles and seeds by `benchmarks.paper.feedback`."""


@dataclass(frozen=True)
class Knowledge:
    """What can be learnt from `flights` of a vehicle believed to be `model`. `dt` [s] is the control period."""

    model: Model
    flights: Sequence[OpenFlight]
    points: int
    _held: dict[str, GaussianProcess] = field(default_factory=dict, repr=False)

    @property
    def dt(self) -> float:
        """Control period [s]."""
        return 1.0 / self.model.controller.rate_hz

    @property
    def settings(self) -> Settings:
        """Of every compensation that is not said to differ."""
        return Settings(dt=self.dt)

    @cached_property
    def explanation(self) -> Explanation:
        """What `wrenchgap explain` names, with the command's own settings."""
        return explain(self.flights, self.model)

    @property
    def physics(self) -> Model:
        """The model with the effects that were named."""
        return self.explanation.model

    def gp(self, physics: bool = False, **settings: Any) -> GaussianProcess:
        """A torque GP on what the nominal model, or that with `physics`, leaves; `settings` of the fit.

        As fitted, like the paper's, unless the settings say `guarded`.
        """
        key = f"{physics} {sorted(settings.items())}"
        if key not in self._held:
            mean = "physics" if physics else "zero"
            chosen = FitSettings(**{"points": self.points, "mean": mean, "guarded": False, **settings})
            self._held[key] = learn_process(self.flights, self.physics if physics else self.model, TORQUE, chosen).gp
        return self._held[key]

    def linear(self, slope: bool) -> LinearMismatch:
        """A straight line, or a constant."""
        data = samples([r for f in self.flights for r in f.records], self.model)
        return fit_linear(data.inputs, data.outputs[:, 3:], TORQUE, slope=slope)


Build = Callable[[Knowledge], Any]
Predict = Callable[[Knowledge, Record], Array]


@dataclass(frozen=True)
class Method:
    """One row of the tables.

    `build` makes the compensator, None for none. `predict` gives the torque mismatch (K, 3) that the method expects at
    the samples of a record, `gp` and `physics` the models behind it where there are any.
    """

    name: str
    build: Build | None = None
    predict: Predict | None = None
    integral: bool | None = None
    gp: Callable[[Knowledge], GaussianProcess] | None = None
    physics: bool = False


def with_gp(name: str, physics: bool = False, lead: float | None = None, **settings: Any) -> Method:
    """A GP on what the nominal model or, with `physics`, the named effects leave; `settings` of its fit."""

    def gp(known: Knowledge) -> GaussianProcess:
        return known.gp(physics, **settings)

    def build(known: Knowledge) -> Compensator:
        named = PhysicsMismatch(known.physics.wrench_model, TORQUE, lead=lead) if physics else None
        return Compensator(gp(known), known.settings, physics=named)

    def predict(known: Knowledge, record: Record) -> Array:
        return predicted(known, record, known.physics if physics else known.model, gp(known))

    return Method(name, build, predict, gp=gp, physics=physics)


def _physics(name: str, lead: float | None = None) -> Method:
    return Method(
        name,
        lambda known: Compensator(PhysicsMismatch(known.physics.wrench_model, TORQUE, lead=lead), known.settings),
        lambda known, record: predicted(known, record, known.physics),
        physics=True,
    )


def _line(name: str, slope: bool) -> Method:
    return Method(
        name,
        lambda known: Compensator(known.linear(slope), known.settings),
        lambda known, record: known.linear(slope).mean(record.commanded),
    )


def predicted(known: Knowledge, record: Record, model: Model, gp: GaussianProcess | None = None) -> Array:
    """Torque mismatch (K, 3) that a model, with or without a GP on top, expects."""
    wrench = Predictor("", model.wrench_model, gp).predict(record, known.model.vehicle.body)
    return np.asarray((wrench - nominal(known, record))[:, 3:])


def nominal(known: Knowledge, record: Record) -> Array:
    """The wrench (K, 6) that the nominal model expects."""
    return Predictor("nominal", known.model.wrench_model).predict(record, known.model.vehicle.body)


def _observed(known: Knowledge, record: Record, hz: float = OBSERVER_HZ) -> Array:
    """What an observer would know at each sample: the mismatch so far, through its first-order low-pass."""
    z = (record.measured - nominal(known, record))[:, 3:]
    late, _ = first_order(z, 1.0 / (2.0 * np.pi * hz), record.dt_kept, None)
    return late


PD = Method("PD", integral=False)
INTEGRAL = Method("PD + integral", integral=True)
CONSTANT, LINEAR = _line("constant offset", False), _line("linear in W", True)
OBSERVER = Method(
    f"disturbance observer, {OBSERVER_HZ:g} Hz",
    lambda known: DisturbanceObserver(known.model.vehicle, known.dt, OBSERVER_HZ),
    _observed,
)
PHYSICS, GP, BOTH = _physics("physics"), with_gp("GP"), with_gp("physics + GP", physics=True)
SPARSE = with_gp("GP, sparse on all samples", inference="sparse")
PAST = with_gp("GP with the past as input", inputs=("past",))
LEADING = _physics(f"physics, lags led by {LEAD:g} s", LEAD)
LEADING_BOTH = with_gp(f"physics, lags led by {LEAD:g} s, + GP", physics=True, lead=LEAD)
ON_A_LINE = with_gp("GP on a linear mean", mean="linear")
PAPERS = with_gp("GP, points chosen as in the paper", method="pyclustering", scale="raw")


def _together(gp: GaussianProcess, model: Model, settings: Settings) -> Any:
    """With an observer; without one where `learn` gives none, since it would remove little of what is left."""
    return (combined if gp.provenance.observer_hz is not None else compensator)(gp, model, settings)


JUDGED = with_gp("GP, as far as held-out time supports it", guarded=True)
TOGETHER = Method(
    "combined: that GP and an observer of the log's bandwidth",
    lambda known: _together(known.gp(guarded=True), known.model, known.settings),
)
"""Feed-forward and feedback (`compensate.Combined`)."""
ALL_TOGETHER = Method(
    "combined: physics + GP and an observer of the log's bandwidth",
    lambda known: _together(known.gp(physics=True, guarded=True), known.physics, known.settings),
)
"""The same on top of what `explain` names."""


def _increments(known: Knowledge, record: Record, hz: float, lag: float = 0.0) -> Array:
    """What INDI expects, A_o W_cmd + H (W_meas - A_o W_cmd), less the command (`compensate.feedback`)."""
    command = nominal(known, record)[:, 3:]
    made, _ = first_order(command, lag, record.dt_kept, None)
    z, section = record.measured[:, 3:] - made, butterworth(hz, 1.0 / record.dt_kept)
    return made + filtered(section[:3], section[3:], z, np.outer(steady_state(section), z[0])) - command


def _logged_lag(known: Knowledge) -> float:
    """Of the training log [s], as the combination is told."""
    return known.gp(guarded=True).provenance.observer_lag


def _by_feedback(law: str, build: Callable[[Knowledge, float], Any], predict: Callable[..., Array]) -> Method:
    hz = CUTOFFS_HZ[law]
    return Method(f"{law}, {hz:g} Hz", lambda known: build(known, hz), lambda known, record: predict(known, record, hz))


FEEDBACK = (
    _by_feedback(
        "INDI, told the lag",
        lambda known, hz: INDI(known.model.vehicle, known.dt, hz, lag=_logged_lag(known)),
        lambda known, record, hz: _increments(known, record, hz, _logged_lag(known)),
    ),
    _by_feedback("INDI, told no lag", lambda known, hz: INDI(known.model.vehicle, known.dt, hz), _increments),
    _by_feedback("L1", lambda known, hz: L1(known.model.vehicle, known.dt, hz), _observed),
)
"""What others fly. L1 finds the mismatch within a period, so that what it expects is an observer's of its cut-off."""

EVERYWHERE = (PD, INTEGRAL, CONSTANT, LINEAR, OBSERVER, PHYSICS, GP, BOTH)
"""The rows of every table."""
