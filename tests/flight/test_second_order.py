"""The filter of every analysis and the window of every spectrum are scipy's, without scipy.signal."""

import subprocess
import sys

import numpy as np
import pytest
from scipy.signal import butter, get_window, sosfilt_zi, sosfreqz

from wrenchgap.flight.second_order import butterworth, hann, response, steady_state


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
