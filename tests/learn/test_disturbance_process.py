"""Another flight's disturbance: closed forms of white noise and of a first-order process, and how often it holds."""

import numpy as np
import pytest

from wrenchgap.learn.diagnose.disturbance_process import BLOCK, Left, disturbance_process

DT, SILENT = 0.025, np.zeros(6)


def gusts(rng, seconds, tau=1.5, axes=6):
    """First-order Gauss-Markov processes (K, 6) of variance one."""
    keep = np.exp(-DT / tau)
    out = rng.standard_normal((round(seconds / DT), axes))
    for k in range(1, len(out)):
        out[k] = keep * out[k - 1] + np.sqrt(1.0 - keep**2) * out[k]
    return np.broadcast_to(out, (len(out), 6)).copy()


def draws(left, seconds, number, rng):
    process = disturbance_process(left)
    return [process.draw(round(seconds / 0.02), 0.02, rng) for _ in range(number)]


def test_of_independent_blocks_the_constant_is_known_as_a_mean_is():
    """sigma / sqrt(n) at the least; 25 s cannot exclude something slow of a few per cent of the variance besides."""
    rng = np.random.default_rng(1)
    blocks = 3.0 + rng.standard_normal((100, 6))
    left = [Left(np.repeat(blocks, round(BLOCK / DT), axis=0), DT, SILENT)]
    constants = np.array([c for _, c in draws(left, 1.0, 400, rng)])
    assert constants.mean(axis=0) == pytest.approx(blocks.mean(axis=0), abs=0.05)
    ratio = constants.std(axis=0) / (blocks.std(axis=0) / 10.0)
    assert ratio.min() > 0.9
    assert ratio.max() < 4.0


def test_what_is_drawn_has_the_variance_and_the_memory_of_what_was_left():
    rng = np.random.default_rng(2)
    drawn = draws([Left(gusts(rng, 400.0), DT, SILENT)], 20.0, 100, rng)
    values = np.array([d for d, _ in drawn])
    assert values.var() == pytest.approx(1.0, rel=0.15)
    later = values[:, 75:] * values[:, :-75]  # 1.5 s
    assert later.mean() == pytest.approx(np.exp(-1.0), abs=0.1)


@pytest.mark.parametrize("tau", [0.5, 1.5, 4.0])
def test_another_flights_mean_is_within_what_is_said_after_one_of_six_seconds(tau):
    """Nine in ten of the means and of the largest values of another six seconds: 25 pairs of flights, six axes."""
    rng = np.random.default_rng(3)
    inside = []
    for _ in range(25):
        drawn = np.array([d for d, _ in draws([Left(gusts(rng, 6.0, tau), DT, SILENT)], 6.0, 60, rng)])
        other = gusts(rng, 6.0, tau)
        for statistic in (np.mean, np.max):
            low, high = np.percentile(statistic(drawn, axis=1), (5.0, 95.0), axis=0)
            inside.append((low <= statistic(other, axis=0)) & (statistic(other, axis=0) <= high))
    assert 0.83 < np.mean(inside) < 0.985


def test_axes_go_together_as_they_did():
    rng = np.random.default_rng(4)
    left = gusts(rng, 60.0, axes=1) * [1.0, -1.0, 1.0, 1.0, 1.0, 0.0]
    for values, _ in draws([Left(left, DT, SILENT)], 20.0, 5, rng):
        correlation = np.corrcoef(values[:, :5].T)
        assert correlation[0, 1] < -0.8
        assert correlation[0, 2] > 0.8
        assert np.abs(values[:, 5]).max() < 1e-9


def test_noise_of_the_sensors_pushes_nothing():
    rng = np.random.default_rng(5)
    left = rng.standard_normal((4000, 6))
    values = np.array([d for d, _ in draws([Left(left, DT, np.ones(6))], 10.0, 50, rng)])
    assert values.std() < 0.25


def test_stretches_of_any_length_are_one_vehicles():
    """Their constant is one: of two stretches it is known better than of either."""
    rng = np.random.default_rng(6)
    parts = [Left(gusts(rng, s), d, SILENT) for s, d in ((30.0, DT), (9.0, DT), (130.0, DT))]
    one, all_ = (np.std([c for _, c in draws(some, 1.0, 300, rng)]) for some in (parts[:1], parts))
    assert all_ < 0.6 * one
