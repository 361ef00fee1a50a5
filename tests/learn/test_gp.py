"""The closed form against hand-made cases, finite differences, limits, and GPy."""

from dataclasses import FrozenInstanceError, replace

import numpy as np
import pytest

from wrenchgap.flight.errors import FitError, ModelError
from wrenchgap.learn.process.gp import GaussianProcess, Provenance


def commands(gp: GaussianProcess, count: int) -> np.ndarray:
    return gp.input_mean + 1.2 * gp.input_scale * np.random.default_rng(1).normal(size=(count, 6))


@pytest.mark.parametrize("linear", [False, True])
def test_agrees_with_gpy(linear, hand_made):
    import GPy

    gp = hand_made(linear=linear)
    xi = commands(gp, 25)
    x = (xi - gp.input_mean) / gp.input_scale
    for index in range(3):
        kernel = GPy.kern.RBF(6, variance=gp.signal_variance[index], lengthscale=gp.lengthscales[index], ARD=True)
        other = GPy.models.GPRegression(
            np.array(gp.inputs), np.array(gp.residuals[:, [index]]), kernel, noise_var=gp.noise_variance[index]
        )
        mean, variance = other.predict(x)
        slope = other.predictive_gradients(x)[0][:, :, 0]
        b, scale = gp.mean_coefficients[index], gp.output_scale[index]
        assert gp.mean(xi)[:, index] == pytest.approx((mean[:, 0] + b[0] + x @ b[1:]) * scale, abs=1e-8)
        assert gp.std(xi)[:, index] == pytest.approx(np.sqrt(variance[:, 0]) * scale, abs=1e-8)
        expected = (slope + b[1:]) * scale / gp.input_scale
        assert gp.jacobian(xi)[:, index] == pytest.approx(expected, abs=1e-8)


def test_one_training_point_by_hand(hand_made):
    """Posterior of one point a distance r away: mean k z / (s + n), variance s + n - k^2 / (s + n)."""
    gp = replace(hand_made(1, linear=False), inputs=np.zeros((1, 6)), residuals=np.array([[2.0, -1.0, 0.5]]))
    step = np.array([[0.5, 0, 0, 0, 0.7, 0]])
    xi = gp.input_mean + step * gp.input_scale
    s, n = gp.signal_variance, gp.noise_variance
    k = s * np.exp(-0.5 * ((step / gp.lengthscales) ** 2).sum(axis=1))
    assert gp.mean(xi)[0] == pytest.approx(k / (s + n) * [2.0, -1.0, 0.5] * gp.output_scale)
    assert gp.std(xi)[0] == pytest.approx(np.sqrt(s + n - k**2 / (s + n)) * gp.output_scale)


def test_jacobian_is_the_derivative_of_the_mean(hand_made):
    gp = hand_made()
    xi = commands(gp, 6)
    for axis, step in enumerate(1e-5 * np.diag(gp.input_scale)):
        slope = (gp.mean(xi + step) - gp.mean(xi - step)) / (2 * step[axis])
        assert gp.jacobian(xi)[:, :, axis] == pytest.approx(slope, rel=1e-6, abs=1e-8)


def test_hardly_any_noise_interpolates(hand_made):
    gp = replace(hand_made(), noise_variance=np.full(3, 1e-7))
    xi = gp.input_mean + gp.inputs * gp.input_scale
    mean_function = gp.mean_coefficients[:, 0] + gp.inputs @ gp.mean_coefficients[:, 1:].T
    assert gp.mean(xi) == pytest.approx((mean_function + gp.residuals) * gp.output_scale, abs=1e-4)
    assert (gp.std(xi) < 0.01 * gp.sigma_prior).all()


def test_far_away_nothing_is_known(hand_made):
    gp = hand_made(linear=False)
    far = commands(gp, 3) + 1e3 * gp.input_scale
    assert gp.mean(far) == pytest.approx(np.zeros((3, 3)))
    assert gp.std(far) == pytest.approx(np.tile(gp.sigma_prior, (3, 1)))
    assert gp.jacobian(far) == pytest.approx(np.zeros((3, 3, 6)))


def test_noise_adds_its_variance(hand_made):
    gp = hand_made()
    xi = commands(gp, 9)
    added = gp.std(xi) ** 2 - gp.std(xi, noise=False) ** 2
    assert added == pytest.approx(np.tile(gp.noise_variance * gp.output_scale**2, (9, 1)))


def test_more_data_is_never_less_certain(hand_made):
    gp = hand_made(30)
    fewer = replace(gp, inputs=gp.inputs[:20], residuals=gp.residuals[:20])
    xi = commands(gp, 200)
    assert (gp.std(xi) <= fewer.std(xi) + 1e-12).all()
    assert (gp.std(xi) < fewer.std(xi) - 1e-3).any()


def test_many_queries_are_single_queries(hand_made):
    gp = hand_made()
    block = 512  # queries that are evaluated at once
    xi = commands(gp, 2 * block + 3)
    picked = [0, block - 1, block, 2 * block + 2]
    for function in (gp.mean, gp.std, gp.jacobian):
        singles = np.concatenate([function(xi[[index]]) for index in picked])
        assert function(xi)[picked] == pytest.approx(singles, abs=1e-12)
    mean, jacobian = gp.mean_and_jacobian(xi[:5])
    assert mean == pytest.approx(gp.mean(xi[:5]), abs=1e-12)
    assert jacobian == pytest.approx(gp.jacobian(xi[:5]), abs=1e-12)


def test_cannot_be_changed_not_even_by_its_callers_array(hand_made):
    mine = np.ones(3)
    gp = replace(hand_made(), mismatch_max=mine)
    mine[0] = 5.0
    assert gp.mismatch_max[0] == 1.0
    with pytest.raises(ValueError, match="read-only"):
        gp.inputs[0, 0] = 1.0
    with pytest.raises(FrozenInstanceError):
        gp.outputs = ("torque_z",)


def test_belongs_to_one_vehicle(hand_made):
    gp = replace(hand_made(), provenance=Provenance(vehicle="voliro_x"))
    gp.check_vehicle("voliro_x")
    with pytest.raises(FitError, match="another vehicle: learnt on 'voliro_x', the model is 'crazyflie'"):
        gp.check_vehicle("crazyflie")


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"residuals": np.zeros((40, 2))}, FitError, r"residuals has shape \(40, 2\), expected \(40, 3\)"),
        ({"lengthscales": np.full((3, 6), -1.0)}, FitError, "lengthscales must be positive"),
        ({"noise_variance": np.array([0.1, np.nan, 0.1])}, FitError, "noise_variance holds values that are not finite"),
        ({"outputs": ("torque_x", "torque_y", "torque_q")}, ModelError, "unknown output 'torque_q'"),
    ],
)
def test_bad_parts_are_refused(change, error, message, hand_made):
    with pytest.raises(error, match=message):
        replace(hand_made(), **change)
