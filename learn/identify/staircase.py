"""The error step by step: the nominal vehicle, one effect after the other, a Gaussian process, the noise.

One staircase is about one kind of time (`Basis`), because an error means little without it:

    HELD_OUT  blocks of time of the given logs; every block is predicted by parameters fitted without it, the
              accelerometer's bias among them (`learn.identify.fit.held_out`)
    UNSEEN    flights that nothing was fitted to; raw errors, as `compare` reports them
    FITTED    the flights that the effects were fitted to; raw errors, in-sample
    RAW       flights on which a model without fitted effects stands; raw errors

At each step all effects up to there are fitted together. "In all" is sqrt(sum_l (w_l rms_l)^2) with the weights of
`learn.data.dataset.Dataset`, newtons and newton metres on one scale.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Self

from wrenchgap.flight.flight import Array
from wrenchgap.learn.data.comparison import Comparison, compare
from wrenchgap.learn.data.dataset import Dataset, dataset
from wrenchgap.learn.data.errors import rms, whole
from wrenchgap.learn.data.opening import OpenFlight
from wrenchgap.learn.data.prediction import Predictor, pooled_inputs
from wrenchgap.learn.identify.bias_and_trim import with_thrust_as_given
from wrenchgap.learn.identify.fit import Fit, fit, held_out, with_fit
from wrenchgap.learn.process.gp import GaussianProcess
from wrenchgap.plant.mismatch import output_indices
from wrenchgap.plant.model import Model


class Basis(StrEnum):
    """Which time a staircase is about; see the module."""

    HELD_OUT = "held out"
    UNSEEN = "unseen"
    FITTED = "fitted"
    RAW = "raw"


class Kind(StrEnum):
    """What a stair is the error of."""

    NOMINAL = "nominal"
    EFFECT = "effect"  # with this effect and all before it
    GIVEN = "given"  # the model as it was given
    PROCESS = "process"  # a Gaussian process on the last step
    GIVEN_PROCESS = "given process"  # a process that was given, on the model as it was given
    NOISE = "noise"


@dataclass(frozen=True)
class Stair:
    """One step: rms (6,) [N, Nm]; `name` of the effect or of the given model.

    `beside` is true for what is no step of the staircase but worth comparing, `learnt_here` for a process that was
    learnt on this very time.
    """

    kind: Kind
    name: str
    rms: Array
    in_all: float
    beside: bool = False
    learnt_here: bool = False

    @classmethod
    def of(
        cls, kind: Kind, name: str, size: Array, weights: Array, beside: bool = False, learnt_here: bool = False
    ) -> Self:
        """The stair of an rms (6,)."""
        return cls(kind, name, size, whole(size, weights), beside, learnt_here)


@dataclass(frozen=True)
class Staircase:
    """Stairs from the nominal vehicle downwards on `flights`, and the noise floor."""

    basis: Basis
    flights: tuple[str, ...]
    stairs: tuple[Stair, ...]
    noise: Stair

    @property
    def falling(self) -> tuple[Stair, ...]:
        """The steps proper."""
        return tuple(s for s in self.stairs if not s.beside)

    def share(self, stair: Stair) -> float:
        """The error in all of a stair over that of the nominal vehicle."""
        return stair.in_all / max(self.stairs[0].in_all, 1e-30)

    def at_the_noise(self, stair: Stair, within: float = 1.05) -> bool:
        """Whether nothing remains but the noise of the sensors, whose estimate is good to a few per cent only."""
        return stair.in_all <= within * self.noise.in_all


def staircase(basis: Basis, data: Dataset, residuals: Iterable[Array], effects: Sequence[str]) -> Staircase:
    """From residuals (K, 6) of `data`: of the nominal vehicle, then with the first, the first two, ... `effects`."""
    labels = zip(_labels(effects), residuals, strict=True)
    return _made(basis, data, [Stair.of(kind, name, rms(left), data.weights) for (kind, name), left in labels])


def _labels(effects: Sequence[str]) -> list[tuple[Kind, str]]:
    return [(Kind.NOMINAL, ""), *((Kind.EFFECT, name) for name in effects)]


def _made(basis: Basis, data: Dataset, stairs: Sequence[Stair]) -> Staircase:
    names = tuple(dict.fromkeys(r.flight for r in data.records))
    return Staircase(basis, names, tuple(stairs), Stair.of(Kind.NOISE, "", data.noise, data.weights))


@dataclass(frozen=True)
class Steps:
    """The fits behind the stairs: of no effect, of the first, of the first two, ... all together.

    `left` (K, 6) of each is the residual on blocks of time that were not fitted.
    """

    names: tuple[str, ...]
    fits: tuple[Fit, ...]
    left: tuple[Array, ...]
    nominal: Model

    def model(self, count: int) -> Model:
        """The model with the first `count` effects."""
        return with_fit(self.nominal, self.fits[count])


def steps(
    data: Dataset,
    model: Model,
    names: Sequence[str],
    *,
    whole: Fit | None = None,
    earlier: Steps | None = None,
) -> Steps:
    """Fit the first 0, 1, 2, ... of `names` together, on the nominal vehicle of `model`.

    Nothing is fitted that is there already: `whole` is a fit to `data`, of use where it is of all
    of them, in any order; `earlier` are steps on the same `data` that may begin with the same names. Raises FitError
    where nothing can be held out.
    """
    nominal = with_thrust_as_given(model.nominal)
    fits: list[Fit] = []
    left: list[Array] = []
    for count in range(len(names) + 1):
        part = tuple(names[:count])
        if earlier is not None and earlier.names[:count] == part and count < len(earlier.fits):
            fits.append(earlier.fits[count])
            left.append(earlier.left[count])
            continue
        if whole is not None and not whole.thrust.size and {e.name for e in whole.effects} == set(part) == set(names):
            fits.append(whole)
        else:
            fits.append(fit(data, nominal, part, start=fits[-1] if count > 1 else None))
        left.append(held_out(data, nominal, [e.name for e in fits[-1].effects], fits[-1]))
    return Steps(tuple(names), tuple(fits), tuple(left), nominal)


@dataclass(frozen=True)
class Process:
    """A Gaussian process on top of a model.

    `given` ones sit on the model that was given; others were learnt for the report on the last step, to show what is
    left to learn. `known` says whether it has seen any of the given logs. `left` (K, 6) is what stays of the given
    logs' residual on blocks that the process did not see; None where it has seen them all.
    """

    gp: GaussianProcess
    given: bool
    known: bool
    left: Array | None = None


def held_out_staircase(data: Dataset, model: Model, made: Steps, process: Process | None) -> Staircase:
    """On blocks of the given logs that were not fitted."""
    stairs = list(staircase(Basis.HELD_OUT, data, made.left, made.names).stairs)
    as_given = made.left[0].copy()
    if model.effects:
        given = with_thrust_as_given(model)
        as_given = held_out(data, given, (), fit(data, given, ()))
        stairs.append(Stair.of(Kind.GIVEN, model.name, rms(as_given), data.weights, beside=True))
    if process is not None and process.left is not None:
        stairs.append(Stair.of(Kind.PROCESS, "", rms(process.left), data.weights))
    elif process is not None:
        rows = output_indices(process.gp.outputs)
        as_given[:, rows] -= process.gp.mean(pooled_inputs(process.gp.input_groups, data.records))
        beside = _beside(model, made)
        stairs.append(Stair.of(Kind.GIVEN_PROCESS, model.name, rms(as_given), data.weights, beside, process.known))
    return _made(Basis.HELD_OUT, data, stairs)


def unseen_staircase(
    flights: Sequence[OpenFlight], model: Model, made: Steps, process: Process | None
) -> tuple[Staircase, Comparison]:
    """On flights that nothing was fitted to; and the comparison behind it, evaluated in the order of the stairs."""
    labels = _labels(made.names)
    models = [made.model(k).wrench_model for k in range(len(labels))]
    found = [Predictor(name or kind, each) for (kind, name), each in zip(labels, models, strict=True)]
    if model.effects:
        labels.append((Kind.GIVEN, model.name))
        found.append(Predictor(f"{model.name} as given", model.wrench_model))
    if process is not None:
        labels.append((Kind.GIVEN_PROCESS, model.name) if process.given else (Kind.PROCESS, ""))
        below = model.wrench_model if process.given else models[-1]
        found.append(Predictor(f"{model.name}+GP", below, process.gp))
    result = compare(flights, model, found)
    data = dataset(result.records, model)
    aside = {Kind.GIVEN: True, Kind.GIVEN_PROCESS: _beside(model, made)}
    stairs = [
        Stair.of(kind, name, one.pooled.rms, data.weights, aside.get(kind, False))
        for (kind, name), one in zip(labels, result.evaluations, strict=True)
    ]
    return _made(Basis.UNSEEN, data, stairs), result


def _beside(model: Model, made: Steps) -> bool:
    """Whether the model as given, which a given GP sits on, is something else than the last step."""
    return {e.name for e in model.effects} != set(made.names)
