"""A process or a straight line as plain arrays: what compiled code evaluates, and what goes onto a vehicle.

With x = (xi - input_mean) / input_scale and, for each of L outputs, q = x / lengthscale

    mean = output_scale (b_0 + b . x + sum_n alpha_n s_f^2 exp(-1/2 |q - p_n|^2))
    std  = output_scale sigma_scale sqrt(max(s_f^2 - |C^-1 k|^2, 0) + s_n^2)

These are the forms of `learn.process.gp`, which is their specification; see there for the source. A straight line is
one without points.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from wrenchgap.flight.flight import Array


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
    """A mismatch model that is such arrays and nothing else."""

    def expansion(self) -> Expansion:
        """The arrays."""


def straight_line(outputs: tuple[str, ...], offset: Array, gain: Array, sigma: Array) -> Expansion:
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
