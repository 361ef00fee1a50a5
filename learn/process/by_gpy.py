"""The search for hyperparameters by GPy, as in the paper: the reference for `learn.process.likelihood`."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from wrenchgap.flight.flight import Array
from wrenchgap.learn.process.likelihood import ITERATIONS, SPARSE_ITERATIONS
from wrenchgap.learn.process.sparse import Kernel


def maximise(
    x: Array, z: Array, start: Kernel, bounds: dict[str, Any], inducing: Array | None = None
) -> tuple[float, Kernel]:
    """As `learn.process.likelihood.maximise`, of samples x (N, D), z (N,), by GPy's models and its L-BFGS."""
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
            model.optimize("lbfgsb", max_iters=ITERATIONS if inducing is None else SPARSE_ITERATIONS)
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
