"""What sensors do is no firm effect: flights of the independent engine, stamps moved and readings changed."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import butter, lfilter

from benchmarks.hidden_effects import engine
from wrenchgap import explain, open_flights
from wrenchgap.flight.checks.command_rate import widest_spacing
from wrenchgap.flight.offsets import Offset
from wrenchgap.learn.diagnose.timing import FlightTiming
from wrenchgap.learn.posterior.sensor_causes import (
    LateClock,
    ScaledAccelerometer,
    ScaledGyroscope,
    SlowGyroscope,
    UnboundedClock,
    late_clock,
    made_by_another_filter,
    other_clock,
    scaled_accelerometer,
)
from wrenchgap.learn.posterior.sparse_commands import SparseCommands, made_by_sparse_commands
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


def test_a_delay_that_is_longer_is_no_clock(hexarotor):
    """Of a shorter one a lag may have the rest: a low-pass is late, and no pure delay."""
    clock = LateClock(0.015, 0.0003)
    made = {"command_delay": {"delay": 0.0155}, "motor_lag": {"tau": 0.012}}
    assert clock.made(made | {"mass": {"added": 0.001}}, hexarotor.vehicle) == [*made]
    assert clock.made({"command_delay": {"delay": 0.008}}, hexarotor.vehicle)
    assert not clock.made({"command_delay": {"delay": 0.030}}, hexarotor.vehicle)


@pytest.fixture(scope="module")
def scaled(once, hexarotor):
    """Explanation of 25 s with an effect hidden, whose IMU reads so many times what there is."""

    def made(hidden="none", **factors):
        flight = once(f"late_clock {hidden}", lambda: engine.fly(hidden, None, "train", seed=23, seconds=25))[0]
        read = {sensor: factor * getattr(flight.imu, sensor) for sensor, factor in factors.items()}
        flight = replace(flight, imu=replace(flight.imu, **read))
        names = [*TRIED, "thrust_scale", "inertia", "arm_reaction"]
        return explain(open_flights([flight], hexarotor), hexarotor, names=names, jobs=1)

    return made


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


@pytest.mark.slow
def test_an_imu_whose_sensors_have_one_low_pass_has_no_late_gyroscope_and_makes_no_firm_lag(filtered):
    found = filtered("omega_B", "specific_force_B")
    assert found.timing[0].late_gyroscope is None
    assert not {"command_delay", "motor_lag"} & set(found.firm)


def test_what_is_longer_than_the_gyroscope_is_late_it_has_not_made(hexarotor):
    late = SlowGyroscope(0.018, 0.0002)
    between = {"command_delay": {"delay": 0.008}}  # between forces, which are not late, and torques
    assert late.made(between, hexarotor.vehicle) == ["command_delay"]
    assert late.made({"asymmetric_motor_lag": {"tau_up": 0.015, "tau_down": 0.01}}, hexarotor.vehicle)
    assert not late.made({"motor_lag": {"tau": 0.04}, "mass": {"mass": 0.001}}, hexarotor.vehicle)


def test_an_accelerometer_that_reads_too_much_is_no_firm_mass(scaled):
    """Newton: a specific force k times what it is makes the vehicle look 1/k times as heavy."""
    found = scaled(specific_force_B=1.015)
    (mass,) = [e for e in found.fit.effects if e.name == "mass"]
    assert mass.theta[0] / found.model.vehicle.body.mass == pytest.approx(1.0 / 1.015 - 1.0, abs=0.003)
    assert "mass" not in found.firm
    assert ("mass", "accelerometer_calibration") in found.groups
    assert any(c.name == "accelerometer_calibration" for c in found.posterior.settle)


def test_an_accelerometer_that_rectifies_vibration_is_known_by_what_changes_along_the_thrust(once, hexarotor):
    """Its mean is right and its changes are 12 % too large: so a mass that is 1 / 1.12 of the model's looks."""
    flight = once("late_clock none", lambda: engine.fly("none", None, "train", seed=23, seconds=25))[0]
    force = flight.imu.specific_force_B.copy()
    force[:, 2] += 0.12 * (force[:, 2] - force[:, 2].mean())
    mass = hexarotor.vehicle.body.mass
    lighter = {"mass": {"added": (1.0 / 1.12 - 1.0) * mass}}
    read = replace(flight, imu=replace(flight.imu, specific_force_B=force))
    assert scaled_accelerometer([read]).made(lighter, hexarotor.vehicle) == ["mass"]
    assert scaled_accelerometer([flight]).made(lighter, hexarotor.vehicle) == []
    assert scaled_accelerometer([read]).made({"mass": {"added": -0.3 * mass}}, hexarotor.vehicle) == []


def test_without_odometry_a_late_imu_is_no_firm_delay(once, hexarotor):
    """Nothing tells a low-pass of 15 Hz, which is late by 1 / (2 pi 15 Hz) = 11 ms, from commands that are."""
    flight = once("late_clock none", lambda: engine.fly("none", None, "train", seed=23, seconds=25))[0]
    slow = replace(flight.imu, time=flight.imu.time + 0.011)
    blind = replace(flight, imu=slow, odometry=None)
    found = explain(open_flights([blind], hexarotor), hexarotor, names=TRIED, jobs=1)
    assert "command_delay" in found.effects
    assert "command_delay" not in found.firm
    assert ("command_delay", "late_clock") in found.groups


def test_a_mass_beside_a_good_accelerometer_is_firm(scaled):
    found = scaled(hidden="mass")
    assert "mass" in found.firm
    assert not any("accelerometer_calibration" in s.names for s in found.posterior.sets)


def test_a_scale_makes_mass_and_thrust_by_newtons_law(hexarotor):
    """f = T / m: k f is k T, or T / (m / k)."""
    accelerometer, m = ScaledAccelerometer(1.01, 1.02), hexarotor.vehicle.body.mass
    assert accelerometer.made({"thrust_scale": {"scale": 0.015}}, hexarotor.vehicle) == ["thrust_scale"]
    assert accelerometer.made({"mass": {"added": m / 1.015 - m}}, hexarotor.vehicle) == ["mass"]
    assert not accelerometer.made({"mass": {"added": 0.015 * m}}, hexarotor.vehicle)
    both = {"mass": {"added": 0.015 * m}, "thrust_scale": {"scale": 0.015}}  # torques k times, forces as they are
    assert not accelerometer.made(both, hexarotor.vehicle)
    assert ScaledGyroscope(1.01, 1.02).made(both, hexarotor.vehicle) == ["mass", "thrust_scale"]
    assert not ScaledGyroscope(0.99, 1.0).made(both, hexarotor.vehicle)


def test_a_gyroscope_makes_inertia_by_eulers_law(hexarotor):
    """J k domega = torque: J / k in place of J; and axes that are off square by e make products of about e J."""
    gyroscope, J = ScaledGyroscope(1.01, 1.02), hexarotor.vehicle.body.inertia
    moments = {"xyz"[i] * 2: J[i, i] / 1.015 - J[i, i] for i in range(3)}
    assert gyroscope.made({"inertia": moments | {"xy": 0.02 * J[0, 0]}}, hexarotor.vehicle) == ["inertia"]
    assert not gyroscope.made({"inertia": moments | {"xy": 0.05 * J[0, 0]}}, hexarotor.vehicle)
    assert not gyroscope.made({"inertia": moments | {"zz": 0.015 * J[2, 2]}}, hexarotor.vehicle)


def seen(*seconds):
    """Timing of flights whose odometry lags the IMU by so much +- 0.1 ms, None where there is none."""
    return [
        FlightTiming(str(k), 20.0, (), ())
        if s is None
        else FlightTiming(str(k), 20.0, (Offset("gyroscope", "odometry", s, 1e-4, 2e-4),), (0.0,))
        for k, s in enumerate(seconds)
    ]


def test_one_flight_without_odometry_leaves_the_clock_open():
    found = other_clock(seen(0.0, None))
    assert isinstance(found, UnboundedClock)
    assert found.seconds == pytest.approx(0.02)
    assert other_clock(seen(0.0, 0.0)).seconds < 1e-3  # three standard deviations
    assert other_clock(seen(-0.03, None)).seconds > 0.03
    assert not isinstance(other_clock(seen(-0.03, -0.03)), UnboundedClock)


def test_an_imu_that_became_later_may_have_made_a_delay_that_came():
    delay = {"command_delay": {"delay": 0.006}, "mass": {"added": 0.1}}
    assert made_by_another_filter(delay, seen(None), seen(0.0)) == ["command_delay"]
    assert made_by_another_filter(delay, seen(0.0, 0.001), seen(-0.006)) == ["command_delay"]
    assert not made_by_another_filter(delay, seen(0.0, 0.001), seen(0.0))
    assert not made_by_another_filter({"command_delay": {"delay": 0.03}}, seen(None), seen(None))
    gone = {"command_delay": {"delay": -0.006}}  # which an IMU that became earlier may have made
    assert made_by_another_filter(gone, seen(-0.006), seen(0.0)) == ["command_delay"]
    assert not made_by_another_filter(gone, seen(0.0), seen(0.0))
    assert not made_by_another_filter(gone, seen(0.0), seen(-0.006))
    assert not made_by_another_filter({"command_delay": {"delay": -0.03}}, seen(None), seen(None))


def test_a_lag_below_the_time_between_commands_is_not_firm(once, hexarotor):
    """Commands of 200 Hz of which the log repeats every tenth, 50 ms: what it says of a lag of 30 ms is its own."""
    flight = once("late_clock servo_lag", lambda: engine.fly("servo_lag", None, "train", seed=23, seconds=25))[0]
    act = flight.actuators
    held = {name: np.repeat(getattr(act, name)[::10], 10, axis=0)[: len(act.time)] for name in ("tilt", "rotor_speed")}
    sparse = replace(flight, actuators=replace(act, **held), commanded=None)
    assert widest_spacing([flight]) == 0.0
    assert widest_spacing([sparse]) == pytest.approx(10 * act.period, rel=0.01)
    lags = {"motor_lag": {"tau": 0.03}, "mass": {"added": 0.1}}
    assert SparseCommands(0.05).made(lags, hexarotor.vehicle) == ["motor_lag"]
    assert SparseCommands(0.02).made(lags, hexarotor.vehicle) == []
    assert made_by_sparse_commands(lags, [flight], [sparse]) == ["motor_lag"]
    assert made_by_sparse_commands(lags, [sparse], [sparse]) == []
    found = explain(open_flights([sparse], hexarotor), hexarotor, names=TRIED, jobs=1)
    assert not {"servo_lag", "motor_lag", "command_delay"} & set(found.firm)
    lag = next(v for n in found.effects if n in ("servo_lag", "motor_lag") for v in found.fit.values(n))
    assert lag.std > 0.05 / 3**0.5  # sent at any time in the 50 ms before
