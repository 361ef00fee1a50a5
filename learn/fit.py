"""Estimating the parameters of effects from flights: bounded Gauss-Newton on the residual of all six axes.

Minimised over theta (all parameters of all named effects together):

    sum_k sum_l w_l^2 (W_meas - W_pred(theta))_kl^2 * eta  +  sum_p (theta_p / s_p)^2

w_l are the axis weights, s_p the parameter's typical size (a weak prior that only decides what the data leave open),
and eta = dt_kept * 2 f_c at most 1 discounts samples that the filter has made dependent. Steps are bounded
least-squares problems within the plausible ranges, with numerical derivatives of the whole prediction.

Standard deviations are those of a block sandwich, H^-1 (sum_b g_b g_b^T) H^-1 over blocks of time, which stays honest
when residuals are coloured or the model is not quite right. Source: Gauss-Newton, Nocedal and Wright, "Numerical
Optimization", 2nd ed., 10.3; clustered sandwich, Liang and Zeger, Biometrika 1986.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from flight.errors import FitError, ModelError
from learn.measurement import Record, predict
from plant.effects import Parameter, find
from plant.model import Model
from plant.wrench_model import ModelEffect, WrenchModel

Array = NDArray[np.float64]

BLOCK_SECONDS = 2.0
"""Length of the blocks of time that are treated as independent [s]; many filter lengths."""


@dataclass(frozen=True)
class Dataset:
    """Records of one or several flights, stacked: K samples in all.

    `measured` and `commanded` are (K, 6); `block` (K,) numbers the blocks of time; `weights` (6,) puts newtons and
    newton metres on one scale; `independence` is the share of samples that count as independent.
    """

    records: tuple[Record, ...]
    measured: Array
    commanded: Array
    block: NDArray[np.intp]
    weights: Array
    independence: float

    def predict(self, model: WrenchModel) -> Array:
        """Predicted measured wrench (K, 6)."""
        return np.concatenate([predict(record, model) for record in self.records])

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
    for record in records:
        duration = float(record.time[-1] - record.time[0])
        pieces = max(1, round(duration / BLOCK_SECONDS))
        index = np.minimum((record.time - record.time[0]) / max(duration, 1e-9) * pieces, pieces - 1).astype(np.intp)
        blocks.append(index + count)
        count += pieces
    first = records[0]
    dt_kept = first.dt * (first.keep.step or 1)
    weights = np.concatenate((np.ones(3), np.full(3, 1.0 / length_scale(model))))
    return Dataset(
        tuple(records),
        np.concatenate([r.measured for r in records]),
        np.concatenate([r.commanded for r in records]),
        np.concatenate(blocks),
        weights,
        min(1.0, dt_kept * 2.0 * first.cutoff_hz),
    )


@dataclass(frozen=True)
class Fit:
    """Effects with fitted values. `theta` (P,), `covariance` (P, P); `residual` (K, 6) on the fitted data;
    `jacobian` (K, 6, P) of the prediction; `at_bound` names parameters that ended at a plausible limit.
    """  # noqa: D205

    effects: tuple[ModelEffect, ...]
    parameters: tuple[tuple[str, Parameter], ...]
    theta: Array
    covariance: Array
    residual: Array
    jacobian: Array
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


def fit(
    data: Dataset,
    model: Model,
    names: Sequence[str],
    *,
    start: Sequence[ModelEffect] = (),
    iterations: int = 8,
    reweight: bool = True,
    tick: Callable[[], None] | None = None,
) -> Fit:
    """Fit the named effects together on `data`; other effects of `model` stay as they are.

    `start` gives values to begin from. With `reweight` a second pass weights each axis by its own residual. `tick` is
    called after each derivative. Raises FitError where an effect cannot be fitted on this data.
    """
    for name in names:
        reason = inapplicable(name, model, data.records)
        if reason is not None:
            raise FitError(reason)
    problem = _Problem(data, model, tuple(names), tick)
    theta = problem.start(start)
    weights = data.weights
    theta, used = problem.minimise(theta, weights, iterations)
    if reweight:
        rms = np.sqrt(np.mean(problem.residual(theta) ** 2, axis=0))
        weights = 1.0 / np.maximum(rms, data.noise)
        weights = weights * (data.weights[0] / weights[:3].min())
        theta, more = problem.minimise(theta, weights, iterations)
        used += more
    residual = problem.residual(theta)
    jacobian = problem.jacobian(theta, residual)
    covariance = problem.covariance(theta, residual, jacobian, weights)
    return Fit(
        problem.effects(theta, np.sqrt(np.maximum(np.diag(covariance), 0.0))),
        problem.parameters,
        theta,
        covariance,
        residual,
        jacobian,
        weights,
        problem.at_bound(theta),
        used,
    )


class _Problem:
    """The least-squares problem of one set of effects."""

    def __init__(self, data: Dataset, model: Model, names: tuple[str, ...], tick: Callable[[], None] | None) -> None:
        self.data = data
        self.model = model
        self.names = names
        self.tick = tick
        self.parameters = tuple((n, p) for n in names for p in find(n).parameters(model.vehicle))
        self.low = np.array([p.low for _, p in self.parameters])
        self.high = np.array([p.high for _, p in self.parameters])
        self.scale = np.array([p.scale for _, p in self.parameters])
        self.fixed = tuple(e for e in model.effects if e.name not in names)

    def start(self, given: Sequence[ModelEffect]) -> Array:
        """Start values: given, else the model's, else the parameters' own."""
        known = {e.name: e.theta for e in (*self.model.effects, *given)}
        parts = []
        for name in self.names:
            own = np.array([p.start for p in find(name).parameters(self.model.vehicle)])
            parts.append(known.get(name, own))
        return np.clip(np.concatenate(parts), self.low, self.high) if parts else np.empty(0)

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

    def residual(self, theta: Array) -> Array:
        """W_meas - W_pred (K, 6)."""
        model = WrenchModel(self.model.vehicle, self.fixed + self.effects(theta))
        return self.data.measured - self.data.predict(model)

    def jacobian(self, theta: Array, residual: Array) -> Array:
        """Derivative of the prediction (K, 6, P), forward differences that stay within the bounds."""
        out = np.empty((*residual.shape, theta.size))
        for k in range(theta.size):
            step = 0.02 * self.scale[k]
            if theta[k] + step > self.high[k]:
                step = -step
            moved = theta.copy()
            moved[k] += step
            out[:, :, k] = (residual - self.residual(moved)) / step
            if self.tick is not None:
                self.tick()
        return out

    def minimise(self, theta: Array, weights: Array, iterations: int) -> tuple[Array, int]:
        """Bounded Gauss-Newton with step halving."""
        if theta.size == 0:
            return theta, 0
        residual = self.residual(theta)
        cost = self.cost(theta, residual, weights)
        for count in range(1, iterations + 1):
            step = self.step(theta, residual, self.jacobian(theta, residual), weights)
            fraction = 1.0
            for _ in range(6):
                trial = theta + fraction * step
                trial_residual = self.residual(trial)
                trial_cost = self.cost(trial, trial_residual, weights)
                if trial_cost <= cost:
                    break
                fraction *= 0.5
            else:
                return theta, count
            gain = cost - trial_cost
            theta, residual, cost = trial, trial_residual, trial_cost
            if gain <= 1e-4 * cost or np.all(np.abs(step) <= 1e-3 * self.scale):
                return theta, count
        return theta, iterations

    def cost(self, theta: Array, residual: Array, weights: Array) -> float:
        """The minimised quantity."""
        data_part = self.data.independence * float(np.sum((residual * weights) ** 2))
        return data_part + float(np.sum((theta / self.scale) ** 2))

    def step(
        self, theta: Array, residual: Array, jacobian: Array, weights: Array, rows: NDArray[np.bool_] | None = None
    ) -> Array:
        """Gauss-Newton step within the bounds, from the rows given."""
        if rows is not None:
            residual, jacobian = residual[rows], jacobian[rows]
        factor = np.sqrt(self.data.independence) * weights
        A = (jacobian * factor[:, None]).reshape(-1, theta.size) * self.scale
        b = (residual * factor).reshape(-1)
        # normal equations in units of `scale`; the prior adds one to the diagonal
        H = A.T @ A + np.eye(theta.size)
        g = A.T @ b - theta / self.scale
        L = np.linalg.cholesky(H)
        target = np.linalg.solve(L, g)
        low, high = (self.low - theta) / self.scale, (self.high - theta) / self.scale
        solution = lsq_linear(L.T, target, bounds=(low - 1e-12, high + 1e-12), method="bvls")
        return np.asarray(np.clip(theta + solution.x * self.scale, self.low, self.high) - theta)

    def covariance(self, theta: Array, residual: Array, jacobian: Array, weights: Array) -> Array:
        """Block sandwich (P, P)."""
        if theta.size == 0:
            return np.empty((0, 0))
        A = jacobian * weights[:, None]
        scores = np.einsum("klp,kl->kp", A, residual * weights)
        blocks = np.zeros((int(self.data.block.max()) + 1, theta.size))
        np.add.at(blocks, self.data.block, scores)
        flat = A.reshape(-1, theta.size)
        H = flat.T @ flat + np.diag(1.0 / (self.data.independence * self.scale**2))
        inverse = np.linalg.inv(H)
        count = len(blocks)
        small_sample = count / max(count - 1, 1)
        return np.asarray(small_sample * inverse @ (blocks.T @ blocks) @ inverse)

    def at_bound(self, theta: Array) -> tuple[str, ...]:
        """Parameters at a plausible limit, other than at zero."""
        margin = 1e-6 * (self.high - self.low)
        stuck = (np.abs(theta - self.low) < margin) | (np.abs(theta - self.high) < margin)
        return tuple(f"{n}.{p.name}" for (n, p), s, v in zip(self.parameters, stuck, theta, strict=True) if s and v)


def held_out(data: Dataset, model: Model, names: Sequence[str], fitted: Fit, folds: int = 4) -> Array:
    """Residual (K, 6) in which every block was predicted by parameters fitted without it.

    Blocks go to the folds in turn. Each fold takes one Gauss-Newton step from the joint optimum, with the rows of
    the other folds, and its prediction is evaluated in full (not linearised).
    """
    problem = _Problem(data, model, tuple(names), None)
    out = np.empty_like(fitted.residual)
    fold = data.block % folds
    for f in range(folds):
        test = fold == f
        if not test.any():
            continue
        if test.all():
            raise FitError("the log is too short to hold anything out; needs at least two blocks of 2 s")
        step = problem.step(fitted.theta, fitted.residual, fitted.jacobian, fitted.axis_weights, ~test)
        out[test] = problem.residual(fitted.theta + step)[test]
    return out


def with_fit(model: Model, fitted: Fit) -> Model:
    """The model with the fitted effects in place of its own of the same names."""
    names = {e.name for e in fitted.effects}
    return model.with_effects((*(e for e in model.effects if e.name not in names), *fitted.effects))
