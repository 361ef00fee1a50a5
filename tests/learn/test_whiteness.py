"""Bands hold for coloured series; delays are found; filtered noise is told from structure."""

import numpy as np
import pytest
from scipy.signal import lfilter

from wrenchgap.learn.data.measurement import derivative, low_pass
from wrenchgap.learn.diagnose.quantities import InputGroup
from wrenchgap.learn.diagnose.whiteness import autocorrelation, crosscorrelation, noise_autocorrelation, whiteness

DT, STEP, CUTOFF = 0.005, 5, 8.0
KEPT = DT * STEP


def coloured(rng, seconds, memory=0.0, differentiated=False):
    """White noise behind the filter; with `memory` [s] it was an autoregression of first order before."""
    white = rng.standard_normal(round(seconds / DT) + 800)
    if memory:
        white = lfilter([1.0], [1.0, -np.exp(-DT / memory)], white)
    smooth = low_pass(white, DT, CUTOFF)
    return (derivative(smooth, DT) if differentiated else smooth)[400:-400:STEP]


def sines(rng, seconds):
    """What a trajectory looks like: two slow sines."""
    t = np.arange(0, seconds, KEPT)
    return sum(a * np.sin(2 * np.pi * (rng.uniform(0.1, 0.6) * t + rng.uniform())) for a in (1.0, 0.5))


@pytest.mark.parametrize("memory", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("trajectory", [True, False])
def test_independent_series_stay_inside_the_band(memory, trajectory):
    """1 % of them may leave it anywhere in +-1 s: of 100, 5 or more are one case in 290 (binomial)."""
    rng = np.random.default_rng(7)
    found = []
    for _ in range(100):
        x = sines(rng, 40) if trajectory else coloured(rng, 40, 0.3)
        found.append(crosscorrelation([x], [coloured(rng, 40, memory)[: len(x)]], KEPT, 40))
    judged = [one for one in found if one is not None]
    assert len(judged) >= 96  # else, by chance, most of both is slower than the log is long
    assert all(one.outside == (one.p < 0.01) for one in judged)
    assert sum(one.outside for one in judged) <= 4
    assert sum(one.p < 0.05 for one in judged) <= 11


def test_a_naive_band_would_cry_wolf():
    """Same series, band of independent samples without a search over lags: it would not hold."""
    rng = np.random.default_rng(8)
    pairs = [([coloured(rng, 40, 0.3)], [coloured(rng, 40, 0.3)]) for _ in range(20)]
    peaks = np.array([crosscorrelation(*pair, KEPT, 40).peak for pair in pairs])
    assert np.mean(np.abs(peaks) > 2.58 / np.sqrt(40 / KEPT)) > 0.9


@pytest.mark.parametrize("differentiated", [False, True])
def test_autocorrelation_of_filtered_noise_is_as_expected(differentiated):
    """Against half an hour of filtered noise."""
    long = coloured(np.random.default_rng(1), 1800, differentiated=differentiated)
    expected = noise_autocorrelation(DT, CUTOFF, KEPT, differentiated)
    measured = [float(long[: len(long) - k] @ long[k:]) / float(long @ long) for k in range(40)]
    assert expected[:40] == pytest.approx(np.array(measured), abs=0.02)


@pytest.mark.parametrize("differentiated", [False, True])
def test_filtered_noise_is_white_and_structure_is_not(differentiated):
    rng = np.random.default_rng(2)
    expected = noise_autocorrelation(DT, CUTOFF, KEPT, differentiated)
    noises = [coloured(rng, 40, differentiated=differentiated) for _ in range(100)]
    assert sum(not autocorrelation([noise], expected, KEPT).white for noise in noises) <= 4
    slow = coloured(rng, 40, memory=0.5)
    found = autocorrelation([noises[0] + noises[0].std() / slow.std() * slow], expected, KEPT)
    assert not found.white
    assert found.p < 1e-6


@pytest.mark.parametrize("delay", [0, 4, -8])
def test_the_lag_of_an_echo_is_found(delay):
    """Positive where the residual follows the input."""
    rng = np.random.default_rng(3)
    x = coloured(rng, 60, 0.3)
    z = -np.roll(x, delay) / x.std() + coloured(rng, 60) * 3
    found = crosscorrelation([x], [z], KEPT, 40, pairs=100)
    assert found.outside
    assert found.peak < 0
    assert found.lag == pytest.approx(delay * KEPT)


def test_pieces_are_not_joined():
    """An echo across the gap between two pieces is none."""
    rng = np.random.default_rng(4)
    x, z = ([coloured(rng, 30), coloured(rng, 30)] for _ in range(2))
    joined = crosscorrelation([np.concatenate(x)], [np.concatenate(z)], KEPT, 40).value
    size = np.sqrt(np.prod([sum(np.sum((p - p.mean()) ** 2) for p in pieces) for pieces in (x, z)]))
    by_hand = sum(float((a - a.mean())[:-10] @ (b - b.mean())[10:]) for a, b in zip(x, z, strict=True)) / size
    assert crosscorrelation(x, z, KEPT, 40).value[50] == pytest.approx(by_hand)
    assert joined[50] != pytest.approx(by_hand)


def test_too_slow_an_input_says_nothing():
    """One half period of a sine in a flight: no band can be had from that."""
    ramp = np.sin(np.pi * np.linspace(0, 1, 400))
    assert crosscorrelation([ramp], [ramp], KEPT, 40) is None
    assert crosscorrelation([np.ones(400)], [ramp], KEPT, 40) is None


def test_the_surest_input_is_named(tumbling):
    """Torque z as an echo of the first of three inputs, 0.1 s late."""
    rng = np.random.default_rng(5)
    inputs = np.column_stack([coloured(rng, 50, 0.2)[: len(tumbling.measured)] for _ in range(3)])
    residual = np.column_stack([coloured(rng, 50, 0, k >= 3)[: len(tumbling.measured)] for k in range(6)])
    residual /= residual.std(axis=0)
    residual[4:, 5] += 0.7 * inputs[:-4, 0] / inputs[:, 0].std()
    found = whiteness(tumbling, residual, groups=[InputGroup("made", "made", ("a", "b", "c"), inputs)])
    assert [a.axis for a in found.autocorrelation if not a.white] == ["torque_z"]
    best = found.crosscorrelation[0]
    assert (best.axis, best.input, best.lag) == ("torque_z", "a", pytest.approx(0.1))
    assert [c.axis for c in found.crosscorrelation if c.outside] == ["torque_z"]
    assert len(found.crosscorrelation) == 18
