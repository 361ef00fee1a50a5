"""The marginal likelihood of an exact process and its gradient, and the search for hyperparameters that maximise it.

Equations and sources: docs/theory/process.md, Hyperparameters; no array of N x N x D is needed for the gradient by
lengthscales. The search is GPy's, L-BFGS over the logits of the bounded hyperparameters, and finds what GPy finds
(tests/learn/test_likelihood.py) without its overhead; for a sparse process GPy takes the gradient by the inducing
inputs as well, which stay where they are. `maximise_by_gpy` is the reference.

A search asks for a thousand likelihoods of some hundred samples. In the compiled passes (`exponents`, `lower`,
`slopes`) each pair of samples is once, and pairs lie row by row: (1, 0), (2, 0), (2, 1), (3, 0), ...
(docs/decisions/0026-compiled-kernels.md).
"""

import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numba import njit
from scipy.linalg import solve_triangular
from scipy.linalg.blas import dgemm, dsyrk, dtrsm
from scipy.linalg.lapack import dpotrf, dpotri, dpotrs

from wrenchgap.flight.flight import Array
from wrenchgap.learn.process.subsample import JITTER, Kernel

NOT_DEFINITE = "the covariance of the samples is not positive definite"


def _by_lengthscale(W: Array, a: Array, b: Array, kernel: Kernel) -> Array:
    """sum_ij W_ij (a_id - b_jd)^2 / l_d^3, (D,), without an array of all differences."""
    squares = W.sum(axis=1) @ a**2 + W.sum(axis=0) @ b**2 - 2.0 * np.einsum("id,id->d", a, W @ b)
    return np.asarray(squares / kernel.lengthscales**3)


class LogLikelihood:
    """Of samples x (N, D), z (N,) at one kernel after the other, in the same memory."""

    def __init__(self, x: Array, z: Array) -> None:
        count = len(x)
        self.columns, self.z = np.ascontiguousarray(x.T), z
        self.pairs, self.C = np.empty(count * (count - 1) // 2), np.empty((count, count))

    def __call__(self, kernel: Kernel) -> tuple[float, Array]:
        """Its value and its gradient (D + 2,) by signal variance, lengthscales and noise variance.

        Raises numpy's LinAlgError where the covariance is not positive definite.
        """
        q = self.columns / kernel.lengthscales[:, None]
        exponents(q, self.pairs)
        np.exp(self.pairs, out=self.pairs)
        C = self._factored(kernel)
        a, _ = dpotrs(C.T, self.z, lower=0)  # the lower triangle of C is the upper one of LAPACK's, column by column
        logarithm = 2.0 * float(np.sum(np.log(np.diagonal(C))))
        dpotri(C.T, lower=0, overwrite_c=1)
        sums = slopes(q, self.pairs, C, a)
        sums[1:-1] *= kernel.signal_variance / kernel.lengthscales
        return float(-0.5 * (self.z @ a + logarithm + len(a) * np.log(2.0 * np.pi))), sums

    def _factored(self, kernel: Kernel) -> Array:
        """The Cholesky factor of the covariance in the lower triangle; attempts as those of `_factor`."""
        noise, more = kernel.noise_variance + JITTER.noise, 0.0
        for attempt in range(JITTER.attempts):
            lower(self.pairs, kernel.signal_variance, noise + more, self.C)
            _, failed = dpotrf(self.C.T, lower=0, clean=0, overwrite_a=1)
            if not failed:
                return self.C
            more = (kernel.signal_variance + noise) * 1e-6 * 10.0**attempt
        raise np.linalg.LinAlgError(NOT_DEFINITE)


class Bound:
    """The bound of a sparse process on the likelihood of x (N, D), z (N,); rows are inducing inputs (M, D).

    Titsias (2009) with K_zz = L L^T, A = L^-1 K_zx / s_n, B = I + A A^T, v = B^-1 A z / s_n, w = L^-T v and
    b = (K_xz K_zz^-1 K_zx + s_n^2 I)^-1 z = s_n^-2 (z - K_xz w):

        F = -1/2 [z b + log det B + N log(2 pi s_n^2) + N s_f^2 / s_n^2 - tr A A^T]
        dF/dK_zx = w b^T + L^-T (I - B^-1) A / s_n
        dF/dK_zz = -1/2 L^-T (v v^T + B^-1 - 2 I + B) L^-1
    """

    def __init__(self, x: Array, z: Array, inducing: Array) -> None:
        self.x, self.z, self.inducing = x, z, inducing
        self.K, self.A, self.W = (np.empty((len(inducing), len(x))) for _ in range(3))

    def __call__(self, kernel: Kernel) -> tuple[float, Array]:
        """Its value and its gradient, as those of `LogLikelihood`."""
        noise, (size, count), eye = kernel.noise_variance, self.K.shape, np.eye(len(self.inducing))
        Kzz, Kzx = kernel(self.inducing, self.inducing), kernel(self.inducing, self.x, self.K)
        A, W = self.A, self.W
        L = _factor(Kzz, JITTER.noise)
        np.copyto(A, Kzx)
        dtrsm(noise**-0.5, L, A.T, side=1, lower=1, trans_a=1, overwrite_b=1)  # A^T L^T = K_xz / s_n
        half = dsyrk(1.0, A.T, trans=1, lower=1)
        inside = half + np.tril(half, -1).T
        B = eye + inside
        factor = _factor(B, 0.0)
        logarithm = 2.0 * float(np.sum(np.log(np.diagonal(factor))))
        triangle, _ = dpotri(factor, lower=1, overwrite_c=1)  # above the diagonal zeros, as in the factor
        inverse = np.add(triangle, triangle.T, order="C")
        inverse[np.diag_indices(size)] *= 0.5
        v = inverse @ (A @ self.z) / np.sqrt(noise)
        w = solve_triangular(L, v, lower=True, trans=1)
        b = (self.z - w @ Kzx) / noise
        missing = count * kernel.signal_variance / noise - np.trace(inside)
        value = -0.5 * (self.z @ b + logarithm + count * np.log(2.0 * np.pi * noise) + missing)
        by_noise = 0.5 * (b @ b + (missing - count + size - np.trace(inverse)) / noise)
        np.multiply(w[:, None], b, out=W)
        right = solve_triangular(L, eye - inverse, lower=True, trans=1)
        dgemm(noise**-0.5, A.T, np.asfortranarray(right), trans_b=1, beta=1.0, c=W.T, overwrite_c=1)
        W *= Kzx
        inner = solve_triangular(L, np.outer(v, v) + inverse - 2.0 * eye + B, lower=True, trans=1)
        V = -0.5 * solve_triangular(L, inner.T, lower=True, trans=1) * Kzz
        by_signal = (W.sum() + V.sum()) / kernel.signal_variance - 0.5 * count / noise
        lengths = _by_lengthscale(W, self.inducing, self.x, kernel)
        lengths += _by_lengthscale(V, self.inducing, self.inducing, kernel)
        return float(value), np.concatenate(([by_signal], lengths, [by_noise]))


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
    width = high - low
    asked = LogLikelihood(x, z) if inducing is None else Bound(x, z, inducing)

    def kernel(logits: Array) -> Kernel:
        theta = low + width / (1.0 + np.exp(-np.maximum(logits, -300.0)))
        return Kernel(theta[1:-1], float(theta[0]), float(theta[-1]))

    def objective(logits: Array) -> tuple[float, Array]:
        at = kernel(logits)
        value, gradient = asked(at)
        theta = _vector(at)
        return -value, -gradient * (theta - low) * (high - theta) / width

    most = _iterations(inducing)
    first = _vector(start)
    logits = np.log(np.clip(first - low, 1e-10, np.inf) / np.clip(high - first, 1e-10, np.inf))
    try:
        found = minimize(objective, logits, jac=True, method="L-BFGS-B", options={"maxiter": most, "maxfun": most})
    except np.linalg.LinAlgError:
        return -np.inf, start
    return (-float(found.fun) if np.isfinite(found.fun) else -np.inf), kernel(found.x)


def _iterations(inducing: Array | None) -> int:
    """Of L-BFGS; a sparse process begins with hyperparameters that an exact one on a few samples has found."""
    return 500 if inducing is None else 120


def _vector(kernel: Kernel) -> Array:
    return np.concatenate(([kernel.signal_variance], kernel.lengthscales, [kernel.noise_variance]))


def _factor(K: Array, noise: float) -> Array:
    """The Cholesky factor of K + noise I, lower triangular."""
    diagonal, more = np.diag_indices(len(K)), 0.0
    for attempt in range(JITTER.attempts):
        C = np.array(K.T, order="F")  # which LAPACK may write to
        C[diagonal] += noise + more
        factor, failed = dpotrf(C, lower=1, clean=1, overwrite_a=1)
        if not failed:
            return np.asarray(factor)
        more = float(np.mean(np.diagonal(K)) + noise) * 1e-6 * 10.0**attempt
    raise np.linalg.LinAlgError(NOT_DEFINITE)


FAST = {"reassoc", "contract"}


@njit(cache=True, nogil=True, fastmath=FAST)
def exponents(q: Array, pairs: Array) -> None:
    """-1/2 |q_i - q_j|^2 into `pairs` (N (N - 1) / 2,), of samples over lengthscales q (D, N)."""
    dims, count = q.shape
    first = 0
    for i in range(1, count):
        row = pairs[first : first + i]
        row[:] = 0.0
        for d in range(dims):
            here, others = q[d, i], q[d]
            for j in range(len(row)):
                apart = here - others[j]
                row[j] += apart * apart
        for j in range(len(row)):
            row[j] *= -0.5
        first += i


@njit(cache=True, nogil=True)
def lower(pairs: Array, variance: float, noise: float, C: Array) -> None:
    """The lower triangle of C (N, N), the covariance: `variance` times `pairs`, and on the diagonal both variances."""
    first = 0
    for i in range(len(C)):
        into, row = C[i], pairs[first : first + i]
        for j in range(len(row)):
            into[j] = variance * row[j]
        into[i] = variance + noise
        first += i


@njit(cache=True, nogil=True, fastmath=FAST)
def slopes(q: Array, pairs: Array, inverse: Array, a: Array) -> Array:
    """Sums (D + 2,) over W_ij = 1/2 (a_i a_j - C^-1_ij) k_ij, k = `pairs` off the diagonal and one on it.

    First of W itself, then of W (q_id - q_jd)^2, last the trace of 1/2 (a a^T - C^-1); of the `inverse` (N, N) the
    lower triangle counts. `pairs` are overwritten.
    """
    dims, count = q.shape
    sums = np.zeros(dims + 2)
    first = 0
    for i in range(count):
        row, known, own = pairs[first : first + i], inverse[i], a[i]
        total = 0.0
        for j in range(len(row)):
            row[j] *= own * a[j] - known[j]
            total += row[j]
        half = 0.5 * (own * own - known[i])
        sums[0] += total + half
        sums[dims + 1] += half
        for d in range(dims):
            here, others = q[d, i], q[d]
            part = 0.0
            for j in range(len(row)):
                apart = here - others[j]
                part += row[j] * (apart * apart)
            sums[d + 1] += part
        first += i
    return sums


def maximise_by_gpy(
    x: Array, z: Array, start: Kernel, bounds: dict[str, Any], inducing: Array | None = None
) -> tuple[float, Kernel]:
    """As `maximise`, of samples x (N, D), z (N,), by GPy, as in the paper: its models and its L-BFGS."""
    with _gpy() as gpy:
        kernel = gpy.kern.RBF(x.shape[1], variance=start.signal_variance, lengthscale=start.lengthscales, ARD=True)
        if inducing is None:
            model = gpy.models.GPRegression(x, z[:, None], kernel, noise_var=start.noise_variance)
        else:
            model = gpy.models.SparseGPRegression(x, z[:, None], kernel, Z=inducing)
            model.likelihood.variance[:] = start.noise_variance
            model.inducing_inputs.fix(warning=False)
        noise = model.likelihood.variance
        for parameter, name in ((kernel.lengthscale, "lengthscale"), (kernel.variance, "signal"), (noise, "noise")):
            parameter.constrain_bounded(*bounds[name], warning=False)
        try:
            model.optimize("lbfgsb", max_iters=_iterations(inducing))
            likelihood = float(np.squeeze(model.log_likelihood()))
        except (np.linalg.LinAlgError, FloatingPointError):
            likelihood = -np.inf
        lengthscales = np.array(kernel.lengthscale, dtype=float)
        return likelihood, Kernel(lengthscales, float(kernel.variance[0]), float(noise[0]))


@contextmanager
def _gpy() -> Iterator[Any]:
    """GPy, imported late (it takes seconds) and without its chatter."""
    loggers = [logging.getLogger(name) for name in ("GP", "GPy", "paramz", "root")]
    levels = [logger.level for logger in loggers]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for logger in loggers:
            logger.setLevel(logging.ERROR)
        try:
            import GPy

            yield GPy
        finally:
            for logger, level in zip(loggers, levels, strict=True):
                logger.setLevel(level)
