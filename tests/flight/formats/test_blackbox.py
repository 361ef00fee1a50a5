"""Tables as `blackbox_decode` writes them, and the logs that it reads."""

import shlex

import numpy as np
import pytest

from wrenchgap import flight
from wrenchgap.flight.errors import LogError
from wrenchgap.flight.flight import GRAVITY

TIME = np.arange(0, 4.0, 0.002)


def decoded(path, motor, one_g=2048, gyro_unit="", **more):
    """Write a table with a space behind each comma, words among the numbers, and the motion that is returned."""
    rate = np.round(np.stack([100 * np.sin(k * TIME) for k in (1, 2, 3)], axis=1))
    felt = np.round(one_g * np.stack([0.1 * np.sin(TIME), 0 * TIME, 1 + 0.1 * np.cos(TIME)], axis=1))
    columns = {"loopIteration": np.arange(len(TIME)), "time (us)": np.round(55158008 + 1e6 * TIME)}
    columns |= {f"rcCommand[{i}]": 0 * TIME for i in range(4)} | {f"setpoint[{i}]": 0 * TIME for i in range(4)}
    columns |= {"vbatLatest (V)": 15.6 - 0.01 * TIME}
    columns |= {f"gyroADC[{i}]{gyro_unit}": rate[:, i] for i in range(3)}
    columns |= {f"accSmooth[{i}]": felt[:, i] for i in range(3)}
    columns |= {f"motor[{i}]": motor[:, i] for i in range(motor.shape[1])} | more
    lines = [", ".join([*columns, "flightModeFlags (flags)", "failsafePhase (flags)"])]
    lines += [
        ", ".join([*(f"{v:3.10g}" for v in row), "ANGLE_MODE|AIR", "IDLE"])
        for row in zip(*columns.values(), strict=True)
    ]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return rate, felt


def outputs(low, high):
    return np.linspace(low, high, len(TIME) * 4).reshape(-1, 4)


def test_rates_accelerations_outputs_and_battery(tmp_path):
    rate, felt = decoded(tmp_path / "LOG00001.01.csv", outputs(48.0, 2047.0))
    found = flight.load(tmp_path / "LOG00001.01.csv")
    np.testing.assert_allclose(found.imu.omega_B, np.radians(rate), atol=1e-12)
    np.testing.assert_allclose(found.imu.specific_force_B, felt * GRAVITY / 2048)
    assert found.actuators.unit == "normalised"
    np.testing.assert_allclose([found.actuators.rotor_speed.min(), found.actuators.rotor_speed.max()], [0.0, 1.0])
    np.testing.assert_allclose(found.battery.voltage, 15.6 - 0.01 * TIME)
    assert any("2048 of them are read as 1 g" in note for note in found.notes)


def test_outputs_that_are_pulses_and_rates_whose_unit_is_stated(tmp_path):
    rate, _ = decoded(tmp_path / "log.csv", outputs(1000.0, 2000.0), one_g=512, gyro_unit=" (rad/s)")
    found = flight.load(tmp_path / "log.csv")
    assert (found.actuators.unit, found.actuators.rotor_speed.max()) == ("pwm", 2000.0)
    np.testing.assert_allclose(found.imu.omega_B, rate)


def test_counts_that_no_sensor_has_are_left_out_with_the_option_to_type(tmp_path):
    _, felt = decoded(tmp_path / "log.csv", outputs(48.0, 2047.0), one_g=3000)
    found = flight.load(tmp_path / "log.csv")
    assert np.isnan(found.imu.specific_force_B).all()
    assert any("--topic accelerometer=/table.accSmooth*F" in note for note in found.notes)
    told = flight.load(tmp_path / "log.csv", {"accelerometer": f"/table.accSmooth*{GRAVITY / 3000}"})
    np.testing.assert_allclose(told.imu.specific_force_B, felt * GRAVITY / 3000, rtol=1e-6)


def test_electrical_speed_is_read_with_the_number_of_magnets(tmp_path):
    electrical = {f"eRPM[{i}]": np.full(len(TIME), 1400.0) for i in range(4)}
    decoded(tmp_path / "log.csv", outputs(48.0, 2047.0), **electrical)
    found = flight.load(tmp_path / "log.csv")
    assert any("--topic rotor_speed=/table.eRPM*F" in note for note in found.notes)
    turning = flight.load(tmp_path / "log.csv", {"rotor_speed": "/table.eRPM*1.496"}).actuators.rotor_speed
    np.testing.assert_allclose(turning, 1400 * 100 / 7 * 2 * np.pi / 60, rtol=1e-4)  # 14 magnets are 7 pairs


def test_outputs_that_are_neither_are_not_used(tmp_path):
    decoded(tmp_path / "log.csv", outputs(0.0, 30000.0))
    found = flight.load(tmp_path / "log.csv")
    assert found.actuators is None
    assert any("not used" in note for note in found.notes)


@pytest.mark.parametrize("name", ["LOG00001.BFL", "my log.bbl", "--prefix=a.bbl"])
def test_a_blackbox_log_names_its_converter(tmp_path, name):
    path = tmp_path / name
    path.write_bytes(b"H Product:Blackbox flight data recorder by Nicholas Sherlock\nH Data version:2\nI\x00\x01")
    with pytest.raises(LogError, match=r"blackbox_decode .*\.csv") as error:
        flight.load(path)
    command = shlex.split(str(error.value).split("`")[1])
    assert command == ["blackbox_decode", str(path)], "the file where it is, and no option"
    assert "\n" not in str(error.value)
