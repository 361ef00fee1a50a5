"""Lower rotors in the wake of the upper."""

import pytest


def test_takes_from_the_lower_rotors_only(bench):
    W = bench.added("coaxial_loss", {"eta": 0.2})
    assert W[2] == pytest.approx(-0.2 * bench.weight / 2)
