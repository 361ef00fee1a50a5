"""What an IMU did not measure: said by the user, by NaN throughout, or by a covariance of -1; and never read."""

import re
from dataclasses import replace

import numpy as np
import pytest

from wrenchgap import flight
from wrenchgap.flight.errors import LogError, UsageError
from wrenchgap.flight.unmeasured import Why, axis_names

IMU = "sensor_msgs/msg/Imu"
TIME = np.arange(0, 6, 0.01)


@pytest.fixture
def recorded(logs):
    """A recording with its IMU's fields replaced: `recorded(**{"linear_acceleration.x": values})`."""

    def made(odometry=True, **fields):
        named = {name.replace("__", "."): values for name, values in fields.items()}
        recording = logs.Recording().plain("/command/wrench", TIME)
        if odometry:
            recording.plain("/odometry", TIME[::2])
        columns = logs.Motion(TIME).imu() | named
        return recording.series("/imu", IMU, TIME, columns, stamp_s=True)

    return made


def covariance(first):
    return np.tile([first, *[0.0] * 8], (len(TIME), 1))


def test_an_axis_that_is_never_a_number_costs_no_sample(recorded, loaded, logs):
    found = loaded(recorded(linear_acceleration__x=np.full(len(TIME), np.nan)))
    assert flight.unmeasured_axes(found) == {"force_x": Why.NAN}
    assert len(found.imu.time) == len(TIME)
    assert found.imu.dropped == {}
    assert np.isnan(found.imu.specific_force_B).all(axis=0).tolist() == [True, False, False]
    np.testing.assert_array_equal(found.imu.omega_B, logs.Motion(TIME).omega_B)


def test_a_few_samples_that_are_no_number_are_damage_not_an_axis(recorded, loaded, logs):
    values = logs.Motion(TIME).specific_force_B[:, 0].copy()
    values[100:103] = np.nan
    found = loaded(recorded(linear_acceleration__x=values))
    assert flight.unmeasured_axes(found) == {}
    assert found.imu.dropped == {"not finite": 3}


@pytest.mark.parametrize("form", ["mcap-zstd", "mcap1-zstd", "bag", "folder-sqlite"])
def test_a_covariance_of_minus_one_says_so_in_every_format(form, recorded, tmp_path):
    path = recorded(linear_acceleration_covariance=covariance(-1.0)).save(tmp_path / "log", form)
    found = flight.load(path)
    assert flight.unmeasured_axes(found) == dict.fromkeys(("force_x", "force_y", "force_z"), Why.COVARIANCE)
    assert np.isnan(found.imu.specific_force_B).all()


@pytest.mark.parametrize("first", [0.0, 0.02])
def test_other_covariances_say_nothing(first, recorded, loaded):
    found = loaded(
        recorded(
            linear_acceleration_covariance=covariance(first),
            angular_velocity_covariance=covariance(first),
            orientation_covariance=covariance(-1.0),
        )
    )
    assert flight.unmeasured_axes(found) == {}


def test_minus_one_in_some_messages_only_says_nothing(recorded, loaded):
    some = covariance(-1.0)
    some[200:] = 0.0
    assert flight.unmeasured_axes(loaded(recorded(angular_velocity_covariance=some))) == {}


@pytest.mark.parametrize("filler", [0.0, 1e15, np.nan])
def test_what_stands_in_a_declared_axis_is_not_read(filler, recorded, tmp_path):
    path = recorded(linear_acceleration__x=np.full(len(TIME), filler)).save(tmp_path / "log.mcap")
    found = flight.load(path, unmeasured=["force_x"])
    assert found.unmeasured == {"force_x": Why.DECLARED}
    assert found.imu.dropped == {}
    assert np.isnan(found.imu.specific_force_B[:, 0]).all()
    (samples,) = flight.uniform(found)
    assert samples.unmeasured == ("force_x",)


def test_the_odometry_tells_the_motion_where_the_imu_does_not(recorded, loaded, logs):
    found = loaded(recorded(angular_velocity__y=np.full(len(TIME), np.nan)))
    (samples,) = flight.uniform(found)
    inside = slice(50, -50)
    truth = logs.Motion(samples.time)
    np.testing.assert_allclose(samples.omega_B[inside], truth.omega_B[inside], atol=0.02)
    assert samples.unmeasured == ("torque_y",)


def test_without_odometry_a_rate_that_nobody_measured_is_an_error(recorded, loaded):
    found = loaded(recorded(odometry=False, angular_velocity__y=np.full(len(TIME), np.nan)))
    with pytest.raises(LogError, match=r"gyroscope did not measure about y.*--topic odometry"):
        flight.uniform(found)


def test_without_odometry_a_specific_force_that_nobody_measured_stays_unknown(recorded, loaded):
    (samples,) = flight.uniform(loaded(recorded(odometry=False, linear_acceleration__x=np.full(len(TIME), np.nan))))
    assert np.isnan(samples.specific_force_B).all(axis=0).tolist() == [True, False, False]


def test_a_flight_that_is_written_says_it_too(recorded, loaded, tmp_path):
    gone = loaded(recorded(angular_velocity_covariance=covariance(-1.0)))
    again = flight.load(flight.write(gone, tmp_path / "again.mcap"))
    assert flight.unmeasured_axes(again) == dict.fromkeys(("torque_x", "torque_y", "torque_z"), Why.COVARIANCE)


def test_a_flight_in_memory(recorded, loaded):
    whole = loaded(recorded())
    declared = flight.without_axes(whole, {"force_y": Why.DECLARED})
    assert flight.without_axes(whole, {}) is whole
    assert np.isnan(declared.imu.specific_force_B[:, 1]).all()
    assert np.isfinite(whole.imu.specific_force_B).all()
    blank = replace(whole.imu, omega_B=np.full_like(whole.imu.omega_B, np.nan))
    assert list(flight.unmeasured_axes(replace(whole, imu=blank))) == ["torque_x", "torque_y", "torque_z"]


def test_names():
    assert axis_names(["force_y", "force_x", "force_y"]) == ("force_x", "force_y")
    with pytest.raises(UsageError, match=r"--unmeasured: 'force_w' is no axis; expected names out of force_x"):
        axis_names(["force_w"])
    with pytest.raises(UsageError, match="all six axes"):
        axis_names(flight.AXES)


@pytest.mark.parametrize(
    ("field", "values", "words"),
    [
        ("linear_acceleration.x", 0.0, "exactly zero throughout on force_x"),
        ("angular_velocity.z", 0.0, "exactly zero throughout on .*torque_z"),
        ("linear_acceleration.y", np.nan, r"force_y \(not a number throughout\)"),
    ],
)
def test_inspect_says_which_axis_has_no_reading(field, values, words, recorded, tmp_path):
    path = recorded(**{field.replace(".", "__"): np.full(len(TIME), values)}).save(tmp_path / "log.mcap")
    said = [check.words for check in flight.inspect(path).checks if check.name == "not-measured"]
    assert re.search(words, " ".join(said))


def test_the_other_checks_do_not_look_at_it(recorded, tmp_path):
    path = recorded(linear_acceleration__x=np.full(len(TIME), np.nan)).save(tmp_path / "log.mcap")
    found = {check.name: check.level for check in flight.inspect(path).checks}
    assert found["accelerometer-unit"] == "ok"
    assert found["gyroscope"] == "ok"
