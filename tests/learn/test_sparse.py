"""The sparse posterior: exact where its inducing inputs are all inputs, GPy's elsewhere, and better for more data."""

from dataclasses import replace

import GPy
import numpy as np
import pytest

from wrenchgap.learn.process import likelihood, train
from wrenchgap.learn.process.gp import FitSettings
from wrenchgap.learn.process.likelihood import maximise
from wrenchgap.learn.process.subsample import Kernel, posterior
from wrenchgap.learn.process.train import BOUNDS, _Posterior, fit

TORQUES = ("torque_x", "torque_y")
KERNEL = Kernel(np.array([0.8, 1.5, 3.0]), 1.7, 0.05)


def data(count):
    rng = np.random.default_rng(0)
    x = rng.normal(size=(count, 3))
    return x, np.sin(2.0 * x[:, 0]) + 0.3 * x[:, 1] + np.sqrt(KERNEL.noise_variance) * rng.normal(size=count)


def predicted(weights, whitener, inducing, query):
    """Mean and variance of the function (without noise), as the docstring of `posterior` says."""
    k = KERNEL(inducing, query)
    return weights @ k, KERNEL.signal_variance - ((whitener @ k) ** 2).sum(axis=0)


QUERY = np.random.default_rng(9).normal(size=(60, 3)) * 1.5


def test_kernel_by_hand():
    a, b = np.array([[0.0, 0.0, 0.0]]), np.array([[0.8, 0.0, 3.0]])
    assert KERNEL(a, b)[0, 0] == pytest.approx(1.7 * np.exp(-1.0))
    assert KERNEL(a, a)[0, 0] == pytest.approx(1.7)


def test_with_all_inputs_inducing_it_is_the_exact_posterior():
    """Rasmussen and Williams (2006), 2.25 and 2.26, up to the jitter."""
    x, z = data(40)
    mean, variance = predicted(*posterior(KERNEL, x, z, x), x, QUERY)
    K, k = KERNEL(x, x) + KERNEL.noise_variance * np.eye(40), KERNEL(x, QUERY)
    assert mean == pytest.approx(k.T @ np.linalg.solve(K, z), abs=1e-3)
    exact = KERNEL.signal_variance - np.einsum("nm,nm->m", k, np.linalg.solve(K, k))
    assert variance == pytest.approx(exact, abs=1e-3)


def test_one_inducing_input_by_hand():
    """All N samples at one place z_0: k N zbar / (N s + n), variance s - k^2 / s + k^2 / (s + N s^2 / n)."""
    x, z = np.zeros((10, 3)), np.linspace(0.0, 1.8, 10)
    mean, variance = predicted(*posterior(KERNEL, x, z, x[:1]), x[:1], QUERY)
    s, n, k = KERNEL.signal_variance, KERNEL.noise_variance, KERNEL(x[:1], QUERY)[0]
    assert mean == pytest.approx(k * 9.0 / (10 * s + n), rel=1e-4)
    assert variance == pytest.approx(s - k**2 / s + k**2 / (s + 10 * s**2 / n), rel=1e-3)


def test_agrees_with_gpy():
    x, z = data(300)
    inducing = x[::15]
    rbf = GPy.kern.RBF(3, variance=KERNEL.signal_variance, lengthscale=KERNEL.lengthscales, ARD=True)
    other = GPy.models.SparseGPRegression(x, z[:, None], rbf, Z=inducing.copy())
    other.likelihood.variance[:] = KERNEL.noise_variance
    mean, variance = other.predict(QUERY)
    ours, spread = predicted(*posterior(KERNEL, x, z, inducing), inducing, QUERY)
    assert ours == pytest.approx(mean[:, 0], abs=1e-4)
    assert spread + KERNEL.noise_variance == pytest.approx(variance[:, 0], abs=1e-4)


def test_far_away_nothing_is_known():
    x, z = data(300)
    mean, variance = predicted(*posterior(KERNEL, x, z, x[:20]), x[:20], QUERY + 100.0)
    assert mean == pytest.approx(np.zeros(60), abs=1e-9)
    assert variance == pytest.approx(np.full(60, 1.7))


def test_more_data_through_the_same_inducing_inputs_is_more_certain():
    x, z = data(1200)
    inducing = x[:25]
    spreads = [predicted(*posterior(KERNEL, x[:n], z[:n], inducing), inducing, QUERY)[1] for n in (50, 200, 1200)]
    assert (spreads[1] <= spreads[0] + 1e-9).all()
    assert (spreads[2] <= spreads[1] + 1e-9).all()
    assert spreads[2].mean() < 0.95 * spreads[0].mean()


def test_hyperparameters_maximise_the_bound():
    """From a start that is wrong in every respect, the noise and the lengthscale that made the data are found."""
    x, z = data(400)
    start = Kernel(np.full(3, 3.0), 0.3, 0.5)
    _, found = maximise(x, z, start, BOUNDS, x[::10])
    assert found.noise_variance == pytest.approx(KERNEL.noise_variance, rel=0.3)
    assert found.lengthscales[0] < 0.3 * found.lengthscales[2]


def truth(x):
    return np.column_stack([0.3 * np.sin(x[:, 0] / 5.0), 0.02 * (x[:, 2] - 39.0)])


def flown(count, seed):
    rng = np.random.default_rng(seed)
    wrench = rng.normal(size=(count, 6)) * [8, 8, 3, 0.3, 0.3, 0.2] + [0, 0, 39, 0, 0, 0]
    return wrench, truth(wrench) + 0.1 * rng.normal(size=(count, 2))


@pytest.fixture(scope="module")
def fitted():
    settings = FitSettings(points=40, restarts=0, calibrate=False)
    return {kind: fit(*flown(1500, 0), TORQUES, replace(settings, inference=kind)) for kind in ("exact", "sparse")}


def test_all_samples_predict_better_than_some_of_them_with_an_honest_sigma(fitted):
    """At the same number of points, so at the same cost of a prediction."""
    wrench, measured = flown(1500, 6)
    exact, sparse = (np.sqrt(np.mean((gp.mean(wrench) - truth(wrench)) ** 2, axis=0)) for gp in fitted.values())
    assert fitted["sparse"].inputs.shape == fitted["exact"].inputs.shape == (40, 6)
    assert (sparse < 0.7 * exact).all()
    score = (measured - fitted["sparse"].mean(wrench)) / fitted["sparse"].std(wrench)
    assert np.sqrt((score**2).mean(axis=0)) == pytest.approx(np.ones(2), abs=0.15)


def test_derivative_of_a_sparse_mean(fitted):
    gp, wrench = fitted["sparse"], flown(5, 7)[0]
    mean, jacobian = gp.mean_and_jacobian(wrench)
    assert mean == pytest.approx(gp.mean(wrench), abs=1e-10)
    for axis, step in enumerate(1e-4 * np.diag(gp.input_scale)):
        slope = (gp.mean(wrench + step) - gp.mean(wrench - step)) / (2.0 * step[axis])
        assert jacobian[:, :, axis] == pytest.approx(slope, rel=1e-4, abs=1e-7)


def test_a_process_that_saw_no_noise_on_few_samples_sees_it_on_all():
    """From a start at the least noise the search does not leave it, where gradients vanish: it has another start."""
    rng = np.random.default_rng(1)
    x = rng.normal(size=(400, 3))
    z = np.sin(2.0 * x[:, 0]) + 0.3 * rng.normal(size=400)
    made = _Posterior(x, z[:, None], np.arange(12), np.arange(400), FitSettings(points=12, inference="sparse"))
    quiet = replace(KERNEL, noise_variance=(1.0 + 1e-10) * BOUNDS["noise"][0])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(likelihood, "_iterations", lambda _: 1)  # stands for a search that does not move from there
        patch.setattr(train, "_maximum_likelihood", lambda *_: quiet)
        made.fit(0)
    assert made.kernels[0].noise_variance > 0.01
