"""Likelihood, bound and their gradients against GPy's and against differences, and the same searches."""

import logging

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from wrenchgap.learn.process.gp import FitSettings
from wrenchgap.learn.process.likelihood import Bound, LogLikelihood, maximise
from wrenchgap.learn.process.subsample import Kernel
from wrenchgap.learn.process.train import BOUNDS, fit


def samples(count):
    rng = np.random.default_rng(0)
    x = rng.normal(size=(count, 3))
    return x, np.sin(x[:, 0]) + 0.5 * x[:, 1] + 0.1 * rng.normal(size=count)


def by_gpy(x, z, kernel, inducing=None):
    """GPy's model of the same process, within the same bounds."""
    import GPy

    logging.getLogger("GP").setLevel(logging.ERROR)
    rbf = GPy.kern.RBF(x.shape[1], variance=kernel.signal_variance, lengthscale=kernel.lengthscales, ARD=True)
    if inducing is None:
        model = GPy.models.GPRegression(x, z[:, None], rbf, noise_var=kernel.noise_variance)
    else:
        model = GPy.models.SparseGPRegression(x, z[:, None], rbf, Z=inducing)
        model.likelihood.variance[:] = kernel.noise_variance
        model.inducing_inputs.fix(warning=False)
    noise = model.likelihood.variance
    for parameter, name in ((rbf.lengthscale, "lengthscale"), (rbf.variance, "signal"), (noise, "noise")):
        parameter.constrain_bounded(*BOUNDS[name], warning=False)
    return model


START = Kernel(np.array([1.5, 2.5, 4.0]), 0.8, 0.05)


@pytest.mark.parametrize("sparsely", [False, True])
@pytest.mark.parametrize("dims", [1, 6, 15])
def test_value_and_gradient_are_gpys(sparsely, dims):
    rng = np.random.default_rng(dims)
    x = rng.normal(size=(50, dims))
    z = np.sin(x[:, 0]) + 0.1 * rng.normal(size=50)
    inducing = x[::5] if sparsely else None
    asked = LogLikelihood(x, z) if inducing is None else Bound(x, z, inducing)
    for _ in range(3):  # in the same memory
        kernel = Kernel(rng.uniform(0.3, 5.0, dims), rng.uniform(0.1, 3.0), rng.uniform(0.01, 1.0))
        value, gradient = asked(kernel)
        model = by_gpy(x, z, kernel, inducing)
        assert value == pytest.approx(float(np.squeeze(model.log_likelihood())), rel=1e-6)
        own = [model.kern.variance.gradient, model.kern.lengthscale.gradient, model.likelihood.variance.gradient]
        expected = np.concatenate([np.atleast_1d(part) for part in own])
        np.testing.assert_allclose(gradient, expected, rtol=1e-5, atol=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize("sparsely", [False, True])
def test_the_gradient_is_that_of_differences(sparsely):
    x, z = samples(40)

    asked = Bound(x, z, x[::3]) if sparsely else LogLikelihood(x, z)

    def value(theta):
        return asked(Kernel(theta[1:-1], theta[0], theta[-1]))

    theta = np.array([0.8, 1.5, 2.5, 4.0, 0.05])
    steps = 1e-5 * theta * np.eye(5)
    slopes = [(value(theta + d)[0] - value(theta - d)[0]) / (2e-5 * t) for d, t in zip(steps, theta, strict=True)]
    np.testing.assert_allclose(value(theta)[1], slopes, rtol=1e-5, atol=1e-5)


def test_the_bound_is_below_the_likelihood_and_reaches_it_with_all_samples():
    x, z = samples(40)
    exact, _ = LogLikelihood(x, z)(START)
    few, more, all_of_them = (Bound(x, z, x[::step])(START)[0] for step in (4, 2, 1))
    assert few < more < exact
    assert all_of_them == pytest.approx(exact, abs=1e-4)


@pytest.mark.parametrize("sparsely", [False, True])
def test_the_search_ends_where_gpys_ends(sparsely):
    x, z = samples(80)
    inducing = x[::4] if sparsely else None
    with threadpool_limits(1):
        likelihood, found = maximise(x, z, START, BOUNDS, inducing)
        model = by_gpy(x, z, START, inducing)
        model.optimize("lbfgsb", max_iters=120 if sparsely else 500)
    assert likelihood == pytest.approx(float(np.squeeze(model.log_likelihood())), abs=1e-4)
    np.testing.assert_allclose(found.noise_variance, model.likelihood.variance[0], rtol=1e-2)
    for name, bounds in (("lengthscales", "lengthscale"), ("signal_variance", "signal")):
        low, high = BOUNDS[bounds]
        assert np.all((getattr(found, name) >= low) & (getattr(found, name) <= high))


def test_a_process_that_gpy_fits_is_the_same():
    """Hyperparameters of the whole `fit`, its starts included, by both searches."""
    x, z = samples(60)
    x6 = np.column_stack((x, 0.3 * np.random.default_rng(1).normal(size=(60, 3))))
    ours, gpys = (
        fit(x6, z[:, None], ("torque_x",), FitSettings(points=40, restarts=0, calibrate=False, search=search))
        for search in ("closed-form", "gpy")
    )
    assert gpys.settings.search == "gpy"
    query = x6[::7] + 0.1
    np.testing.assert_allclose(gpys.predict(query), ours.predict(query), atol=1e-3)
    np.testing.assert_allclose(gpys.std(query), ours.std(query), rtol=1e-2)


def test_where_samples_coincide_a_millionth_is_added_to_the_diagonal():
    x, z = samples(20)
    asked = LogLikelihood(np.concatenate((x, x)), np.concatenate((z, z)))
    value, gradient = asked(Kernel(np.full(3, 2.0), 1e12, 1e-12))
    expected, slopes = asked(Kernel(np.full(3, 2.0), 1e12, 1e6))
    assert value == pytest.approx(expected, rel=1e-6)
    np.testing.assert_allclose(gradient, slopes, rtol=1e-6)
    with pytest.raises(np.linalg.LinAlgError):
        LogLikelihood(x, z)(Kernel(np.full(3, 2.0), -1.0, 1e-9))
