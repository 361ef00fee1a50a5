"""Drag of the body at its centre of pressure."""

import numpy as np
import pytest

from wrenchgap.flight.so3 import rotate


def test_opposes_the_motion_whatever_the_attitude(bench):
    x = bench.state(velocity=(2.0, -1.0, 0.5), quat=bench.turned)
    W = bench.added("body_drag", [0.1, 0.2, 0.3, 0.05, 0.05, 0.1, 0, 0, 0], x=x)
    assert bench.power(W, x) < 0
    isotropic = bench.added("body_drag", [0.3, 0.3, 0.3, 0, 0, 0, 0, 0, 0], x=x)
    np.testing.assert_allclose(rotate(bench.turned, isotropic[:3]), -0.3 * x.velocity_E[0], atol=1e-12)


def test_above_the_centre_of_mass_pitches_the_nose_up_in_forward_flight(bench):
    W = bench.added("body_drag", [0.5, 0, 0, 0, 0, 0, 0, 0, 0.1], x=bench.state(velocity=(2.0, 0.0, 0.0)))
    assert W[0] == pytest.approx(-1.0)  # backward, 0.1 m above
    assert W[4] == pytest.approx(-0.1)  # about -y: in FLU the nose goes up
