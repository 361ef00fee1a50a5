import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from wrenchgap.flight.errors import ModelError
from wrenchgap.plant.mismatch import LinearMismatch, conditioning

TORQUES = ("torque_x", "torque_y", "torque_z")


def line(gain_z: float) -> LinearMismatch:
    gain = np.zeros((3, 6))
    gain[2, 5] = gain_z
    gain[0, :3] = 7.0  # a dependence on force, whose column is no part of the correction
    return LinearMismatch(TORQUES, np.array([0.1, 0.2, 0.3]), gain, np.full(3, 0.05))


@given(st.floats(-3, 3))
@example(-1.0)
def test_conditioning_of_one_axis_is_its_gain(gain_z):
    """At a gain of -1, the trap of a closed loop, the singular value is zero."""
    result = conditioning(line(gain_z), np.zeros((4, 6)))
    assert result.real_min == pytest.approx(np.full(4, min(1.0, 1 + gain_z)))
    assert result.singular_min == pytest.approx(np.full(4, min(1.0, abs(1 + gain_z))), abs=1e-12)


def test_rotation_has_negative_real_part_but_full_singular_value():
    """Torque turned by 120 deg about z: solvable by inversion, though simple feedback would diverge."""
    c, s = np.cos(np.deg2rad(120)), np.sin(np.deg2rad(120))
    gain = np.zeros((2, 6))
    gain[:, 3:5] = [[c - 1, -s], [s, c - 1]]
    result = conditioning(LinearMismatch(TORQUES[:2], np.zeros(2), gain, np.ones(2)), np.zeros((1, 6)))
    assert result.real_min[0] == pytest.approx(-0.5)
    assert result.singular_min[0] == pytest.approx(1.0)


def test_line_is_its_own_tangent():
    rng = np.random.default_rng(3)
    model = line(0.4)
    wrench, step = rng.normal(size=(5, 6)), rng.normal(size=(5, 6))
    change = model.mean(wrench + step) - model.mean(wrench)
    assert change == pytest.approx(np.einsum("nld,nd->nl", model.jacobian(wrench), step))


@pytest.mark.parametrize("outputs", [(), ("torque_q",), ("torque_x", "torque_x")])
def test_output_names_are_checked(outputs):
    with pytest.raises(ModelError, match="torque"):
        LinearMismatch(outputs, np.zeros(len(outputs)), np.zeros((len(outputs), 6)), np.ones(len(outputs)))


def test_shapes_are_checked():
    with pytest.raises(ModelError, match=r"gain has shape \(3, 3\), expected \(3, 6\)"):
        LinearMismatch(TORQUES, np.zeros(3), np.zeros((3, 3)), np.ones(3))
