"""Channels that say less than they seem to: held readings, one voltage, rotors that stop at one value, or for good."""

from dataclasses import replace

import numpy as np
import pytest

from wrenchgap.flight.checks import with_checks
from wrenchgap.flight.checks.channels import held_for, held_voltage
from wrenchgap.flight.checks.clipping import stopped_together
from wrenchgap.flight.checks.command_rate import command_spacing
from wrenchgap.flight.flight import ActuatorSeries, BatterySeries, Flight, ImuSeries

TIME = np.arange(0.0, 24.0, 0.01)
UP = np.array([0.0, 0.0, 9.80665])


def flown(*, speeds=None, volts=None, held=(1, 1), landed=24.0):
    """A hover whose four rotors answer gusts, with a battery that falls; landed, motors off, from `landed` on."""
    rng = np.random.default_rng(4)
    waves = np.stack([np.sin(2 * np.pi * f * TIME + 7 * f) for f in (0.3, 0.8, 1.7, 2.9)], axis=1)
    flies = (landed > TIME)[:, None]
    rotor = np.where(flies, 600.0 + 40.0 * waves + rng.standard_normal(waves.shape), 0.0)
    readings = flies * waves[:, :3] + 0.05 * rng.standard_normal((len(TIME), 3))
    gyro, accel = (
        np.repeat(v[::k], k, axis=0)[: len(TIME)] for v, k in zip((readings, readings + UP), held, strict=True)
    )
    volts = 16.0 - 0.02 * TIME + 0.01 * rng.standard_normal(len(TIME)) if volts is None else np.full(len(TIME), volts)
    rotor = rotor if speeds is None else speeds(rotor)
    actuators = ActuatorSeries("/motors", TIME, np.zeros((len(TIME), 0)), rotor)
    battery = BatterySeries("/battery", TIME, volts)
    return Flight(
        "f", "f.mcap", "0" * 64, 0, imu=ImuSeries("/imu", TIME, gyro, accel), actuators=actuators, battery=battery
    )


def said(flight):
    return {check.name: check for check in with_checks(flight).checks if check.level != "ok" and check.name != "roles"}


def test_a_healthy_hover_with_a_landing_says_nothing_of_these():
    assert not said(flown()).keys() - {"roles", "no-odometry"}
    assert not said(flown(landed=18.0)).keys()


@pytest.mark.parametrize(("held", "name", "rate"), [((1, 20), "accelerometer", "5 Hz"), ((4, 1), "gyroscope", "25 Hz")])
def test_readings_that_are_held_have_the_rate_at_which_they_change(held, name, rate):
    found = said(flown(held=held))["rate"]
    assert found.words.startswith(f"The {name} has each value {max(held)} times: it reads at {rate}, not at the 100 Hz")
    late = 0.5 * (max(held) - 1) * 10.0  # ms: the mean age of a value that is held for so long
    assert f"late by {late:.2g} ms" in found.words


@pytest.mark.parametrize(("step", "share"), [(1.0, 0.0), (2.0, 0.683), (4.0, 0.954)])
def test_a_sensor_whose_steps_are_larger_than_what_it_measures_is_no_sensor(step, share):
    """Of a normal signal of deviation s the step about zero takes erf(q / (s sqrt(8))) of the samples."""
    flight = flown()
    rng = np.random.default_rng(9)
    accel = flight.imu.specific_force_B.copy()
    accel[:, 0] = step * 0.3 * np.round(rng.standard_normal(len(TIME)) / step)
    found = said(replace(flight, imu=replace(flight.imu, specific_force_B=accel))).get("not-measured")
    if not share:
        assert found is None
        return
    assert (found.level, found.mend) == ("bad", "--unmeasured force_x")
    told = float(found.words.split("force_x ")[1].split(" %")[0])
    assert told == pytest.approx(100.0 * share, abs=3.0)


def held_commands(rotor):
    """A log at 100 Hz of commands that a 10 Hz topic repeats."""
    return np.repeat(rotor[::10], 10, axis=0)


def interpolated_commands(rotor):
    """The same with straight lines between them, as resampled tables have them."""
    return np.stack([np.interp(TIME, TIME[::10], column[::10]) for column in rotor.T], axis=1)


@pytest.mark.parametrize(
    ("how", "words"), [(held_commands, "have each value 10 times"), (interpolated_commands, "lie on straight lines")]
)
def test_commands_of_which_one_in_ten_says_something_have_that_rate(how, words):
    found = said(flown(speeds=how))["rate"]
    assert words in found.words
    assert "at 10 Hz, not at the 100 Hz of their stamps, so that no delay and no lag below 1e+02 ms" in found.words
    assert command_spacing(flown(speeds=how))["actuators"].seconds == pytest.approx(0.1, rel=0.02)


def test_commands_that_are_stamped_in_bursts_say_no_more_often_what_was_sent():
    """Eight samples of one packet within 7 us, 80 ms apart: as loggers stamp what arrives together."""
    flight = flown()
    place = np.arange(len(TIME))
    stamps = TIME[place - place % 8] + 1e-6 * (place % 8)
    flight = replace(flight, actuators=replace(flight.actuators, time=stamps))
    assert command_spacing(flight)["actuators"].seconds == pytest.approx(0.08, rel=0.01)
    assert "in bursts, 80 ms apart" in said(flight)["rate"].words


def test_smooth_commands_and_those_of_which_one_rotor_is_held_are_as_fast_as_their_stamps():
    assert not command_spacing(
        flown(speeds=lambda rotor: 600.0 + 40.0 * np.sin(2.0 * np.pi * TIME)[:, None] + 0 * rotor)
    )
    assert not command_spacing(flown(speeds=lambda rotor: np.c_[held_commands(rotor)[:, :3], rotor[:, 3]]))


def test_coarse_readings_and_rest_are_not_held():
    rng = np.random.default_rng(1)
    wander = np.cumsum(rng.standard_normal(5000))
    assert held_for(np.round(wander / 5.0)) == 1
    assert held_for(np.concatenate((np.zeros(4000), wander))) == 1
    assert held_for(np.zeros(100)) == 1
    assert held_for(np.repeat(wander, 3)) == 3


def test_a_battery_of_one_voltage_is_said():
    assert "15.9 V in all 2400 samples" in said(flown(volts=15.9))["constant-channel"].words


def test_a_voltmeter_that_stops_in_flight_is_said_and_one_that_rests_before_or_after_it_is_not():
    def with_voltage(flight, keeps):
        volts = flight.battery.voltage
        return replace(flight, battery=replace(flight.battery, voltage=np.where(keeps, volts[np.argmax(keeps)], volts)))

    found = said(with_voltage(flown(), TIME >= 9.0))["constant-channel"].words
    assert found.startswith("battery voltage: 15.8")
    assert "V from 9.0 s to 24.0 s, where motors run" in found
    assert not said(with_voltage(flown(landed=18.0), TIME >= 18.0)).keys()
    assert not said(with_voltage(flown(), TIME < 9.0)).keys()
    assert not held_voltage(flown(landed=0.0))  # motors never ran


def test_rotors_that_stop_at_one_value_are_said_and_full_throttle_is_not():
    stopping = flown(speeds=lambda v: np.minimum(v, 630.0))
    assert "clipped" not in said(stopping)  # in rad/s: a model file says what full throttle is
    speeds = stopping.actuators.rotor_speed
    (found,) = stopped_together(speeds, 950.0)
    assert found.words.startswith("the commands of 4 rotors stop at 630, one or more of them in ")
    assert not [*stopped_together(speeds, 630.2)]
    for full, level in ((1.0, None), (0.8, "warn")):
        shares = flown(speeds=lambda v, k=full: k * np.minimum(v / 630.0, 1.0))
        found = said(replace(shares, actuators=replace(shares.actuators, unit="normalised"))).get("clipped")
        assert (found and found.level) == level
    one = said(flown(speeds=lambda v: np.stack((np.minimum(v[:, 0], 630.0), *v.T[1:]), axis=1)))
    assert "rotor_speed 0 stops at 630 in " in one["clipped"].words
    assert one["clipped"].level == "bad"


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_an_arm_that_stops_where_others_go_beyond_is_said_and_the_limit_of_all_is_not(sign):
    def tilting(limits):
        flight = flown()
        angle = sign * (0.4 + 0.5 * np.stack([np.sin(1.1 * TIME + k) for k in range(6)], axis=1))
        tilt = np.clip(angle, -np.array(limits), np.array(limits))
        return said(replace(flight, actuators=replace(flight.actuators, tilt=tilt)))

    words = tilting([1.2, 1.2, 0.5, 1.2, 1.2, 1.2])["clipped"].words
    assert words.startswith(f"tilt 2 stops at {sign * 0.5:.4g} in ")
    assert "clipped" not in tilting([1.2] * 6)
    assert "clipped" not in tilting([0.5] * 6)


def test_a_rotor_that_is_logged_in_the_place_of_another_is_refused():
    found = said(flown(speeds=lambda v: v[:, [0, 0, 2, 3]]))["rotors"]
    assert found.level == "bad"
    assert found.words.startswith("rotor_speed 0, 1 are equal in all 2400 samples, which others are not")
    pairs = [0, 0, 1, 1, 2, 2, 3, 3]  # coaxial, of one command each
    assert "rotors" not in said(flown(speeds=lambda v: v[:, pairs]))
    assert "0, 1, 2 are equal" in said(flown(speeds=lambda v: v[:, [0, 0, 0, *pairs[3:]]]))["rotors"].words
    assert "rotors" not in said(flown(speeds=lambda v: np.concatenate((v, np.full((len(v), 2), 600.0)), axis=1)))


def test_one_command_for_all_rotors_of_a_vehicle_that_turns_is_a_throttle():
    """A hull that goes up and down on four equal rotors does not turn, but for its gyroscope's noise."""
    throttle = flown(speeds=lambda v: np.repeat(v.mean(axis=1, keepdims=True), 4, axis=1))
    still = replace(
        throttle,
        imu=replace(throttle.imu, omega_B=0.02 * np.random.default_rng(0).normal(size=(len(throttle.imu.time), 3))),
    )
    assert "rotors" not in said(still)
    turning = replace(still, imu=replace(still.imu, omega_B=20.0 * still.imu.omega_B))
    assert said(turning)["rotors"].words.startswith("all 4 rotors have one command in all 2400 samples")
    tilting = replace(turning, actuators=replace(turning.actuators, tilt=0.1 * np.sin(TIME)[:, None] * np.ones(4)))
    assert "rotors" not in said(tilting)


def test_rotors_on_both_sides_of_a_plane_in_which_the_vehicle_stays_are_told_the_same():
    plane = flown(speeds=lambda v: v[:, [0, 1, 2, 1]])
    plane = replace(plane, imu=replace(plane.imu, omega_B=plane.imu.omega_B * [0.0, 1.0, 0.0]))
    assert "rotors" not in said(plane)


def stopped(columns, since=15.0):
    def change(speeds):
        out = speeds.copy()
        rows = np.flatnonzero(since < TIME)
        out[np.ix_(rows, columns)] = out[rows[0], columns]
        return out

    return change


@pytest.mark.parametrize("columns", [[2], [0, 3], [0, 1, 2, 3]], ids=["one", "two", "all"])
def test_rotors_whose_commands_stand_still_to_the_end_of_a_flight_are_left_out_from_there_on(columns):
    flight = with_checks(flown(speeds=stopped(columns)))
    found = said(replace(flown(speeds=stopped(columns)), checks=None))["frozen"]
    assert "to the end of the log" in found.words
    assert "in mid-flight: left out" in found.words
    assert all(f"rotor_speed {k}" in found.words for k in columns)
    assert "more" not in found.words
    assert flight.actuators.time[-1] == pytest.approx(15.0, abs=0.05)


def test_rotors_that_rest_at_a_limit_or_on_the_ground_or_hardly_ever_change_are_not():
    assert "frozen" not in said(flown(speeds=stopped([2]), landed=14.0))
    top = said(flown(speeds=lambda v: np.where((TIME > 15.0)[:, None] & [True, False, False, False], 700.0, v)))
    assert "frozen" not in top
    switch = said(
        flown(speeds=lambda v: np.stack((*v.T, np.where(TIME > 5.0, 600.0, np.where(TIME > 2.0, 500.0, 700.0))), 1))
    )
    assert "frozen" not in switch
