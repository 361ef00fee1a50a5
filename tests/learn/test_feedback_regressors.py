"""On an axis where commands answer the motion, what they answer is no evidence.

The loop closes through the controller, so that commands follow what disturbs, later and with the other sign (Forssell
and Ljung, Automatica 35, 1999). What no command answers, and the mean of a flight, are left.
"""

from dataclasses import replace

import numpy as np
import pytest

from wrenchgap.learn.data.feedback_regressors import REGRESSORS, answers, lagged, shifted
from wrenchgap.learn.identify.bias_and_trim import trim_of
from wrenchgap.learn.posterior.columns import Column
from wrenchgap.learn.posterior.spectrum import Spectrum

AXIS = 2


def column(name, values):
    jacobian = np.zeros((len(values), 6, 1))
    jacobian[:, AXIS, 0] = values
    one = np.ones(1)
    return Column((name,), 0 * one, 0 * one, 0 * jacobian[:, :, 0], jacobian, -one, one, one, one < 0, 0.05)


@pytest.fixture
def left_of(plain, hexarotor):
    """What an answering axis leaves of some values over time: their coefficients by block and frequency, and which of
    them are means.
    """

    def coefficients(values):
        data = replace(plain, answering=(AXIS,))
        residual = plain.noise * np.random.default_rng(0).normal(size=plain.measured.shape)
        space = Spectrum(data, residual, [column("mass", values)], trim_of(hexarotor))
        out = space.coefficients[:, AXIS, 1]
        means = np.zeros(len(out), dtype=bool)
        means[space.starts] = True
        return out, means

    return coefficients


def sent(plain):
    return np.concatenate([r.commanded[:, AXIS] for r in plain.records])


@pytest.mark.parametrize("samples", [-2, 0, 1])
def test_what_commands_answer_earlier_or_later_is_gone_and_its_mean_stays(plain, left_of, samples):
    """A multiple of the command, as a scale of all thrusts is, even some samples before it."""
    values = shifted(sent(plain), samples)
    coefficients, means = left_of(values)
    moving = values - values.mean()
    assert np.linalg.norm(coefficients[~means]) < 0.02 * np.linalg.norm(moving)
    assert np.linalg.norm(coefficients[means]) == pytest.approx(abs(values.mean()) * np.sqrt(len(values)), rel=0.01)


def test_a_disturbance_far_above_the_noise_is_no_evidence_for_what_goes_with_it(plain, hexarotor):
    """A gust shows in the measured force; of a column that is that force there is next to nothing left but means."""
    gust = 300.0 * plain.noise[AXIS] * np.random.default_rng(1).normal(size=len(plain.measured))
    measured = plain.measured.copy()
    measured[:, AXIS] += gust
    cuts = np.cumsum([len(r) for r in plain.records])[:-1]
    records = tuple(replace(r, measured=m) for r, m in zip(plain.records, np.split(measured, cuts), strict=True))
    data = replace(plain, answering=(AXIS,), records=records)
    residual = plain.noise * np.random.default_rng(0).normal(size=measured.shape)
    residual[:, AXIS] += gust
    space = Spectrum(data, residual, [column("mass", measured[:, AXIS])], trim_of(hexarotor))
    moving = np.ones(len(space.block), dtype=bool)
    moving[space.starts] = False
    left, carried = (space.coefficients[moving, AXIS, k] for k in (0, 1))
    assert np.linalg.norm(left) > 0.5 * np.linalg.norm(gust)
    assert np.linalg.norm(carried) < 0.05 * np.linalg.norm(gust)


def test_what_no_command_answers_stays(plain, left_of):
    """A tone of its own."""
    tone = np.sin(2 * np.pi * 3.3 * plain.records[0].time)
    tone = np.resize(tone, len(plain.measured))
    coefficients, means = left_of(tone)
    assert np.linalg.norm(coefficients[~means]) > 0.8 * np.linalg.norm(tone)


def test_responses_are_seen_behind_lags_and_shifts(plain):
    """Columns for every moving command: the command itself first, and shifts of a whole number of samples."""
    record = plain.records[0]
    moving = [a for a in range(6) if np.std(record.commanded[:, a]) > 0.0]
    every = answers(plain.records, REGRESSORS.shifts)
    assert every.shape == (len(plain.measured), len(moving) * (len(REGRESSORS.lags) + len(REGRESSORS.shifts)))
    step = round(REGRESSORS.shifts[0] / (record.cutoff_hz * record.dt_kept))
    first = every[: len(record), len(moving) * len(REGRESSORS.lags)]
    np.testing.assert_array_equal(first[:step], record.commanded[-step:, moving[0]])


@pytest.mark.parametrize("samples", [0.4, 25.0])
def test_a_lag_rests_where_it_begins_and_answers_a_step_by_an_exponential(samples):
    signal = np.append(np.full(20, 3.0), np.full(200, 5.0))
    expected = 5.0 - 2.0 * np.exp(-np.arange(1, 201) / samples)
    found = lagged(np.stack((signal, signal), axis=1)[:, 1], samples)  # not side by side in memory
    np.testing.assert_allclose(found, np.append(np.full(20, 3.0), expected), rtol=1e-13)


def test_without_a_lag_a_signal_stays_as_it_is():
    signal = np.random.default_rng(4).standard_normal(500)
    np.testing.assert_array_equal(lagged(signal, 0.0), signal)
