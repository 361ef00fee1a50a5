"""Motors that PX4 logs at 10 Hz are what its faster setpoints asked for, where the log shows that and nowhere else."""

import numpy as np
import pytest

from wrenchgap import flight

STAMP = "uint64_t timestamp;uint64_t timestamp_sample"
ALLOCATION = np.array(
    [[-0.7, 0.7, 0.9, -1.0], [0.7, -0.7, 1.0, -1.0], [0.7, 0.7, -0.9, -1.0], [-0.7, -0.7, -1.0, -1.0]]
)
"""Of a quadrotor: motors by roll, pitch, yaw and thrust (down is positive)."""
ARMED, SECONDS, LOOP = 1.0, 20.0, 400.0


class Vehicle:
    """Armed after a second; at 10 s an impossible torque for half a second; motor 1 halves from `fails` on."""

    def __init__(self, fails=np.inf):
        self.time = np.arange(0.0, SECONDS, 1.0 / LOOP)
        phase = 2.0 * np.pi * self.time
        self.torque = 0.05 * np.stack((np.sin(7.3 * phase), np.cos(5.9 * phase), np.sin(0.7 * phase)), axis=1)
        self.torque[(self.time > 10.0) & (self.time < 10.5), 0] += 0.9
        self.thrust = np.zeros((len(self.time), 3))
        self.thrust[:, 2] = -0.5 - 0.1 * np.sin(3.1 * phase)
        wanted = np.column_stack((self.torque, self.thrust[:, 2])) @ ALLOCATION.T
        wanted[self.time > fails, 0] *= 0.5
        self.beyond = ((wanted < 0.0) | (wanted > 1.0)).any(axis=1)
        self.motors = np.clip(np.where(self.beyond[:, None], 0.8 * wanted, wanted), 0.0, 1.0)  # not what a clip gives
        self.motors[self.time < ARMED] = np.nan

    def flight(self, log, path, motors_hz=10):
        def topic(name, fields, rate, **columns):
            rows = slice(None, None, round(LOOP / rate))
            read = np.round(1e6 * (5.0 + self.time[rows])).astype(int)
            stamps = {"timestamp": read + 80, "timestamp_sample": read}
            log.topic(name, f"{STAMP};{fields}", stamps | {k: v[rows] for k, v in columns.items()})

        topic("vehicle_thrust_setpoint", "float[3] xyz", 50, xyz=self.thrust)
        topic("vehicle_torque_setpoint", "float[3] xyz", 50, xyz=self.torque)
        control = np.column_stack((self.motors, np.full((len(self.time), 8), np.nan)))
        topic("actuator_motors", "float[12] control", motors_hz, control=control)
        return flight.load(log.save(path))

    def at(self, series, start_ns):
        """Rows of the loop of the stamps of a series, which are 80 us late."""
        return np.round((series.time + start_ns * 1e-9 - 5.0 - 80e-6) * LOOP).astype(int)


@pytest.fixture
def log(autopilots):
    return autopilots.Ulog({"CA_ROTOR_COUNT": 4})


def test_motors_come_at_the_rate_of_the_setpoints(log, tmp_path):
    vehicle = Vehicle()
    found = vehicle.flight(log, tmp_path / "a.ulg")
    assert len(found.actuators.time) == 50 * SECONDS
    row = vehicle.at(found.actuators, found.start_ns)
    known = (vehicle.time[row] > ARMED) & ~vehicle.beyond[row]
    np.testing.assert_allclose(found.actuators.rotor_speed[known], vehicle.motors[row][known], atol=1e-6)
    assert any("1000 commands of the setpoints" in note and "200 of actuator_motors" in note for note in found.notes)


def test_at_a_limit_and_while_disarmed_the_logged_command_is_held(log, tmp_path):
    vehicle = Vehicle()
    found = vehicle.flight(log, tmp_path / "a.ulg")
    row = vehicle.at(found.actuators, found.start_ns)
    held = vehicle.motors[row // 40 * 40]  # the last of those that were logged
    beyond = vehicle.beyond[row]
    assert beyond.sum() > 20
    np.testing.assert_allclose(found.actuators.rotor_speed[beyond], held[beyond], atol=1e-6)
    assert not found.actuators.rotor_speed[vehicle.time[row] < ARMED].any()


def test_motors_that_the_setpoints_do_not_give_are_left_as_logged(log, tmp_path):
    found = Vehicle(fails=15.0).flight(log, tmp_path / "a.ulg")
    assert len(found.actuators.time) == 10 * SECONDS
    assert any("control 0 is not what the setpoints" in note for note in found.notes)


def test_motors_that_are_logged_as_fast_are_left_as_logged(log, tmp_path):
    found = Vehicle().flight(log, tmp_path / "a.ulg", motors_hz=50)
    assert not any("setpoints of thrust" in note for note in found.notes)


def test_the_logged_ones_can_be_chosen(log, tmp_path):
    Vehicle().flight(log, tmp_path / "a.ulg")
    slow = flight.load(tmp_path / "a.ulg", topics={"rotor_speed": "/px4/motor_command_normalised/actuator_motors"})
    assert len(slow.actuators.time) == 10 * SECONDS


@pytest.mark.parametrize("value", [0.0, np.nan, 1.0])
def test_a_motor_that_was_stopped_is_as_logged_and_not_as_the_setpoints_would_have_it(value, log, tmp_path):
    vehicle = Vehicle()
    late = vehicle.time > 14.0
    vehicle.motors[late, 2] = value
    found = vehicle.flight(log, tmp_path / "a.ulg")
    row = vehicle.at(found.actuators, found.start_ns)
    assert len(row) == 50 * SECONDS
    after = vehicle.time[row] > 14.2
    np.testing.assert_array_equal(found.actuators.rotor_speed[after, 2], np.nan_to_num(value))
    before = (vehicle.time[row] > ARMED) & (vehicle.time[row] < 13.8) & ~vehicle.beyond[row]
    np.testing.assert_allclose(found.actuators.rotor_speed[before], vehicle.motors[row][before], atol=1e-6)


def test_a_column_that_has_one_number_by_damage_is_no_motor(autopilots, tmp_path):
    for parameters in ({"CA_ROTOR_COUNT": 4}, {}):
        vehicle = Vehicle()
        fifth = np.full((len(vehicle.time), 1), np.nan)
        fifth[40 * 150] = 1.5
        vehicle.motors = np.hstack((vehicle.motors, fifth))
        log = autopilots.Ulog(parameters)
        control = np.column_stack((vehicle.motors, np.full((len(vehicle.time), 7), np.nan)))[::40]
        read = np.round(1e6 * (5.0 + vehicle.time[::40])).astype(int)
        log.topic("actuator_motors", "uint64_t timestamp;float[12] control", {"timestamp": read, "control": control})
        path = log.save(tmp_path / f"{len(parameters)}.ulg")
        assert (
            flight.load(path, topics={"actuators": "/px4/motor_command_normalised"}).actuators.rotor_speed.shape[1] == 4
        )
