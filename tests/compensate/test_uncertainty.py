import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wrenchgap.compensate.uncertainty import UncertaintyFilter, default_filter
from wrenchgap.plant.mismatch import LinearMismatch

ONE = UncertaintyFilter(np.array([True]), np.zeros(1), np.ones(1), threshold=0.38, kappa=40.0, decay=0.9)


def levels(training, prior, outputs=("torque_x", "torque_y", "torque_z"), **options):
    unused = dict.fromkeys(("mean", "std", "jacobian", "mismatch_max"))
    model = SimpleNamespace(outputs=outputs, sigma_training=np.array(training), sigma_prior=np.array(prior), **unused)
    options = {"threshold": None, "kappa": None, "normalise": None} | options
    return default_filter(model, 0.9, **options)


@given(st.floats(-1e300, 1e300), st.floats(0, 1e300))
def test_beta_rises_from_zero_to_one_without_overflow(sigma, more):
    assert 0.0 <= ONE.beta(sigma) <= ONE.beta(sigma + more) <= 1.0


@settings(deadline=None)
@given(beta=st.floats(0, 1), decay=st.floats(0.01, 0.99), optimum=st.floats(-3, 3))
def test_steady_state_gain(beta, decay, optimum):
    """dW = a beta dW + (1 - beta) dW* solved for dW."""
    one = UncertaintyFilter(np.array([True]), np.zeros(1), np.ones(1), 0.4, 40.0, decay)
    correction = np.zeros(6)
    for _ in range(3000):
        correction = one.filtered(np.full(6, optimum), correction, beta)
    assert correction == pytest.approx(np.full(6, optimum * (1 - beta) / (1 - decay * beta)), abs=1e-9)


def test_default_goes_from_1_to_99_percent_between_data_and_prior():
    found = levels([0.05, 0.1, 0.27], [0.2, 0.3, 0.5])
    assert found.sigma(np.array([0.2, 0.7, 0.3])) == 0.7, "the largest"
    assert found.threshold == pytest.approx((0.27 + 0.5) / 2)
    assert found.kappa == pytest.approx(9.2 / (0.5 - 0.27), rel=2e-3)
    assert found.beta(0.27) == pytest.approx(0.01)
    assert found.beta(0.5) == pytest.approx(0.99)


def test_forces_and_torques_are_not_compared_in_newtons():
    """A torque out of its data is noticed beside a force that always has a larger number."""
    found = levels([2.0, 0.1], [4.0, 0.5], ("force_x", "torque_x"))
    assert found.sigma(np.array([2.0, 0.1])) == pytest.approx(0.0)
    assert found.beta(found.sigma(np.array([2.0, 0.5]))) == pytest.approx(0.99)
    assert found.beta(found.sigma(np.array([4.0, 0.1]))) == pytest.approx(0.99)
    raw = levels([2.0, 0.1], [4.0, 0.5], ("force_x", "torque_x"), normalise=False)
    assert raw.beta(raw.sigma(np.array([2.0, 0.5]))) == pytest.approx(0.01)


def test_output_that_is_all_noise_does_not_vote():
    found = levels([0.1, 0.9], [0.5, 0.9], ("torque_x", "torque_z"))
    assert found.sigma(np.array([0.1, 0.9])) == 0.1
    assert levels([0.3], [0.3], ("torque_x",)).beta(1e9) == 0.0, "a model that is all noise is not filtered"
    assert found.threshold == pytest.approx(0.3)


def test_model_without_levels_is_filtered_only_when_told():
    line = LinearMismatch(("torque_x",), np.zeros(1), np.zeros((1, 6)), np.full(1, 0.2))
    assert default_filter(line, 0.9, None, None, None).beta(5.0) == 0.0
    told = default_filter(line, 0.9, 0.38, 40.0, None)
    assert told.beta(5.0) == pytest.approx(1.0)
    assert told.beta(0.2) == pytest.approx(1 / (1 + math.exp(40 * 0.18)))


def test_given_values_win():
    found = levels([0.1], [0.5], ("torque_x",), threshold=0.2, kappa=7.0)
    assert (found.threshold, found.kappa, found.beta(0.2)) == (0.2, 7.0, 0.5)
