"""Find the correction that makes the real wrench equal the desired one.

With W = W_cmd + mu(W_cmd) and W_cmd = W_des + dW, minimise (paper, 'Finding compensation signal using optimization')

    J(dW) = |r|^2,   r = mu(W_des + dW) + dW        on the outputs of the model, dW zero elsewhere
    dJ/ddW = 2 (I + dmu/dW)^T r                     columns of the same outputs

by L-BFGS (nlopt, LD_LBFGS) within a box, from the last optimum. An optional `regulariser` adds w |dW_torque|^2 for
the search alone: acceptance always looks at J. (The paper's |W_cmd|^2 contains the weight, about 1570 N^2, next to a
threshold of 1e-4: even 1e-6 of it would decide everything.)
"""

from collections.abc import Callable
from dataclasses import dataclass

import nlopt
import numpy as np

from wrenchgap.flight.flight import AXES, Array, Indices
from wrenchgap.plant.mismatch import Linearises, MismatchModel, output_indices

TORQUES = np.array([axis.startswith("torque") for axis in AXES])
SEARCH_ERRORS: tuple[type[Exception], ...] = (
    *(getattr(nlopt, name) for name in ("exception", "RoundoffLimited", "ForcedStop") if hasattr(nlopt, name)),
    RuntimeError,
    ValueError,
    FloatingPointError,
)
"""What a search may raise: nlopt (classes of its own in new versions, Python's in old ones) or our objective."""


@dataclass(frozen=True)
class NotCompiled:
    """A compensator steps plain models with L-BFGS, tens of times as slow, because of `reason`."""

    reason: str


@dataclass(frozen=True)
class Optimum:
    """Where a search ended.

    `correction` (6,) is the dW to use, `cost` its J. `accepted` says that J is below the threshold; otherwise
    `correction` is the better of the search's end and zero. `iterations` counts evaluations of the model in searches.
    `trouble` is empty, or says in one line what went wrong.
    """

    correction: Array
    cost: float
    accepted: bool
    iterations: int
    trouble: str = ""


class _Search:
    """J and its gradient in the free components, remembering the best point seen.

    nlopt's L-BFGS may give up with an exception when rounding stops its line search, at a point that is perfectly
    good; the best point seen is then the answer.
    """

    def __init__(self, model: MismatchModel, wrench_des: Array, rows: Indices, regulariser: float) -> None:
        self.linearise = linearisation(model)
        self.wrench_des = wrench_des
        self.rows = rows
        self.weight = regulariser * TORQUES[rows]
        self.best = np.zeros(len(rows))
        self.best_penalised = self.best_cost = np.inf
        self.evaluations = 0
        self.interrupted = False

    def residual(self, free: Array) -> tuple[Array, Array]:
        """Residual r (L,) and dr/ddW (L, L)."""
        wrench = self.wrench_des.copy()
        wrench[self.rows] += free
        mean, jacobian = self.linearise(wrench[None])
        return mean[0] + free, jacobian[0][:, self.rows] + np.eye(len(self.rows))

    def objective(self, free: Array, gradient: Array) -> float:
        """What nlopt minimises; a float, because a 1-element array fails as `invalid_argument`.

        nlopt makes an error of its own of a Ctrl-C; `interrupted` remembers that it was one.
        """
        try:
            self.evaluations += 1
            residual, slope = self.residual(free)
            if not (np.isfinite(residual).all() and np.isfinite(slope).all()):
                raise FloatingPointError("the mismatch model gave a value that is not finite")
            cost = float(residual @ residual)
            value = cost + float(self.weight @ (free * free))
            if gradient.size:
                gradient[:] = 2.0 * (slope.T @ residual + self.weight * free)
            if value < self.best_penalised:
                self.best, self.best_penalised, self.best_cost = free.copy(), value, cost
            return value
        except KeyboardInterrupt:
            self.interrupted = True
            raise


def linearisation(model: MismatchModel) -> Callable[[Array], tuple[Array, Array]]:
    """Mean and Jacobian of the model in one call."""
    if isinstance(model, Linearises):
        return model.mean_and_jacobian
    return lambda query: (model.mean(query), model.jacobian(query))


@dataclass(frozen=True)
class Optimiser:
    """Minimises J for one desired wrench after the other.

    lower, upper  (6,) bounds of the correction [N, Nm]
    accept        J below which the optimum solves the problem (paper: 1e-4, i.e. 0.01 Nm)
    regulariser   weight of |dW_torque|^2 in the search
    max_evaluations  of the model in one search
    good_enough   share of `accept` at which the search stops: a thousandth of its error
    """

    lower: Array
    upper: Array
    accept: float = 1e-4
    regulariser: float = 0.0
    max_evaluations: int = 100
    good_enough: float = 1e-6

    def solve(self, model: MismatchModel, wrench_des: Array, start: Array, centre: Array | None = None) -> Optimum:
        """Optimum of `model` for `wrench_des` (6,): searched from the correction `start` (6,), else from zero.

        The bounds are around `centre` (6,), by default zero.

        Never raises for numerical trouble: the correction is then zero and `trouble` says why.
        """
        rows = output_indices(model.outputs)
        zero = np.zeros(len(AXES))
        try:
            search = _Search(model, wrench_des, rows, self.regulariser)
            middle = zero if centre is None else centre
            lower, upper = ((bound + middle)[rows] for bound in (self.lower, self.upper))
            trouble = self._descend(search, start[rows], lower, upper)
            if search.best_cost >= self.accept and start[rows].any():
                trouble = self._descend(search, zero[rows], lower, upper)
            cost, cost_of_zero = search.best_cost, np.inf
            if not cost < self.accept:
                residual, _ = search.residual(zero[rows])
                cost_of_zero = float(residual @ residual)
        except (FloatingPointError, ValueError, ArithmeticError, np.linalg.LinAlgError) as error:
            return Optimum(zero, float("nan"), False, 0, f"no correction: {' '.join(str(error).split())}")
        if not cost < cost_of_zero:
            return Optimum(zero, cost_of_zero, False, search.evaluations, trouble)
        correction = zero.copy()
        correction[rows] = search.best
        return Optimum(correction, cost, cost < self.accept, search.evaluations, trouble)

    def _descend(self, search: _Search, start: Array, lower: Array, upper: Array) -> str:
        """One L-BFGS search, whose best point `search` remembers; says what nlopt complained about."""
        descent = nlopt.opt(nlopt.LD_LBFGS, len(start))
        descent.set_min_objective(search.objective)
        descent.set_lower_bounds(lower)
        descent.set_upper_bounds(upper)
        descent.set_stopval(self.good_enough * self.accept)
        descent.set_ftol_rel(1e-9)
        descent.set_xtol_rel(1e-9)
        descent.set_maxeval(self.max_evaluations)
        trouble = ""
        try:
            descent.optimize(np.clip(start, lower, upper))
        except SEARCH_ERRORS as error:
            if search.interrupted:
                raise KeyboardInterrupt from None
            trouble = f"search stopped early: {' '.join(str(error).split()) or type(error).__name__}"
        if not np.isfinite(search.best_penalised):
            raise FloatingPointError(trouble or "the search evaluated nothing")
        return trouble
