"""Which of two models is better: noise decides nothing, units count for nothing, and no model is exactly right."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats
from scipy.signal import butter, lfilter

from wrenchgap.learn.data.blocks import SIGNIFICANCE, Contrast, contrast, cosine, evidence
from wrenchgap.learn.data.errors import energy

BLOCKS, SAMPLES = 30, 80
NOISE = np.array([0.03, 0.03, 0.04, 0.003, 0.003, 0.005])


def blocks(count=BLOCKS, noise=NOISE):
    """What a comparison asks of a data set: blocks of 80 samples (2 s at 40 Hz)."""
    block, weights = np.repeat(np.arange(count), SAMPLES), np.repeat([1.0, 5.0], 3)
    return SimpleNamespace(block=block, noise=noise, weights=weights, measured_axes=np.ones(6, dtype=bool))


DATA = blocks()


def white(seed, size=1.0):
    return size * NOISE * np.random.default_rng(seed).normal(size=(BLOCKS * SAMPLES, 6))


def slow(seed, hz=1.0):
    """Noise below 1 Hz: some 40 samples in a row say the same."""
    b, a = butter(2, hz, fs=40.0)
    gain = np.linalg.norm(lfilter(b, a, np.eye(1, 2000)[0]))
    return lfilter(b, a, white(seed), axis=0) / gain


def within(values, freedom):
    """Share of values inside the 95 % range of Student's t."""
    return np.mean(np.abs(values) < stats.t.ppf(0.975, freedom))


def test_t_between_two_residuals_of_noise_is_students():
    t = np.array([contrast(DATA, white(2 * k), white(2 * k + 1)).t for k in range(300)])
    assert 0.92 < within(t, BLOCKS - 1) < 0.98
    assert stats.kstest(t, "t", args=(BLOCKS - 1,)).pvalue > 0.01


def test_t_stays_nominal_where_samples_are_not_independent():
    """Counting samples instead of blocks would call every second pair of equal models different."""
    by_block, by_sample = [], []
    for k in range(150):
        a, b = slow(2 * k), slow(2 * k + 1)
        by_block.append(contrast(DATA, a, b).t)
        by_sample.append(stats.ttest_1samp(np.sum((a**2 - b**2) / NOISE**2, axis=1), 0.0).statistic)
    assert 0.90 < within(by_block, BLOCKS - 1) < 0.99
    assert within(by_sample, BLOCKS * SAMPLES) < 0.7


def test_loss_is_counted_in_the_mean_squares_of_the_axes():
    """Twice the rms on one axis, all else equal: (4 - 1) / sqrt(4 * 1) of a loss that is one per axis."""
    a = white(0)
    worse = a * [1, 1, 1, 1, 2, 1]
    assert contrast(DATA, worse, a).difference == pytest.approx(1.5, rel=1e-6)
    assert contrast(DATA, a, worse).difference == pytest.approx(-1.5, rel=1e-6)


def test_excess_is_what_the_better_leaves_above_the_noise():
    """Four times the noise's power on two axes, the noise on four: 3/4 of the loss of each of the two."""
    a = white(0)
    a *= NOISE / np.sqrt(np.mean(a**2, axis=0))
    a[:, :2] *= 2.0
    assert contrast(DATA, a, a).excess == pytest.approx(1.5, rel=1e-6)


@pytest.mark.parametrize("seed", range(10))
def test_separation_has_the_sign_of_t_and_is_never_larger(seed):
    rng = np.random.default_rng(seed)
    a, b = (slow(20 + seed, hz) * rng.uniform(0.5, 5, 6) for hz in (0.5, 3.0))
    for one in (contrast(DATA, a, b), contrast(DATA, b, a)):
        assert abs(one.separation) <= abs(one.t)
        assert one.separation * one.t > 0


def test_a_difference_half_as_large_as_what_the_better_leaves_separates_nothing():
    """Sixty seconds make any difference certain; what made the rest may as well have made the difference."""
    left = white(1, 10.0)
    for more, told in ((0.5, False), (1.0, True)):
        one = contrast(DATA, left * np.sqrt(1 + more), left)
        assert one.difference == pytest.approx(more * one.excess, rel=0.05)
        assert one.t > 20
        assert (one.separation > SIGNIFICANCE.indistinct) == told


def test_where_the_better_leaves_only_noise_any_certain_difference_separates():
    noise = white(1, 0.99)  # just below, so that chance makes no excess
    one = contrast(DATA, noise + 0.3 * white(2), noise)
    assert one.excess < 0.05
    assert one.separation == pytest.approx(one.t, rel=0.05)
    assert one.separation > SIGNIFICANCE.indistinct


def test_the_unit_of_an_axis_counts_for_nothing():
    a, b = slow(1) * 3, slow(2) * 2
    unit = np.array([1, 1, 1, 1e3, 1, 1])
    first, second = contrast(DATA, a, b), contrast(blocks(noise=NOISE * unit), a * unit, b * unit)
    for key in ("difference", "spread", "excess", "t", "separation"):
        assert getattr(second, key) == pytest.approx(getattr(first, key), rel=1e-9)
    assert evidence(a * unit, b * unit) == pytest.approx(evidence(a, b), rel=1e-9)


def test_two_blocks_decide_nothing():
    one = contrast(blocks(2), white(0, 5.0)[: 2 * SAMPLES], white(1)[: 2 * SAMPLES])
    assert one == Contrast(0.0, 1.0, 0.0)
    assert one.separation == 0


def test_evidence_adds_up_along_a_chain_and_counts_axes_alike():
    a, b, c = slow(1) * 3, slow(2), white(3)
    assert evidence(a, c) == pytest.approx(evidence(a, b) + evidence(b, c), rel=1e-12)
    assert evidence(2 * a, a) == pytest.approx(np.log(64))
    assert evidence(a, a * [1, 1, 1, 1, 1, 0.5]) == pytest.approx(np.log(2))


def test_cosine_is_that_of_the_changes_whatever_their_size():
    start, change = white(0, 10.0), slow(1)
    assert cosine(DATA, start, start - change, start - 0.01 * change) == pytest.approx(1.0)
    assert cosine(DATA, start, start - change, start + 3 * change) == pytest.approx(-1.0)
    assert abs(cosine(DATA, start, start - white(2), start - white(3))) < 0.05
    forces, torques = change * [1, 1, 1, 0, 0, 0], change * [0, 0, 0, 1, 1, 1]
    assert cosine(DATA, start, start - forces, start - torques) == 0
    assert cosine(DATA, start, start, start - change) == 0  # no change looks like nothing


def test_energy_puts_newton_metres_beside_newtons_by_a_length():
    """1 N, and 0.2 Nm at the length of 0.2 m, weigh the same."""
    force, torque = np.zeros((2, 100, 6))
    force[:, 0], torque[:, 4] = 1.0, 0.2
    assert energy(force, DATA.weights) == pytest.approx(100)
    assert energy(torque, DATA.weights) == pytest.approx(100)
