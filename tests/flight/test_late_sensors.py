"""One sensor of the IMU behind a low-pass or a clock that the other lacks, on a motion in closed form."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import butter, sosfilt
from scipy.spatial.transform import Rotation

from tests.flight.test_accelerometer_scale import flown
from wrenchgap.flight.checks.late_sensors import late_sensors
from wrenchgap.flight.flight import ImuSeries
from wrenchgap.flight.stamps import gaps_of

RATE = 250.0
SENSORS = {"omega_B": ("gyroscope", "torques"), "specific_force_B": ("accelerometer", "forces")}


def filtered(flight, *fields, hertz=5.0):
    """Behind a first-order low-pass, which makes slow motion late by 1 / (2 pi hertz)."""
    sections = butter(1, hertz, fs=RATE, output="sos")
    imu = flight.imu
    changed = {}
    for name in fields:
        values = getattr(imu, name)
        changed[name] = values[0] + sosfilt(sections, values - values[0], axis=0)
    return replace(flight, imu=replace(imu, **changed))


def shifted(flight, name, samples=8):
    values = getattr(flight.imu, name)
    return replace(flight, imu=replace(flight.imu, **{name: np.roll(values, samples, axis=0)}))


@pytest.mark.parametrize("name", SENSORS)
@pytest.mark.parametrize("how", [filtered, shifted])
def test_a_sensor_that_is_later_than_the_other_is_said_with_by_how_much(name, how):
    sensor, what = SENSORS[name]
    flight = flown(seconds=60.0, vibration=0.1)
    (found,) = late_sensors(how(flight, name), ())
    assert (found.name, found.level) == ("rate", "warn")
    assert found.words.startswith(f"The {sensor} is ")
    assert f"The {what} come late" in found.words
    assert float(found.words.split()[3]) == pytest.approx(
        1e3 / (2 * np.pi * 5.0), abs=3.0
    )  # 8 samples are 32 ms as well


@pytest.mark.parametrize("step", [0.08, -0.08, 0.04])
def test_stamps_that_step_in_flight_are_said_with_when_and_by_how_much(step):
    flight = flown(seconds=60.0)
    imu = flight.imu
    time = imu.time + step * (imu.time > 36.0)
    kept = (imu.time <= 36.0) | (time > 36.0)  # a reader keeps the order of stamps
    stepped = ImuSeries("/imu", time[kept], imu.omega_B[kept], imu.specific_force_B[kept], gaps=gaps_of(time[kept]))
    (found,) = late_sensors(replace(flight, imu=stepped), ())
    assert (found.name, found.level) == ("clock-jump", "warn")
    said = re.match(r"From about (\d+) s on the IMU's stamps are (\d+) ms (later|earlier) than before", found.words)
    assert float(said[1]) == pytest.approx(36.0, abs=8.0)  # a block
    assert float(said[2]) == pytest.approx(1e3 * abs(step), abs=8.0)
    assert said[3] == ("later" if step > 0.0 else "earlier")


def swinging(flight, hertz=12.5, size=6.0):
    """As a slung load pulls: a motion along x that is alike after every 80 ms."""
    imu, odometry, rate = flight.imu, flight.odometry, 2.0 * np.pi * hertz
    pull, speed = np.zeros((len(imu.time), 3)), np.zeros((len(odometry.time), 3))
    pull[:, 0], speed[:, 0] = size * np.cos(rate * imu.time), size / rate * np.sin(rate * odometry.time)
    turn = Rotation.from_quat(odometry.quat_EB, scalar_first=True)
    return replace(
        flight,
        imu=replace(imu, specific_force_B=imu.specific_force_B + pull),
        odometry=replace(odometry, velocity_E=odometry.velocity_E + turn.apply(speed)),
    )


def test_a_sensor_that_is_late_by_a_period_of_what_swings_is_not_taken_for_one_that_is_not():
    flight = swinging(flown(seconds=60.0, vibration=0.1, tilt=0.02))
    assert not list(late_sensors(flight, ()))
    (found,) = late_sensors(shifted(flight, "specific_force_B", samples=20), ())
    assert found.words.startswith("The accelerometer is ")
    assert float(found.words.split()[3]) == pytest.approx(80.0, abs=3.0)


@pytest.mark.parametrize(
    "how",
    [
        {},
        {"late": 0.05},
        {"late": -0.03},
        {"odometry_hz": 20.0},
        {"velocity": False},
        {"vibration": 3.0},
    ],
    ids=lambda how: ", ".join(how) or "as it is",
)
def test_an_odometry_that_is_late_or_slow_or_noise_are_no_late_sensor(how):
    flight = flown(seconds=60.0, **how)
    assert not list(late_sensors(flight, ()))
    assert not list(late_sensors(filtered(flight, *SENSORS), ()))
