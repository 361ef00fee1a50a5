"""The accelerometer against gravity and the odometry: f_B = R^T (a + g e_z) of a motion in closed form."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wrenchgap.flight.checks import with_checks
from wrenchgap.flight.checks.accelerometer_scale import gravity_ratio
from wrenchgap.flight.checks.motion import motion_means
from wrenchgap.flight.checks.sensor_windows import steady_blocks
from wrenchgap.flight.flight import Flight, Gap, ImuSeries, OdometrySeries

G = np.array([0.0, 0.0, 9.80665])


def flown(
    scale=1.0, bias=(0.0, 0.0, 0.0), *, seconds=30.0, mount=None, late=0.0, odometry_hz=100.0, velocity=True,
    falls=False, tilt=0.3, vibration=0.3, limit=np.inf,
):  # fmt: skip
    """Three sinusoids of position and three angles that do not depend on it, as a fully actuated vehicle flies."""
    rng = np.random.default_rng(3)
    frequency, phase = rng.uniform(0.1, 0.9, (3, 3)), rng.uniform(0.0, 6.0, (3, 3))

    def motion(time, order):
        angle = 2 * np.pi * frequency[:, :, None] * time + phase[:, :, None]
        wave = np.sin(angle + order * np.pi / 2) * (2 * np.pi * frequency[:, :, None]) ** order
        fall = (0.5 * time**2, time, np.ones_like(time))[order]
        return 0.1 * wave.sum(axis=1).T - float(falls) * fall[:, None] * G

    def attitude(time):
        angles = [tilt * np.sin(0.9 * time), tilt * np.sin(1.3 * time + 1.0), 0.3 * time]
        return Rotation.from_euler("xyz", np.transpose(angles))

    time = np.arange(0.0, seconds, 0.004)
    turn = attitude(time)
    force = turn.inv().apply(motion(time, 2) + G) + vibration * rng.standard_normal((len(time), 3))
    ahead = attitude(time + 0.001)
    omega = 1000.0 * (turn.inv() * ahead).as_rotvec() + 4e-3 * rng.standard_normal((len(time), 3))
    force, omega = (v if mount is None else mount.apply(v) for v in (force, omega))
    imu = ImuSeries("/imu", time, omega, np.clip(scale * force + bias, -limit, limit))
    own = np.arange(0.0, seconds, 1.0 / odometry_hz)
    place = motion(own, 0) + 1e-3 * rng.standard_normal((len(own), 3))
    speed = motion(own, 1) + 0.02 * rng.standard_normal((len(own), 3)) if velocity else None
    odometry = OdometrySeries("/odom", own + late, place, attitude(own).as_quat(scalar_first=True), speed)
    return Flight("f", "f.mcap", "0" * 64, 0, imu=imu, odometry=odometry, mapping={"imu": "/imu", "pose": "/odom"})


def said(flight):
    return {check.name: check for check in with_checks(flight).checks}.get("accelerometer-scale")


@pytest.mark.parametrize(("scale", "level"), [(1.06, "bad"), (0.93, "bad"), (1.03, "warn"), (0.975, "warn")])
@pytest.mark.parametrize("velocity", [True, False])
def test_a_scale_is_said_to_half_a_per_cent_and_its_option_mends_it(scale, level, velocity):
    found = said(flown(scale, velocity=velocity))
    assert found.level == level
    if level == "bad":
        undone = found.mend
    else:  # a bias may make it as well: what undoes a scale is told, and no command ends in it
        assert found.mend is None
        undone = found.words.split("Only where you know that it is the scale: `")[1].rstrip("`")
    assert undone.startswith("--topic 'imu=/imu:accel*")
    assert float(undone.rpartition("*")[2].strip("'")) * scale == pytest.approx(1.0, abs=0.006)


def test_one_axis_and_a_bias_are_said_with_what_they_make_along_the_vertical():
    assert said(flown([1.0, 1.0, 1.06])).level == "bad"
    found = said(flown(bias=(0.0, 0.0, 0.59), tilt=0.01, vibration=0.01))
    assert found.level == "bad"
    assert "scale of 1.060, or a bias of +0.59 m/s^2 along the vertical" in found.words


@pytest.mark.parametrize(
    "how",
    [
        {},
        {"velocity": False},
        {"vibration": 3.0},
        {"late": 0.05},
        {"odometry_hz": 10.0},
        {"odometry_hz": 6.0, "tilt": 1.5},
        {"tilt": 1.0},
        {"mount": Rotation.from_euler("xyz", [12, -9, 5], degrees=True)},
        {"bias": (0.4, -0.3, 0.0)},
    ],
    ids=lambda how: ", ".join(how) or "as it is",
)
def test_noise_delay_tilt_mounting_and_lateral_bias_are_no_scale(how):
    flight = flown(**how)
    ratio = gravity_ratio(flight, motion_means(flight))
    assert ratio.value == pytest.approx(1.0, abs=max(0.004, 4.0 * ratio.std))
    assert ratio.std < 0.006
    assert said(flight).level == "ok"


def test_the_standard_deviation_is_that_of_the_ratio_over_many_flights():
    """A random walk of the odometry's velocity is what decides here."""
    flight, rng, found = flown(), np.random.default_rng(0), []
    for _ in range(30):
        walk = np.cumsum(0.02 * rng.standard_normal((len(flight.odometry.time), 3)), axis=0)
        drifting = replace(flight, odometry=replace(flight.odometry, velocity_E=flight.odometry.velocity_E + walk))
        found.append(gravity_ratio(drifting, motion_means(drifting)))
    assert np.std([ratio.value for ratio in found]) == pytest.approx(np.mean([ratio.std for ratio in found]), rel=0.5)


def test_free_fall_no_attitude_and_a_short_log_say_nothing():
    flight = flown(falls=True, vibration=0.05)
    assert gravity_ratio(flight, motion_means(flight)) is None
    assert said(flight) is None
    assert said(replace(flown(1.06), odometry=None)) is None
    assert said(flown(1.06, seconds=5.0)) is None


def test_another_check_that_is_bad_is_heard_first():
    turned = said(flown(mount=Rotation.from_euler("x", 180, degrees=True)))
    assert turned is None


def test_a_vehicle_that_measures_the_vertical_force_alone_is_checked_by_it():
    flight = flown(1.06, tilt=0.1)
    flight.imu.specific_force_B[:, :2] = np.nan
    assert said(flight).level == "bad"
    sound = flown(tilt=0.1)
    sound.imu.specific_force_B[:, :2] = np.nan
    assert said(sound).level == "ok"


def test_a_sensor_that_is_clipped_has_no_factor():
    found = said(flown(1.06, limit=13.0, vibration=1.0))
    assert found.level in ("warn", "bad")
    assert found.mend is None


def test_an_imu_that_ends_in_flight_is_compared_up_to_there_whatever_gaps_the_odometry_has_later():
    """The block before a later gap reached beyond the IMU's end, where hats had no weight: 0 / 0."""
    flight = flown(1.06, seconds=40.0)
    imu, odometry = flight.imu, flight.odometry
    ends = ImuSeries("/imu", imu.time[:5000], imu.omega_B[:5000], imu.specific_force_B[:5000])
    odometry = replace(odometry, gaps=(Gap(30.0, 31.0),))
    assert max(stop for _, stop in steady_blocks(odometry, ends)) == pytest.approx(ends.time[-1])
    with np.errstate(all="raise"):
        assert said(replace(flight, imu=ends, odometry=odometry)).level == "bad"


def reading(flight, change):
    """With what its accelerometer reads changed: `change` of time (N,) and specific forces (N, 3)."""
    imu = flight.imu
    return replace(flight, imu=replace(imu, specific_force_B=change(imu.time, imu.specific_force_B.copy())))


def later(flight, change, since=18.0):
    """The same from a moment [s] on."""
    return reading(flight, lambda t, f: np.where((t > since)[:, None], change(f), f))


@pytest.mark.parametrize(
    ("change", "axes", "words"),
    [
        (lambda f: f * [-1, 1, 1], "force_x", "x reads the opposite of what it should from (16|18|20) s on"),
        (lambda f: f * [1, -1, 1], "force_y", "y reads the opposite of what it should from (16|18|20) s on"),
        (lambda f: f[:, [1, 0, 2]], "force_x,force_y", "x reads what y should from (16|18|20) s on"),
        (
            lambda f: f[:, [1, 0, 2]] * [-1, 1, 1],
            "force_x,force_y",
            "x reads the opposite of what y should from (16|18|20) s on",
        ),
        (lambda f: f * [0.5, 1, 1], "force_x", r"x has the scale 1.0\d in the first half of the flight, 0.5\d"),
        (
            lambda f: G + (f - G) * [1, 1, 0.6],
            "force_z",
            r"z has the scale 1.0\d in the first half of the flight, 0.6\d",
        ),
    ],
    ids=["x opposite", "y opposite", "swapped", "turned by 90 deg", "x halved", "z pumped down"],
)
@pytest.mark.parametrize("velocity", [True, False], ids=["velocity", "positions"])
def test_an_axis_that_contradicts_the_motion_is_said_with_what_it_reads(change, axes, words, velocity):
    """Specific force is R^T (a + g e_z) of the motion that is flown, in each axis at all times; then it is not."""
    flight = flown(seconds=32.0, velocity=velocity, vibration=0.1)
    assert said(flight).level == "ok"
    found = said(later(flight, change, 16.0 if "scale" in words else 18.0))
    assert found.level == "bad"
    assert re.search(words, found.words)
    assert found.mend == f"--unmeasured {axes}"


def test_an_axis_that_is_opposite_throughout_or_until_a_moment_is_said():
    flight = flown(seconds=32.0)
    opposite = said(reading(flight, lambda t, f: f * [1, -1, 1]))
    assert "y reads the opposite of what it should throughout (correlation -1.00)" in opposite.words
    first = said(reading(flight, lambda t, f: np.where((t < 12.0)[:, None], f * [-1, 1, 1], f)))
    assert "x reads the opposite of what it should until 12 s" in first.words


@pytest.mark.parametrize(("scale", "level"), [(1.3, "warn"), (1.6, "bad"), (2.0, "bad"), (1.0, "ok")])
def test_an_axis_with_another_gain_is_said_where_noise_of_the_odometry_leaves_no_number(scale, level):
    """Positions that are off by 2 mm make half of what the odometry shows of the acceleration at 3 Hz."""
    flight, rng = flown(seconds=40.0, tilt=0.02, velocity=False, vibration=0.05), np.random.default_rng(4)
    odometry = flight.odometry
    noise = 0.002 * rng.standard_normal((len(odometry.time), 3)) * [1, 1, 0]
    noisy = replace(odometry, position_E=odometry.position_E + noise)
    found = said(reading(replace(flight, odometry=noisy), lambda t, f: f * [scale, 1, 1]))
    assert found.level == level
    assert found.mend == (None if level == "ok" else "--unmeasured force_x")


@pytest.mark.parametrize("size", [0.0, 0.1])
def test_an_axis_that_reads_noise_alone_is_not_said_to_read_another(size):
    """As in a hover, where nothing pushes sideways."""
    flight = reading(flown(seconds=60.0, tilt=0.02), lambda t, f: np.stack((f[:, 2] * size, f[:, 1], f[:, 2]), axis=1))
    noise = np.random.default_rng(5).standard_normal(len(flight.imu.time))
    assert said(reading(flight, lambda t, f: f + np.outer(noise, [0.5, 0, 0]))).level == "ok"


@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_a_sensor_askew_by_fifteen_degrees_has_no_axis_that_lies(axis):
    """It reads of the other axes too: an effect (`imu_misalignment`)."""
    mount = Rotation.from_euler(axis, 15.0, degrees=True)
    assert said(flown(mount=mount, seconds=40.0, tilt=0.1)).level == "ok"
    assert said(flown(mount=mount, seconds=40.0, tilt=1.0)).level == "ok"


@pytest.mark.parametrize("velocity", [True, False])
def test_positions_with_y_up_beside_an_attitude_with_z_up_are_said(velocity):
    """As motion capture exports them: (x, y, z) becomes (x, -z, y)."""
    flight = flown(velocity=velocity)

    def bad(one):
        return [c.words for c in with_checks(one).checks if c.name == "inertial-frame" and c.level == "bad"]

    assert bad(flight) == []
    turn = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    own = flight.odometry
    speed = own.velocity_E @ turn if velocity else None
    (words,) = bad(replace(flight, odometry=replace(own, position_E=own.position_E @ turn, velocity_E=speed)))
    assert "positions and velocities read as axes=x" in words


@pytest.mark.parametrize(("offset", "frame", "words"), [
    ((0.15, 0.0, 0.0), "E", "+0.15 m/s along x in E"),
    ((0.0, -0.3, 0.0), "B", "-0.30 m/s along y in B"),
    ((0.05, 0.0, 0.0), "E", ""),
])  # fmt: skip
def test_a_velocity_that_is_off_by_a_constant_is_said_with_axis_and_size(offset, frame, words):
    """A constant in B turns with the vehicle, which yaws by 9 rad here, and averages out in E."""
    flight = flown()
    pose = flight.odometry
    turn = Rotation.from_quat(pose.quat_EB, scalar_first=True) if frame == "B" else Rotation.identity(len(pose.time))
    moved = replace(pose, velocity_E=pose.velocity_E + turn.apply(np.array(offset)))
    found = {check.name: check for check in with_checks(replace(flight, odometry=moved)).checks}["velocity"]
    assert found.level == ("bad" if words else "ok")
    assert words in found.words
    assert found.mend == ("--topic twist=none" if words else None)
