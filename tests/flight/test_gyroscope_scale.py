"""The gyroscope's scale against an attitude that is integrated here from known rates: scales, lags, filters, noise."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import butter, sosfilt
from scipy.spatial.transform import Rotation

from wrenchgap.flight.checks import with_checks
from wrenchgap.flight.checks.gyroscope_scale import gyroscope_scales
from wrenchgap.flight.flight import Flight, ImuSeries, OdometrySeries

RATE = 1000.0


def wander(rng, time, size):
    """Rates (N, 3) of sinusoids from 0.1 to 3 Hz."""
    frequency = rng.uniform(0.1, 3.0, (3, 20))
    phase = rng.uniform(0.0, 2 * np.pi, (3, 20))
    angle = 2 * np.pi * frequency[:, None, :] * time[None, :, None] + phase[:, None, :]
    return size * np.sqrt(0.1) * np.sin(angle).sum(axis=2).T


def flown(
    scale=1.0, *, seed=0, size=0.5, seconds=20.0, gyro_noise=4e-3, attitude_noise=8e-4, late=0.0, odometry_hz=100.0,
    lag=None, smoothed=None, tumbling=False,
):  # fmt: skip
    """A flight at 1 kHz, integrated sample by sample: the truth is in the attitude, `scale` (1 or 3) in the rates."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, seconds, 1.0 / RATE)
    omega = wander(rng, time, size)
    crash = tumbling & (time > 15.0) & (time < 15.8)
    omega[crash] *= 6.0
    steps = Rotation.from_rotvec(omega / RATE)
    turn = Rotation.identity()
    quat = np.empty((len(time), 4))
    every = round(RATE / odometry_hz)
    for k, step in enumerate(steps):
        quat[k] = turn.as_quat(scalar_first=True) if k % every == 0 else 0.0
        turn = turn * step
    quat = quat[::every]
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
    scales = gyroscope_scales(flown(1.0, seed=4, size=0.05, attitude_noise=4e-3))
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
    scales = gyroscope_scales(flown(1.0, seed=6, seconds=32.0, odometry_hz=50.0, tumbling=True))
    assert [scale.value for scale in scales.values()] == pytest.approx([1.0] * 3, abs=0.02)


def test_an_axis_of_a_sensor_that_is_turned_has_no_option():
    flight = replace(flown([1.0, 0.95, 1.0]), mapping={"imu": "/imu:frd", "pose": "/odom"})
    assert said(flight).mend is None
