"""Estimating the parameters of effects from flights: bounded Gauss-Newton on the residual of all six axes.

Minimised over theta (all parameters of all named effects together):

    eta sum_k sum_l w_l^2 (W_meas - W_pred(theta) - m b_flight)_kl^2  +  sum_p (theta_p / s_p)^2

An accelerometer's bias changes from flight to flight and looks like a force that is constant in B. It is therefore
estimated along with the effects, per flight, within +-`ACCELEROMETER_BIAS`: a constant force larger than that is an
effect, a smaller one is not news.

w_l are the axis weights, s_p the parameter's typical size (a weak prior that only decides what the data leave open),
and eta = dt_kept * 2 f_c at most 1 discounts samples that the filter has made dependent. Steps are bounded
least-squares problems within the plausible ranges, with numerical derivatives of the whole prediction.

For an effect that is `sparse` (one gain per rotor, one angle per arm) the prior's sizes are themselves estimated, one
per parameter, by the evidence: s_p^2 <- theta_p^2 + var_p (automatic relevance determination, MacKay, "Information
Theory, Inference, and Learning Algorithms", 45.4; EM form, Tipping, JMLR 2001). Where the data leave open which rotor
is weak, one weak rotor is then preferred to twelve slightly odd ones.

Standard deviations have four parts: a block sandwich, H^-1 (sum_b g_b g_b^T) H^-1 over blocks of time, which stays
honest when residuals are coloured; the width of the prior in directions that the data leave open (of a sparse effect
too: that one weak rotor is likelier than twelve odd ones does not show which); `MISFIT` of the value; and for times a
sample period over sqrt(12), since stamps say no more (docs/decisions/0009-honest-intervals.md).
Source: Gauss-Newton, Nocedal and Wright, "Numerical Optimization", 2nd ed., 10.3; clustered sandwich, Liang and Zeger,
Biometrika 1986.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear
from threadpoolctl import threadpool_limits

from wrenchgap.flight.errors import FitError, ModelError
from wrenchgap.learn.data.measurement import Evaluator, Record, window
from wrenchgap.plant.effects import Context, Parameter, find
from wrenchgap.plant.model import Model
from wrenchgap.plant.wrench_model import ModelEffect, WrenchModel

Array = NDArray[np.float64]

ACCELEROMETER_BIAS = 0.05
"""Largest bias of an accelerometer that is taken to be the sensor's own, per axis [m/s^2] (5 mg)."""
MISFIT = 0.03
"""Relative error of a parameter that comes from forms being nearly right only: what the intervals of all effects
together need to cover hidden truths made by other formulas (docs/hidden-effects.md)."""
BLOCK_SECONDS = 2.0
"""Length of the blocks of time that are treated as independent [s]; many filter lengths."""


FEWEST_BLOCKS = 8
"""Into how many blocks at least a short log is cut, as long as a block holds four periods of the cut-off."""


@dataclass(frozen=True)
class Dataset:
    """Records of one or several flights, stacked: K samples in all.

    `measured` and `commanded` are (K, 6); `block` (K,) numbers the blocks of time and `flight` (K,) the flights;
    `weights` (6,) puts newtons and newton metres on one scale; `independence` is the share of samples that count as
    independent.
    """

    records: tuple[Record, ...]
    measured: Array
    commanded: Array
    block: NDArray[np.intp]
    flight: NDArray[np.intp]
    weights: Array
    independence: float

    def predict(self, model: WrenchModel) -> Array:
        """Predicted measured wrench (K, 6)."""
        return np.concatenate([evaluate(model) for evaluate in self.evaluators])

    @cached_property
    def evaluators(self) -> tuple[Evaluator, ...]:
        """One for each record; they remember what models have in common."""
        return tuple(Evaluator(record) for record in self.records)

    @property
    def noise(self) -> Array:
        """Sensor noise (6,), the mean over records."""
        lengths = np.array([len(r) for r in self.records], dtype=float)
        squared = np.array([r.noise**2 for r in self.records])
        return np.asarray(np.sqrt(lengths @ squared / lengths.sum()))


def length_scale(model: Model) -> float:
    """The length [m] that makes torques comparable with forces: the vehicle's radius of gyration times sqrt(3)."""
    body = model.vehicle.body
    return float(np.sqrt(1.5 * np.trace(body.inertia) / body.mass))


def dataset(records: Sequence[Record], model: Model) -> Dataset:
    """Stack records; weights are 1/N for forces and 1/(N l) for torques, l the vehicle's `length_scale`."""
    if not records:
        raise FitError("no stretch of flight is long enough to be used; see `wrenchgap inspect`")
    blocks: list[NDArray[np.intp]] = []
    count = 0
    total = sum(float(r.time[-1] - r.time[0]) for r in records)
    length = min(BLOCK_SECONDS, max(total / FEWEST_BLOCKS, 4.0 / records[0].cutoff_hz))
    for record in records:
        duration = float(record.time[-1] - record.time[0])
        pieces = max(1, round(duration / length))
        index = np.minimum((record.time - record.time[0]) / max(duration, 1e-9) * pieces, pieces - 1).astype(np.intp)
        blocks.append(index + count)
        count += pieces
    first = records[0]
    names = list(dict.fromkeys(r.flight for r in records))
    dt_kept = first.dt * (first.keep.step or 1)
    weights = np.concatenate((np.ones(3), np.full(3, 1.0 / length_scale(model))))
    return Dataset(
        tuple(records),
        np.concatenate([r.measured for r in records]),
        np.concatenate([r.commanded for r in records]),
        np.concatenate(blocks),
        np.concatenate([np.full(len(r), names.index(r.flight)) for r in records]),
        weights,
        min(1.0, dt_kept * 2.0 * first.cutoff_hz),
    )


def spread_out(records: tuple[Record, ...], seconds: float, piece: float = 40.0) -> tuple[Record, ...]:
    """About `seconds` of flight in pieces of at most `piece` seconds, evenly spread; all where there is no more."""
    step = records[0].dt * (records[0].keep.step or 1)
    total = sum(len(r) for r in records) * step
    if total <= seconds:
        return records
    share, length = seconds / total, round(piece / step)
    out: list[Record] = []
    passed = kept = 0
    for record in records:
        passed += len(record)
        wanted = share * passed - kept
        if wanted < 0.5 * min(length, len(record)):
            continue
        if len(record) <= length:
            out.append(record)
            kept += len(record)
            continue
        count = max(1, round(wanted / length))
        starts = np.linspace(0, len(record) - length, count).astype(int)
        out += [window(record, int(s), int(s) + length) for s in starts]
        kept += count * length
    return tuple(out)


@dataclass(frozen=True)
class Fit:
    """Effects with fitted values, and what they leave.

    `theta` (P,) and `covariance` (P, P) of the effects' parameters; `bias` (flights, 3) [m/s^2] of the accelerometer;
    `residual` (K, 6) on the fitted data, without the bias; `jacobian` (K, 6, P + 3 flights) of the prediction; `scale`
    (P + 3 flights,) the prior's sizes and `axis_weights` (6,) the axes' weights, as used last; `at_bound` names
    parameters that ended at a plausible limit.
    """

    effects: tuple[ModelEffect, ...]
    parameters: tuple[tuple[str, Parameter], ...]
    theta: Array
    bias: Array
    covariance: Array
    residual: Array
    jacobian: Array
    scale: Array
    axis_weights: Array
    at_bound: tuple[str, ...]
    iterations: int

    @property
    def std(self) -> Array:
        """Standard deviation of each parameter (P,)."""
        return np.asarray(np.sqrt(np.maximum(np.diag(self.covariance), 0.0)))


def inapplicable(name: str, model: Model, records: Sequence[Record]) -> str | None:
    """Why this effect cannot be fitted on these records, None if it can."""
    effect = find(name)
    try:
        effect.parameters(model.vehicle)
    except ModelError as error:
        return str(error)
    if effect.needs_rotors and any(r.commands.rotor_speed is None for r in records):
        return f"effect {name} needs rotor commands: the log has none and the model file no arms to allocate to"
    if effect.needs_pose and not all(r.has_pose for r in records):
        return f"effect {name} needs pose and velocity; map them with --topic odometry=/your/topic"
    if effect.needs_voltage and not all(r.has_voltage for r in records):
        return f"effect {name} needs the battery voltage; map it with --topic battery=/your/topic"
    return None


def unexcited(name: str, model: Model, records: Sequence[Record]) -> str | None:
    """Why these flights cannot show this effect although it could be fitted, None if they can."""
    effect = find(name)
    reasons = [effect.unexcited(Context(model.vehicle, r.state)) for r in records]
    return None if any(reason is None for reason in reasons) else f"{name}: {reasons[0]}"


def fit(
    data: Dataset,
    model: Model,
    names: Sequence[str],
    *,
    base: Fit | None = None,
    start: Fit | None = None,
    iterations: int = 8,
    tick: Callable[[], None] | None = None,
) -> Fit:
    """Fit the named effects together on `data`; other effects of `model` stay as they are.

    A first pass uses the weights of `data`, a second weights each axis by what the first left there. `start` is a
    fit to begin from. `base` is a fit
    of the leading names: its values are the start and its derivatives are kept, so that trying one more effect costs
    no more than that effect (a chord iteration; converges to the same optimum a little more slowly). `tick` is called
    after each derivative. Raises FitError where an effect cannot be fitted on this data.
    """
    for name in names:
        reason = inapplicable(name, model, data.records)
        if reason is not None:
            raise FitError(reason)
    with threadpool_limits(1, user_api="blas"):  # small matrices: threads cost more than they bring
        return _fit(_Problem(data, model, tuple(names), base, tick), start or base, iterations)


def _fit(problem: _Problem, begin: Fit | None, iterations: int) -> Fit:
    """The passes of `fit`."""
    data = problem.data
    point = problem.start(begin)
    weights = data.weights / max(float(np.sqrt(np.mean((point.residual * data.weights) ** 2))), 1e-30)
    point, jacobian, first = problem.minimise(point, None, weights, iterations)
    weights = 1.0 / np.maximum(np.sqrt(np.mean(point.residual**2, axis=0)), data.noise)
    point, jacobian, second = problem.minimise(point, jacobian, weights, iterations)
    if problem.sparse.any():
        problem.find_relevance(point, jacobian, weights)
        point, jacobian, third = problem.minimise(point, jacobian, weights, iterations)
        second += third
    covariance = problem.covariance(point, jacobian, weights)
    theta, bias = problem.split(point.x)
    return Fit(
        problem.effects(theta, np.sqrt(np.maximum(np.diag(covariance), 0.0))),
        problem.parameters,
        theta,
        bias,
        covariance,
        point.residual,
        jacobian,
        problem.scale,
        weights,
        problem.at_bound(theta),
        first + second,
    )


@dataclass(frozen=True)
class _Point:
    """Where the search is: unknowns (P + 3 flights,) and their residual (K, 6)."""

    x: Array
    residual: Array


class _Problem:
    """The least-squares problem of one set of effects. Unknowns: parameters, then one bias (3,) per flight."""

    def __init__(
        self,
        data: Dataset,
        model: Model,
        names: tuple[str, ...],
        base: Fit | None = None,
        tick: Callable[[], None] | None = None,
    ) -> None:
        self.data = data
        self.model = model
        self.names = names
        self.tick = tick
        self.parameters = tuple((n, p) for n in names for p in find(n).parameters(model.vehicle))
        self.size = len(self.parameters)
        self.flights = int(data.flight.max()) + 1
        biases = 3 * self.flights
        self.low = np.array([p.low for _, p in self.parameters] + [-ACCELEROMETER_BIAS] * biases)
        self.high = np.array([p.high for _, p in self.parameters] + [ACCELEROMETER_BIAS] * biases)
        self.scale = np.array([p.scale for _, p in self.parameters] + [0.5 * ACCELEROMETER_BIAS] * biases)
        self.typical = self.scale
        self.sparse = np.array([find(n).sparse for n, _ in self.parameters] + [False] * biases, dtype=bool)
        self.fixed = tuple(e for e in model.effects if e.name not in names)
        self.base = base
        self.known = 0 if base is None else len(base.theta)
        self.bias_jacobian = np.zeros((len(data.measured), 6, biases))
        for axis in range(3):
            self.bias_jacobian[np.arange(len(data.flight)), axis, 3 * data.flight + axis] = model.vehicle.body.mass

    def start(self, earlier: Fit | None) -> _Point:
        """Start values: the earlier fit's, else the model's, else the parameters' own."""
        known = {e.name: e.theta for e in self.model.effects}
        if earlier is not None:
            known |= {e.name: e.theta for e in earlier.effects}
        own = {n: np.array([p.start for p in find(n).parameters(self.model.vehicle)]) for n in self.names}
        bias = np.zeros(3 * self.flights)
        if earlier is not None and len(earlier.bias) == self.flights:  # a fit of some flights knows other biases
            bias = earlier.bias.ravel()
        x = np.concatenate([*(known.get(n, own[n]) for n in self.names), bias])
        return self.at(np.clip(x, self.low, self.high))

    def split(self, x: Array) -> tuple[Array, Array]:
        """Parameters (P,) and biases (flights, 3) of the unknowns."""
        return x[: self.size], x[self.size :].reshape(self.flights, 3)

    def effects(self, theta: Array, std: Array | None = None) -> tuple[ModelEffect, ...]:
        """The named effects with these values."""
        out: list[ModelEffect] = []
        at = 0
        for name in self.names:
            effect = find(name)
            size = len(effect.parameters(self.model.vehicle))
            spread = None if std is None else std[at : at + size]
            out.append(ModelEffect(effect, theta[at : at + size], spread))
            at += size
        return tuple(out)

    def at(self, x: Array) -> _Point:
        """Residual W_meas - W_pred - m b (K, 6) at these unknowns."""
        theta, bias = self.split(x)
        model = WrenchModel(self.model.vehicle, self.fixed + self.effects(theta))
        residual = self.data.measured - self.data.predict(model)
        residual[:, :3] -= self.model.vehicle.body.mass * bias[self.data.flight]
        return _Point(x, residual)

    def jacobian(self, point: _Point) -> Array:
        """Derivative of the prediction (K, 6, P + 3 flights), forward differences that stay within the bounds."""
        columns = np.empty((*point.residual.shape, self.size))
        if self.base is not None:
            columns[:, :, : self.known] = self.base.jacobian[:, :, : self.known]
        for k in range(self.known, self.size):
            step = 0.02 * self.scale[k]
            if point.x[k] + step > self.high[k]:
                step = -step
            moved = point.x.copy()
            moved[k] += step
            columns[:, :, k] = (point.residual - self.at(moved).residual) / step
            if self.tick is not None:
                self.tick()
        return np.concatenate((columns, self.bias_jacobian), axis=2)

    def minimise(
        self, point: _Point, jacobian: Array | None, weights: Array, iterations: int
    ) -> tuple[_Point, Array, int]:
        """Bounded Gauss-Newton with step halving; returns the derivative that the last step relied on.

        A step whose gain is the one that the linearisation promised ends the search: the prediction is linear there,
        the step was the best, and the derivative still holds. Not so where a parameter had no derivative at all: the
        place of a mass shows only once there is a mass.
        """
        cost = self.cost(point.x, point.residual, weights)
        derivative = self.jacobian(point) if jacobian is None else jacobian
        for count in range(1, iterations + 1):
            step = self.step(point, derivative, weights)
            promised = cost - self.cost(point.x + step, point.residual - derivative @ step, weights)
            fraction = 1.0
            for _ in range(5):
                trial = self.at(point.x + fraction * step)
                gain = cost - self.cost(trial.x, trial.residual, weights)
                if gain >= 0:
                    break
                fraction *= 0.5
            else:
                return point, derivative, count
            point, cost = trial, cost - gain
            linear = abs(promised - gain) <= 0.005 * promised + 1e-4 * cost
            blind = ~np.any(derivative != 0.0, axis=(0, 1))
            if fraction == 1.0 and linear and not blind.any():
                return point, derivative, count
            derivative = self.jacobian(point)
            still = bool(np.all(blind == ~np.any(derivative != 0.0, axis=(0, 1))))
            if gain <= 1e-3 * cost or (fraction == 1.0 and linear and still):
                return point, derivative, count
        return point, derivative, iterations

    def cost(self, x: Array, residual: Array, weights: Array) -> float:
        """The minimised quantity."""
        data_part = self.data.independence * float(np.sum((residual * weights) ** 2))
        return data_part + float(np.sum((x / self.scale) ** 2))

    def step(
        self, point: _Point, jacobian: Array, weights: Array, rows: NDArray[np.bool_] | slice = slice(None)
    ) -> Array:
        """Gauss-Newton step within the bounds, from the rows given."""
        H, g = self.normal_equations(point, jacobian, weights, rows)
        return self.bounded_step(point, H * np.outer(self.scale, self.scale), g * self.scale)

    def normal_equations(
        self, point: _Point, jacobian: Array, weights: Array, rows: NDArray[np.bool_] | slice = slice(None)
    ) -> tuple[Array, Array]:
        """Curvature H and gradient g of the data's half of the cost, without the prior."""
        factor = np.sqrt(self.data.independence) * weights
        A = (jacobian[rows] * factor[:, None]).reshape(-1, point.x.size)
        return A.T @ A, A.T @ (point.residual[rows] * factor).reshape(-1)

    def bounded_step(self, point: _Point, H: Array, g: Array) -> Array:
        """Solution of the step's bounded least squares; H and g in units of `scale`, in which the prior is one."""
        L = np.linalg.cholesky(H + np.eye(point.x.size))
        target = np.linalg.solve(L, g - point.x / self.scale)
        low, high = (self.low - point.x) / self.scale, (self.high - point.x) / self.scale
        solution = lsq_linear(L.T, target, bounds=(low - 1e-12, high + 1e-12), method="bvls")
        return np.asarray(np.clip(point.x + solution.x * self.scale, self.low, self.high) - point.x)

    def find_relevance(self, point: _Point, jacobian: Array, weights: Array, rounds: int = 200) -> None:
        """Set the prior's sizes of sparse parameters to what the evidence says, on the linearised problem."""
        H, g = self.normal_equations(point, jacobian, weights)
        least = 1e-2 * self.scale
        x = point.x.copy()
        for _ in range(rounds):
            posterior = np.linalg.inv(H + np.diag(self.scale**-2.0))
            x = np.clip(posterior @ (g + H @ point.x), self.low, self.high)
            size = np.maximum(np.sqrt(x**2 + np.diag(posterior)), least)
            change = np.abs(np.log(size / self.scale))[self.sparse].max()
            self.scale = np.where(self.sparse, size, self.scale)
            if change < 0.01:
                return

    def covariance(self, point: _Point, jacobian: Array, weights: Array) -> Array:
        """Covariance (P, P) of the parameters, the biases estimated along with them.

        Block sandwich, plus what the data leave open, which is as wide as the parameters' typical sizes, plus what a
        form that is nearly right and stamps that are nearly right may be off by.
        """
        prior = 1.0 / (self.data.independence * self.typical**2)
        A = jacobian * weights[:, None]
        scores = np.einsum("klp,kl->kp", A, point.residual * weights)
        blocks = np.zeros((int(self.data.block.max()) + 1, point.x.size))
        np.add.at(blocks, self.data.block, scores)
        flat = A.reshape(-1, point.x.size)
        inverse = np.linalg.inv(flat.T @ flat + np.diag(prior))
        count = len(blocks)
        whole = count / max(count - 1, 1) * inverse @ (blocks.T @ blocks) @ inverse
        whole += inverse @ np.diag(prior) @ inverse / self.data.independence
        seconds = np.array([p.unit == "s" for _, p in self.parameters], dtype=bool)
        dt = max(r.dt for r in self.data.records)
        inexact = (MISFIT * point.x[: self.size]) ** 2 + seconds * dt**2 / 12.0
        return np.asarray(whole[: self.size, : self.size] + np.diag(inexact))

    def at_bound(self, theta: Array) -> tuple[str, ...]:
        """Parameters that are at a plausible limit other than zero, or within half a per cent of the range of it."""
        low, high = self.low[: self.size], self.high[: self.size]
        margin = 5e-3 * (high - low)
        stuck = ((theta - low < margin) & (low != 0.0)) | ((high - theta < margin) & (high != 0.0))
        return tuple(f"{n}.{p.name}" for (n, p), s in zip(self.parameters, stuck, strict=True) if s)


SMALL = 0.3
"""Change of a prediction, relative to the residual, up to which its linearisation will do in a search."""


def held_out(
    data: Dataset, model: Model, names: Sequence[str], fitted: Fit, folds: int = 4, *, exact: bool = True
) -> Array:
    """Residual (K, 6) in which every block was predicted by parameters (and biases) fitted without it.

    Blocks go to the folds in turn. Each fold takes one Gauss-Newton step from the joint optimum, with the rows of
    the other folds, and its prediction is evaluated in full; with `exact` off, linearised where the step changes it by
    less than `SMALL` of the residual.
    """
    problem = _Problem(data, model, tuple(names))
    problem.scale = fitted.scale
    point = _Point(np.concatenate((fitted.theta, fitted.bias.ravel())), fitted.residual)
    out = np.empty_like(fitted.residual)
    fold = data.block % folds
    for f in range(folds):
        test = fold == f
        if not test.any():
            continue
        if test.all():
            raise FitError("the log is too short to hold anything out; needs at least two blocks of 2 s")
        step = problem.step(point, fitted.jacobian, fitted.axis_weights, ~test)
        change = fitted.jacobian[test] @ step
        if not exact and np.linalg.norm(change) < SMALL * np.linalg.norm(point.residual[test]):
            out[test] = point.residual[test] - change
        else:
            out[test] = problem.at(point.x + step).residual[test]
    return out


def with_fit(model: Model, fitted: Fit) -> Model:
    """The model with the fitted effects in place of its own of the same names."""
    names = {e.name for e in fitted.effects}
    return model.with_effects((*(e for e in model.effects if e.name not in names), *fitted.effects))
