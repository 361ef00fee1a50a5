"""An IMU whose stamps are late is not sold as commands that are: flights of the independent engine, stamps moved."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import butter, lfilter

from benchmarks.hidden_effects import engine
from wrenchgap import explain, open_flights
from wrenchgap.learn.diagnose.timing import FlightTiming
from wrenchgap.learn.posterior.late_clock import LateClock, SlowGyroscope, late_clock
from wrenchgap.replay.present.timing import warnings

TRIED = ["command_delay", "servo_lag", "motor_lag", "com_offset", "mass"]
LATE = 0.02  # s


@pytest.fixture(scope="module")
def explained(once, hexarotor):
    """Explanation of 25 s whose IMU and odometry stamps are moved by so many seconds, with an effect hidden."""

    def made(imu=0.0, odometry=0.0, hidden="none"):
        flight = once(f"late_clock {hidden}", lambda: engine.fly(hidden, None, "train", seed=23, seconds=25))[0]
        flight = replace(
            flight,
            imu=replace(flight.imu, time=flight.imu.time + imu),
            odometry=replace(flight.odometry, time=flight.odometry.time + odometry),
        )
        return explain(open_flights([flight], hexarotor), hexarotor, names=TRIED, jobs=1)

    return made


def test_a_late_imu_is_a_delay_or_a_late_clock(explained):
    found = explained(imu=LATE)
    assert "command_delay" in found.effects
    assert "command_delay" not in found.firm
    assert ("command_delay", "late_clock") in found.groups
    assert all("late_clock" not in g for g in found.separable)
    clock = next(c for c in found.posterior.settle if c.name == "late_clock")
    assert clock.kind == "bench"
    shift = float(clock.what.split("--shift imu=")[1].split(";")[0])
    assert shift == pytest.approx(-LATE, abs=2e-3)
    assert any(limit.shown for limit in found.limits)  # what it could have shown does not depend on the clock


def test_with_the_shift_undone_nothing_is_late(explained):
    assert "command_delay" not in explained().effects


def test_late_commands_beside_a_good_clock_are_a_delay(explained):
    found = explained(hidden="command_delay")
    assert "command_delay" in found.firm
    assert not any("late_clock" in s.names for s in found.posterior.sets)


def test_a_late_odometry_excuses_no_delay(explained):
    """The IMU leads: its own clock cannot be late."""
    found = explained(odometry=LATE, hidden="command_delay")
    assert "command_delay" in found.firm


def test_a_delay_that_is_longer_is_no_clock():
    """Of a shorter one a lag may have the rest: a low-pass is late, and no pure delay."""
    clock = LateClock(0.015, 0.0003)
    assert clock.made("command_delay", {"delay": 0.0155})
    assert clock.made("command_delay", {"delay": 0.008})
    assert clock.made("motor_lag", {"tau": 0.012})
    assert not clock.made("command_delay", {"delay": 0.030})
    assert not clock.made("mass", {"added": 0.001})


def test_flights_without_offsets_have_no_late_clock():
    assert late_clock([]) is None
    assert late_clock([FlightTiming("a", 10.0, (), ())]) is None


@pytest.fixture(scope="module")
def filtered(once, hexarotor):
    """Explanation of a flight with nothing hidden whose gyroscope, accelerometer or both have a low-pass of 8 Hz."""

    def made(*sensors):
        flight = once("late_clock none", lambda: engine.fly("none", None, "train", seed=23, seconds=25))[0]
        step = np.median(np.diff(flight.imu.time))
        numerator, denominator = butter(1, 8.0, fs=1.0 / step)
        slow = {s: lfilter(numerator, denominator, getattr(flight.imu, s), axis=0) for s in sensors}
        return explain(open_flights([replace(flight, imu=replace(flight.imu, **slow))], hexarotor), hexarotor, jobs=1)

    return made


def test_a_gyroscope_with_a_low_pass_of_its_own_is_no_firm_lag(filtered):
    """A first-order low-pass is late by one over its cut-off, 1 / (2 pi 8 Hz) = 20 ms, at frequencies well below it."""
    found = filtered("omega_B")
    late = found.timing[0].late_gyroscope
    assert late.seconds == pytest.approx(0.0199, abs=2e-3)
    assert any("The gyroscope is" in said for said in warnings(found.timing[0]))
    assert not {"command_delay", "motor_lag"} & set(found.firm)


def test_an_imu_whose_sensors_have_one_low_pass_has_no_late_gyroscope_and_makes_no_firm_lag(filtered):
    found = filtered("omega_B", "specific_force_B")
    assert found.timing[0].late_gyroscope is None
    assert not {"command_delay", "motor_lag"} & set(found.firm)


def test_what_is_longer_than_the_gyroscope_is_late_it_has_not_made():
    late = SlowGyroscope(0.018, 0.0002)
    assert late.made("command_delay", {"delay": 0.008})  # between forces, which are not late, and torques
    assert late.made("asymmetric_motor_lag", {"tau_up": 0.015, "tau_down": 0.01})
    assert not late.made("motor_lag", {"tau": 0.04})
    assert not late.made("mass", {"mass": 0.001})
