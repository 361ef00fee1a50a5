"""The noise floor, against noise alone that is put through the measurement, and closed forms."""

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter, welch

from wrenchgap import flight
from wrenchgap.flight.flight import Flight, ImuSeries, Samples, WrenchSeries
from wrenchgap.learn.data.input_errors import EDGES
from wrenchgap.learn.data.measurement import prepare
from wrenchgap.learn.data.sensor_noise import (
    SPECTRUM,
    coefficient_shapes,
    left_by_resampling,
    noise_shapes,
    periodogram,
    white_noise,
)
from wrenchgap.plant.vehicle import Body, Vehicle

GYRO, ACCEL = 3e-3, 0.04  # one-sided densities
BODY = Body(2.0, np.array([[0.10, 0.01, 0.0], [0.01, 0.20, 0.0], [0.0, 0.0, 0.30]]), np.array([0.0, 0.02, 0.0]))
VEHICLE = Vehicle("noisy", BODY, None, None, np.array([0.06, 0.0, -0.03]))
SECONDS = 400.0


def stamps(rate, jitter=0.0, rng=None, start=0.0):
    """At a rate [Hz], each moved by up to `jitter` of a period."""
    regular = start + np.arange(int(SECONDS * rate)) / rate
    return regular if not jitter else regular + jitter / rate * rng.uniform(-1.0, 1.0, len(regular))


def white(rate, count, rng):
    """Readings (N, 6) of the densities above, over the whole of their bandwidth."""
    return np.repeat([GYRO, ACCEL], 3) * np.sqrt(0.5 * rate) * rng.standard_normal((count, 6))


def record(time, readings, command_rate):
    """The one stretch of a flight with these readings."""
    sent = stamps(command_rate)
    log = Flight(
        "f", Path("f"), "0", 0,
        commanded=WrenchSeries("/w", sent, wrench_B=np.zeros((len(sent), 6))),
        imu=ImuSeries("/imu", time, omega_B=readings[:, :3], specific_force_B=readings[:, 3:]),
    )  # fmt: skip
    (samples,) = flight.uniform(log)
    return prepare(samples, VEHICLE, imu=log.imu)


def motion(time):
    """Readings (N, 6) of a vehicle that swings below the cut-off and vibrates at two lines above."""
    swing = np.stack([np.sin(2 * np.pi * (0.7 + 0.3 * k) * time) for k in range(6)], axis=1)
    lines = np.stack([np.sin(2 * np.pi * 31.0 * time + k) + np.sin(2 * np.pi * 37.3 * time) for k in range(6)], axis=1)
    return swing + 0.03 * lines


CLOCKS = [(i, c, j) for i in (200, 500, 1000) for c in (100, 200, 250) for j in (0.0, 0.3)] + [
    (100, 250, 0.0),
    (100, 250, 0.1),
]


@pytest.mark.parametrize(("imu_rate", "command_rate", "jitter"), CLOCKS)
def test_noise_floor_is_what_filtered_noise_alone_amounts_to(imu_rate, command_rate, jitter):
    """The floor is read from noise, motion and vibration; noise alone, on the same stamps, leaves as much."""
    rng = np.random.default_rng([imu_rate, command_rate, int(10 * jitter)])
    time = stamps(imu_rate, jitter, rng, start=0.37 / imu_rate)
    noise = white(imu_rate, len(time), rng)
    alone = record(time, noise, command_rate).measured.std(axis=0)
    np.testing.assert_allclose(record(time, noise + motion(time), command_rate).noise, alone, rtol=0.05)


def test_drifting_clocks_do_not_lower_the_floor():
    """At 200.6 Hz on 200 Hz each instant lies elsewhere between two readings, and the band has lost half its power."""
    rng = np.random.default_rng(5)
    time = stamps(200.6)
    found = record(time, white(200.6, len(time), rng), 200)
    np.testing.assert_allclose(found.noise, found.measured.std(axis=0), rtol=0.05)
    samples = Samples("f", found.state.time, found.dt, found.state.omega_B, np.zeros((len(found.state.time), 3)))
    _, taken_for_readings = white_noise(samples, None, 8.0)
    assert np.all(taken_for_readings[0, :3] < 0.7 * GYRO**2)


def test_a_beat_of_the_clocks_that_is_slower_than_the_flight_is_followed():
    """101.15 Hz on 101 Hz for 7 s: of two segments one may lie where all is interpolated, half way between readings."""
    errors = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        time = np.arange(0.0, 7.0, 1.0 / 101.15) + seed / 40.0 / 101.15
        clock = np.arange(2, 700) / 101.0
        read = white(101.15, len(time), rng)
        seen = np.stack([np.interp(clock, time, column) for column in read.T], axis=1)
        imu = ImuSeries("/imu", time, omega_B=read[:, :3], specific_force_B=read[:, 3:])
        f, found = white_noise(Samples("f", clock, 1.0 / 101.0, *np.hsplit(seen, 2)), imu, 8.0)
        errors.append(found[np.searchsorted(f, 1.0)] / np.repeat([GYRO, ACCEL], 3) ** 2)
    assert np.mean(errors) == pytest.approx(1.0, abs=0.05)


def test_half_way_between_readings_the_middle_of_two_is_taken():
    """x = (s_i + s_i+1) / 2 has the gain cos^2(pi f dt); at the readings themselves nothing is lost."""
    time, f = np.arange(2000) * 0.005, np.linspace(0.0, 100.0, 50)
    np.testing.assert_allclose(left_by_resampling(time, time, f), 1.0, atol=1e-9)
    half = np.arange(2002) * 0.005 - 0.0025
    np.testing.assert_allclose(left_by_resampling(time, half, f), np.cos(np.pi * f * 0.005) ** 2, atol=2e-6)


def test_drifting_clocks_leave_two_thirds_of_the_power():
    """The mean over u of (1 - u)^2 + u^2 is 2/3, and of u (1 - u) it is 1/6: S = (2 + cos(2 pi f dt)) / 3."""
    time, f = np.arange(20000) * 0.005, np.linspace(0.0, 100.0, 50)
    drifting = np.arange(20100) / 200.01 - 0.001
    left = left_by_resampling(time, drifting, f)
    np.testing.assert_allclose(left, (2.0 + np.cos(2 * np.pi * f * 0.005)) / 3.0, atol=5e-3)


def test_faster_readings_keep_their_density_below_the_cutoff():
    """The anti-alias filter passes what the comparison uses: at 8 Hz all, at half the clock's rate next to nothing."""
    time = np.arange(4000) * 0.005
    left = left_by_resampling(time, np.arange(20000) / 1000.0, np.array([0.5, 4.0, 8.0, 100.0]))
    np.testing.assert_allclose(left[:3], 1.0, atol=0.02)
    assert left[3] < 0.05


@pytest.mark.parametrize("seconds", [2.0, 5.0, 9.0, 60.0])
def test_density_of_short_stretches_is_not_too_small_on_average(seconds):
    """One periodogram or many: the mean over thirty sensors is the density put in."""
    rng, time = np.random.default_rng(3), np.arange(0.0, seconds, 0.005)
    readings = [white(200.0, len(time), rng) for _ in range(30)]
    found = [white_noise(Samples("f", time, 0.005, r[:, :3], r[:, 3:]), None, 8.0)[1][0] for r in readings]
    np.testing.assert_allclose(np.mean(found, axis=0), np.repeat([GYRO, ACCEL], 3) ** 2, rtol=0.06)


def test_a_sensor_that_filters_what_it_reads_is_not_taken_for_a_quiet_one():
    """First order at 80 Hz, read at 1 kHz: up to 400 Hz the median would be a tenth of what is below the cut-off."""
    rng = np.random.default_rng(4)
    time = stamps(1000.0)
    share = 1.0 - np.exp(-2 * np.pi * 80.0 / 1000.0)
    noise = lfilter([share], [1.0, share - 1.0], white(1000.0, len(time), rng), axis=0)
    found = record(time, noise, 200)
    truth = found.measured.std(axis=0)
    assert np.all((0.8 * truth < found.noise) & (found.noise < 1.05 * truth))


def test_coarse_steps_of_a_reading_count_as_noise():
    """Rounding to steps of three standard deviations adds a noise of its own, about a twelfth of the step squared."""
    rng = np.random.default_rng(6)
    time = stamps(500.0, 0.3, rng)
    read = white(500.0, len(time), rng) + motion(time)
    step = 3.0 * np.repeat([GYRO, ACCEL], 3) * np.sqrt(0.5 * 500.0)
    steps = step * np.round(read / step)
    truth = record(time, steps - motion(time), 200).measured.std(axis=0)
    np.testing.assert_allclose(record(time, steps, 200).noise, truth, rtol=0.1)


def test_what_the_imu_did_not_measure_was_not_interpolated_from_it():
    """Readings half a period off the clock have lost cos^2(pi f dt) of the samples; a column from elsewhere has not."""
    rng = np.random.default_rng(7)
    time = stamps(200.0)
    samples = Samples("f", time, 0.005, *np.hsplit(white(200.0, len(time), rng), 2))
    blind = np.zeros((len(time) + 1, 3))
    blind[:, 0] = np.nan
    imu = ImuSeries("/imu", np.append(time, time[-1] + 0.005) - 0.0025, omega_B=blind, specific_force_B=0.0 * blind)
    f, found = white_noise(samples, imu, 8.0)
    np.testing.assert_allclose(found[:, 0], GYRO**2, rtol=0.05)
    np.testing.assert_allclose(found[:, 1] / found[0, 1], np.cos(np.pi * f * 0.005) ** 2, atol=2e-6)


@pytest.mark.parametrize("count", [37, 777, 12_345])
def test_segments_transformed_together_are_those_of_welch(count):
    columns = np.random.default_rng(3).standard_normal((4, count)) + 2.0
    columns[3, 5] = np.nan  # a reading that was none spoils its own column alone
    frequency, power = periodogram(columns, 1 / 197.0)
    expected_frequency, expected = welch(columns, 197.0, nperseg=min(count, int(SPECTRUM.segment * 197.0)))
    np.testing.assert_allclose(frequency, expected_frequency, rtol=1e-14)
    np.testing.assert_allclose(power[1:], expected.T[1:], rtol=1e-11)  # the mean is taken out: nothing at zero


def test_no_band_is_without_noise():
    """Of blocks of 1.5 s the lowest band has the mean alone, in which a differentiated noise would have no power."""
    hertz = np.tile(np.arange(150) / 3.0, 2)
    _, band = np.unique(np.digitize(hertz, EDGES), return_inverse=True)
    shapes = coefficient_shapes(hertz, band, 12.0)
    assert shapes.min() > 0.0
    np.testing.assert_array_equal(shapes[hertz == 0.0], shapes[hertz == hertz[1]])
    np.testing.assert_array_equal(shapes[hertz > 0.0], noise_shapes(hertz[hertz > 0.0], 12.0))
    longer = 0.5 * hertz  # of 3 s: the next coefficient is in that band too
    _, band = np.unique(np.digitize(longer, EDGES), return_inverse=True)
    np.testing.assert_array_equal(coefficient_shapes(longer, band, 12.0), noise_shapes(longer, 12.0))
