"""What held-out time supports: gains of known mixtures of function and noise, and the chance of a false one."""

import numpy as np
import pytest

from wrenchgap.learn.process.held_out_time import SUPPORT, HeldOut, support

BLOCK = np.arange(1600) * 16 // 1600


def held(actual, predicted):
    return HeldOut(actual, predicted, np.ones_like(actual), BLOCK)


def test_function_that_is_there_is_believed_and_half_of_it_by_half():
    m = np.sin(np.arange(1600) / 7.0)[:, None] * [1.0, 1.0, 1.0]
    noise = 0.05 * np.random.default_rng(0).normal(size=m.shape)
    found = support(held(m * [1.0, 0.5, 2.0] + noise, m))
    assert found.gain == pytest.approx([1.0, 0.5, 1.0], abs=0.01)  # never more than the process says
    assert found.share[:2] == pytest.approx([1.0 - 2 * 0.05**2, 1.0 - 8 * 0.05**2], abs=2e-3)


def test_noise_gets_nothing():
    """z and m independent: the gain is zero but for chance, and what is left then is harmless."""
    rng = np.random.default_rng(1)
    gains = support(held(rng.normal(size=(1600, 400)), rng.normal(size=(1600, 400)))).gain
    assert np.mean(gains > 0) < 0.01


def test_prediction_of_the_wrong_sign_gets_nothing():
    m = np.sin(np.arange(1600) / 7.0)[:, None]
    assert support(held(-m, m)).gain[0] == 0.0


def test_function_of_some_blocks_alone_is_less_certain_than_one_of_all():
    """Equal energy of the agreement: the same in every block, or all of it in two of sixteen."""
    m = np.ones((1600, 2))
    z = np.stack([np.full(1600, 0.5), np.where(BLOCK < 8, 1.0, 0.0)], axis=1)
    everywhere, somewhere = support(held(z, m)).gain
    assert everywhere == pytest.approx(0.5)
    # s^2 = 16/15 (0.5^2 16) 100^2 / 1600^2: certain to 1 - 4 / 15
    assert somewhere == pytest.approx(0.5 * (1.0 - 4.0 / 15.0))


def test_what_explains_less_than_the_least_share_is_not_worth_it():
    rng = np.random.default_rng(2)
    m = np.sin(np.arange(1600) / 7.0)[:, None] * [1.0, 1.0]
    rms = np.sqrt(0.5)  # of m
    ratio = np.sqrt((1.0 - SUPPORT.least_share) / SUPPORT.least_share) * rms  # noise with which the share is the least
    found = support(held(m + rng.normal(size=m.shape) * ratio * [2.0, 0.5], m))
    assert found.gain[0] == 0.0 < 0.8 < found.gain[1]


def test_interval_of_the_reduction_holds_the_true_one():
    rng, truth, inside = np.random.default_rng(3), 1.0 - 0.3 / np.sqrt(0.5 + 0.3**2), []
    m = np.sin(np.arange(1600) / 7.0)[:, None]
    for _ in range(200):
        _, low, high = support(held(m + 0.3 * rng.normal(size=m.shape), m)).reduction[0]
        inside.append(low < truth < high)
    assert 0.88 < np.mean(inside) < 1.0
