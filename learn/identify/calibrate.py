"""What a careful user trims, from flights that are known to be healthy: chosen by held-out time, one effect at a time.

Tried is what a model file usually has slightly wrong of a vehicle that is in order (`TRIMMED`): thrust, its curve over
the command, the torque ratio, centre of mass, tilt and place of the IMU, lags and delays; moments of inertia where the
file says that they are not sure; and the drag of the rotors, which a file seldom has and a place of the IMU would take
the place of. Of those the one that helps most on blocks of time which its fit did not see is taken,
then the next beside it, until none helps; not what ends at the limit of what is plausible; what another made
superfluous goes again (stepwise selection with held-out error, Hastie, Tibshirani and Friedman, "The Elements of
Statistical Learning", 2nd ed., 3.3 and 7.10). With several flights each has to hold besides when whole flights are left
out, so that the loading of one flight is no calibration.

Only what is evidence counts: where the motion does not plainly follow the commands, they may have answered a
disturbance, and what such an answer could make of a fit is taken out of it (`learn.data.feedback_regressors`). Lags and
delays are judged on axes alone that follow (`learn.diagnose.timing.following_axes`), and not tried where none does.
What helps but may be nothing, by its standard deviation, stays out of the model; until the end it is fitted beside the
others, so that none takes what it explains.

Standard deviations are those of the fit (`learn.identify.fit`), the scatter of the flights' own values beyond their
errors, and of the thrust the tolerance of the mass: a later flight may differ as much as these did among themselves.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from wrenchgap.flight.arguments import Progress, silent
from wrenchgap.flight.flight import Array
from wrenchgap.flight.repeats import refuse_seen
from wrenchgap.flight.result import Result
from wrenchgap.learn.data.candidates import Lack, Untried, inapplicable, known, unexcited
from wrenchgap.learn.data.dataset import Dataset, dataset
from wrenchgap.learn.data.errors import rms
from wrenchgap.learn.data.opening import OpenFlight
from wrenchgap.learn.diagnose.timing import dataset_of, following_axes, timing_of, unfollowed_axes
from wrenchgap.learn.identify.add import Addition, addition
from wrenchgap.learn.identify.bias_and_trim import FlightsApart, flights_apart
from wrenchgap.learn.identify.fit import Fit, fit, held_out
from wrenchgap.learn.identify.least_squares import left_by
from wrenchgap.learn.identify.stepwise import Stepwise, of_actuators
from wrenchgap.learn.identify.trend import ParameterTrend, trend
from wrenchgap.plant.model import Model

TRIMMED = (
    *("thrust_scale", "thrust_curve", "com_offset", "drag_torque", "inertia", "rotor_drag"),
    *("imu_misalignment", "imu_lever_arm", "motor_lag", "servo_lag", "command_delay"),
)
"""What is tried, in this order."""


class Fate(StrEnum):
    """What became of an effect that was considered."""

    KEPT = "kept"
    NO_HELP = "no help"  # on held-out time
    ONE_FLIGHT = "one flight"  # helps within flights, not on flights that were left out whole
    UNSURE = "size not sure"  # helps, but its parameters may be nothing
    AT_LIMIT = "at its limit"  # with it a parameter ends at the limit of what is plausible
    HIDES = "hides a weak rotor"  # that the model as it was shows
    UNTRIED = "not tried"


@dataclass(frozen=True)
class Tried:
    """An effect that was considered: `t` of what it changes on held-out time, and why it was not tried, if so."""

    effect: str
    fate: Fate
    t: float | None = None
    reason: Untried | None = None


@dataclass(frozen=True)
class Trimmed:
    """One parameter: its value with `std`, which includes `scatter` between flights (None of one flight).

    `values` (n,) are those of each flight by itself, empty where there is one.
    """

    effect: str
    name: str
    unit: str
    value: float
    std: float
    scatter: float | None
    values: Array


@dataclass(frozen=True)
class HiddenRotor:
    """A change [1] of one rotor's thrust that is found with the model as it was and not with the calibrated one."""

    parameter: str
    change: float


@dataclass(frozen=True, repr=False)
class Calibration(Result):
    """A calibrated model: `added` has it with its fit and its error on held-out time; `tried` what was considered.

    `before` and `after` (n, 6) [N, Nm] are the rms of each flight on its held-out time, `unseen` the same of flights
    that were never fitted. `added` is None where nothing helped, and where it would leave a weak rotor `hidden`: the
    model stays as it was. Lags and delays were judged on the axes `following`, by number. `apart` are axes on which the
    flights do not agree on a constant, whatever was kept.
    """

    given: Model
    added: Addition | None
    tried: tuple[Tried, ...]
    trimmed: tuple[Trimmed, ...]
    names: tuple[str, ...]
    before: Array
    after: Array
    unseen: tuple[tuple[str, Array, Array], ...]
    flights: tuple[OpenFlight, ...]
    following: tuple[int, ...] = ()
    hidden: HiddenRotor | None = None
    apart: tuple[FlightsApart, ...] = ()

    @property
    def lags(self) -> tuple[str, ...]:
        """What was kept of lags and delays."""
        return tuple(name for name in self.effects if of_actuators(name))

    @property
    def model(self) -> Model:
        """The calibrated model, or the given one."""
        return self.given if self.added is None else self.added.model

    @property
    def effects(self) -> tuple[str, ...]:
        """What was kept."""
        return tuple(t.effect for t in self.tried if t.fate is Fate.KEPT)


def calibrate(
    flights: Sequence[OpenFlight],
    model: Model,
    *,
    unseen: Sequence[OpenFlight] = (),
    progress: Progress | None = None,
) -> Calibration:
    """Trim a model on healthy flights; `unseen` are tested on and never fitted.

    Effects of `TRIMMED` that the model has already are fitted anew, others stay as they are. Raises FitError where the
    flights are too short to hold anything out, LogError where a flight is fitted and tested on.
    """
    report = progress or silent
    refuse_seen([f.flight for f in flights], [f.flight for f in unseen])
    report(0.0, "timing of the topics")
    given, model = model, model.with_known_thrust
    bare = model.without(e.name for e in model.effects if e.name in TRIMMED)
    timing = [timing_of(f, model) for f in flights]
    data = dataset([r for f in flights for r in f.records], model, unfollowed_axes(timing))
    following = following_axes(timing)
    reasons = {name: _reason(name, bare, flights, following) for name in TRIMMED}
    search = Stepwise(data, bare, report, following)
    chosen = search.chosen([name for name in TRIMMED if reasons[name] is None])
    tried = tuple(_tried(name, chosen, search, reasons[name]) for name in TRIMMED)
    names = tuple(f.records[0].flight for f in flights)
    before = after = _by_flight(data, held_out(data, model, (), fit(data, model, ())))
    added: Addition | None = None
    trimmed: tuple[Trimmed, ...] = ()
    trimmed_model = model
    if chosen:
        report(0.9, "flight by flight")
        fitted = search.fit
        trimmed = _trimmed(fitted, flights, bare, chosen)
        fitted_to = f"{', '.join(chosen)} together, healthy flights, below {data.records[0].cutoff_hz:g} Hz"
        wider = _with_std(fitted, np.array([one.std for one in trimmed]))
        added = addition(model, bare, chosen, flights, data, wider, f"wrenchgap calibrate: {fitted_to}")
        after = _by_flight(data, held_out(data, bare, chosen, fitted))
        trimmed_model = added.model
    return Calibration(
        given,
        added,
        tried,
        trimmed,
        names,
        before,
        after,
        _unseen(unseen, model, trimmed_model),
        tuple(flights),
        following,
        apart=flights_apart(data, left_by(data, trimmed_model), replace(trimmed_model, between_flights=None)),
    )


def _reason(name: str, model: Model, flights: Sequence[OpenFlight], following: Sequence[int]) -> Untried | None:
    """Why an effect is not trimmed on these flights: it cannot be, or nothing says that it is open."""
    records = [r for f in flights for r in f.records]
    reason = known(name, model)
    if reason is None and name == "thrust_curve" and model.command is None:
        reason = Untried(name, Lack.KNOWN, "logs of this vehicle have rotor speeds or a wrench: no [command]")
    if reason is None and name == "inertia" and model.vehicle.tolerances.inertia is None:
        reason = Untried(name, Lack.KNOWN, "the model file gives the inertia without a tolerance")
    reason = reason or inapplicable(name, model, records) or unexcited(name, model, records)
    return reason or (Untried(name, Lack.FOLLOWING) if of_actuators(name) and not following else None)


def _tried(name: str, chosen: Sequence[str], search: Stepwise, reason: Untried | None) -> Tried:
    if reason is not None:
        return Tried(name, Fate.UNTRIED, None, reason)
    fates = {
        Fate.KEPT: chosen,
        Fate.AT_LIMIT: search.stuck,
        Fate.UNSURE: search.unsure,
        Fate.ONE_FLIGHT: search.single,
    }
    fate = next((fate for fate, names in fates.items() if name in names), Fate.NO_HELP)
    return Tried(name, fate, search.t.get(name))


def _trimmed(fitted: Fit, flights: Sequence[OpenFlight], model: Model, chosen: Sequence[str]) -> tuple[Trimmed, ...]:
    """Every parameter with its scatter between flights in its standard deviation."""
    rows: dict[tuple[str, str], ParameterTrend] = {}
    if len(flights) > 1:
        rows = {(p.effect, p.name): p for p in trend(flights, model, chosen).parameters}
    tolerance = model.vehicle.tolerances.mass
    out = []
    for (effect, p), value, std in zip(fitted.parameters, fitted.theta, fitted.std, strict=True):
        row = rows.get((effect, p.name))
        scatter = None if row is None else scatter_of(row.values, row.errors)
        more = 0.0 if scatter is None else scatter * np.sqrt(1.0 + 1.0 / len(flights))
        weighed = tolerance / model.vehicle.body.mass if tolerance and effect == "thrust_scale" else 0.0
        whole = float(np.sqrt(std**2 + more**2 + weighed**2))
        values = np.empty(0) if row is None else row.values
        out.append(Trimmed(effect, p.name, p.unit, float(value), whole, scatter, values))
    return tuple(out)


def scatter_of(values: Array, errors: Array) -> float:
    """By how much flights differ (n,), one standard deviation, beyond what each is uncertain by itself (n,)."""
    beyond = float(np.var(values, ddof=1) - np.mean(errors**2))
    return float(np.sqrt(max(beyond, 0.0)))


def _with_std(fitted: Fit, stds: Array) -> Fit:
    """The fit with these standard deviations, correlations kept."""
    factor = stds / np.maximum(fitted.std, 1e-300)
    each = np.split(stds, np.cumsum([len(e.theta) for e in fitted.effects])[:-1])
    effects = tuple(replace(effect, std=own) for effect, own in zip(fitted.effects, each, strict=True))
    return replace(fitted, effects=effects, covariance=fitted.covariance * np.outer(factor, factor))


def _by_flight(data: Dataset, left: Array) -> Array:
    """Rms (n, 6) of a residual (K, 6) on each flight."""
    return np.array([rms(left[data.flight == f]) for f in range(int(data.flight.max()) + 1)])


def _unseen(flights: Sequence[OpenFlight], given: Model, calibrated: Model) -> tuple[tuple[str, Array, Array], ...]:
    """Name, rms before and after (6,), of flights that were not fitted; each keeps a bias of its own."""
    out = []
    for one in flights:
        data = dataset_of([one], given)
        before, after = (rms(fit(data, m, ()).residual) for m in (given, calibrated))
        hidden = ~data.measured_axes
        before[hidden], after[hidden] = np.nan, np.nan
        out.append((one.records[0].flight, before, after))
    return tuple(out)
