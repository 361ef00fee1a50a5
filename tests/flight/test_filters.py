"""The compiled filters are those of scipy, the window of every spectrum too, without scipy.signal."""

import subprocess
import sys

import numpy as np
import pytest
from scipy.signal import butter, get_window, lfilter, sosfilt_zi, sosfreqz

from wrenchgap.flight.filters import butterworth, filtered, hann, response, steady_state


@pytest.mark.parametrize(
    ("b", "a"),
    [([0.3, 0.2], [1.0, -0.5]), ([0.3, 0.2], [2.0, -0.5]), ([0.1], [1.0, -1.2, 0.5]), ([0.5, 0.1, 0.2], [1.0, -0.4])],
)
def test_it_is_scipys_with_and_without_states(b, a):
    rng = np.random.default_rng(1)
    signal, start = rng.standard_normal((300, 4)), rng.standard_normal((max(len(b), len(a)) - 1, 4))
    np.testing.assert_allclose(filtered(np.array(b), np.array(a), signal), lfilter(b, a, signal, axis=0), rtol=1e-12)
    expected = lfilter(b, a, signal, axis=0, zi=start)[0]
    np.testing.assert_allclose(filtered(np.array(b), np.array(a), signal, start), expected, rtol=1e-12, atol=1e-14)


def test_a_constant_leaves_with_the_gain_at_rest():
    b, a = np.array([0.2, 0.1, 0.05]), np.array([1.0, -0.7, 0.1])
    last = filtered(b, a, np.ones((400, 1)))[-1, 0]
    assert last == pytest.approx(b.sum() / a.sum(), rel=1e-12)


def test_what_is_given_is_not_written_to():
    signal, start = np.ones((5, 2)), np.ones((1, 2))
    filtered(np.array([0.5, 0.5]), np.array([1.0, 0.0]), signal, start)
    np.testing.assert_array_equal(signal, np.ones((5, 2)))
    np.testing.assert_array_equal(start, np.ones((1, 2)))


@pytest.mark.parametrize(("cutoff", "rate"), [(8.0, 200.0), (1.0, 250.0), (0.3, 1000.0), (30.0, 71.3)])
def test_the_filter_is_scipys_to_the_last_digit(cutoff, rate):
    section = butterworth(cutoff, rate)
    expected = butter(2, cutoff, fs=rate, output="sos")
    np.testing.assert_array_equal(section, expected[0])
    np.testing.assert_array_equal(steady_state(section), sosfilt_zi(expected)[0])
    frequency = np.linspace(0.0, 0.5 * rate, 301)
    _, passed = sosfreqz(expected, worN=frequency, fs=rate)
    np.testing.assert_allclose(response(section, frequency, rate), passed, rtol=1e-9, atol=1e-12)


def test_half_of_the_power_passes_at_the_cutoff_and_all_of_it_at_rest():
    gain = np.abs(response(butterworth(8.0, 200.0), np.array([0.0, 8.0, 100.0]), 200.0))
    np.testing.assert_allclose(gain, [1.0, np.sqrt(0.5), 0.0], atol=1e-12)


@pytest.mark.parametrize("count", [37, 800])
def test_the_window_is_scipys(count):
    np.testing.assert_array_equal(hann(count), get_window("hann", count))


def test_what_answers_a_command_or_draws_a_page_waits_for_no_statistics():
    code = "import sys, wrenchgap.replay.api, wrenchgap.replay.session.log_session, wrenchgap.viewer.page"
    heavy = "scipy.signal", "scipy.stats", "scipy.optimize", "scipy.interpolate", "pandas"
    said = subprocess.run(
        [sys.executable, "-c", f"{code}; print([m for m in {heavy} if m in sys.modules])"],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert said.stdout.strip() == "[]"
