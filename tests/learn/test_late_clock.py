"""An IMU whose stamps are late is not sold as commands that are: flights of the independent engine, stamps moved."""

from dataclasses import replace

import pytest

from benchmarks.hidden_effects import engine
from wrenchgap import explain, open_flights
from wrenchgap.learn.diagnose.timing import FlightTiming
from wrenchgap.learn.posterior.late_clock import LateClock, late_clock

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


def test_a_delay_of_another_length_is_no_clock():
    clock = LateClock(0.015, 0.0003)
    assert clock.explains(0.0155)
    assert not clock.explains(0.030)


def test_flights_without_offsets_have_no_late_clock():
    assert late_clock([]) is None
    assert late_clock([FlightTiming("a", 10.0, (), ())]) is None
