"""What sits at one frequency is seen there, however little it is over all; noise, trends and inexact laws are not."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

from wrenchgap.learn.posterior.settings import DEFAULT
from wrenchgap.learn.posterior.verdict import FAR, unexplained_bands

FORCE_Y, TORQUE_X = 1, 3


def sensed(data, seed):
    """(K, 6) of what white sensors leave behind a filter forward and backward, differentiated for torques."""
    rng = np.random.default_rng(seed)
    out = []
    for r in data.records:
        n, every, margin = len(r) + 80, 10, 40
        white = rng.standard_normal((n * every, 6))
        white[:, 3:] = np.gradient(white[:, 3:], axis=0)
        fine = sosfiltfilt(butter(2, r.cutoff_hz, fs=every / r.dt_kept, output="sos"), white, axis=0)
        out.append(fine[::every][margin:-margin])
    made = np.concatenate(out)
    return made * data.noise / made.std(axis=0)


def sine(data, hz, size, axis):
    """(K, 6): so many times the sensors' noise, rms, on one axis."""
    time = np.concatenate([r.time for r in data.records])
    out = np.zeros((len(time), 6))
    out[:, axis] = np.sqrt(2.0) * size * data.noise[axis] * np.sin(2 * np.pi * hz * time + 0.3)
    return out


def found(data, inexact=0.0):
    """A likeliest set whose laws may be off by this mean square in every band, on every axis."""
    count = len(np.unique(np.digitize(np.arange(0.0, 0.5 / data.records[0].dt_kept, 0.2), EDGES)))
    scored = SimpleNamespace(inexact=np.broadcast_to(inexact, (count, 6)))
    return SimpleNamespace(best=SimpleNamespace(scored_set=SimpleNamespace(scored=scored)))


EDGES = (0.3, 0.7, 1.2, 2.0, 3.0, 4.5, 6.5, 9.0, 12.0, 16.0)


def bands(data, given, left, inexact=0.0):
    return unexplained_bands(SimpleNamespace(settings=DEFAULT, data=data, given=given), found(data, inexact), left)


@pytest.mark.parametrize("seed", range(4))
def test_sensor_noise_opens_nothing(plain, seed):
    noise = sensed(plain, seed)
    assert bands(plain, noise, noise) == ()


def test_a_swing_of_less_than_the_noise_is_seen_at_its_frequency(plain):
    """All of its power stands in one band, of the noise's that of its width: white, through the filter twice."""
    given = sensed(plain, 1) + sine(plain, 0.95, 0.9, FORCE_Y)
    (only,) = bands(plain, given, given)
    assert (only.axis, only.low_hz, only.high_hz) == (FORCE_Y, 0.7, 1.2)
    hertz = np.linspace(0.0, 0.5 / plain.records[0].dt_kept, 1000)
    passed = (1.0 + (hertz / plain.records[0].cutoff_hz) ** 4) ** -2.0
    power = 0.9**2 * np.trapezoid(passed, hertz) / (1.2 - 0.7)
    assert only.over_noise == pytest.approx(np.sqrt(power + 1.0), rel=0.15)


def test_a_torque_is_held_against_the_noise_of_torques(plain):
    """Angular accelerations are differentiated: at 1.6 Hz their noise is a tenth of what it is at 8 Hz."""
    given = sensed(plain, 1) + sine(plain, 1.6, 0.5, TORQUE_X)
    first = bands(plain, given, given)[0]
    assert (first.axis, first.low_hz, first.high_hz) == (TORQUE_X, 1.2, 2.0)
    force = sensed(plain, 1) + sine(plain, 1.6, 0.5, FORCE_Y)
    assert bands(plain, force, force) == ()


def test_what_the_set_explains_is_not_open(plain):
    noise, swing = sensed(plain, 2), sine(plain, 0.95, 3.0, FORCE_Y)
    assert bands(plain, noise + swing, noise + 0.2 * swing) == ()
    assert bands(plain, noise + swing, noise + 0.9 * swing)


def test_what_laws_may_be_off_by_is_not_open(plain):
    given = sensed(plain, 3) + sine(plain, 0.95, 0.9, FORCE_Y)
    (only,) = bands(plain, given, given)
    mean_square = (only.over_noise * plain.noise[FORCE_Y]) ** 2
    assert bands(plain, given, given, 4.0 * mean_square / FAR**2) == ()
    assert bands(plain, given, given, 0.01 * mean_square / FAR**2) == (only,)


def test_a_trace_of_what_is_explained_elsewhere_is_not_open(plain):
    """Vehicles are never quite symmetric: a fiftieth of what one axis had, on another."""
    noise, swing = sensed(plain, 4), sine(plain, 0.95, 200.0, FORCE_Y)
    beside = swing[:, [FORCE_Y, 0, 2, 3, 4, 5]]
    for share, seen in ((0.02, False), (0.2, True)):
        left = noise + share * beside
        assert bool(bands(plain, left + swing, left)) is seen


def test_one_touch_is_no_verdict(plain):
    """Two seconds of 25, within a block; in all of the time it is."""
    time = np.concatenate([r.time for r in plain.records])
    noise, swing = sensed(plain, 7), sine(plain, 0.95, 30.0, FORCE_Y)
    once = swing * ((time > time[0] + 10.2) & (time < time[0] + 12.2))[:, None]
    assert bands(plain, noise + once, noise + once) == ()
    assert bands(plain, noise + swing, noise + swing)


def test_a_block_that_bends_the_fit_excuses_what_the_set_adds_and_no_more(plain):
    """Fifty times louder for two seconds. All of the time: a set that adds the same swing, or adds nothing there."""
    time = np.concatenate([r.time for r in plain.records])
    noise, swing = sensed(plain, 8), sine(plain, 0.95, 2.0, FORCE_Y)
    once = 50.0 * swing * ((time > time[0] + 10.2) & (time < time[0] + 12.2))[:, None]
    assert bands(plain, noise + once, noise + once + swing) == ()
    assert bands(plain, noise + once + swing, noise + once + swing)


def test_trends_are_nobodys(plain):
    given = sensed(plain, 5) + sine(plain, 0.02, 3.0, FORCE_Y)
    assert bands(plain, given, given) == ()


def test_where_commands_answer_turbulence_nothing_is_said(plain):
    given = sensed(plain, 6) + sine(plain, 0.95, 3.0, FORCE_Y)
    assert bands(plain, given, given)
    assert bands(replace(plain, answering=(3, 4, 5)), given, given) == ()


@pytest.mark.parametrize("blocks", [1, 2, 3])
def test_a_flight_of_few_blocks_is_no_error(plain, blocks):
    """The loudest are left aside, and with them, it may be, all of the time, or that in which there were slow bands."""
    record = plain.records[0]
    count = int(np.searchsorted(plain.block, np.unique(plain.block)[blocks]))
    short = {k: getattr(record, k)[:count] for k in ("time", "measured", "commanded")}
    whole = {k: getattr(plain, k)[:count] for k in ("measured", "commanded", "block", "flight")}
    part = replace(plain, records=(replace(record, **short),), **whole)
    swing = 5.0 * sensed(plain, 1)[:count]
    assert bands(part, swing, swing) == () or blocks > 1
