"""Wakes of neighbouring arms."""

import numpy as np
import pytest


def test_wake_hurts_only_who_stands_downstream(bench):
    """All arms tilted by +90 deg blow around the circle: everybody stands in somebody's wake. At hover nobody does."""
    values = {"loss": 0.3, "width": 1.2}
    assert abs(bench.added("rotor_interference", values)[2]) < 5e-3 * bench.weight
    around = bench.commands(np.pi / 2)
    nominal = bench.model().wrench(around, bench.state())[0, 5]
    assert bench.added("rotor_interference", values, around)[5] / nominal < -0.01


@pytest.mark.parametrize(("tilt", "hit"), [(-np.pi / 2, False), (np.pi / 2, True)])
def test_wake_of_one_arm_reaches_the_arm_it_blows_at(bench, tilt, hit):
    """Arm 0 (at +x) tilted by -90 deg thrusts along +y, so its wake leaves along -y, away from arm 1 (60 deg)."""
    u = bench.commands(np.where(np.arange(6) == 0, tilt, 0.0), np.where(np.arange(12) < 4, 700.0, 0.0))
    lost = -bench.added("rotor_interference", {"loss": 0.5, "width": 3.0}, u)[2]
    assert (lost > 0.05) == hit
