"""The error as a falling staircase: the nominal vehicle, one effect after the other, a Gaussian process, the noise.

Two staircases tell the same story on data that was not fitted:

    held out    blocks of time of the given logs; every block is predicted by parameters fitted without it, the
                accelerometer's bias among them (`learn.identify.fit.held_out`)
    unseen      flights that nothing was fitted to; raw errors, as `wrenchgap compare` reports them

At each step all effects up to there are fitted together. "In all" is sqrt(sum_l (w_l rms_l)^2) with the weights of
`learn.data.dataset.Dataset`, newtons and newton metres on one scale.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wrenchgap.learn.data.comparison import Comparison, compare
from wrenchgap.learn.data.dataset import Dataset, dataset
from wrenchgap.learn.data.errors import rms, whole
from wrenchgap.learn.data.inputs import pooled_inputs
from wrenchgap.learn.data.opening import OpenFlight
from wrenchgap.learn.data.prediction import Predictor
from wrenchgap.learn.identify.fit import Fit, fit, held_out, with_fit
from wrenchgap.learn.process.gp import GaussianProcess
from wrenchgap.plant.mismatch import output_indices
from wrenchgap.plant.model import Model

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Stair:
    """One step: rms (6,) [N, Nm]; `beside` is true for what is no step of the staircase but worth comparing."""

    name: str
    rms: Array
    in_all: float
    beside: bool = False
    note: str = ""


@dataclass(frozen=True)
class Staircase:
    """Stairs from the nominal vehicle downwards, and the noise floor."""

    title: str
    stairs: tuple[Stair, ...]
    noise: Stair

    @property
    def falling(self) -> tuple[Stair, ...]:
        """The steps proper."""
        return tuple(s for s in self.stairs if not s.beside)


@dataclass(frozen=True)
class Steps:
    """The fits behind the stairs: of no effect, of the first, of the first two, ... all together."""

    names: tuple[str, ...]
    fits: tuple[Fit, ...]
    nominal: Model

    def model(self, count: int) -> Model:
        """The model with the first `count` effects."""
        return with_fit(self.nominal, self.fits[count])


def steps(data: Dataset, model: Model, names: Sequence[str], tick: Callable[[int], None] | None = None) -> Steps:
    """Fit the first 0, 1, 2, ... of `names` together, on the nominal vehicle of `model`."""
    nominal = model.nominal
    fits = [fit(data, nominal, ())]
    for count in range(1, len(names) + 1):
        start = None if count == 1 else fits[-1]
        fits.append(fit(data, nominal, tuple(names[:count]), start=start))
        if tick is not None:
            tick(count)
    return Steps(tuple(names), tuple(fits), nominal)


@dataclass(frozen=True)
class Process:
    """A Gaussian process on top of a model.

    `given` ones sit on the model that was given; others were learnt for the report on the last step, to show what is
    left to learn. `left` (K, 6) is what stays of the given logs' residual on blocks that the process did not see; None
    where it has seen them all.
    """

    gp: GaussianProcess
    given: bool
    known: bool
    left: Array | None = None


def held_out_staircase(data: Dataset, model: Model, made: Steps, process: Process | None) -> Staircase:
    """On blocks of the given logs that were not fitted."""
    left = (held_out(data, made.nominal, made.names[:k], f) for k, f in enumerate(made.fits))
    stairs = [_stair(name, rms(r), data.weights) for name, r in zip(_names(made), left, strict=True)]
    as_given = held_out(data, model, (), fit(data, model, ()))
    if model.effects:
        stairs.append(_stair(f"{model.name} as given", rms(as_given), data.weights, beside=True))
    if process is not None and process.left is not None:
        stairs.append(_stair(PROCESS, rms(process.left), data.weights))
    elif process is not None:
        rows = output_indices(process.gp.outputs)
        as_given[:, rows] -= process.gp.mean(pooled_inputs(process.gp.input_groups, data.records))
        note = "learnt on these logs: not held out" if process.known else ""
        stairs.append(_stair(_given_name(model), rms(as_given), data.weights, _beside(model, made), note))
    return Staircase("held-out time of the given logs", tuple(stairs), _stair("sensor noise", data.noise, data.weights))


def unseen_staircase(
    flights: Sequence[OpenFlight], model: Model, made: Steps, process: Process | None
) -> tuple[Staircase, Comparison]:
    """On flights that nothing was fitted to; and the comparison behind it, the first and the last step first."""
    found = [Predictor(name, made.model(k).wrench_model) for k, name in enumerate(_names(made))]
    count = len(found)
    if model.effects:
        found.append(Predictor(f"{model.name} as given", model.wrench_model))
    if process is not None:
        below = model if process.given else made.model(count - 1)
        name = _given_name(model) if process.given else PROCESS
        found.append(Predictor(name, below.wrench_model, process.gp))
    result = compare(flights, model, found)
    weights = dataset(result.records, model).weights
    stairs = []
    for k, one in enumerate(result.evaluations):
        on_top = process is not None and k == len(found) - 1
        falling = k < count or (on_top and (not process.given or not _beside(model, made)))  # type: ignore[union-attr]
        stairs.append(_stair(one.name, one.pooled.rms, weights, not falling))
    title = f"unseen flights ({', '.join(result.flights)})"
    return Staircase(title, tuple(stairs), _stair("sensor noise", result.noise, weights)), result


PROCESS = "+ GP of the rest"


def _given_name(model: Model) -> str:
    return f"{model.name} as given + GP"


def _beside(model: Model, made: Steps) -> bool:
    """Whether the model as given, which a given GP sits on, is something else than the last step."""
    return {e.name for e in model.effects} != set(made.names)


def _names(made: Steps) -> list[str]:
    return ["nominal", *(f"+ {name}" for name in made.names)]


def _stair(name: str, rms: Array, weights: Array, beside: bool = False, note: str = "") -> Stair:
    return Stair(name, rms, whole(rms, weights), beside, note)
