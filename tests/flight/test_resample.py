"""One clock: held commands, no bridging of gaps, nothing folded in from above the new Nyquist rate."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from wrenchgap.flight import resample, uniform
from wrenchgap.flight.errors import LogError, UsageError
from wrenchgap.flight.flight import ActuatorSeries, BatterySeries, Flight, ImuSeries, OdometrySeries, WrenchSeries
from wrenchgap.flight.resample import held_mean
from wrenchgap.flight.stamps import gaps_of
from wrenchgap.plant.rigid_body import RigidBody
from wrenchgap.plant.vehicle import GRAVITY, Body


def grid(rate, seconds=10.0, start=0.0):
    return start + np.arange(round(seconds * rate) + 1) / rate


COMMAND, IMU = grid(100), grid(200)


def inside(samples):
    """Away from the ends."""
    return (samples.time > 0.5) & (samples.time < 9.5)


def a_flight(command=COMMAND, imu=IMU, **others):
    wave, tone = np.sin(2.0 * command)[:, None] * np.ones(6), np.outer(imu, [3.0, 3.0, 3.0])
    commanded = WrenchSeries("/w", command, wave, gaps=gaps_of(command))
    sensed = ImuSeries("/i", imu, np.sin(tone), np.cos(tone), gaps=gaps_of(imu))
    return Flight("f", Path("f.mcap"), "0", 0, commanded=commanded, imu=sensed, **others)


def odometry(logs, time):
    motion = logs.Motion(time)
    return OdometrySeries("/o", time, motion.position_E, motion.quat_EB, motion.velocity_E, motion.omega_B)


def held_integral(time, slope, period):
    """Integral from 0 to `time` of a ramp that is sampled every `period` and held: a closed form."""
    whole = np.floor(time / period + 1e-9)
    return slope * period**2 * whole * (whole - 1) / 2 + slope * whole * period * (time - whole * period)


@pytest.mark.parametrize(("period", "window"), [(0.01, 0.01), (0.01, 0.04), (0.02, 0.02)])
def test_a_held_ramp_has_its_closed_form_mean(period, window):
    stamps = np.arange(0, 2, period)
    time = np.arange(0.1, 1.8, 0.0037)
    found = held_mean(time, stamps, 5.0 * stamps[:, None], period, window)[:, 0]
    upper, lower = (held_integral(time + side * window / 2, 5.0, period) for side in (1, -1))
    np.testing.assert_allclose(found, (upper - lower) / window, atol=1e-12)


def test_over_one_period_the_held_mean_is_the_line_half_a_period_earlier():
    stamps, period = np.arange(0, 2, 0.01), 0.01
    values = np.random.default_rng(0).standard_normal((len(stamps), 2))
    time = np.arange(0.05, 1.9, 0.0013)
    found = held_mean(time, stamps, values, period, period)
    expected = np.stack([np.interp(time - period / 2, stamps, column) for column in values.T], axis=1)
    np.testing.assert_allclose(found, expected, atol=1e-12)


@pytest.mark.parametrize("window", [0.01, 0.037])
def test_a_held_mean_is_the_share_of_every_hold_in_the_window_also_beyond_the_ends(window):
    """The last of the commands is held for one period; before the first and after the last there is nothing."""
    rng = np.random.default_rng(1)
    stamps = np.cumsum(rng.uniform(0.005, 0.015, 300))
    stamps[150:] += 0.4  # a command that is held for long
    values = rng.standard_normal((len(stamps), 3))
    time = np.arange(stamps[0] - 0.1, stamps[-1] + 0.1, 0.0041)
    found = held_mean(time, stamps, values, 0.01, window)
    ends = np.append(stamps[1:], stamps[-1] + 0.01)
    shared = np.minimum(time + window / 2, ends[:, None]) - np.maximum(time - window / 2, stamps[:, None])
    np.testing.assert_allclose(found, np.maximum(shared, 0.0).T @ values / window, atol=1e-11)


def test_a_plant_driven_by_held_commands_sees_the_resampled_command():
    """An integrator driven by held commands moves by exactly the sum of the resampled ones."""
    (samples,) = uniform(a_flight(), rate=100.0)
    state = np.concatenate(([0.0], np.cumsum(np.sin(2.0 * COMMAND) * 0.01)))  # at the commands' stamps, exactly
    moved = np.diff(np.interp(samples.time - 0.005, np.append(COMMAND, COMMAND[-1] + 0.01), state))
    np.testing.assert_allclose(samples.wrench_cmd_B[:-1, 0] * 0.01, moved, atol=1e-12)


def test_rate_is_that_of_the_commands_and_capped():
    assert uniform(a_flight())[0].dt == pytest.approx(0.01)
    assert uniform(a_flight(grid(1000), grid(1000)))[0].dt == pytest.approx(0.004)
    assert uniform(a_flight(), rate=50.0)[0].dt == pytest.approx(0.02)


def test_measurements_keep_their_values_and_phase_and_vibration_is_not_folded_in():
    """What shakes at 90 Hz, above the new Nyquist rate, would appear at 10 Hz."""
    still = a_flight(imu=grid(1000))
    shake = np.sin(2 * np.pi * 90.0 * still.imu.time)[:, None]
    shaken = replace(still, imu=replace(still.imu, omega_B=still.imu.omega_B + shake))
    for flight, largest, rms in ((still, 2e-4, 2e-4), (shaken, np.inf, 0.01)):
        (samples,) = uniform(flight, rate=100.0)
        error = (samples.omega_B[:, 0] - np.sin(3.0 * samples.time))[inside(samples)]
        assert np.abs(error).max() < largest
        assert np.std(error) < rms


def test_no_stretch_reaches_over_a_gap_of_any_used_role():
    command = np.concatenate((grid(100, 4.0), grid(100, 5.0, start=5.0)))
    imu = np.concatenate((grid(200, 7.0), grid(200, 2.5, start=7.5)))
    result = resample(a_flight(command, imu), minimum_duration=1.0)
    limits = [(s.time[0], s.time[-1]) for s in result.samples]
    assert len(limits) == 3
    for start, stop in limits:
        assert not (start < 4.5 < stop)
        assert not (start < 7.25 < stop)
        np.testing.assert_allclose(np.diff(result.samples[0].time), result.samples[0].dt, rtol=1e-9)
    assert result.covered == pytest.approx(sum(stop - start for start, stop in limits), abs=0.05)
    assert result.span == pytest.approx(10.0)


def test_short_stretches_are_left_out_and_counted():
    imu = np.concatenate((grid(200, 1.0), grid(200, 8.0, start=2.0)))
    result = resample(a_flight(imu=imu))
    assert len(result.samples) == 1
    assert [round(gap.stop - gap.start, 1) for gap in result.short] == [1.0]
    assert any("1 stretch(es) shorter than 2 s" in note for note in result.notes)
    assert len(resample(a_flight(imu=imu), minimum_duration=0.5).samples) == 2


def test_overlap_of_all_used_roles_but_those_hardly_there(logs):
    flight = a_flight(imu=grid(200, 6.0, start=2.0), odometry=odometry(logs, grid(50, 9.0, start=1.0)))
    (samples,) = uniform(flight)
    assert samples.time[[0, -1]] == pytest.approx([2.0, 8.0])
    result = resample(a_flight(odometry=odometry(logs, grid(50, 2.0))))
    assert result.samples[0].quat_EB is None
    assert result.covered > 9.9
    assert any("odometry covers less than half" in note for note in result.notes)


@pytest.mark.parametrize("unknown", [(), ("velocity_E", "omega_B"), ("velocity_E",)])
def test_without_imu_the_odometry_gives_rates_and_specific_force(unknown, logs):
    series = replace(odometry(logs, COMMAND), **dict.fromkeys(unknown))
    result = resample(replace(a_flight(), imu=None, odometry=series))
    (samples,) = result.samples
    truth, inner = logs.Motion(samples.time), inside(samples)
    np.testing.assert_allclose(samples.omega_B[inner], truth.omega_B[inner], atol=0.01)
    np.testing.assert_allclose(samples.specific_force_B[inner], truth.specific_force_B[inner], atol=0.05)
    assert any("no IMU" in note for note in result.notes)


def test_without_imu_what_hovers_feels_the_force_that_keeps_it_in_the_air():
    """A log that stands still, and a body of the plant that this very force accelerates nowhere."""
    level, zeros = np.tile([1.0, 0, 0, 0], (len(COMMAND), 1)), np.zeros((len(COMMAND), 3))
    still = OdometrySeries("/o", COMMAND, zeros, level, zeros)
    (samples,) = uniform(replace(a_flight(), imu=None, odometry=still))
    body = Body(2.0, np.diag([0.01, 0.01, 0.02]), np.zeros(3))
    push = np.concatenate((body.mass * samples.specific_force_B[len(samples) // 2], np.zeros(3)))
    rates = RigidBody(body, GRAVITY).derivative(np.array([*np.zeros(3), 1.0, *np.zeros(9)]), push)
    np.testing.assert_allclose(rates, 0.0, atol=1e-9)


def test_attitude_is_interpolated_along_the_shortest_rotation(logs):
    series = odometry(logs, grid(50))
    flipped = series.quat_EB * np.where(np.arange(len(series.time)) % 2, -1.0, 1.0)[:, None]
    (samples,) = uniform(a_flight(odometry=replace(series, quat_EB=flipped)))
    truth = logs.Motion(samples.time).quat_EB
    np.testing.assert_allclose(np.abs(np.sum(samples.quat_EB * truth, axis=1)), 1.0, atol=1e-6)


def test_actuators_and_voltage():
    actuators = ActuatorSeries("/a", COMMAND, np.outer(COMMAND, np.ones(6)), np.zeros((len(COMMAND), 0)))
    battery = BatterySeries("/b", grid(1), np.linspace(16, 15, 11))
    (samples,) = uniform(a_flight(actuators=actuators, battery=battery))
    np.testing.assert_allclose(samples.tilt_cmd[:, 0], samples.time - 0.005, atol=1e-9)
    assert samples.rotor_speed_cmd.shape == (len(samples), 0)
    np.testing.assert_allclose(samples.voltage, 16 - samples.time / 10, atol=1e-9)
    (samples,) = uniform(a_flight(actuators=actuators, battery=replace(battery, voltage=battery.voltage / 300.0)))
    assert samples.voltage is None  # 0.05 V is no battery


def test_what_is_missing_is_said(logs):
    flight = a_flight()
    with pytest.raises(LogError, match=r"no topic plays the role 'actuators'.*--topic actuators="):
        uniform(flight, require=("actuators", "imu"))
    with pytest.raises(LogError, match="neither an IMU nor an odometry"):
        uniform(replace(flight, imu=None), require=("commanded",))
    with pytest.raises(LogError, match="no stretch of 20 s"):
        uniform(flight, minimum_duration=20.0)
    with pytest.raises(UsageError, match="positive number"):
        uniform(flight, rate=-1.0)
    with pytest.raises(UsageError, match="no such role"):
        uniform(flight, require=("gyro",))


def test_desired_wrench_that_is_the_commanded_one_gives_equal_samples():
    flight = a_flight()
    (samples,) = uniform(replace(flight, desired=flight.commanded))
    np.testing.assert_array_equal(samples.wrench_cmd_B, samples.wrench_des_B)
