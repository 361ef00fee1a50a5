"""The marginal likelihood of an exact process and its gradient, and the search for hyperparameters that maximise it.

With K = s_f^2 exp(-1/2 |x_i - x_j|^2 / l^2), C = K + s_n^2 I and a = C^-1 z,

    log p(z) = -1/2 (z a + log det C + N log 2 pi)
    d log p / d theta = 1/2 tr[(a a^T - C^-1) dC / d theta]

(Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006, eq. 5.8 and 5.9). For lengthscales
dK / dl_d = K (x_id - x_jd)^2 / l_d^3, so that with the symmetric W = (a a^T - C^-1) K and its row sums r

    sum_ij W_ij (x_id - x_jd)^2 = 2 (sum_i r_i x_id^2 - x_d^T W x_d)

needs no array of N x N x D. The search is GPy's, L-BFGS over the logits of the bounded hyperparameters, and finds what
GPy finds (tests/learn/test_likelihood.py) without its overhead; for a sparse process GPy takes the gradient by the
inducing inputs as well, which stay where they are.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.linalg import solve_triangular
from scipy.linalg.lapack import dpotrf, dpotri

from wrenchgap.flight.flight import Array
from wrenchgap.learn.process.sparse import Kernel

JITTER = 1e-8
"""GPy's, on the diagonal."""
ATTEMPTS = 6
"""With a diagonal that is ten times larger each, where C is not positive definite but for rounding."""
ITERATIONS, SPARSE_ITERATIONS = 500, 120
"""Of L-BFGS; a sparse process begins with hyperparameters that an exact one on a few samples has found."""


def log_likelihood(x: Array, z: Array, kernel: Kernel) -> tuple[float, Array]:
    """Of samples x (N, D), z (N,), and its gradient (D + 2,) by signal variance, lengthscales and noise variance.

    Raises numpy's LinAlgError where the covariance is not positive definite.
    """
    K = kernel(x, x)
    logarithm, inverse = _inverted(K, kernel.noise_variance + JITTER)
    a = inverse @ z
    slope = 0.5 * (np.outer(a, a) - inverse)
    W = slope * K
    gradient = np.concatenate(([W.sum() / kernel.signal_variance], _by_lengthscale(W, x, x, kernel), [np.trace(slope)]))
    return float(-0.5 * (z @ a + logarithm + len(z) * np.log(2.0 * np.pi))), gradient


def bound(x: Array, z: Array, kernel: Kernel, inducing: Array) -> tuple[float, Array]:
    """The bound of a sparse process on the likelihood of x (N, D), z (N,), and its gradient, as `log_likelihood`.

    Titsias (2009) with K_zz = L L^T, A = L^-1 K_zx / s_n, B = I + A A^T, v = B^-1 A z / s_n, w = L^-T v and
    b = (K_xz K_zz^-1 K_zx + s_n^2 I)^-1 z = s_n^-2 (z - K_xz w):

        F = -1/2 [z b + log det B + N log(2 pi s_n^2) + N s_f^2 / s_n^2 - tr A A^T]
        dF/dK_zx = w b^T + L^-T (I - B^-1) A / s_n
        dF/dK_zz = -1/2 L^-T (v v^T + B^-1 - 2 I + B) L^-1
    """
    noise, count, eye = kernel.noise_variance, len(x), np.eye(len(inducing))
    Kzz, Kzx = kernel(inducing, inducing), kernel(inducing, x)
    L = _factor(Kzz, JITTER)
    A = solve_triangular(L, Kzx, lower=True) / np.sqrt(noise)
    B = eye + A @ A.T
    logarithm, inverse = _inverted(B)
    v = inverse @ (A @ z) / np.sqrt(noise)
    w = solve_triangular(L, v, lower=True, trans=1)
    b = (z - w @ Kzx) / noise
    missing = count * kernel.signal_variance / noise - np.sum(A * A)
    value = -0.5 * (z @ b + logarithm + count * np.log(2.0 * np.pi * noise) + missing)
    by_noise = 0.5 * (b @ b + (missing - count + len(eye) - np.trace(inverse)) / noise)
    W = (np.outer(w, b) + solve_triangular(L, (eye - inverse) @ A, lower=True, trans=1) / np.sqrt(noise)) * Kzx
    inner = solve_triangular(L, np.outer(v, v) + inverse - 2.0 * eye + B, lower=True, trans=1)
    V = -0.5 * solve_triangular(L, inner.T, lower=True, trans=1) * Kzz
    by_signal = (W.sum() + V.sum()) / kernel.signal_variance - 0.5 * count / noise
    lengths = _by_lengthscale(W, inducing, x, kernel) + _by_lengthscale(V, inducing, inducing, kernel)
    return float(value), np.concatenate(([by_signal], lengths, [by_noise]))


def _by_lengthscale(W: Array, a: Array, b: Array, kernel: Kernel) -> Array:
    """sum_ij W_ij (a_id - b_jd)^2 / l_d^3, (D,), without an array of all differences."""
    squares = W.sum(axis=1) @ a**2 + W.sum(axis=0) @ b**2 - 2.0 * np.einsum("id,id->d", a, W @ b)
    return np.asarray(squares / kernel.lengthscales**3)


def maximise(
    x: Array, z: Array, start: Kernel, bounds: dict[str, Any], inducing: Array | None = None
) -> tuple[float, Kernel]:
    """Hyperparameters that maximise the likelihood of samples x (N, D), z (N,), from `start`, within `bounds`.

    With `inducing` inputs (M, D) it is the bound of the sparse process, and they stay where they are. Its logarithm,
    -inf where that failed, and the kernel.
    """
    from scipy.optimize import minimize  # here: others need not wait for it

    names = ["signal", *["lengthscale"] * x.shape[1], "noise"]
    low, high = np.array([bounds[name] for name in names], dtype=float).T

    def kernel(logits: Array) -> Kernel:
        theta = low + (high - low) / (1.0 + np.exp(-np.maximum(logits, -300.0)))
        return Kernel(theta[1:-1], float(theta[0]), float(theta[-1]))

    def objective(logits: Array) -> tuple[float, Array]:
        at = kernel(logits)
        value, gradient = log_likelihood(x, z, at) if inducing is None else bound(x, z, at, inducing)
        theta = _vector(at)
        return -value, -gradient * (theta - low) * (high - theta) / (high - low)

    first = _vector(start)
    logits = np.log(np.clip(first - low, 1e-10, np.inf) / np.clip(high - first, 1e-10, np.inf))
    most = ITERATIONS if inducing is None else SPARSE_ITERATIONS
    try:
        found = minimize(objective, logits, jac=True, method="L-BFGS-B", options={"maxiter": most, "maxfun": most})
    except np.linalg.LinAlgError:
        return -np.inf, start
    return (-float(found.fun) if np.isfinite(found.fun) else -np.inf), kernel(found.x)


def _vector(kernel: Kernel) -> Array:
    return np.concatenate(([kernel.signal_variance], kernel.lengthscales, [kernel.noise_variance]))


def _inverted(K: Array, noise: float = 0.0) -> tuple[float, Array]:
    """Logarithm of the determinant and inverse of K + noise I."""
    factor = _factor(K, noise)
    logarithm = 2.0 * float(np.sum(np.log(np.diagonal(factor))))
    lower, _ = dpotri(factor, lower=1, overwrite_c=1)  # above the diagonal zeros, as in the factor
    inverse = np.add(lower, lower.T, order="C")
    inverse[np.diag_indices(len(inverse))] *= 0.5
    return logarithm, inverse


def _factor(K: Array, noise: float) -> Array:
    """The Cholesky factor of K + noise I, lower triangular."""
    diagonal, more = np.diag_indices(len(K)), 0.0
    for attempt in range(ATTEMPTS):
        C = np.array(K.T, order="F")  # which LAPACK may write to
        C[diagonal] += noise + more
        factor, failed = dpotrf(C, lower=1, clean=1, overwrite_a=1)
        if not failed:
            return np.asarray(factor)
        more = float(np.mean(np.diagonal(K)) + noise) * 1e-6 * 10.0**attempt
    raise np.linalg.LinAlgError("the covariance of the samples is not positive definite")
