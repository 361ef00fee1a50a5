"""The least-squares problem behind a fit of effects: unknowns, steps within bounds, relevance, covariance.

What is minimised, and the sources, are in `learn.identify.fit`.
"""

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from wrenchgap.flight.errors import ModelError
from wrenchgap.flight.flight import Array, Mask
from wrenchgap.learn.data.dataset import Dataset
from wrenchgap.learn.data.errors import sums_by
from wrenchgap.learn.data.gauss_markov import block_means, gauss_markov, pieces
from wrenchgap.learn.identify.air import awake
from wrenchgap.learn.identify.bias_and_trim import trim_of, unsure_thrust
from wrenchgap.plant.effects import Parameter, find, is_air
from wrenchgap.plant.history import Snapshot, Value
from wrenchgap.plant.model import Model
from wrenchgap.plant.wrench_model import ModelEffect, WrenchModel

MISFIT = 0.03
"""Relative error of a parameter that comes from forms being nearly right only: what the intervals of all effects
together need to cover hidden truths made by other formulas (docs/hidden-effects.md)."""


@dataclass(frozen=True)
class Fit:
    """Effects with fitted values, and what they leave.

    `theta` (P,) and `covariance` (P, P) of the effects' parameters, `dependence` (P,) the part of their variances that
    independent blocks of time would not have; `bias` (flights, A) of the accelerometer [m/s^2], with the trim of the
    flights where they differ, and `thrust` (0,) or (1,) what an unsure thrust is off by, relative
    (`learn.identify.bias_and_trim`); `residual` (K, 6) on the fitted data, without those; `jacobian` (K, 6, P + G) of
    the prediction by parameters and these G; `scale` (P + G,) the prior's sizes
    and `axis_weights` (6,) the axes' weights, as used last; `at_bound` names parameters that ended at a plausible
    limit. Residual, derivative and weight are zero on axes that were not measured.
    """

    effects: tuple[ModelEffect, ...]
    parameters: tuple[tuple[str, Parameter], ...]
    theta: Array
    bias: Array
    thrust: Array
    covariance: Array
    dependence: Array
    residual: Array
    jacobian: Array
    scale: Array
    axis_weights: Array
    at_bound: tuple[str, ...]
    iterations: int

    @property
    def granted(self) -> Array:
        """`bias` and `thrust` (G,)."""
        return np.concatenate((self.bias.ravel(), self.thrust))

    @property
    def std(self) -> Array:
        """Standard deviation of each parameter (P,)."""
        return np.asarray(np.sqrt(np.maximum(np.diag(self.covariance), 0.0)))

    @property
    def stuck(self) -> frozenset[str]:
        """Effects with a parameter at a plausible limit: their law, or what they are fitted to, is another one."""
        return frozenset(name.split(".")[0] for name in self.at_bound)

    def from_nothing(self, name: str) -> float:
        """How far an effect's parameters are from zero, in their standard deviations together."""
        own = [k for k, (effect, _) in enumerate(self.parameters) if effect == name]
        return float(np.sqrt(self.theta[own] @ np.linalg.solve(self.covariance[np.ix_(own, own)], self.theta[own])))

    @property
    def snapshot(self) -> tuple[Snapshot, ...]:
        """The effects as plain values, in the order in which they were named."""
        rows: dict[str, list[Value]] = {}
        for (name, p), value, std in zip(self.parameters, self.theta, self.std, strict=True):
            rows.setdefault(name, []).append(Value(p.name, float(value), float(std), p.unit))
        return tuple(Snapshot(name, tuple(values)) for name, values in rows.items())

    def values(self, name: str) -> tuple[Value, ...]:
        """Of one effect; empty where it was not fitted."""
        return next((s.values for s in self.snapshot if s.effect == name), ())


@dataclass(frozen=True)
class Point:
    """Where the search is: unknowns (P + G,) and their residual (K, 6)."""

    x: Array
    residual: Array


class Problem:
    """The least-squares problem of one set of effects. Unknowns: parameters, then what is granted: one trim (A,) per
    flight, an accelerometer's bias and what flights differ by, and the thrust of a model that is not sure of it
    (`learn.identify.bias_and_trim`).
    """  # noqa: D205

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
        self.all_measured = bool(data.measured_axes.all())
        self.trim = trim_of(model)
        thrust = np.full(1, unsure_thrust(model, names))
        self.thrust = thrust[thrust > 0.0]
        limit, usual = (np.tile(v, self.flights) for v in (self.trim.limit, self.trim.scale))
        unlimited = np.full(self.thrust.size, np.inf)
        limit, usual = np.concatenate((limit, unlimited)), np.concatenate((usual, self.thrust))
        self.low = np.concatenate(([p.low for _, p in self.parameters], -limit))
        self.high = np.concatenate(([p.high for _, p in self.parameters], limit))
        self.scale = np.concatenate(([p.scale for _, p in self.parameters], usual))
        self.typical = self.scale
        self.sparse = np.array([find(n).sparse for n, _ in self.parameters] + [False] * len(limit), dtype=bool)
        self.fixed = tuple(e for e in model.effects if e.name not in names)
        self.base = base
        self.known = 0 if base is None else len(base.theta)
        self.granted_jacobian = self.trim.columns(data)
        if self.thrust.size:
            thrust_column = np.where(data.measured_axes, data.commanded, 0.0)[:, :, None]
            self.granted_jacobian = np.concatenate((self.granted_jacobian, thrust_column), axis=2)

    def start(self, earlier: Fit | None, near: Mapping[str, Array] | None = None) -> Point:
        """Start values: the earlier fit's, else those that are `near`, else the model's, else the parameters' own."""
        known = {e.name: e.theta for e in self.model.effects} | dict(near or {})
        if earlier is not None:
            known |= {e.name: e.theta for e in earlier.effects}
        own = {n: np.array([p.start for p in find(n).parameters(self.model.vehicle)]) for n in self.names}
        granted = np.zeros(len(self.low) - self.size)
        if earlier is not None and earlier.granted.size == len(granted):  # a fit of some flights knows other biases
            granted = earlier.granted
        values = awake({n: known.get(n, own[n]) for n in self.names}, self.fixed, self.model.vehicle)
        x = np.concatenate([*values.values(), granted])
        return self.at(np.clip(x, self.low, self.high))

    def split(self, x: Array) -> tuple[Array, Array, Array]:
        """Parameters (P,), trims (flights, A) and unsure thrust (0,) or (1,) of the unknowns."""
        theta, bias, thrust = np.split(x, [self.size, len(x) - self.thrust.size])
        return theta, bias.reshape(self.flights, -1), thrust

    def effects(self, theta: Array, std: Array | None = None) -> tuple[ModelEffect, ...]:
        """The named effects with these values."""
        out: list[ModelEffect] = []
        at = 0
        for effect in map(find, self.names):
            own = slice(at, at + len(effect.parameters(self.model.vehicle)))
            out.append(ModelEffect(effect, theta[own], None if std is None else std[own]))
            at = own.stop
        return tuple(out)

    def at(self, x: Array) -> Point:
        """Residual W_meas - W_pred (K, 6), without what is granted, at these unknowns."""
        theta, bias, thrust = self.split(x)
        model = WrenchModel(self.model.vehicle, self.fixed + self.effects(theta))
        residual = self.data.measured - self.data.predict(model)
        trims = np.zeros((self.flights, 6))
        trims[:, self.trim.axes] = self.trim.unit * bias
        residual -= trims[self.data.flight] if self.flights > 1 else trims[0]
        for share in thrust:
            residual -= share * self.data.commanded
        if not self.all_measured:
            residual[:, ~self.data.measured_axes] = 0.0  # no weight, no derivative: out of every sum below
        if self.names and not np.isfinite(residual).all():
            raise ModelError(f"effect {', '.join(self.names)}: what it adds is not finite within its plausible range")
        return Point(x, residual)

    def tried(self, x: Array) -> Point | None:
        """`at`; None where each unknown is within its bounds and no body has all of them, as of products."""
        with suppress(ModelError):
            return self.at(x)
        return None

    def jacobian(self, point: Point, first: int = 0) -> Array:
        """Derivative of the prediction (K, 6, P + G) by differences within the bounds; NaN before the `first`."""
        columns = np.empty((*point.residual.shape, len(self.low)))
        columns[:, :, : self.size] = np.nan
        columns[:, :, self.size :] = self.granted_jacobian
        if self.base is not None:
            columns[:, :, : self.known] = self.base.jacobian[:, :, : self.known]
        for k, (name, _) in enumerate(self.parameters):
            if k < first or (k < self.known and not is_air(name)):  # the air's depends on every effect that sees it
                continue
            step = 0.02 * self.scale[k]
            if point.x[k] + step > self.high[k]:
                step = -step
            moved = point.x + step * (np.arange(len(point.x)) == k)
            other = self.tried(moved)
            if other is None:  # no body has that: to the other side
                step, other = -step, self.at(2.0 * point.x - moved)
            columns[:, :, k] = (point.residual - other.residual) / step
            if self.tick is not None:
                self.tick()
        return columns

    def minimise(self, point: Point, jacobian: Array | None, weights: Array, most: int) -> tuple[Point, Array, int]:
        """Bounded Gauss-Newton with step halving; returns the derivative that the last step relied on.

        A step whose gain is the one that the linearisation promised ends the search: the prediction is linear there,
        the step was the best, and the derivative still holds. Not so where a parameter had no derivative at all: the
        place of a mass shows only once there is a mass.
        """
        cost = self.cost(point.x, point.residual, weights)
        derivative = self.jacobian(point) if jacobian is None else jacobian
        for count in range(1, most + 1):
            step = self.step(point, derivative, weights)
            promised = cost - self.cost(point.x + step, point.residual - derivative @ step, weights)
            fraction = 1.0
            for _ in range(5):
                trial = self.tried(point.x + fraction * step)
                gain = -np.inf if trial is None else cost - self.cost(trial.x, trial.residual, weights)
                if trial is not None and gain >= 0:
                    break
                fraction *= 0.5
            else:
                return point, derivative, count
            point, cost = trial, cost - gain
            linear = abs(promised - gain) <= 0.005 * promised + 1e-4 * cost
            blind = self.blind(derivative)
            if fraction == 1.0 and linear and not blind.any():
                return point, derivative, count
            derivative = self.jacobian(point)
            still = bool(np.all(blind == self.blind(derivative)))
            if gain <= 1e-3 * cost or (fraction == 1.0 and linear and still):
                return point, derivative, count
        return point, derivative, most

    def blind(self, derivative: Array, rounding: float = 1e-9) -> Mask:
        """Unknowns that change nothing: by a typical size less than a share `rounding` of the largest wrench."""
        shown = np.abs(derivative).max(axis=(0, 1)) * self.scale
        return np.asarray(shown <= rounding * np.nanmax(np.abs(self.data.measured)))

    def cost(self, x: Array, residual: Array, weights: Array) -> float:
        """The minimised quantity."""
        data_part = self.data.independence * float(np.sum((self.data.unanswered(residual) * weights) ** 2))
        return data_part + float(np.sum((x / self.scale) ** 2))

    def step(self, point: Point, jacobian: Array, weights: Array) -> Array:
        """Gauss-Newton step within the bounds."""
        swept, rest = self.data.unanswered(jacobian), self.data.unanswered(point.residual)
        return self.step_from(point, *self.normal_equations(swept, rest, weights))

    def step_from(self, point: Point, H: Array, g: Array) -> Array:
        """The step from `normal_equations`, or a sum of those of parts of the samples."""
        return self.bounded_step(point, H * np.outer(self.scale, self.scale), g * self.scale)

    def normal_equations(self, jacobian: Array, residual: Array, weights: Array) -> tuple[Array, Array]:
        """Curvature H and gradient g of the data's half of the cost, of `unanswered` derivatives and residuals."""
        factor = np.sqrt(self.data.independence) * weights
        A = (jacobian * factor[:, None]).reshape(-1, jacobian.shape[2])
        return A.T @ A, A.T @ (residual * factor).reshape(-1)

    def bounded_step(self, point: Point, H: Array, g: Array) -> Array:
        """Solution of the step's bounded least squares; H and g in units of `scale`, in which the prior is one."""
        low, high = (self.low - point.x) / self.scale, (self.high - point.x) / self.scale
        free = np.linalg.solve(H + np.eye(point.x.size), g - point.x / self.scale)
        if np.all((low <= free) & (free <= high)):
            return np.asarray(free * self.scale)
        from scipy.optimize import lsq_linear  # here: others need not wait for it

        L = np.linalg.cholesky(H + np.eye(point.x.size))
        target = np.linalg.solve(L, g - point.x / self.scale)
        solution = lsq_linear(L.T, target, bounds=(low - 1e-12, high + 1e-12), method="bvls")
        return np.asarray(np.clip(point.x + solution.x * self.scale, self.low, self.high) - point.x)

    def find_relevance(self, point: Point, jacobian: Array, weights: Array, rounds: int = 200) -> None:
        """Set the prior's sizes of sparse parameters to what the evidence says, on the linearised problem."""
        data = self.data
        H, g = self.normal_equations(data.unanswered(jacobian), data.unanswered(point.residual), weights)
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

    def covariance(self, point: Point, jacobian: Array, weights: Array) -> tuple[Array, Array]:
        """Covariance (P, P) of the parameters, the biases estimated along with them, and `Fit.dependence` in it.

        Block sandwich, plus what blocks and flights that are not independent add to the variances, plus what the data
        leave open, which is as wide as the parameters' typical sizes, plus what a form that is nearly right and stamps
        that are nearly right may be off by.
        """
        prior = 1.0 / (self.data.independence * self.typical**2)
        A = self.data.unanswered(jacobian) * weights[:, None]
        scores = np.einsum("klp,kl->kp", A, self.data.remaining(point.residual) * weights)
        blocks = sums_by(self.data.block, scores)
        flat = A.reshape(-1, point.x.size)
        inverse = np.linalg.inv(flat.T @ flat + np.diag(prior))
        count = len(blocks)
        whole = np.asarray(count / max(count - 1, 1) * inverse @ (blocks.T @ blocks) @ inverse, dtype=np.float64)
        dependence = beyond_blocks(self.data, scores @ inverse, np.diag(whole))
        whole += inverse @ np.diag(prior) @ inverse / self.data.independence
        late = ("commands", "sensor")  # where a time shifts something; elsewhere seconds are what units leave over
        seconds = np.array([p.unit == "s" and find(name).place in late for name, p in self.parameters], dtype=bool)
        timing = max(r.timing_error for r in self.data.records)
        inexact = (MISFIT * point.x[: self.size]) ** 2 + seconds * timing**2
        dependence = dependence[: self.size]
        return np.asarray(whole[: self.size, : self.size] + np.diag(inexact + dependence)), dependence

    def at_bound(self, theta: Array) -> tuple[str, ...]:
        """Names of the parameters that are `at_limit`."""
        stuck = at_limit(theta, self.low[: self.size], self.high[: self.size])
        return tuple(f"{n}.{p.name}" for (n, p), s in zip(self.parameters, stuck, strict=True) if s)


def at_limit(theta: Array, low: Array, high: Array) -> Mask:
    """Which parameters are at a plausible limit other than zero, or within half a per cent of the range of it."""
    margin = 5e-3 * (high - low)
    return np.asarray(((theta - low < margin) & (low != 0.0)) | ((high - theta < margin) & (high != 0.0)))


def beyond_blocks(data: Dataset, influence: Array, within: Array) -> Array:
    """What the variances of the sandwich over blocks (P,) lack where blocks that follow one another are alike, or
    flights differ by more than their blocks: (P,) of what each sample adds to the parameters' errors (K, P).
    """  # noqa: D205
    stretches = [(own, r.dt_kept) for own, r in zip(data.by_record(influence), data.records, strict=True)]
    means = [block_means(part, dt) for own, dt in stretches for part in pieces(own, dt)]
    variance = len(influence) ** 2 * gauss_markov(means).variance
    count = int(data.flight.max()) + 1
    if count > 1:
        flights = sums_by(data.flight, influence)
        variance = np.maximum(variance, count / (count - 1) * np.sum(flights**2, axis=0))
    return np.maximum(variance - within, 0.0)


def left_by(data: Dataset, model: Model) -> Array:
    """What a model leaves of the measured wrench (K, 6) [N, Nm], without trims; zero on axes not measured."""
    problem = Problem(data, model, ())
    return problem.at(np.zeros(problem.low.size)).residual
