"""What motors, spectra and parameters say, against closed forms."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from wrenchgap.flight.autopilot import Autopilot, parameter_differences
from wrenchgap.flight.flight import ActuatorSeries, Flight, ImuSeries, OdometrySeries
from wrenchgap.flight.formats.reader import Table
from wrenchgap.learn.data.phases.phase import Phase
from wrenchgap.learn.health.autopilot_messages import Recorded
from wrenchgap.learn.health.motors import Shape, motors_of
from wrenchgap.learn.health.phases import FlightPhases, NoPhases, phases_of
from wrenchgap.learn.health.rotors import RotorPlace, Thrusts, thrusts_of
from wrenchgap.learn.health.vibration import VIBRATION, vibration_of

QUAD = tuple(
    RotorPlace(f"M{k + 1}", np.cos(a), np.sin(a), spin)
    for k, (a, spin) in enumerate(zip(np.radians([-45.0, 135.0, 45.0, -135.0]), (1, 1, -1, -1), strict=True))
)
HEXA = tuple(
    RotorPlace(f"M{k + 1}", np.cos(a), np.sin(a), (-1) ** k) for k, a in enumerate(np.radians(np.arange(6) * 60.0))
)
HOVER = FlightPhases(
    (Phase("hover", 0.0, 20.0, ""),),
    speed_known=True,
    level=(Phase("level hover", 0.0, 20.0, "a hover that is level"),),
)
COAXIAL = tuple(replace(r, name=f"{r.name}{which}") for r in QUAD for which in "ab")


def balance(rotors, com=(0.0, 0.0), yaw=0.0):
    """Thrusts (R,) of mean 1 whose torque about `com` is zero, and whose drag torques sum to `yaw`: the least ones."""
    x, y, spin = (np.array([getattr(r, key) for r in rotors], dtype=float) for key in ("x", "y", "spin"))
    rows = np.stack((np.ones(len(x)), x - com[0], y - com[1], spin))
    return np.linalg.pinv(rows) @ [len(x), 0.0, 0.0, yaw * len(x)]


def motors(rotors, thrusts):
    time = np.arange(0.0, 20.0, 0.02)
    return motors_of(Thrusts(time, np.tile(thrusts, (len(time), 1)), rotors), HOVER)


@pytest.mark.parametrize("rotors", [QUAD, HEXA])
@pytest.mark.parametrize("com", [(0.2, 0.0), (0.0, -0.15), (-0.12, 0.12)])
def test_the_thrust_is_centred_where_the_centre_of_mass_is(rotors, com):
    found = motors(rotors, balance(rotors, com))
    assert found.shape is Shape.COM
    assert found.centre == pytest.approx(com, abs=1e-9)


@pytest.mark.parametrize("rotors", [QUAD, HEXA])
@pytest.mark.parametrize("yaw", [0.2, -0.3])
def test_a_yaw_torque_loads_the_rotors_of_one_turning_direction(rotors, yaw):
    found = motors(rotors, balance(rotors, yaw=yaw))
    assert found.shape is Shape.YAW
    assert found.yaw == pytest.approx(yaw)
    assert found.centre == pytest.approx((0.0, 0.0), abs=1e-9)


@pytest.mark.parametrize("weak", range(4))
def test_a_weak_propeller_is_told_its_thrust_back(weak):
    """A rotor that makes 70 % of what it is commanded is commanded 1 / 0.7 of what hover needs."""
    commanded = np.ones(4)
    commanded[weak] /= 0.7
    found = motors(QUAD, commanded)
    assert found.shape is Shape.ONE
    assert found.hardest.rotor is QUAD[weak]
    assert found.hardest.deviation == pytest.approx(commanded[weak] / commanded.mean() - 1.0)


def test_numbers_of_motors_do_not_matter():
    rng = np.random.default_rng(5)
    commanded = balance(QUAD, (0.1, 0.05), 0.1)
    order = rng.permutation(4)
    found, other = motors(QUAD, commanded), motors(tuple(QUAD[k] for k in order), commanded[order])
    assert other.shape is found.shape
    assert other.hardest.rotor is found.hardest.rotor
    assert other.centre == pytest.approx(found.centre)


def test_rotors_that_stand_unevenly_are_not_blamed_for_it():
    """Front arms twice as long carry half as much: that is the vehicle, and no fault."""
    uneven = tuple(RotorPlace(r.name, r.x * (1.0 if r.x > 0 else 0.5), r.y, r.spin) for r in QUAD)
    commanded = balance(uneven)
    assert np.ptp(commanded) > 0.5
    found = motors(uneven, commanded)
    assert found.shape is Shape.EVEN
    assert found.unevenness < 1e-9
    assert motors(uneven, np.ones(4)).balance_level != "ok"


def test_without_places_no_shape_is_told_and_nothing_of_moving_flight():
    alone = tuple(RotorPlace(r.name) for r in QUAD)
    assert motors(alone, balance(QUAD, (0.2, 0.0))).shape is Shape.UNKNOWN
    time = np.arange(0.0, 20.0, 0.02)
    thrusts = Thrusts(time, np.tile(balance(QUAD, (0.2, 0.0)), (len(time), 1)), QUAD)
    moving = motors_of(thrusts, FlightPhases((Phase("moving", 0.0, 20.0, ""),)))
    assert moving.condition == "flight"
    assert moving.balance_level == "ok"
    assert motors_of(thrusts, FlightPhases((Phase("hover", 0.0, 1.0, ""),))) is None


@pytest.mark.parametrize("weak", range(4))
def test_of_a_coaxial_pair_that_is_commanded_alike_neither_is_named_alone(weak):
    """Half of each pair's thrust is commanded to each of its rotors, whichever of them is weak."""
    commanded = np.repeat(np.where(np.arange(4) == weak, 1.4, 1.0), 2)
    found = motors(COAXIAL, commanded)
    assert found.shape is Shape.ONE
    assert {found.hardest.rotor, *found.hardest.alike} == set(COAXIAL[2 * weak : 2 * weak + 2])
    apart = motors(COAXIAL, commanded + np.tile([0.05, 0.0], 4))
    assert not any(motor.alike for motor in apart.motors)


def pitching(attitude):
    """20 s that pitch to 60 deg and back on the spot; of rotors on arms that tilt the shares go with the pitch."""
    time = np.arange(0.0, 20.0, 0.01)
    pitch = np.radians(60.0) * np.clip((time - 6.0) / 4.0, 0.0, 1.0) * np.clip((18.0 - time) / 4.0, 0.0, 1.0)
    zero = np.zeros_like(time)
    felt = 9.81 * np.column_stack((-np.sin(pitch), zero, np.cos(pitch)))  # R^T (0, 0, g), pitch about y
    turning = np.column_stack((zero, np.gradient(pitch, time), zero))
    quat = np.column_stack((np.cos(0.5 * pitch), zero, np.sin(0.5 * pitch), zero))
    odometry = OdometrySeries("/odometry", time, np.zeros_like(felt), quat, np.zeros_like(felt), turning)
    share = 0.25 * (1.0 + 0.5 * np.outer(np.sin(pitch), [1.0, 1.0, -1.0, -1.0]))
    flight = Flight("log", Path("log"), "", 0, imu=ImuSeries("/imu", time, turning, felt))
    flight = replace(flight, actuators=ActuatorSeries("/speeds", time, np.zeros((len(time), 0)), np.sqrt(share)))
    return replace(flight, odometry=odometry) if attitude else flight, Thrusts(time, share, QUAD), time, pitch


@pytest.mark.parametrize("attitude", [True, False])
def test_the_balance_is_that_of_level_hover(attitude):
    flight, thrusts, time, pitch = pitching(attitude)
    phases = phases_of(flight, thrusts)
    assert phases.seconds("hover") > 17.0
    level = FlightPhases(phases.level).within(time, "level hover")
    assert np.abs(pitch[level]).max() < np.radians(7.0)
    assert level.sum() * 0.01 == pytest.approx((np.abs(pitch) < 0.1).sum() * 0.01, abs=0.5)
    found = motors_of(thrusts, phases)
    assert found.condition == "hover"
    assert found.unevenness < 0.01
    hover = phases.within(time, "hover")
    assert np.abs(thrusts.share[hover].mean(axis=0) / 0.25 - 1.0).max() > 0.1


def losing_control():
    """18 s at 5 m and 1.2 m/s; from 14 s on the commands grow to nine weights, and the vehicle feels one."""
    time = np.arange(0.0, 18.0, 0.01)
    zero, one = np.zeros_like(time), np.ones_like(time)
    level, still = np.column_stack((one, zero, zero, zero)), np.zeros((len(time), 3))
    felt = np.random.default_rng(2).normal((0.0, 0.0, 9.81), 0.1, (len(time), 3))
    place = np.column_stack((1.2 * time, zero, 5.0 * one))
    weights = 1.0 + 2.0 * np.clip(time - 14.0, 0.0, None)
    speeds = 100.0 * np.sqrt(np.repeat(0.25 * weights[:, None], 4, axis=1))
    odometry = OdometrySeries("/odometry", time, place, level, np.column_stack((1.2 * one, zero, zero)), still)
    flight = Flight("log", Path("log"), "", 0, imu=ImuSeries("/imu", time, still, felt), odometry=odometry)
    return replace(flight, actuators=ActuatorSeries("/speeds", time, np.zeros((len(time), 0)), speeds))


def test_the_commands_of_a_loss_of_control_are_not_what_carries_the_weight():
    flight = losing_control()
    phases = phases_of(flight, thrusts_of(flight))
    assert {p.name for p in phases.phases} == {"moving", "crash"}
    (crash,) = phases.named("crash")
    assert crash.start == pytest.approx(14.1, abs=0.2)
    assert crash.event == crash.start
    assert crash.stop == pytest.approx(18.0, abs=0.05)


def test_what_a_model_tells_of_crashes_is_taken_over():
    flight = losing_control()
    told = (Phase("crash", 15.0, 17.0, ""), Phase("saturation", 3.0, 4.0, ""))
    phases = phases_of(flight, thrusts_of(flight), told)
    assert phases.named("crash") == told[:1]
    assert phases.seconds("moving", "crash") == pytest.approx(18.0, abs=0.1)


@pytest.mark.parametrize(("turns", "bench"), [(0.0, True), (0.02, False)])
def test_motors_that_run_on_a_bench_are_no_flight(turns, bench):
    """20 s in which the thrust changes by a tenth, and the IMU reads its noise; with a slow turn it may fly."""
    rng, time = np.random.default_rng(4), np.arange(0.0, 20.0, 0.01)
    felt = rng.normal((0.0, 0.0, 9.81), 0.05, (len(time), 3))
    omega = rng.normal(0.0, 1e-3, (len(time), 3)) + turns * np.sin(0.5 * time)[:, None]
    speeds = 100.0 * np.sqrt(1.0 + 0.1 * np.sin(0.7 * time))[:, None] * np.ones(4)
    flight = Flight("log", Path("log"), "", 0, imu=ImuSeries("/imu", time, omega, felt))
    flight = replace(flight, actuators=ActuatorSeries("/speeds", time, np.zeros((len(time), 0)), speeds))
    assert (phases_of(flight, thrusts_of(flight)).lack is NoPhases.BENCH) == bench


def test_without_a_level_hover_the_balance_is_not_known():
    flight, thrusts, time, pitch = pitching(True)
    tilted = replace(thrusts, share=thrusts.share[np.abs(pitch) > 0.1], time=time[np.abs(pitch) > 0.1])
    phases = replace(phases_of(flight, thrusts), level=())
    found = motors_of(tilted, phases)
    assert found.unevenness > 0.1
    assert (found.condition, found.balance_level) == ("flight", "ok")


def shaken(tones, rate, seconds=20.0, noise=0.02, seed=0):
    """A flight whose accelerometer reads sines along x: (amplitude [m/s^2], frequency [Hz]), and white noise."""
    time = np.arange(0.0, seconds, 1.0 / rate)
    force = np.random.default_rng(seed).normal((0.0, 0.0, 9.81), noise, (len(time), 3))
    force[:, 0] += sum((a * np.sin(2.0 * np.pi * f * time) for a, f in tones), np.zeros(len(time)))
    return Flight("log", None, "", 0, imu=ImuSeries("/imu", time, np.zeros((len(time), 3)), force))


def spectrum(flight):
    return vibration_of(flight, Recorded({}, 0), HOVER, ())


def test_a_peak_has_the_root_mean_square_of_its_sine():
    found = spectrum(shaken([(2.0, 80.0)], 400.0))
    (peak,) = found.peaks
    assert peak.hz == pytest.approx(80.0, abs=0.5)
    assert peak.rms == pytest.approx(2.0 / np.sqrt(2.0), rel=0.03)
    assert found.rms[0] == pytest.approx(2.0 / np.sqrt(2.0), rel=0.03)
    assert not peak.harmonic


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf])
def test_a_level_that_is_no_number_leaves_those_of_the_other_messages(wrong):
    stamps = np.arange(0, 20 * 10**9, 10**8)
    level = np.full(len(stamps), 3.0)
    level[50:60] = wrong
    table = Table("vehicle_imu_status", "", stamps, stamps, {"accel_vibration_metric": level})
    found = vibration_of(shaken([], 250.0), Recorded({"vehicle_imu_status": table}, 0), HOVER, ())
    assert found.levels == (3.0,)


def test_two_peaks_of_one_thing_that_turns_are_harmonics():
    peaks = spectrum(shaken([(2.0, 70.0), (1.0, 140.0)], 400.0)).peaks
    assert [peak.harmonic for peak in peaks] == [True, True]
    assert not any(peak.harmonic for peak in spectrum(shaken([(2.0, 70.0), (1.0, 115.0)], 400.0)).peaks)


@pytest.mark.parametrize("seed", range(8))
def test_noise_has_no_peak(seed):
    seconds = 4.6 if seed % 2 else 20.0  # eight pieces that overlap by half are the least
    assert spectrum(shaken([], 250.0, seconds, noise=0.5, seed=seed)).peaks == ()


def test_the_vehicles_own_motion_is_no_vibration():
    assert spectrum(shaken([(3.0, 0.5 * VIBRATION.slow_hz)], 250.0)).peaks == ()


def test_a_parameter_that_cannot_be_costs_no_more_than_what_it_says():
    """A share of the curve of -1e30 is damage; the commands are there all the same, and their ends are not known."""
    time = np.arange(0.0, 10.0, 0.01)
    sent = ActuatorSeries("/motors", time, np.zeros((len(time), 0)), np.full((len(time), 4), 0.5), unit="normalised")
    flight = Flight("damaged", Path("damaged.ulg"), "", 0, actuators=sent)
    found = thrusts_of(replace(flight, autopilot=Autopilot("PX4", parameters={"THR_MDL_FAC": -1e30})))
    assert found is not None
    assert found.limits is None
    np.testing.assert_allclose(found.share, 0.25)


def test_parameters_are_compared_as_the_autopilots_hold_them():
    """0.1 in double and in single precision are one value; a parameter that a log lacks is no difference."""
    one = Autopilot("PX4", parameters={"A": 0.1, "B": 1, "C": 3.0, "STAT_BOOTCNT": 1, "ONLY": 1})
    two = Autopilot("PX4", parameters={"A": float(np.float32(0.1)), "B": 2, "C": 3, "STAT_BOOTCNT": 9})
    found = parameter_differences([("a", one), ("b", two), ("c", None)])
    assert [(entry.name, entry.values) for entry in found.differ] == [("B", (1, 2))]
    assert (found.logs, found.without, found.ignored, found.not_in_all) == (("a", "b"), ("c",), ("STAT_BOOTCNT",), 1)
    assert parameter_differences([("a", one)]).differ == ()


def test_calibrations_stand_last():
    one, two = (Autopilot("PX4", parameters={"CAL_ACC0_XOFF": k, "ZZZ": k}) for k in (1, 2))
    assert [entry.name for entry in parameter_differences([("a", one), ("b", two)]).differ] == ["ZZZ", "CAL_ACC0_XOFF"]
