"""FRD and NED to FLU and ENU, pinned by what a pilot would see."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from wrenchgap.flight import so3
from wrenchgap.flight.formats.ned_frd import enu, flu, quat_flu_to_enu, quat_of_euler

X, Y, Z = np.eye(3)
EAST, NORTH, UP = np.eye(3)
ANGLE = st.floats(-3.0, 3.0)


def test_level_and_heading_north_body_x_is_north_and_body_y_is_west():
    q = quat_flu_to_enu(np.array([1.0, 0.0, 0.0, 0.0]))
    np.testing.assert_allclose(so3.rotate(q, X), NORTH, atol=1e-12)
    np.testing.assert_allclose(so3.rotate(q, Y), -EAST, atol=1e-12)
    np.testing.assert_allclose(so3.rotate(q, Z), UP, atol=1e-12)


def test_pitched_up_heading_north_the_nose_points_north_and_up():
    q = quat_flu_to_enu(quat_of_euler(0.0, np.radians(30.0), 0.0))
    np.testing.assert_allclose(so3.rotate(q, X), np.cos(np.pi / 6) * NORTH + 0.5 * UP, atol=1e-12)


def test_rolled_right_heading_east_the_left_side_rises_on_the_north():
    q = quat_flu_to_enu(quat_of_euler(np.radians(20.0), 0.0, np.radians(90.0)))
    left = so3.rotate(q, Y)
    np.testing.assert_allclose(left, np.cos(np.radians(20)) * NORTH + np.sin(np.radians(20)) * UP, atol=1e-12)
    np.testing.assert_allclose(so3.rotate(q, X), EAST, atol=1e-12)


def test_a_body_that_climbs_and_moves_east():
    np.testing.assert_array_equal(enu(np.array([0.0, 3.0, -2.0])), [3.0, 0.0, 2.0])


def test_an_accelerometer_at_rest_reads_up_and_pitching_up_turns_about_the_right_wing():
    np.testing.assert_array_equal(flu(np.array([0.0, 0.0, -9.81])), 9.81 * Z)
    np.testing.assert_array_equal(flu(np.array([0.0, 0.3, 0.0])), -0.3 * Y)


@given(ANGLE, ANGLE, ANGLE, st.tuples(*[st.floats(-5, 5)] * 3))
def test_a_vector_is_the_same_whichever_way_it_is_taken_from_frd_to_enu(roll, pitch, yaw, vector):
    q_frd_ned = quat_of_euler(roll, pitch, yaw)
    through_ned = enu(so3.rotate(q_frd_ned, np.array(vector)))
    np.testing.assert_allclose(so3.rotate(quat_flu_to_enu(q_frd_ned), flu(np.array(vector))), through_ned, atol=1e-9)
