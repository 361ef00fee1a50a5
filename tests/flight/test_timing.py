"""Offsets between signals with a known answer: moved stamps, drifting clocks, noise, repetition, copies."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import trapezoid

from wrenchgap.flight import compared_signals, offsets, so3
from wrenchgap.flight.block_integrals import integrals
from wrenchgap.flight.flight import Flight, Gap, ImuSeries, OdometrySeries, ReferenceSeries, WrenchSeries
from wrenchgap.flight.offsets import Problem, Signal, offset


class Wander:
    """Three smooth random signals: sums of sinusoids, known at any time."""

    def __init__(self, seed, low=0.1, high=4.0, count=60):
        rng = np.random.default_rng(seed)
        self.omega = 2 * np.pi * rng.uniform(low, high, count)
        self.size = rng.normal(size=(count, 3)) / np.sqrt(count)
        self.phase = rng.uniform(0, 2 * np.pi, count)

    def __call__(self, time):
        return np.sin(np.outer(time, self.omega) + self.phase) @ self.size

    def integral(self, time):
        return -np.cos(np.outer(time, self.omega) + self.phase) @ (self.size / self.omega[:, None])


def pair(seed, late, *, seconds=30.0, noise=0.1, rates=(200.0, 100.0), rate_error=0.0, jitter=0.0):
    """A signal by two topics with clocks of their own; the second is stamped `late` seconds late at mid-flight."""
    rng = np.random.default_rng(1000 + seed)
    wander = Wander(seed)
    first, second = (np.arange(0.0, seconds, 1.0 / rate) for rate in rates)
    second = second + rng.uniform(0.0, 1.0 / rates[1])
    first = np.sort(first + jitter * rng.normal(size=len(first)))
    values = [wander(t) + noise * rng.normal(size=(len(t), 3)) for t in (first, second)]
    stamps = second + late + rate_error * (second - 0.5 * seconds)
    return Signal("first", first, values[0]), Signal("second", stamps, values[1])


@pytest.mark.parametrize("late", [0.0, 0.0073, -0.0021, 0.15, -0.4])
def test_a_fractional_offset_is_recovered_within_its_interval(late):
    """Without noise it is exact to some microseconds."""
    found = offset(*pair(0, late))
    assert found.std < 5e-4
    assert abs(found.seconds - late) < found.interval
    assert offset(*pair(3, late, noise=0.0)).seconds == pytest.approx(late, abs=2e-5)


def test_intervals_hold_the_truth_about_as_often_as_they_say():
    found = [offset(*pair(seed, 0.0073, seconds=20.0, noise=0.3)) for seed in range(20)]
    missed = [abs(o.seconds - 0.0073) > o.interval for o in found]
    assert sum(missed) <= 3  # 1 expected; more than 3 has a chance of 1.6 %
    scatter = np.std([o.seconds for o in found])
    assert 0.6 < np.mean([o.std for o in found]) / scatter < 1.6


def test_coloured_noise_does_not_fool_the_interval():
    missed = 0
    for seed in range(12):
        first, second = pair(seed, 0.004, noise=0.0)
        slow = Wander(500 + seed, 0.1, 1.0)
        found = offset(first, replace(second, values=second.values + 0.3 * slow(second.time)))
        missed += abs(found.seconds - 0.004) > found.interval
    assert missed <= 2


@pytest.mark.parametrize("jitter", [0.0, 1e-3])
def test_jitter_of_the_stamps_is_no_offset(jitter):
    found = offset(*pair(7, 0.0073, jitter=jitter, noise=0.02))
    assert abs(found.seconds - 0.0073) < found.interval


def test_noise_alone_gives_no_number():
    rng, time = np.random.default_rng(1), np.arange(0.0, 20.0, 0.01)
    for _ in range(20):
        signals = [Signal(name, time, rng.normal(size=(len(time), 3))) for name in ("a", "b")]
        assert offset(*signals).seconds is None


def test_a_motion_that_repeats_itself_has_no_unique_offset():
    time = np.arange(0.0, 30.0, 0.01)
    tone = np.sin(2 * np.pi * 4.0 * time)[:, None]
    signals = [Signal(name, time, tone, ("x",)) for name in ("a", "b")]
    assert offset(*signals).problem is Problem.AMBIGUOUS


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (lambda s: replace(s, values=np.zeros_like(s.values)), Problem.STILL),
        (lambda s: Signal("slow", s.time[::80], s.values[::80]), Problem.SLOW),
        (lambda s: Signal("short", s.time[:250], s.values[:250]), Problem.SHORT),
    ],
)
def test_what_cannot_be_estimated_says_why(change, problem):
    first, second = pair(0, 0.0)
    assert offset(first, change(second)).problem is problem


def test_a_drifting_clock_is_seen_with_its_slope():
    found = offset(*pair(2, 0.005, seconds=60.0, rate_error=2e-4))
    assert found.drifts
    assert found.drift == pytest.approx(2e-4, abs=3 * found.drift_std)
    assert abs(found.seconds - 0.005) < 2 * found.interval
    steady = offset(*pair(2, 0.005, seconds=60.0))
    assert not steady.drifts
    assert [abs(half.seconds - 0.005) < 4 * half.std for half in steady.halves] == [True, True]


def test_a_gap_is_not_bridged():
    first, second = pair(4, 0.0073)
    rng = np.random.default_rng(0)
    bad = (second.time > 10.0) & (second.time < 14.0)
    second = replace(second, values=np.where(bad[:, None], 50 * rng.normal(size=second.values.shape), second.values))
    found = offset(first, replace(second, gaps=(Gap(10.0, 14.0),)))
    assert abs(found.seconds - 0.0073) < found.interval
    assert found.std < 1e-3


def test_one_violent_block_does_not_decide():
    signals = zip(pair(4, 0.0073), (28.0, 28.1), strict=True)
    crashes = ((s, 200.0 * np.exp(-(((s.time - at) / 0.05) ** 2))[:, None]) for s, at in signals)
    found = offset(*(replace(s, values=s.values + crash) for s, crash in crashes))
    assert abs(found.seconds - 0.0073) < found.interval


def test_a_delay_is_the_same_in_every_band_and_a_lag_is_not():
    wander, time, tau = Wander(9, 0.2, 9.0, 200), np.arange(0.0, 60.0, 0.005), 0.05
    late = np.sin(np.outer(time, wander.omega) + wander.phase - np.arctan(wander.omega * tau))
    lagged = late @ (wander.size / np.sqrt(1 + (wander.omega * tau) ** 2)[:, None])
    rng = np.random.default_rng(0)
    first = Signal("first", time, wander(time) + 0.02 * rng.normal(size=lagged.shape))
    lag = offset(first, Signal("second", time, lagged))
    for part, hz in zip(lag.bands[:3], (1.25, 3.5, 7.5), strict=True):
        expected = np.arctan(2 * np.pi * hz * tau) / (2 * np.pi * hz)
        assert part.seconds == pytest.approx(expected, rel=0.12)
    delay = offset(first, Signal("second", time, wander(time - 0.03)))
    assert [part.seconds for part in delay.bands[:3]] == pytest.approx([0.03] * 3, abs=3e-4)


def flown(late=0.0, imu=True):
    """A flight that turns about z and moves: gyroscope and accelerometer exact, odometry stamped `late`."""
    wander, z = Wander(11, 0.2, 3.0), np.array([0.0, 0.0, 1.0])
    fast, slow = np.arange(0.0, 24.0, 0.005), np.arange(0.0, 24.0, 0.01)
    velocity = wander.integral(slow) * z
    position = np.cumsum(velocity, axis=0) * 0.01
    quat = so3.exp(wander.integral(slow)[:, [0]] * z)
    odometry = OdometrySeries("/odometry", slow + late, position, quat, velocity, wander(slow)[:, [0]] * z)
    series = ImuSeries("/imu", fast, wander(fast)[:, [0]] * z, (wander(fast) + 9.80665) * z)
    return Flight("made", __file__, "", 0, imu=series if imu else None, odometry=odometry)


def test_every_part_of_the_odometry_is_held_against_the_imu():
    found = {(o.first, o.second): o.seconds for o in compared_signals.sensor_offsets(flown(0.0123))}
    expected = {
        ("gyroscope", "odometry attitude"): 0.0123,
        ("gyroscope", "odometry rate"): 0.0123,
        ("accelerometer", "odometry velocity"): 0.0123,
        ("odometry rate", "odometry attitude"): 0.0,
        # the position was summed up at the ends of the intervals: half a sample ahead of the velocity
        ("odometry velocity", "odometry position"): -0.005,
    }
    assert {names: found[names] for names in expected} == pytest.approx(expected, abs=2e-4)


def test_noise_that_goes_through_the_controller_is_no_common_motion():
    """What shakes one sensor moves the vehicle: coherent, a quarter period late at all frequencies, of any gain."""
    first, second = pair(6, 0.0073, noise=0.0, seconds=40.0)
    shake = Wander(77, 8.0, 18.0, 200)
    moved = replace(first, values=first.values - 0.02 * shake(first.time))
    rate = (shake(second.time - 0.0073 + 1e-4) - shake(second.time - 0.0073 - 1e-4)) / 2e-4
    shaken = replace(second, values=second.values + 0.01 * rate)
    fooled, found = offset(moved, shaken), offset(moved, shaken, gains=offsets.OFFSETS.alike)
    assert abs(fooled.seconds - 0.0073) > 0.003
    assert abs(found.seconds - 0.0073) < 3e-4


def test_without_imu_pose_and_twist_are_still_compared():
    names = [(o.first, o.second) for o in compared_signals.sensor_offsets(flown(imu=False))]
    assert names == [("odometry rate", "odometry attitude"), ("odometry velocity", "odometry position")]
    assert compared_signals.sensor_offsets(Flight("none", __file__, "", 0)) == ()


def test_tracking_and_controller_offsets():
    made = flown()
    behind, time = made.odometry, np.arange(0.0, 24.0, 0.005)
    reference = ReferenceSeries("/reference", behind.time - 0.08, behind.position_E, behind.quat_EB)
    wrench = np.cumsum(np.random.default_rng(0).normal(size=(len(time), 6)), axis=0)
    desired, commanded = WrenchSeries("/d", time, wrench), WrenchSeries("/c", time + 0.002, wrench)
    found = replace(made, reference=reference, desired=desired, commanded=commanded)
    assert [o.seconds for o in compared_signals.tracking_offsets(found)] == pytest.approx([0.08, 0.08], abs=3e-4)
    assert compared_signals.controller_offset(found).seconds == pytest.approx(0.002, abs=1e-5)
    assert compared_signals.controller_offset(replace(found, commanded=replace(commanded, time=time))).same
    assert compared_signals.controller_offset(made) is None


@pytest.mark.parametrize("columns", [2, 3, 4])
def test_integrals_are_the_trapezoid_rule_on_what_a_weighted_line_leaves(columns):
    """Numpy's weighted fit of a line and scipy's rule, block by block, on stamps that jitter."""
    rng = np.random.default_rng(3)
    time = np.sort(np.arange(0.0, 12.0, 0.01) + rng.normal(0.0, 1e-3, 1200))
    values = rng.normal(size=(1200, columns)).cumsum(axis=0)
    starts = np.append(np.linspace(0.0, 10.0, 7), 11.97)  # in the last lie fewer samples than `FEWEST`
    found = integrals(time, values, starts, 2.0, 2, 30)
    assert not found[-1].any()
    for start, block in zip(starts[:-1], found, strict=False):
        here = (time >= start) & (time < start + 2.0)
        x, y = (time[here] - start) / 2.0, values[here]
        hann = 0.5 - 0.5 * np.cos(2.0 * np.pi * x)
        line = np.polynomial.Polynomial.fit
        weight = np.sqrt(hann * np.gradient(x, edge_order=1))
        left = y - np.stack([line(x, column, 1, w=weight)(x) for column in y.T], axis=1)
        wave = hann[:, None] * np.exp(-2j * np.pi * np.outer(x, np.arange(2, 32)))
        expected = trapezoid(left.T[:, :, None] * wave, x, axis=1)
        np.testing.assert_allclose(block, expected, atol=1e-5 * np.abs(found).max())


def test_integrals_of_a_straight_line_are_none_and_grow_with_the_signal():
    time = np.sort(np.random.default_rng(4).uniform(0.0, 4.0, 900))
    lines = np.outer(time, [3.0, -2.0, 0.0]) + np.array([1.0, 50.0, -7.0])
    noise = np.random.default_rng(5).normal(size=lines.shape)
    starts = np.array([0.0, 1.3])
    assert np.abs(integrals(time, lines, starts, 2.0, 1, 9)).max() < 1e-13
    once, twice = (integrals(time, k * noise + lines, starts, 2.0, 1, 9) for k in (1.0, 2.0))
    np.testing.assert_allclose(twice, 2.0 * once, atol=1e-13)


def test_integrals_of_a_wave_are_half_its_amplitude_at_its_harmonic_and_half_of_that_beside_it():
    """Hann's window: the integral of sin^2(pi x) exp(2 pi i k x) over a block is 1/2 at k = 0 and -1/4 beside it."""
    time = np.linspace(0.0, 2.0, 4001)
    wave = 3.0 * np.cos(2.0 * np.pi * 10.0 * time / 2.0)[:, None]
    found = np.abs(integrals(time, wave, np.array([0.0]), 2.0, 8, 5)[0, 0])
    np.testing.assert_allclose(found, 3.0 * np.array([0.0, 0.125, 0.25, 0.125, 0.0]), atol=2e-3)
