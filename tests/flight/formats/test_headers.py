"""Headers as people write them; what a header does not say is not invented."""

import numpy as np
import pytest

from wrenchgap.flight.formats.headers import meaning

DEG = np.pi / 180


@pytest.mark.parametrize(
    ("header", "field", "index", "factor"),
    [
        ("t", "time", 0, 1.0),
        ("time [us]", "time", 0, 1e-6),
        ("timestamp_ns", "time", 0, 1e-9),
        ("TimeUS", "time", 0, 1e-6),
        ("gyro_x", "gyro", 0, 1.0),
        ("gyroZ", "gyro", 2, 1.0),
        ("gyro_y_dps", "gyro", 1, DEG),
        ("gyro_y [deg/s]", "gyro", 1, DEG),
        ("imu.angular_velocity.z", "gyro", 2, 1.0),
        ("wx", "gyro", 0, 1.0),
        ("acc_x_g", "acc", 0, 9.80665),
        ("linear_acceleration_x (m/s^2)", "acc", 0, 1.0),
        ("x", "position", 0, 1.0),
        ("pose.pose.position.y", "position", 1, 1.0),
        ("position_z_mm", "position", 2, 1e-3),
        ("ref_pos_z", "ref position", 2, 1.0),
        ("qw", "orientation", 0, 1.0),
        ("q[3]", "orientation", 3, 1.0),
        ("yaw_deg", "yaw", 0, DEG),
        ("torque_x [Nmm]", "torque", 0, 1e-3),
        ("desired_force_z", "ref force", 2, 1.0),
        ("motor_1", "rotor", 1, 1.0),
        ("m4", "rotor", 4, 1.0),
        ("rpm_2", "rotor", 2, np.pi / 30),
        ("omega_1", "rotor", 1, 1.0),
        ("omega_x", "gyro", 0, 1.0),
        ("servo_1_deg", "tilt", 1, DEG),
        ("battery_voltage_mV", "voltage", 0, 1e-3),
    ],
)
def test_what_a_header_says(header, field, index, factor):
    found = meaning(header)
    assert (found.field, found.index) == (field, index)
    assert found.factor == pytest.approx(factor)


@pytest.mark.parametrize(
    "header", ["payload_position_x", "mag_x", "gyro_bias_x", "gyro_x [furlong]", "temp", "u1", "a"]
)
def test_what_it_does_not_say(header):
    assert meaning(header) is None


@pytest.mark.parametrize("header", [" " * 5000 + "[a", "gyro_x" + " [" * 5000, "1" * 100_000, "a b " * 50_000])
def test_what_is_too_long_for_a_name_is_none(header):
    assert meaning(header) is None  # by a search through all its parts it would not end


@pytest.mark.parametrize(("header", "unit"), [("pwm_1", "pwm"), ("motor_1 [us]", "pwm"), ("throttle_2", "normalised")])
def test_commands_that_are_no_speeds(header, unit):
    assert meaning(header).unit == unit
