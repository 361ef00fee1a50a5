"""Stamps that the user moves."""

import numpy as np
import pytest

from wrenchgap.flight import load, shifted
from wrenchgap.flight.errors import UsageError


def test_only_the_named_topic_moves_and_it_is_on_record(plain):
    before = load(plain)
    after = shifted(before, {"odometry": -0.0123})
    np.testing.assert_allclose(after.odometry.time, before.odometry.time - 0.0123)
    np.testing.assert_array_equal(after.odometry.position_E, before.odometry.position_E)
    assert after.imu is before.imu
    assert after.shifts == {"odometry": -0.0123}
    assert any("/odometry (odometry) moved by -12.3 ms" in note for note in after.notes)
    assert shifted(before, {"/odometry": -0.0123}).shifts == {"odometry": -0.0123}
    assert shifted(before, {}) == before


@pytest.mark.parametrize(
    ("shifts", "words"),
    [
        ({"commanded": 0.01}, "command_delay"),
        ({"/nobody": 0.01}, r"can be moved: imu \(/imu\), odometry"),
        ({"imu": 12.0}, "at most 10"),
        ({"imu": float("nan")}, "at most 10"),
        ({"imu": 0.01, "/imu": 0.02}, "shifted twice"),
    ],
)
def test_what_makes_no_sense_is_refused(plain, shifts, words):
    with pytest.raises(UsageError, match=words):
        shifted(load(plain), shifts)
