"""The corrected allocation in the loop of an engine that shares no code with it: docs/effectiveness.md has more."""

import numpy as np
import pytest

from benchmarks.corrected_allocation import outcome


@pytest.mark.slow
@pytest.mark.parametrize(("effect", "most"), [("weak_rotor", 0.05), ("tilt_offset", 0.05), ("wake", 0.8)])
def test_what_was_named_and_fitted_is_allocated_around(effect, most):
    """RMS of the attitude error on a flight that was not seen, over that with the nominal allocation."""
    row = outcome(effect, 1, seconds=10.0)
    attitude, position = np.array(row["corrected"]) / np.array(row["nominal"])
    assert attitude < most
    assert position < 1.05


@pytest.mark.slow
def test_where_nothing_is_wrong_with_the_rotors_it_changes_nothing():
    row = outcome("servo_lag", 1, seconds=10.0)
    np.testing.assert_allclose(row["corrected"], row["nominal"], rtol=0.05)
