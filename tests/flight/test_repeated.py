"""A part of a recording that stands in it twice."""

import numpy as np
import pytest

from wrenchgap.flight.checks.repeated import repeated
from wrenchgap.flight.flight import Flight, ImuSeries


def log(rows, rate=100.0):
    """A flight of an IMU with these rows (N, 6)."""
    time = np.arange(len(rows)) / rate
    return Flight("a", "/a", "0", 0, imu=ImuSeries("/imu", time, rows[:, :3], rows[:, 3:]))


def noise(seconds, rate=100.0, seed=1):
    return np.random.default_rng(seed).standard_normal((int(seconds * rate), 6))


def test_a_stretch_that_comes_again_is_told_with_its_place():
    """Five seconds, pasted in behind twenty; from the second on."""
    once = noise(20.0)
    (check,) = repeated(log(np.concatenate([once, once[100:600], noise(10.0, seed=2)])))
    assert check.level == "bad"
    assert check.words.startswith(
        "5.0 s of the IMU's samples stand in the log twice, from 20.0 s on those of 19.0 s before"
    )


@pytest.mark.parametrize(
    "rows",
    [
        noise(30.0),
        np.round(noise(30.0), 0),  # coarse: single rows come again by chance
        np.zeros((3000, 6)),  # dead
        np.repeat(noise(10.0), 3, axis=0),  # held
        np.concatenate([noise(20.0), noise(20.0)[:50]]),  # half a second
    ],
)
def test_what_only_looks_alike_is_no_repetition(rows):
    assert list(repeated(log(rows))) == []
