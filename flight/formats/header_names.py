"""The names of columns that are known, their units, and what the firmwares of small multirotors call theirs.

Sources: the log variables' descriptions in bitcraze/crazyflie-firmware (`stateEstimate.pitch` is "legacy CF2 body
coordinate system, where pitch is inverted"; `motor.m1` "[0 - UINT16_MAX]"); betaflight/blackbox-tools, whose
`blackbox_decode` writes rates and accelerations as they are logged unless told otherwise.
"""

import numpy as np

from wrenchgap.flight.flight import DEGREE, GRAVITY, RPM

UNITS: dict[str, dict[str, float]] = {
    "time": {"s": 1.0, "sec": 1.0, "seconds": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9},
    "rate": {"rad s": 1.0, "rads": 1.0, "radps": 1.0, "deg s": DEGREE, "degs": DEGREE, "dps": DEGREE},
    "acceleration": {
        **dict.fromkeys(("m s2", "m s 2", "m s s", "mps2", "mss", "ms2"), 1.0),
        "g": GRAVITY,
        "mg": 1e-3 * GRAVITY,
        "counts": 1.0,
    },
    "length": {"m": 1.0, "cm": 1e-2, "mm": 1e-3},
    "speed": {"m s": 1.0, "mps": 1.0, "cm s": 1e-2, "mm s": 1e-3, "km h": 1.0 / 3.6},
    "angle": {"rad": 1.0, "deg": DEGREE, "degrees": DEGREE, "deg nose up": -DEGREE},
    "number": {},
    "force": {"n": 1.0, "mn": 1e-3},
    "torque": {"nm": 1.0, "n m": 1.0, "nmm": 1e-3, "mnm": 1e-3},
    "rotor": {"rad s": 1.0, "rads": 1.0, "radps": 1.0, "rpm": RPM, "krpm": 1e3 * RPM, "hz": 2.0 * np.pi},
    "tilt": {"rad": 1.0, "deg": DEGREE},
    "voltage": {"v": 1.0, "volt": 1.0, "mv": 1e-3, "m v": 1e-3},
}
"""Factors to SI by quantity; "/", "^" and "*" of a unit are read as blanks."""
OTHER_ROTOR_UNITS = {
    **dict.fromkeys(("pwm", "us"), "pwm"),
    **dict.fromkeys(("normalised", "normalized", "norm"), "normalised"),
    "of 65535": "of 65535",
}
"""Units of rotor commands that are no speeds."""

XYZ, WXYZ = "xyz", "wxyz"
NAMES: tuple[tuple[str, str, str, str], ...] = (
    ("time", "time", "", "time t timestamp stamp seconds sec secs elapsed elapsed_time time_stamp timeus log_time"),
    ("rotor", "rotor", "number", "motor rotor rotor_speed motor_speed esc omega w m rpm pwm throttle motor_cmd"),
    ("rotor", "rotor", "number", "motor_m motor_motor_m"),
    ("rotor", "rotor", "number", "motor_command motor_rpm rotor_rpm esc_rpm motor_pwm esc_pwm motor_throttle"),
    ("tilt", "tilt", "number", "tilt tilt_angle servo servo_angle arm_angle alpha"),
    ("est position", "length", XYZ, "state_estimate"),
    ("est velocity", "speed", XYZ, "state_estimate_v"),
    ("est acceleration", "acceleration", XYZ, "state_estimate_a"),
    ("est orientation", "number", WXYZ, "state_estimate_q"),
    ("est roll", "angle", "", "state_estimate_roll stabilizer_roll"),
    ("est pitch", "angle", "", "state_estimate_pitch stabilizer_pitch"),
    ("est yaw", "angle", "", "state_estimate_yaw stabilizer_yaw"),
    ("ref position", "length", XYZ, "ctrltarget"),
    ("gyro", "rate", XYZ, "gyro_adc"),
    ("acc", "acceleration", XYZ, "acc_smooth"),
    ("gyro", "rate", XYZ, "gyro gyr gyroscope angular_velocity ang_vel angvel omega body_rate w g"),
    ("acc", "acceleration", XYZ, "acc accel accelerometer linear_acceleration specific_force acceleration a"),
    ("position", "length", XYZ, "position pos translation p"),
    ("position", "length", "bare", ""),
    ("velocity", "speed", XYZ, "velocity vel linear_velocity v"),
    ("orientation", "number", WXYZ, "orientation quaternion quat attitude rotation q"),
    ("roll", "angle", "", "roll phi"),
    ("pitch", "angle", "", "pitch theta"),
    ("yaw", "angle", "", "yaw psi heading"),
    ("force", "force", XYZ, "force wrench_force f thrust"),
    ("torque", "torque", XYZ, "torque moment tau wrench_torque t"),
    ("voltage", "voltage", "", "voltage battery vbat battery_voltage bat_voltage battery_volt"),
    ("voltage", "voltage", "", "pm_vbat vbat_latest"),
)
"""Field, quantity, axes and spellings, which are words joined by `_`; what is spelt out more comes first."""

REFERENCE = frozenset({"ref", "reference", "des", "desired", "setpoint", "sp", "target"})
KNOWN = REFERENCE | frozenset(
    {"imu", "odom", "odometry", "state", "vehicle", "body", "pose", "twist", "mocap", "vicon", "est", "estimate", "cmd"}
    | {"command", "commanded", "wrench", "drone", "uav", "quad", "world", "local", "linear", "angular", "ground"}
    | {"truth", "header", "sensor", "battery", "actuators", "actuator", "att", "pwr", "log", "cf", "crazyflie"}
)
"""Words that may stand before a name."""
CRAZYFLIE, BLACKBOX = "Crazyflie", "Betaflight or INAV"
FIRMWARE_UNITS: dict[str, tuple[str, str]] = {
    **dict.fromkeys(("motor_m", "motor_motor_m"), (CRAZYFLIE, "of 65535")),
    **dict.fromkeys(("state_estimate", "ctrltarget"), (CRAZYFLIE, "m")),
    "state_estimate_v": (CRAZYFLIE, "m s"),
    "state_estimate_a": (CRAZYFLIE, "g"),
    **dict.fromkeys(("state_estimate_roll", "stabilizer_roll"), (CRAZYFLIE, "deg")),
    **dict.fromkeys(("state_estimate_pitch", "stabilizer_pitch"), (CRAZYFLIE, "deg nose up")),
    **dict.fromkeys(("state_estimate_yaw", "stabilizer_yaw"), (CRAZYFLIE, "deg")),
    "pm_vbat": (CRAZYFLIE, "v"),
    "gyro_adc": (BLACKBOX, "deg s"),
    "acc_smooth": (BLACKBOX, "counts"),
    "vbat_latest": (BLACKBOX, "raw"),
}
"""Names that one firmware alone has, and the unit in which it logs them, where the header states none."""
