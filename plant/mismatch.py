"""Models of the mismatch between commanded and real wrench, as a function of the command.

    W = W_cmd + g(W_cmd)                                    (paper, 'Learning model-plant mismatch')

A *mismatch model* estimates some components of g together with a standard deviation. `learn` makes them from logs,
`compensate` inverts them, simulations fly with them; none needs to know which kind it holds.

An `Expansion` is a process or a linear model as plain arrays: what compiled code evaluates, and what is exported. With
x = (xi - input_mean) / input_scale and, for each of L outputs, q = x / lengthscale,

    mean = output_scale (b_0 + b . x + sum_n alpha_n s_f^2 exp(-1/2 |q - p_n|^2))
    std  = output_scale sigma_scale sqrt(max(s_f^2 - |C^-1 k|^2, 0) + s_n^2)

as in `learn.process.gp`, which specifies it and names the source. A linear model has no points.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from wrenchgap.flight.errors import ModelError
from wrenchgap.flight.flight import AXES, Array, Indices
from wrenchgap.plant.state import State


class MismatchModel(Protocol):
    """Estimate of g(W_cmd), evaluated at N commands at once. Inputs are wrenches (N, 6) in B [N, Nm].

    `outputs` are the L components of g that the model knows, names out of `flight.flight.AXES`; the others are taken
    to be zero.
    """

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the L components that the model estimates."""

    def mean(self, wrench_cmd: Array, /) -> Array:
        """Expected mismatch (N, L) [N or Nm]."""

    def std(self, wrench_cmd: Array, /) -> Array:
        """Standard deviation of a measured mismatch about `mean` (N, L), noise included."""

    def jacobian(self, wrench_cmd: Array, /) -> Array:
        """Derivative of `mean` (N, L, 6)."""


@runtime_checkable
class Linearises(Protocol):
    """A mismatch model that gives mean and Jacobian together at less cost than one after the other."""

    def mean_and_jacobian(self, wrench_cmd: Array, /) -> tuple[Array, Array]:
        """`mean` (N, L) and `jacobian` (N, L, 6)."""


@runtime_checkable
class KnowsItsData(Protocol):
    """A mismatch model that knows the range of its training data."""

    @property
    def sigma_training(self) -> Array:
        """99th percentile of `std` over the training inputs (L,)."""

    @property
    def sigma_prior(self) -> Array:
        """`std` infinitely far from the training inputs (L,)."""

    @property
    def mismatch_max(self) -> Array:
        """Largest absolute mismatch in the training data (L,)."""


@runtime_checkable
class Judged(Protocol):
    """A mismatch model with outputs that are not to be compensated, since they do not reduce the error."""

    @property
    def refused(self) -> tuple[str, ...]:
        """Names of these outputs, on which `mean` is zero."""

    def despite_verdict(self) -> MismatchModel | Follows:
        """The model without the verdict."""


class Follower(Protocol):
    """Keeps the further inputs of a mismatch model: the motion, and the commands that were sent."""

    def model_at(self, state: State | None, /) -> MismatchModel:
        """The mismatch as a function of the next command alone, in this state (N = 1), called once per period.

        Raises UsageError where the state is needed and None.
        """

    def record(self, wrench_cmd: Array, /) -> None:
        """Record the command (6,) of this period."""


@runtime_checkable
class Follows(Protocol):
    """A mismatch model that may depend on more than the command."""

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the L components that the model estimates."""

    @property
    def needs_state(self) -> bool:
        """Whether its followers need the state."""

    def follow(self, dt: float) -> Follower:
        """A follower without a past; `model_at` will be called every `dt` [s]."""


def needs_state(model: MismatchModel | Follows) -> bool:
    """Whether a model depends on the state besides the command."""
    return bool(getattr(model, "needs_state", False))


def output_indices(outputs: tuple[str, ...]) -> Indices:
    """Places (L,) of the named components in a wrench; raises ModelError on a name that is none or comes twice."""
    for name in outputs:
        if name not in AXES:
            raise ModelError(f"mismatch model: unknown output {name!r}; available: {', '.join(AXES)}")
    if not outputs or len(set(outputs)) != len(outputs):
        raise ModelError(f"mismatch model: outputs {list(outputs)} must be different names out of {', '.join(AXES)}")
    return np.array([AXES.index(name) for name in outputs], dtype=np.intp)


@dataclass(frozen=True)
class LinearMismatch:
    """g(W) = offset + gain W: exact for fixed tilt and gain errors, which the pseudo-inverse keeps linear in W.

    `offset` (L,), `gain` (L, 6), `sigma` (L,) the residual's standard deviation. With `gain` zero this is the
    constant-offset baseline.
    """

    outputs: tuple[str, ...]
    offset: Array
    gain: Array
    sigma: Array

    def __post_init__(self) -> None:
        count = len(output_indices(self.outputs))
        for name, shape in {"offset": (count,), "gain": (count, len(AXES)), "sigma": (count,)}.items():
            got = np.shape(getattr(self, name))
            if got != shape:
                raise ModelError(f"linear mismatch: {name} has shape {got}, expected {shape}")

    @property
    def input_groups(self) -> tuple[str, ...]:
        """Inputs besides the command: none."""
        return ()

    def mean(self, wrench_cmd: Array, /) -> Array:
        """Expected mismatch (N, L)."""
        return np.asarray(self.offset + wrench_cmd @ self.gain.T)

    def std(self, wrench_cmd: Array, /) -> Array:
        """The same standard deviation everywhere (N, L): a linear model has no range of validity."""
        return np.broadcast_to(self.sigma, (len(wrench_cmd), len(self.sigma))).copy()

    def jacobian(self, wrench_cmd: Array, /) -> Array:
        """`gain` at every command (N, L, 6)."""
        return np.broadcast_to(self.gain, (len(wrench_cmd), *self.gain.shape)).copy()

    def expansion(self) -> Expansion:
        """See `plant.mismatch.Expands`."""
        return linear_expansion(self.outputs, self.offset, self.gain, self.sigma)


@dataclass(frozen=True)
class Conditioning:
    """How well W_des = W_cmd + mu(W_cmd) can be solved for W_cmd, at N commands.

    With A = I + dmu/dW on the output axes: `real_min` (N,) is the smallest real part of A's eigenvalues, `singular_min`
    (N,) its smallest singular value. Near zero no correction exists or it is enormous; below zero the model claims
    that more command gives less wrench, which in closed-loop logs is mostly the trap z = -W_cmd (the measured wrench
    hardly varies, so the regression finds slope -1): the command was not excited independently of the mismatch.
    """

    real_min: Array
    singular_min: Array


def conditioning(model: MismatchModel, wrench_cmd: Array) -> Conditioning:
    """Eigenvalues and singular values of I + dmu/dW along `wrench_cmd` (N, 6)."""
    rows = output_indices(model.outputs)
    plant_gain = np.eye(len(rows)) + model.jacobian(wrench_cmd)[:, :, rows]
    real, singular = np.linalg.eigvals(plant_gain).real, np.linalg.svd(plant_gain, compute_uv=False)
    return Conditioning(np.asarray(real.min(axis=1), dtype=float), np.asarray(singular[:, -1], dtype=float))


@dataclass(frozen=True, eq=False)
class Expansion:
    """L outputs over D inputs, the six components of the command [N, Nm] first, with N points.

    input_groups       groups of `plant.mismatch_inputs` behind the command
    input_mean         (D,), input_scale (D,), output_scale (L,) [N or Nm]
    mean_coefficients  (L, 1 + D): b_0 and b
    lengthscales       (L, D), points (L, N, D) in lengthscales
    alpha              (L, N), whitener (L, N, N): C^-1
    signal_variance    (L,), noise_variance (L,), sigma_scale (L,)
    """

    outputs: tuple[str, ...]
    input_groups: tuple[str, ...]
    input_mean: Array
    input_scale: Array
    output_scale: Array
    mean_coefficients: Array
    lengthscales: Array
    points: Array
    alpha: Array
    whitener: Array
    signal_variance: Array
    noise_variance: Array
    sigma_scale: Array

    @property
    def triangular(self) -> bool:
        """Whether the whiteners are lower triangular, which halves the price of a standard deviation."""
        return not np.triu(self.whitener, 1).any()


@runtime_checkable
class Expands(Protocol):
    """A mismatch model that is an `Expansion`."""

    def expansion(self) -> Expansion:
        """The arrays."""


def linear_expansion(outputs: tuple[str, ...], offset: Array, gain: Array, sigma: Array) -> Expansion:
    """Offset (L,) + gain (L, 6) W with the same standard deviation (L,) everywhere."""
    count, dims = gain.shape
    return Expansion(
        outputs=outputs,
        input_groups=(),
        input_mean=np.zeros(dims),
        input_scale=np.ones(dims),
        output_scale=np.ones(count),
        mean_coefficients=np.hstack((np.asarray(offset)[:, None], gain)),
        lengthscales=np.ones((count, dims)),
        points=np.empty((count, 0, dims)),
        alpha=np.empty((count, 0)),
        whitener=np.empty((count, 0, 0)),
        signal_variance=np.zeros(count),
        noise_variance=np.asarray(sigma) ** 2,
        sigma_scale=np.ones(count),
    )
