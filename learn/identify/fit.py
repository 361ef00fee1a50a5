"""Estimating the parameters of effects from flights: bounded Gauss-Newton on the residual of all six axes.

Minimised over theta (all parameters of all named effects together):

    eta sum_k sum_l w_l^2 (W_meas - W_pred(theta) - m b_flight)_kl^2  +  sum_p (theta_p / s_p)^2

Weights, sizes of sparse effects, the parts of the standard deviations, and the sources: docs/theory/posterior.md, Fit
of one set. Steps are bounded least-squares problems within the plausible ranges, with numerical derivatives of the
whole prediction.

An accelerometer's bias changes from flight to flight and looks like a force that is constant in B. It is therefore
estimated along with the effects, per flight, within +-`ACCELEROMETER_BIAS`: a constant force larger than that is an
effect, a smaller one is not news. So is the trim, where the model knows that flights differ
(`learn.identify.bias_and_trim`).

On axes where commands answer the motion residual and derivatives are taken without what any such answer could explain
(`learn.data.feedback_regressors`).
"""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from wrenchgap.flight.errors import FitError
from wrenchgap.flight.flight import Array, Indices
from wrenchgap.flight.memory import on_disk
from wrenchgap.learn.data.candidates import inapplicable
from wrenchgap.learn.data.dataset import Dataset
from wrenchgap.learn.identify.least_squares import Fit, Point, Problem
from wrenchgap.plant.model import Model

__all__ = ["Fit", "fit", "held_out", "with_fit"]

MANY = 4000
"""Samples from which on derivatives that are asked for later wait on disk: 100 s at 40 Hz, of the whole catalogue
20 MB."""
Starts = dict[tuple[str, ...], tuple[Array, Array, Array]]


def fit(
    data: Dataset,
    model: Model,
    names: Sequence[str],
    *,
    base: Fit | None = None,
    start: Fit | None = None,
    near: Mapping[str, Array] | None = None,
    iterations: int = 8,
    tick: Callable[[], None] | None = None,
    starts: Starts | None = None,
) -> Fit:
    """Fit the named effects together on `data`; other effects of `model` stay as they are.

    A first pass uses the weights of `data`, a second weights each axis by what the first left there. `start` is a fit
    to begin from, `near` are values by effect to begin from where there is none. `base` is a fit of the leading names:
    its values are the start and its derivatives are kept, so that trying one more effect costs no more than that effect
    (a chord iteration; converges to the same optimum a little more slowly). `tick` is called after each derivative.
    `starts` are those of `Dataset.starts`: taken out where they are there, put in where not.
    Raises FitError where an effect cannot be fitted on this data.
    """
    from wrenchgap.learn.parallel import few_threads  # here: others need not wait for it

    for name in names:
        reason = inapplicable(name, model, data.records)
        if reason is not None:
            raise FitError(str(reason))
    with few_threads():
        problem = Problem(data, model, tuple(names), base, tick)
        jacobian: Array | None = None
        if starts is None:
            point = problem.start(start or base, near)
        elif (begun := starts.pop(problem.names, None)) is not None:
            x, residual, effects = begun
            point, jacobian = Point(x, residual), np.concatenate((effects, problem.granted_jacobian), axis=2)
        else:
            point = problem.start(None)
            jacobian = problem.jacobian(point)
            starts[problem.names] = point.x, point.residual, on_disk(jacobian[:, :, : problem.size].copy(), MANY)
        return _fit(problem, point, jacobian, iterations)


def _fit(problem: Problem, point: Point, jacobian: Array | None, iterations: int) -> Fit:
    """The passes of `fit`."""
    data = problem.data
    known = data.measured_axes
    size = np.sqrt(np.mean((data.remaining(point.residual) * data.weights)[:, known] ** 2))
    weights = data.weights / max(float(size), 1e-30)
    point, jacobian, first = problem.minimise(point, jacobian, weights, iterations)
    left = np.sqrt(np.mean(data.remaining(point.residual) ** 2, axis=0))
    weights = np.where(known, 1.0 / np.where(known, np.maximum(left, data.noise), 1.0), 0.0)
    point, jacobian, second = problem.minimise(point, jacobian, weights, iterations)
    if problem.sparse.any():
        problem.find_relevance(point, jacobian, weights)
        point, jacobian, third = problem.minimise(point, jacobian, weights, iterations)
        second += third
    covariance, dependence = problem.covariance(point, jacobian, weights)
    theta, bias, thrust = problem.split(point.x)
    return Fit(
        problem.effects(theta, np.sqrt(np.maximum(np.diag(covariance), 0.0))),
        problem.parameters,
        theta,
        bias,
        thrust,
        covariance,
        dependence,
        point.residual,
        jacobian,
        problem.scale,
        weights,
        problem.at_bound(theta),
        first + second,
    )


MATERIAL = 0.2
"""Smallest parameter worth a name, in typical sizes (`Parameter.scale`): e.g. 1 % of thrust, 6 ms of lag."""


def held_out(
    data: Dataset,
    model: Model,
    names: Sequence[str],
    fitted: Fit,
    folds: int = 4,
    *,
    exact: bool = True,
    groups: Indices | None = None,
    small: float = 0.3,
) -> Array:
    """Residual (K, 6) in which every block was predicted by parameters (and biases) fitted without it.

    Blocks go to the folds in turn, or samples to `groups` (K,) that are given. Each fold takes one Gauss-Newton step
    from the joint optimum, with the rows of the other folds, and its prediction is evaluated in full; linearised where
    no body has its values, and with `exact` off where the step changes it by less than `small` of the residual. Without
    what commands say nothing of (`Dataset.informative`); not a number on axes that were not measured.
    """
    problem = Problem(data, model, tuple(names))
    problem.scale = fitted.scale
    point = Point(np.concatenate((fitted.theta, fitted.granted)), fitted.residual)
    out = np.empty_like(fitted.residual)
    fold = data.block % folds if groups is None else groups
    swept, rest = data.unanswered(fitted.jacobian), data.unanswered(fitted.residual)
    parts = [fold == f for f in range(int(fold.max()) + 1)]
    sums = [problem.normal_equations(swept[test], rest[test], fitted.axis_weights) for test in parts]
    for test in parts:
        if not test.any():
            continue
        if test.all():
            raise FitError("the log is too short to hold anything out; needs at least two blocks of 2 s")
        others = [own for other, own in zip(parts, sums, strict=True) if other is not test]
        step = problem.step_from(point, *(sum(of) for of in zip(*others, strict=True)))
        change = fitted.jacobian[test] @ step
        linear = not exact and np.linalg.norm(change) < small * np.linalg.norm(point.residual[test])
        moved = None if linear else problem.tried(point.x + step)
        out[test] = point.residual[test] - change if moved is None else moved.residual[test]
    out = data.informative(out)
    out[:, ~data.measured_axes] = np.nan
    return out


def with_fit(model: Model, fitted: Fit) -> Model:
    """The model with the fitted effects in place of its own of the same names."""
    return model.with_replaced(fitted.effects)
