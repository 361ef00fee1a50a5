"""On an axis where commands answer the motion, what they answer is no evidence.

The loop closes through the controller, so that commands follow what disturbs, later and with the other sign (Forssell
and Ljung, Automatica 35, 1999). What no command answers, and the mean of a flight, are left.
"""

from dataclasses import replace

import numpy as np
import pytest

from wrenchgap.learn.data.feedback_regressors import (
    REGRESSORS,
    answer_gains,
    answers,
    lagged,
    partly,
    shifted,
    wholly,
    within_blocks,
)
from wrenchgap.learn.data.input_errors import EDGES
from wrenchgap.learn.identify.bias_and_trim import trim_of
from wrenchgap.learn.posterior.columns import Column
from wrenchgap.learn.posterior.spectrum import Spectrum

AXIS = 2


def column(name, values):
    jacobian = np.zeros((len(values), 6, 1))
    jacobian[:, AXIS, 0] = values
    one = np.ones(1)
    return Column((name,), 0 * one, 0 * one, 0 * jacobian[:, :, 0], jacobian, -one, one, one, one < 0, 0.05)


def disturbed(plain):
    """The same flights where commands answer a force of three times their size: hardly any of it was asked for."""
    records, rng = [], np.random.default_rng(2)
    for r in plain.records:
        measured = r.measured.copy()
        measured[:, AXIS] += 3.0 * np.std(r.commanded[:, AXIS]) * rng.normal(size=len(r))
        records.append(replace(r, measured=measured))
    return replace(plain, answering=(AXIS,), records=tuple(records))


@pytest.fixture
def left_of(plain, hexarotor):
    """What an answering axis leaves of some values over time: their coefficients by block and frequency, and which of
    them are means.
    """

    def coefficients(values):
        data = disturbed(plain)
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
    every, of = answers(plain.records, REGRESSORS.shifts)
    assert set(of) == set(moving)
    assert every.shape == (len(plain.measured), len(moving) * (len(REGRESSORS.lags) + len(REGRESSORS.shifts)))
    step = round(REGRESSORS.shifts[0] / (record.cutoff_hz * record.dt_kept))
    first = every[: len(record), len(moving) * len(REGRESSORS.lags)]
    np.testing.assert_array_equal(first[:step], record.commanded[-step:, moving[0]])


def test_axes_that_answer_are_those_of_the_data(plain):
    answering = disturbed(plain)
    values = np.random.default_rng(0).normal(size=(len(plain.measured), 6))
    out = answering.unanswered(values)
    np.testing.assert_array_equal(np.delete(out, AXIS, axis=1), np.delete(values, AXIS, axis=1))
    assert np.linalg.norm(answering.answerable[AXIS].basis.T @ out[:, AXIS]) < 1e-9 * np.linalg.norm(values)


def test_a_linear_answer_to_commands_is_taken_out_and_a_mean_is_not(plain):
    """A residual that is a lagged command with a constant on top: only the constant is evidence."""
    command = np.concatenate([r.commanded[:, AXIS] for r in plain.records])
    answering = disturbed(plain)
    values = np.zeros((len(command), 6))
    values[:, AXIS] = 0.7 * command
    left = answering.unanswered(values)[:, AXIS]
    means = np.array([values[plain.block == b, AXIS].mean() for b in np.unique(plain.block)])
    kept = np.array([left[plain.block == b].mean() for b in np.unique(plain.block)])
    assert np.std(left - kept[plain.block]) < 0.2 * np.std(values[:, AXIS] - means[plain.block])
    constant = np.zeros_like(values)
    constant[:, AXIS] = 0.05
    np.testing.assert_allclose(answering.unanswered(constant)[:, AXIS], 0.05, atol=1e-9)


def closed_loop(plain, share, seed=3):
    """Records whose commands are `share` excitation, and for the rest take away a disturbance; both white."""
    rng, records = np.random.default_rng(seed), []
    for r in plain.records:
        wanted, disturbance = rng.normal(size=(2, len(r)))
        sent = np.zeros((len(r), 6))
        sent[:, AXIS] = share * wanted - disturbance
        measured = sent.copy()
        measured[:, AXIS] += disturbance
        records.append(replace(r, commanded=sent, measured=measured, noise=np.full(6, 1e-6)))
    return tuple(records)


@pytest.mark.parametrize("share", [3.0, 6.0])
def test_a_regression_in_closed_loop_is_off_by_as_much_as_is_allowed_for(plain, share):
    """d = -a u is found of u = e - d, with a = S_d / S_u: 1/10 and 1/37 of these."""
    records = closed_loop(plain, share)
    sent, left = (
        np.concatenate([v[:, AXIS] for v in each])
        for each in zip(*((r.commanded, r.measured - r.commanded) for r in records), strict=True)
    )
    found = -float(sent @ left) / float(sent @ sent)
    assert found == pytest.approx(1.0 / (1.0 + share**2), abs=0.01)  # sqrt(S_d / S_u / N) is 0.003 to 0.006
    assert np.mean(answer_gains(records)[:, AXIS, AXIS]) == pytest.approx(1.0 / (1.0 + share**2), rel=0.2)


def test_where_most_of_the_command_may_be_an_answer_no_gain_of_it_is_evidence(plain):
    assert np.isnan(answer_gains(closed_loop(plain, 1.0))[:, AXIS]).all()


@pytest.mark.parametrize(("share", "least", "most"), [(1.0, 0.0, 0.02), (10.0, 0.2, 0.95)])
def test_the_better_motion_follows_commands_the_more_of_their_gain_is_evidence(plain, share, least, most):
    """Of a tenth more thrust: nothing where commands answer, some where ten times as much was asked for."""
    records = closed_loop(plain, share)
    data = replace(plain, answering=(AXIS,), records=records, **stacked(records))
    gain = np.zeros_like(data.commanded)
    gain[:, AXIS] = within_blocks(data.commanded[:, [AXIS]], data.block)[:, 0]
    left = np.linalg.norm(data.unanswered(gain)) / np.linalg.norm(gain)
    assert least <= left <= most


def stacked(records):
    return {name: np.concatenate([getattr(r, name) for r in records]) for name in ("measured", "commanded")}


def test_without_a_command_that_changes_nothing_is_an_answer(plain):
    records = tuple(replace(r, commanded=np.tile(r.commanded[0], (len(r), 1))) for r in plain.records)
    data = replace(plain, answering=(AXIS,), records=records, **stacked(records))
    values = np.random.default_rng(0).normal(size=data.measured.shape)
    np.testing.assert_allclose(data.unanswered(values), values, atol=1e-12)


def test_what_is_known_up_to_a_size_leaves_a_white_residual():
    """Along one direction the covariance is 1 + s^2; with it taken out in part, one."""
    rng, signal = np.random.default_rng(6), np.zeros((50, 1))
    signal[7] = 4.0
    residuals = rng.normal(size=(50, 4000)) + signal * rng.normal(size=4000)
    white = partly(signal).out_of(residuals)
    np.testing.assert_allclose(np.var(white, axis=1), 1.0, atol=0.12)
    np.testing.assert_allclose(wholly(signal).out_of(residuals)[7], 0.0, atol=1e-12)


def test_how_slow_commands_answer_is_no_evidence_and_a_mean_is(plain):
    """A gust that lasts for blocks of time, taken away by the command: a torque ratio would explain it."""
    gust = np.sin(2 * np.pi * np.arange(len(plain.block)) / len(plain.block) * 3.0)
    share = float(np.std(gust)) / float(np.std(plain.commanded[:, AXIS]))
    starts = np.cumsum([len(r) for r in plain.records])[:-1]
    records = tuple(
        replace(r, commanded=r.commanded - np.eye(6)[AXIS] * g[:, None] / share)
        for r, g in zip(plain.records, np.split(gust, starts), strict=True)
    )
    data = replace(plain, answering=(AXIS,), records=records, **stacked(records))
    column = np.zeros_like(data.commanded)
    column[:, AXIS] = data.commanded[:, AXIS]
    left = data.unanswered(column)[:, AXIS]
    for flight in np.unique(data.flight):
        rows = data.flight == flight
        assert left[rows].mean() == pytest.approx(column[rows, AXIS].mean(), rel=0.01)
    moving = column[:, AXIS] - column[:, AXIS].mean()
    assert np.std(left) < 0.1 * np.std(moving)


@pytest.mark.parametrize("samples", [0.4, 25.0])
def test_a_lag_rests_where_it_begins_and_answers_a_step_by_an_exponential(samples):
    signal = np.append(np.full(20, 3.0), np.full(200, 5.0))
    expected = 5.0 - 2.0 * np.exp(-np.arange(1, 201) / samples)
    found = lagged(np.stack((signal, signal), axis=1)[:, 1], samples)  # not side by side in memory
    np.testing.assert_allclose(found, np.append(np.full(20, 3.0), expected), rtol=1e-13)


def test_without_a_lag_a_signal_stays_as_it_is():
    signal = np.random.default_rng(4).standard_normal(500)
    np.testing.assert_array_equal(lagged(signal, 0.0), signal)


def test_where_commands_say_nothing_the_mean_of_a_flight_stays(plain, hexarotor):
    """Commands that are snapshots in all bands answer nothing: of the torque about the axis nothing is taken out."""
    every = np.zeros_like(plain.records[0].input_error) if plain.records[0].input_error is not None else None
    error = np.zeros((len(EDGES) + 1, 6)) if every is None else every
    error[:, AXIS] = 1.0
    data = replace(plain, answering=(AXIS,), records=tuple(replace(r, input_error=error) for r in plain.records))
    constant = np.zeros_like(plain.measured)
    constant[:, AXIS] = 3.0
    space = Spectrum(data, constant, [column("mass", np.ones(len(constant)))], trim_of(hexarotor))
    assert space.silent[:, AXIS].mean() > 0.9
    kept = np.linalg.norm(space.coefficients[:, AXIS, :2], axis=0)
    np.testing.assert_allclose(kept, np.array([3.0, 1.0]) * np.sqrt(len(constant)), rtol=1e-6)


def test_where_commands_are_snapshots_of_answers_the_mean_of_a_flight_stays(plain):
    """What is left of commands without all bands is rounding, and takes no direction out of a residual."""
    answering = disturbed(plain)
    error = np.zeros((len(EDGES) + 1, 6))
    error[:, AXIS] = 1.0
    data = replace(answering, records=tuple(replace(r, input_error=error) for r in answering.records))
    constant = np.zeros_like(plain.measured)
    constant[:, AXIS] = 3.0
    np.testing.assert_allclose(data.unanswered(constant), constant, atol=1e-9)
