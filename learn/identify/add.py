"""Effects put into a model, fitted to flights, and what that did on time that was not fitted."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

from wrenchgap.flight.arguments import Progress
from wrenchgap.flight.errors import FitError
from wrenchgap.flight.flight import Array
from wrenchgap.flight.result import Result
from wrenchgap.learn.data.blocks import by_block, paired_t
from wrenchgap.learn.data.dataset import Dataset
from wrenchgap.learn.data.errors import energy, reduction, rms, weighted
from wrenchgap.learn.data.opening import OpenFlight
from wrenchgap.learn.diagnose.timing import dataset_of
from wrenchgap.learn.identify.bias_and_trim import between_flights, with_thrust_as_given
from wrenchgap.learn.identify.fit import Fit, fit, held_out, with_fit
from wrenchgap.plant.effects import find, require_force
from wrenchgap.plant.history import Trial
from wrenchgap.plant.model import Model
from wrenchgap.plant.model_file import provenance_now


@dataclass(frozen=True, repr=False)
class Addition(Result):
    """A model with effects fitted: rms (6,) on the fitted flights before and after; `refitted` were in it already.

    `between_flights` (6,) [N, Nm] is by how much these flights differ on average, one standard deviation, None where
    they do not (`learn.identify.bias_and_trim`). `together` are effects that the given model had besides.
    `trial` is the error on time that was not fitted, None where the logs are too short to hold any out.
    """

    given: Model
    model: Model
    fit: Fit
    rms_before: Array
    rms_after: Array
    refitted: tuple[str, ...]
    together: tuple[str, ...]
    trial: Trial | None
    between_flights: Array | None
    flights: tuple[OpenFlight, ...]

    @property
    def reduction(self) -> Array:
        """Fraction (6,) of the rms on the fitted flights that is gone."""
        return reduction(self.rms_before, self.rms_after)

    @property
    def logs(self) -> tuple[tuple[str, str], ...]:
        """(file name, SHA-256) of the fitted logs."""
        return tuple((f.flight.path.name, f.flight.content_hash) for f in self.flights)


def model_of(model: Model | Addition) -> Model:
    """The model itself."""
    return model.model if isinstance(model, Addition) else model


def labels(model: Model | Addition, *others: Model | Addition) -> list[str]:
    """Names for tables; of an addition "+ EFFECT", what it adds to `model`, or to nominal where that is one too."""
    first = set() if isinstance(model, Addition) else {e.name for e in model.effects}

    def label(one: Model | Addition) -> str:
        if isinstance(one, Model):
            return one.name
        names = [e.name for e in one.model.effects]
        known = first if first <= set(names) else set()
        return " ".join([*([one.given.name] if known else []), *(f"+ {n}" for n in names if n not in known)])

    return [label(one) for one in (model, *others)]


def add(
    model: Model,
    names: Sequence[str],
    flights: Sequence[OpenFlight],
    *,
    fitted: Fit | None = None,
    progress: Progress | None = None,
) -> Addition:
    """Fit the named effects together with those that the model has. Raises FitError where the logs cannot say.

    `fitted` is that fit, where these very flights were fitted already (`Explanation.fit`).
    """
    for name in names:
        find(name)
    present = [e.name for e in model.effects]
    every = [*present, *(n for n in dict.fromkeys(names) if n not in present)]
    require_force(every)
    data = dataset_of(flights, model)
    words, ticks = f"fitting {', '.join(every)}", itertools.count(1)

    def tick() -> None:
        if progress is not None:
            progress(1.0 - 0.97 ** next(ticks), words)

    fitted = fitted or fit(data, with_thrust_as_given(model), every, tick=tick)
    how = f"wrenchgap add: {', '.join(every)} together, six axes below {data.records[0].cutoff_hz:g} Hz"
    return addition(model, model, names, flights, data, fitted, how)


def addition(
    model: Model,
    bare: Model,
    names: Sequence[str],
    flights: Sequence[OpenFlight],
    data: Dataset,
    fitted: Fit,
    method: str,
) -> Addition:
    """What a fit of `bare`, which is `model` or has fewer effects, makes of `model`; `method` says how, in words.

    Where the fit was granted a thrust (`Fit.thrust`), it is fitted again without.
    """
    if fitted.thrust.size:
        fitted = fit(data, with_thrust_as_given(bare), [e.name for e in fitted.effects], start=fitted)
    source = provenance_now(method, [(f.flight.path.name, f.flight.content_hash) for f in flights])
    fitted = replace(fitted, effects=tuple(replace(e, provenance=source) for e in fitted.effects))
    after, present = with_fit(bare, fitted), [e.name for e in model.effects]
    before, left = (data.measured - data.predict(m.wrench_model) for m in (model, after))
    scatter = between_flights(data, left, model)
    if scatter is not None:
        after = replace(after, between_flights=tuple(scatter.tolist()))
    return Addition(
        model,
        after,
        fitted,
        rms(before),
        rms(left),
        tuple(n for n in names if n in present),
        tuple(e.name for e in fitted.effects if e.name not in names),
        trial(data, model, [e.name for e in fitted.effects], fitted, bare),
        scatter,
        tuple(flights),
    )


def trial(data: Dataset, model: Model, names: Sequence[str], fitted: Fit, bare: Model | None = None) -> Trial | None:
    """`model` as given against the same, or `bare`, with `names` fitted, on time that the fit did not see.

    The accelerometer's bias is estimated on both sides. `t` is the paired t over the blocks' weighted squared errors.
    """
    given, made = (with_thrust_as_given(one) for one in (model, bare or model))
    try:
        before = held_out(data, given, (), fit(data, given, ()))
        after = held_out(data, made, names, fitted)
    except FitError:  # too short to hold anything out
        return None
    gain = by_block(data.block, weighted(before**2 - after**2, data.weights**2).sum(axis=1))
    change = energy(after, data.weights) / max(energy(before, data.weights), 1e-30) - 1.0
    return Trial(rms(before), rms(after), data.noise, change, float(paired_t(gain)))
