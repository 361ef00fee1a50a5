"""The gyroscope's scale against an attitude that is integrated here from known rates: scales, lags, filters, noise."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import butter, sosfilt
from scipy.spatial.transform import Rotation

from tests.independent.flown_quadrotor import Case, fly
from wrenchgap.flight.checks import with_checks
from wrenchgap.flight.checks.gyroscope_scale import high_pass
from wrenchgap.flight.checks.sensor_scales import sensor_scales, signal_loss
from wrenchgap.flight.checks.sensor_windows import SCALE
from wrenchgap.flight.flight import ActuatorSeries, Flight, ImuSeries, OdometrySeries

RATE = 1000.0


def wander(rng, time, size):
    """Rates (N, 3) of sinusoids from 0.1 to 3 Hz."""
    frequency = rng.uniform(0.1, 3.0, (3, 20))
    phase = rng.uniform(0.0, 2 * np.pi, (3, 20))
    angle = 2 * np.pi * frequency[:, None, :] * time[None, :, None] + phase[:, None, :]
    return size * np.sqrt(0.1) * np.sin(angle).sum(axis=2).T


def flown(
    scale=1.0, *, seed=0, size=0.5, seconds=20.0, gyro_noise=4e-3, attitude_noise=8e-4, late=0.0, odometry_hz=100.0,
    lag=None, smoothed=None, tumbling=False, bursts=False, lands=np.inf, takes_off=0.0,
):  # fmt: skip
    """A flight at 1 kHz, integrated sample by sample: the truth is in the attitude, `scale` (1 or 3) in the rates."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, seconds, 1.0 / RATE)
    omega = wander(rng, time, size)
    omega *= np.where(bursts & (time % 16.0 < 8.0), 0.3, 1.0)[:, None] * ((time >= takes_off) & (time < lands))[:, None]
    crash = tumbling & (time > 15.0) & (time < 15.8)
    omega[crash] *= 6.0
    every = round(RATE / odometry_hz)
    quat = product_of_all_before(Rotation.from_rotvec(omega / RATE)).as_quat(scalar_first=True)[::every]
    if smoothed:  # an estimator's filter of the attitude's small angles
        vectors = np.unwrap(Rotation.from_quat(quat, scalar_first=True).as_rotvec(), axis=0)
        filtered = sosfilt(butter(1, smoothed, fs=odometry_hz, output="sos"), vectors, axis=0)
        quat = Rotation.from_rotvec(filtered).as_quat(scalar_first=True)
    noisy = Rotation.from_quat(quat, scalar_first=True) * Rotation.from_rotvec(
        attitude_noise * rng.standard_normal((len(quat), 3))
    )
    reading = (
        omega if lag is None else sosfilt(butter(1, 1.0 / (2 * np.pi * lag), fs=RATE, output="sos"), omega, axis=0)
    )
    reading = np.where(crash[:, None], 1.1 * reading, reading)
    gyro = (reading * scale + gyro_noise * rng.standard_normal(omega.shape) + [0.03, -0.02, 0.01])[::4]
    gravity = noisy_gravity(quat, time[::4], time[::every])
    imu = ImuSeries("/imu", time[::4], gyro, gravity + 0.05 * rng.standard_normal(gravity.shape))
    place = np.zeros((len(quat), 3))
    odometry = OdometrySeries("/odom", time[::every] + late, place, noisy.as_quat(scalar_first=True))
    return Flight("f", "f.mcap", "0" * 64, 0, imu=imu, odometry=odometry, mapping={"imu": "/imu", "pose": "/odom"})


def product_of_all_before(steps):
    """Of each of the rotations (N,), in their order: pairs, fours, eights and so on are multiplied at once."""
    turned, far = Rotation.concatenate((Rotation.identity(1), steps[:-1])), 1
    while far < len(steps):
        turned = Rotation.concatenate((turned[:far], turned[:-far] * turned[far:]))
        far *= 2
    return turned


def noisy_gravity(quat, imu_time, time):
    own = np.minimum(np.searchsorted(time, imu_time), len(time) - 1)
    return Rotation.from_quat(quat[own], scalar_first=True).inv().apply([0.0, 0.0, 9.80665])


def said(flight):
    found = {check.name: check for check in with_checks(flight).checks}
    return found["gyroscope-scale"]


@pytest.mark.parametrize("scale", [0.9, 0.97, 1.03])
def test_a_scale_is_said_to_a_per_cent_and_its_option_mends_it(scale):
    found = said(flown(scale))
    assert found.level == ("bad" if scale == 0.9 else "warn")
    assert found.mend.startswith("--topic 'imu=/imu:gyro*")
    assert float(found.mend.rpartition("*")[2].strip("'")) * scale == pytest.approx(1.0, abs=0.005)


def test_one_axis_alone_is_said_of_that_axis():
    found = said(flown([1.0, 0.95, 1.0]))
    assert found.mend == "--topic 'imu=/imu:gyro.y*1.05'"
    assert "y 0.95" in found.words


@pytest.mark.slow
@pytest.mark.parametrize(
    "how",
    [
        {},
        {"gyro_noise": 0.1, "attitude_noise": 5e-3},
        {"late": 0.03},
        {"lag": 0.03},
        {"smoothed": 4.0, "size": 0.15},
        {"odometry_hz": 10.0},
        {"size": 0.01, "attitude_noise": 3e-3},
    ],
    ids=lambda how: ", ".join(how) or "as it is",
)
def test_noise_delay_filters_and_calm_are_no_scale(how):
    assert said(flown(1.0, seed=2, **how)).level == "ok"


@pytest.mark.parametrize("how", [{"late": 0.03}, {"late": -0.02}, {"odometry_hz": 20.0}, {"gyro_noise": 0.03}])
def test_a_scale_is_seen_in_spite_of_delay_and_noise(how):
    found = said(flown(0.9, seed=3, **how))
    assert found.level == "bad"
    assert float(found.mend.rpartition("*")[2].strip("'")) == pytest.approx(1 / 0.9, abs=0.02)


def test_bounds_hold_the_scale_under_noise_on_both():
    """Least squares on noisy angles would say 0.7 and less."""
    scales = sensor_scales(flown(1.0, seed=4, size=0.05, attitude_noise=4e-3), "gyroscope")
    for scale in scales.values():
        low, high = scale.bounds[0].low, scale.bounds[0].high
        assert low < 0.95
        assert low - 4 * scale.bounds[0].std < 1.0 < high + 4 * scale.bounds[0].std


def test_an_estimator_that_integrates_this_gyroscope_is_no_witness():
    """Fast motion is the gyroscope's own, slow motion is corrected: no one scale, and nothing is said."""
    flight = flown(0.9, seed=5)
    own = np.diff(flight.odometry.time, prepend=-0.01)[:, None]
    turned = Rotation.identity()
    gyro = np.stack([np.interp(flight.odometry.time, flight.imu.time, c) for c in flight.imu.omega_B.T], axis=1)
    out, truth = [], Rotation.from_quat(flight.odometry.quat_EB, scalar_first=True)
    for k in range(len(own)):
        turned = turned * Rotation.from_rotvec((gyro[k] - [0.03, -0.02, 0.01]) * own[k])
        turned = turned * Rotation.from_rotvec(0.03 * (turned.inv() * truth[k]).as_rotvec())
        out.append(turned.as_quat(scalar_first=True))
    estimated = replace(flight, odometry=replace(flight.odometry, quat_EB=np.array(out)))
    assert said(estimated).level == "ok"


def test_without_an_attitude_it_says_that_it_could_not_test():
    assert said(replace(flown(), odometry=None)).words == "Not tested: no attitude is logged."
    assert "too slowly or too briefly" in said(flown(seconds=6.0)).words


def test_a_crash_does_not_decide():
    """0.8 s of tumbling with another scale, more motion than everything else together."""
    scales = sensor_scales(flown(1.0, seed=6, seconds=32.0, odometry_hz=50.0, tumbling=True), "gyroscope")
    assert [scale.value for scale in scales.values()] == pytest.approx([1.0] * 3, abs=0.02)


def test_an_axis_of_a_sensor_that_is_turned_has_no_option():
    flight = replace(flown([1.0, 0.95, 1.0]), mapping={"imu": "/imu:frd", "pose": "/odom"})
    assert said(flight).mend is None


def reading(flight, change):
    """With what its gyroscope reads changed: `change` of time (N,) and rates (N, 3)."""
    imu = flight.imu
    return replace(flight, imu=replace(imu, omega_B=change(imu.time, imu.omega_B.copy())))


@pytest.mark.parametrize("seconds", [16.0, 32.0])
def test_a_scale_that_changes_in_flight_has_two_numbers_and_no_factor(seconds):
    late = reading(flown(seconds=seconds), lambda t, w: w * np.where(t > seconds / 2, 0.8, 1.0)[:, None])
    found = said(late)
    assert found.level == "bad"
    assert found.mend is None
    numbers = re.search(
        r"x has the scale ([\d.]+) in the first half of the flight, ([\d.]+) in the second", found.words
    )
    assert [float(n) for n in numbers.groups()] == pytest.approx([1.0, 0.8], abs=0.02)


def test_a_stretch_in_another_unit_is_said():
    """Degrees for 10 of 40 s: halves of the flight only become unsure of their scale."""
    degrees = 180.0 / np.pi
    stretch = reading(flown(seconds=40.0), lambda t, w: w * np.where((t > 20.0) & (t < 30.0), degrees, 1.0)[:, None])
    found = said(stretch)
    assert found.level == "bad"
    assert found.mend is None
    numbers = re.search(r"x has the scale ([\d.]+) in most parts of the flight, ([\d.]+) in others", found.words)
    usual, odd = map(float, numbers.groups())
    assert usual == pytest.approx(1.0, abs=0.05)
    assert odd == pytest.approx(degrees, rel=0.05)


def test_a_scale_that_depends_on_the_motion_has_two_numbers_and_no_factor():
    """Calm and lively parts by turns, the lively ones beyond a soft end of the range."""

    def soft(time, omega):
        return np.where((time % 16.0 > 8.0)[:, None], 0.9, 1.0) * omega

    lively = flown(seconds=32.0, gyro_noise=1e-3, bursts=True)
    assert said(lively).level == "ok"
    found = said(reading(lively, soft))
    assert found.mend is None
    numbers = re.search(
        r"x has the scale ([\d.]+) in the calmer half of the flight, ([\d.]+) in the livel", found.words
    )
    assert [float(n) for n in numbers.groups()] == pytest.approx([1.0, 0.9], abs=0.03)


@pytest.mark.parametrize("noise", [0.0, 2e-3])
def test_a_clipped_gyroscope_has_no_factor(noise):
    """Flat tops at 0.4 rad/s of 0.5 rms, with and without noise on them: all parts of the flight are alike."""
    rng = np.random.default_rng(9)
    flight = reading(flown(), lambda t, w: np.clip(w, -0.4, 0.4) + noise * rng.standard_normal(w.shape))
    for factor in (1.0, 1.4):  # as it is, and with the factor that brings it to the right size in the mean
        found = {c.name: c for c in with_checks(reading(flight, lambda t, w, k=factor: k * w)).checks}
        assert found["gyroscope-scale"].level == "bad"
        assert found["gyroscope-scale"].mend is found["gyroscope"].mend is None


def test_a_scale_beside_a_few_flat_tops_has_no_factor():
    found = said(reading(flown(0.9), lambda t, w: np.clip(w, -1.15, 1.15)))
    assert found.level == "bad"
    assert found.mend is None
    assert "x 0.9" in found.words


@pytest.mark.slow
@pytest.mark.parametrize("axes", [slice(0, 3), 2])
@pytest.mark.parametrize("first", [False, True])
def test_axes_that_show_noise_alone_in_part_of_the_flight_are_said(axes, first):
    rng = np.random.default_rng(1)

    def dead(time, omega):
        rows = (time < 14.0) if first else (time > 18.0)
        omega[rows, axes] = 4e-3 * rng.standard_normal(omega[rows, axes].shape)
        return omega

    found = said(reading(flown(seconds=32.0), dead))
    assert found.level == "bad"
    assert found.mend is None
    when = "until 14 s" if first else "from 18 s on"
    assert f"z shows nothing of the attitude's turns {when} (correlation" in found.words
    assert ("x shows nothing" in found.words) == (axes != 2)


@pytest.mark.parametrize(("early", "lost"), [((0.9, 0.95, 0.9, -0.1), False), ((0.1, -0.1, 0.0, -0.1), True)])
def test_an_attitude_that_is_set_anew_once_is_no_dead_gyroscope(early, lost):
    """Four segments, of which one has most of the motion, and 20 in which both turn alike."""
    alike = np.array([*early, *[0.98] * 20])
    motion = np.array([0.2, 0.2, 0.2, 3.0, *[0.3] * 20])
    sums = np.stack((motion, alike * motion, motion))
    found = signal_loss(sums, motion, 2.0 * np.arange(24.0))
    assert (found is not None) == lost
    if lost:
        assert found.time == 8.0


def standing_first(until, size, idle):
    """Half a minute, of which the first `until` [s] on the ground, with motors at `idle` (None: as in flight), and the
    attitude is corrected by some `size` [rad] to and fro, of which the gyroscope knows 6 %.
    """
    flight = flown(seconds=30.0, seed=3, takes_off=until, gyro_noise=2e-4, attitude_noise=2e-5)
    axis, time = np.array([0.6, 0.5, 0.6]), flight.odometry.time
    turned = size * np.where(time < until, np.sin(np.pi * 0.6 * time) * np.sin(np.pi * time / until) ** 2, 0.0)
    quat = Rotation.from_quat(flight.odometry.quat_EB, scalar_first=True) * Rotation.from_rotvec(turned[:, None] * axis)
    rate = np.interp(flight.imu.time, time, np.gradient(turned, time))
    imu = replace(flight.imu, omega_B=flight.imu.omega_B + 0.06 * rate[:, None] * axis)
    hover = 1500.0 + 50.0 * np.random.default_rng(0).standard_normal((len(time), 4))
    motors = (
        hover if idle is None else np.where(time[:, None] < until, np.where(time[:, None] < 2.0, 1000.0, idle), hover)
    )
    actuators = ActuatorSeries("/motors", time, np.zeros((len(time), 0)), motors, unit="pwm")
    odometry = replace(flight.odometry, quat_EB=quat.as_quat(scalar_first=True))
    return replace(flight, imu=imu, odometry=odometry, actuators=actuators)


def test_an_estimator_that_settles_on_the_ground_is_no_dead_gyroscope():
    """Motors off, and the attitude turns as far as in flight; motors that idle, and it turns by its corrections."""
    assert said(standing_first(14.0, 0.6, idle=1000.0)).level == "ok"
    assert said(standing_first(14.0, 0.01, idle=1050.0)).level == "ok"
    assert said(standing_first(14.0, 0.6, idle=None)).level == "bad"  # in flight that is a gyroscope that failed


def test_a_landing_is_no_dead_gyroscope():
    """The attitude's noise goes on, and shows nothing of the gyroscope's."""
    assert said(flown(seconds=32.0, attitude_noise=3e-3, lands=18.0)).level == "ok"


@pytest.mark.parametrize("noise", [3e-3, 8e-3])
def test_a_hover_after_a_lively_start_is_no_dead_gyroscope(noise):
    """In most of the flight the attitude shows its noise alone; segments are turned down to be as loud as most."""
    found = said(flown(seconds=40.0, attitude_noise=noise, lands=8.0))
    assert found.level == "ok"


def test_an_axis_with_bounds_far_apart_is_not_known():
    found = said(flown(size=np.array([[0.5, 0.5, 0.004]]), seconds=20.0, attitude_noise=2e-3))
    assert found.level == "ok"
    assert "beyond doubt (x " in found.words
    assert "Not known, for too little motion next to noise: z" in found.words


def behind_high_pass(flight, corner):
    """The gyroscope behind a high-pass of the first order, as one that takes its bias off by itself."""
    imu = flight.imu
    sos = butter(1, corner, "highpass", fs=1.0 / imu.period, output="sos")
    return replace(flight, imu=replace(imu, omega_B=sosfilt(sos, imu.omega_B, axis=0)))


@pytest.mark.parametrize("corner", [0.05, 0.1, 0.2])
def test_a_gyroscope_that_loses_slow_turns_is_said_with_its_corner(corner):
    """omega - g = c G: the attitude shows c, to the share by which the filter's start and the noise blur it."""
    flight = behind_high_pass(flown(seconds=40.0, seed=3), corner)
    found, std = high_pass(flight)
    assert found == pytest.approx(corner, rel=0.1)
    assert std < 0.05 * corner
    checks = [c for c in with_checks(flight).checks if c.name == "gyroscope-scale" and c.level == "bad"]
    assert "loses slow turns" in checks[0].words


@pytest.mark.parametrize(
    "how",
    [{}, {"late": 0.03}, {"odometry_hz": 20.0}, {"lag": 0.02}, {"scale": 0.97}, {"attitude_noise": 0.01}],
    ids=str,
)
def test_a_sound_gyroscope_loses_no_slow_turns(how):
    for seed in range(3):
        found = high_pass(flown(seconds=40.0, seed=seed, **how))
        assert found is None or found[0] < max(SCALE.least_corner / 2, 3 * found[1])


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("seconds", [20.0, 60.0])
def test_a_still_hover_shows_no_high_pass(seed, seconds):
    """Its vehicle turns as far as the gyroscope's noise lets the controller believe, and no farther."""
    assert high_pass(fly([Case("still", seed=seed, seconds=seconds)])[0]) is None


@pytest.mark.parametrize(("bias", "axes"), [(0.3, ["x"]), (-0.15, ["x"]), (0.0, [])])
def test_a_bias_that_nobody_took_off_is_said_of_its_axis(bias, axes):
    """Beside 0.03, -0.02 and 0.01 rad/s, as sensors have."""
    flight = reading(flown(seconds=40.0, seed=4), lambda _, rates: rates + np.array([bias, 0.0, 0.0]))
    found = [check.words for check in with_checks(flight).checks if "nobody took off" in check.words]
    assert [re.findall(r"about ([xyz])", words) for words in found] == [axes] * bool(axes)
    assert all(f"{bias + 0.03:+.2f} rad/s" in words for words in found)
