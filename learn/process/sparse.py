"""All samples of a log behind a prediction that costs as much as one on a hundred of them.

Variational sparse Gaussian process (Titsias, "Variational learning of inducing variables in sparse Gaussian
processes", AISTATS 2009). With inducing inputs Z (M, D), all inputs X (N, D) and

    A = K_zz + s_n^-2 K_zx K_xz,        mean(x) = k(x, Z) s_n^-2 A^-1 K_zx z
                                        var(x)  = k(x, x) - k(x, Z) (K_zz^-1 - A^-1) k(Z, x)

the bound on the likelihood of all N samples (`learn.process.likelihood`) is maximised over the hyperparameters; Z stays
where it is. The time to predict depends on M alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from wrenchgap.flight.flight import Array


@dataclass(frozen=True)
class Jitter:
    """What is added to a diagonal, so that rounding does not make a covariance indefinite."""

    noise: float = 1e-8
    """To the noise variance of a standardised output wherever K is factored, as GPy does."""
    inducing: float = 1e-6
    """To K_zz, relative to the signal's variance."""
    attempts: int = 6
    """Factors that are tried, each with a diagonal that is ten times larger."""


JITTER = Jitter()


@dataclass(frozen=True)
class Kernel:
    """Squared exponential with one lengthscale per input (D,), and the variances of signal and noise."""

    lengthscales: Array
    signal_variance: float
    noise_variance: float

    def __call__(self, a: Array, b: Array) -> Array:
        """k(a, b) (N, M)."""
        p, q = a / self.lengthscales, b / self.lengthscales
        square = (p * p).sum(axis=1)[:, None] + (q * q).sum(axis=1)
        square -= 2.0 * p @ q.T
        np.maximum(square, 0.0, out=square)
        square *= -0.5
        np.exp(square, out=square)
        square *= self.signal_variance
        return np.asarray(square)


def posterior(kernel: Kernel, x: Array, z: Array, inducing: Array) -> tuple[Array, Array]:
    """`weights` (M,) and `whitener` (M, M): mean = k w, var = k(x, x) - |V k|^2, for k = k(Z, x)."""
    size = len(inducing)
    Kzz = kernel(inducing, inducing) + JITTER.inducing * kernel.signal_variance * np.eye(size)
    Kzx = kernel(inducing, x)
    A = Kzz + Kzx @ Kzx.T / kernel.noise_variance
    factor = cho_factor(A, lower=True)
    weights = cho_solve(factor, Kzx @ z) / kernel.noise_variance
    inverse = np.linalg.inv(Kzz) - cho_solve(factor, np.eye(size))
    values, vectors = np.linalg.eigh(0.5 * (inverse + inverse.T))
    return weights, np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T
