"""How far the mean of a signal may be off: sigma / sqrt(n) of white noise, more where neighbours are alike."""

import numpy as np
import pytest

from tests.learn.test_disturbance_process import gusts
from wrenchgap.learn.data.gauss_markov import block_means, gauss_markov

DT = 0.025


def test_the_mean_of_white_noise_is_known_to_sigma_over_the_root_of_n():
    rng = np.random.default_rng(5)
    noise = rng.standard_normal((100 * 40, 24))
    found = gauss_markov([block_means(part, DT) for part in np.split(noise, 4)])
    np.testing.assert_allclose(np.sqrt(found.variance), 1.0 / np.sqrt(4000.0), rtol=0.5)
    assert np.exp(np.log(found.variance * 4000.0).mean()) == pytest.approx(1.0, abs=0.45)


@pytest.mark.parametrize("seconds", [10.0, 60.0])
def test_the_mean_of_gusts_is_off_by_as_much_as_is_said(seconds):
    """The variance of a mean over T of a process of variance one with memory tau is 2 tau / T (1 - (1 - e^-T/tau) tau /
    T): of 10 s of gusts of 1.5 s one in four, where 40 independent blocks would have one in forty.
    """
    rng = np.random.default_rng(6)
    flights = [gusts(rng, seconds) for _ in range(40)]
    said = np.array([gauss_markov([block_means(one, DT)]).variance for one in flights])
    off = np.array([one.mean(axis=0) for one in flights]) / np.sqrt(said)
    share = 1.5 / seconds
    true = 2.0 * share * (1.0 - (1.0 - np.exp(-1.0 / share)) * share)
    assert 0.8 < np.exp(np.log(said).mean()) / true < 2.5  # of 10 s nothing excludes gusts of ten
    assert 0.6 < np.mean(np.abs(off) < 1.0) < 0.9
    assert np.mean(np.abs(off) < 2.0) > 0.9
