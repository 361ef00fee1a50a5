"""Flights of the shipped Crazyflie as a table with the firmware's names, as a client of the radio logs them."""

import numpy as np
import pandas as pd

import wrenchgap as wg
from wrenchgap.flight.flight import GRAVITY

VOLTS = 4.0
"""Of the battery, throughout: a motor at full PWM then makes 0.15 N."""
OFFSET = "com_offset=x:0.003,y:-0.002"
"""Where the centre of mass is [m], of which no file knows."""


def flight(seed, *hidden):
    """A flight of it with the hidden centre of mass, and what else is hidden."""
    crazyflie = wg.load_model("crazyflie")
    return wg.simulate(crazyflie, "multi_axis", seed=seed, duration=12.0, excitation=0.5, hide=[OFFSET, *hidden])


def write_table(flown, path, rate=100.0):
    """The flight in deg/s, g, m and PWM of 16 bits."""
    imu, odometry, sent = flown.imu, flown.odometry, flown.actuators
    time = np.arange(0.1, 11.9, 1.0 / rate)

    def at(stamps, values):
        return [np.interp(time, stamps, column) for column in values.T]

    _, rotors = wg.load_model("crazyflie").vehicle.geometry()
    share = np.sqrt(rotors.c_f * sent.rotor_speed**2 / 0.15)
    columns = {"timestamp": 1e3 * time}
    for name, stamps, values, letters in (
        ("gyro", imu.time, np.degrees(imu.omega_B), "xyz"),
        ("acc", imu.time, imu.specific_force_B / GRAVITY, "xyz"),
        ("stateEstimate", odometry.time, odometry.position_E, "xyz"),
        ("stateEstimate.v", odometry.time, odometry.velocity_E, "xyz"),
        ("stateEstimate.q", odometry.time, odometry.quat_EB, "wxyz"),
        ("motor.m", sent.time, np.round(65535 * share), "1234"),
    ):
        dot = "" if "." in name else "."
        columns |= {f"{name}{dot}{letter}": column for letter, column in zip(letters, at(stamps, values), strict=True)}
    pd.DataFrame(columns | {"pm.vbat": np.full(len(time), VOLTS)}).to_csv(path, index=False)
    return path
