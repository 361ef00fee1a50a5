"""Flat tops, and what looks like them: quantisation, held samples, rest."""

from dataclasses import replace

import numpy as np
import pytest

from wrenchgap.flight.checks.clipping import clipped
from wrenchgap.flight.flight import Flight, ImuSeries

TIME = np.arange(0.0, 20.0, 0.004)
UP = np.array([0.0, 0.0, 9.8])


def flight_of(gyro, accel=None):
    rng = np.random.default_rng(1)
    accel = rng.standard_normal((len(gyro), 3)) + UP if accel is None else accel
    return Flight("f", "f.mcap", "0" * 64, 0, imu=ImuSeries("/imu", TIME[: len(gyro)], gyro, accel))


def moving(noise=0.01):
    rng = np.random.default_rng(2)
    waves = np.stack([np.sin(2 * np.pi * f * TIME + f) for f in (0.3, 0.7, 1.1)], axis=1)
    return 3.0 * waves + noise * rng.standard_normal(waves.shape)


@pytest.mark.parametrize("noise", [0.0, 0.01])
@pytest.mark.parametrize("limit", [2.0, 2.9])
def test_flat_tops_are_said_with_value_and_count(limit, noise):
    gyro = moving(noise)
    gyro[:, 1] = np.minimum(gyro[:, 1], limit)
    (found,) = clipped(flight_of(gyro))
    assert found.name == "clipped"
    count = int(np.sum(gyro[:, 1] == limit))
    assert f"y at +{limit:.4g} rad/s in {count} samples" in found.words
    assert found.level == ("bad" if count > 0.05 * len(gyro) else "warn")


def test_the_lower_end_of_one_long_flat_top_of_an_accelerometer():
    accel = moving() + UP
    accel[2000:2200, 2] = 6.0 - (np.arange(200) - 100) ** 2 / -5000.0
    accel[:, 2] = np.maximum(accel[:, 2], accel[2050, 2])
    (found,) = clipped(flight_of(moving(), accel))
    assert "accelerometer" in found.words
    assert " z at +6" in found.words


@pytest.mark.parametrize(
    "change",
    [
        lambda v: v,
        lambda v: np.round(v, 2),
        lambda v: np.round(v / 0.06) * 0.06,
        lambda v: np.repeat(v[::5], 5, axis=0),
    ],
    ids=["noise", "fine steps", "coarse steps", "held samples"],
)
def test_healthy_channels_have_none(change):
    gyro = change(moving())
    assert list(clipped(flight_of(gyro, moving() + UP))) == []


def test_rest_is_no_flat_top():
    """Free of noise, as in a simulator, with the largest value of a channel at rest."""
    gyro, accel = -np.abs(moving()), moving() - [0.0, 0.0, 20.0]
    gyro[1000:2000], accel[1000:2000] = 0.0, [0.0, 0.0, 9.8]
    assert list(clipped(flight_of(gyro, accel))) == []


@pytest.mark.parametrize("still", [0.0, 1.0])
def test_a_channel_that_hardly_ever_changes_is_not_clipped(still):
    """A planar flight of a simulator without noise: one rate is zero but for a moment, the others go on."""
    gyro = moving()
    gyro[:, 0] = still
    gyro[3000:4000, 0] += np.abs(gyro[3000:4000, 1])
    assert list(clipped(flight_of(gyro))) == []
    gyro[:, 0] = still
    assert list(clipped(flight_of(gyro))) == []


def test_an_axis_that_was_not_measured_is_passed_over():
    gyro = moving()
    gyro[:, 0] = np.nan
    assert list(clipped(flight_of(gyro))) == []
    assert list(clipped(replace(flight_of(gyro), imu=None))) == []
