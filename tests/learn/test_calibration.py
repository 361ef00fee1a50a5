"""Calibration: factors and coverage of known distributions, blocks of time left out, and what it is good for."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from wrenchgap.learn.process.gp import FitSettings
from wrenchgap.learn.process.held_out_time import CALIBRATION, Coverage, left_out, sigma_scale
from wrenchgap.learn.process.train import fit

TORQUES = ("torque_x", "torque_y")


def test_errors_twice_as_large_as_sigma_ask_for_twice_the_sigma():
    error = np.random.default_rng(0).normal(size=(40_000, 3)) * [1.0, 2.0, 0.6]
    assert sigma_scale(error, np.ones((40_000, 3))) == pytest.approx([1.0, 2.0, 1.0], rel=0.02)  # never narrower
    assert sigma_scale(0.01 * error, np.full((40_000, 3), 0.01)) == pytest.approx([1.0, 2.0, 1.0], rel=0.02)


def test_after_scaling_95_percent_are_inside_whatever_the_distribution():
    """Laplace: fewer lie within one sigma and more far out than of normal numbers."""
    error, std = np.random.default_rng(1).laplace(size=(20_000, 1)), np.full((20_000, 1), 0.3)
    scaled = Coverage.of(error, std * sigma_scale(error, std))
    assert scaled.within_95[0] == pytest.approx(0.95, abs=1e-3)


@pytest.mark.parametrize(("error", "scale"), [(1e9, CALIBRATION.scale[1]), (0.0, CALIBRATION.scale[0])])
def test_factors_stay_within_reason(error, scale):
    assert sigma_scale(np.array([[error], [-error]]), np.ones((2, 1)))[0] == scale


def test_coverage_of_normal_numbers():
    error = np.random.default_rng(2).normal(size=(100_000, 2)) * [1.0, 3.0]
    found = Coverage.of(error, np.ones((100_000, 2)))
    assert found.within_95 == pytest.approx([0.95, 0.4864], abs=4e-3)  # erf(1.96 / sqrt 2), erf(1.96 / 3 / sqrt 2)
    assert found.within_3_sigma == pytest.approx([0.9973, 0.6827], abs=4e-3)


@pytest.mark.parametrize("count", [200, 777, 1600])
def test_folds_leave_blocks_of_time_out(count):
    """Whoever is asked for a sample has seen neither it nor its neighbours, but most of the flight."""
    asked = np.arange(0, count, 3)
    seen = []

    def predict(usable, wanted):
        seen.append((usable, wanted))
        return np.column_stack([wanted, -wanted]), np.full((len(wanted), 2), 0.5)

    mean, std = left_out(count, asked, predict)
    assert np.array_equal(mean, np.column_stack([asked, -asked]))
    assert (std == 0.5).all()
    assert len(seen) == CALIBRATION.folds
    assert sorted(np.concatenate([wanted for _, wanted in seen]).tolist()) == asked.tolist()
    assert np.array_equal(sum((~usable).astype(int) for usable, _ in seen), np.ones(count, dtype=int))
    shortest = count // CALIBRATION.blocks
    for usable, wanted in seen:
        assert not usable[wanted].any()
        assert usable.mean() == pytest.approx(1.0 - 1.0 / CALIBRATION.folds, abs=0.02)
        edges = np.flatnonzero(np.diff(usable.astype(int)))
        assert np.diff(edges).min() >= shortest  # whole blocks, not samples
        assert len(edges) >= 2 * CALIBRATION.blocks // CALIBRATION.folds - 1  # spread over the flight


def sequence(count, seed):
    """Commands on two axes, and a mismatch with errors that last as long as the commands' own features."""
    rng = np.random.default_rng(seed)

    def slow():
        raw = gaussian_filter1d(rng.normal(size=(count, 2)), 12.0, axis=0)
        return raw / raw.std(axis=0)

    wrench = np.zeros((count, 6))
    wrench[:, [0, 2]] = slow() * [8.0, 3.0] + [0.0, 39.0]
    known = np.column_stack([0.3 * np.sin(wrench[:, 0] / 6.0), 0.03 * (wrench[:, 2] - 39.0)])
    return wrench, known + 0.08 * slow() + 0.005 * rng.normal(size=(count, 2))


@pytest.fixture(scope="module", params=["exact", "sparse"])
def fits(request):
    """Without calibration and with it, from the same samples."""
    points = {"exact": 150, "sparse": 40}[request.param]
    settings = {"points": points, "restarts": 0, "inference": request.param}
    return [fit(*sequence(900, 0), TORQUES, FitSettings(calibrate=on, **settings)) for on in (False, True)]


def test_calibrated_sigma_covers_an_unseen_sequence_better(fits):
    """Neighbouring samples share their error, so the process believes it has a function where it has noise."""
    wrench, measured = sequence(3000, 1)
    shares = [Coverage.of(measured - gp.mean(wrench), gp.std(wrench)).within_95 for gp in fits]
    before, after = np.mean(np.abs(np.array(shares) - 0.95), axis=1)
    assert before > 0.1
    assert after < 0.5 * before


def test_calibration_scales_sigma_and_nothing_else(fits):
    plain, calibrated = fits
    wrench = sequence(200, 2)[0]
    assert (plain.sigma_scale == 1.0).all()
    assert (calibrated.sigma_scale > 1.1).all()
    assert np.array_equal(calibrated.mean(wrench), plain.mean(wrench))
    assert calibrated.std(wrench) == pytest.approx(plain.std(wrench) * calibrated.sigma_scale)
    assert calibrated.sigma_training == pytest.approx(plain.sigma_training * calibrated.sigma_scale)
    assert calibrated.sigma_prior == pytest.approx(plain.sigma_prior * calibrated.sigma_scale)


def test_few_samples_are_not_calibrated():
    data = sequence(150, 3)
    assert (fit(*data, TORQUES, FitSettings(points=30, restarts=0)).sigma_scale == 1.0).all()
