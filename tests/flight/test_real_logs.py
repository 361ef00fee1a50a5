"""Logs of other people's vehicles, where they are at hand: an extra, not part of the everyday safety net."""

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

from wrenchgap import flight

REAL = Path("/work/shared/data/real")
pytestmark = pytest.mark.skipif(not REAL.is_dir(), reason="shared logs are not here")


def torque_correlation(path, inertia, band=(1.0, 5.0), last=11.0):
    """Best correlation, over lags below 0.1 s, of commanded torque with J domega/dt + omega x J omega, per axis."""
    samples = max(flight.uniform(flight.load(path), require=("commanded", "imu")), key=len)
    sections = butter(2, band, "band", fs=1 / samples.dt, output="sos")
    omega, moment = samples.omega_B, np.array(inertia)
    needed = np.gradient(omega, samples.dt, axis=0) * moment + np.cross(omega, omega * moment)
    torque, needed = (sosfiltfilt(sections, x, axis=0) for x in (samples.wrench_cmd_B[:, 3:], needed))
    inside = (samples.time > 0.5) & (samples.time < last)
    lags = range(round(0.1 / samples.dt))
    return [
        max(np.corrcoef(needed[inside, i], np.roll(torque[:, i], lag)[inside])[0, 1] for lag in lags) for i in range(3)
    ]


@pytest.mark.parametrize("number", [201, 202, 204])
def test_crazyflie(number):
    path = REAL / f"crazyflie-payload-{number}.mcap"
    found = flight.load(path)
    assert found.odometry.topic == "/cf/state_estimate"
    assert found.reference.topic == "/cf/setpoint"
    assert [len(series.gaps) for series in found.series().values()] == [1, 1, 1, 1]
    assert found.commanded.gaps[0].stop - found.commanded.gaps[0].start > 0.05
    x, y, z = torque_correlation(path, [16.6e-6, 16.7e-6, 29.3e-6], (2.0, 10.0), 15.0)
    assert min(x, y) > 0.95
    assert z > 0.5


def test_variable_tilt_hexacopter():
    path = REAL / "variable-tilt-hexacopter-feedforward"
    found = flight.load(path)
    assert found.actuators.tilt.shape[1] == found.actuators.rotor_speed.shape[1] == 6
    assert found.odometry.time[-1] == pytest.approx(17.74)
    assert any("at 0.5151 times its rate" in note for note in found.notes)
    assert min(torque_correlation(path, [0.0409, 0.0402, 0.0692])) > 0.8


def test_rotors_bag():
    found = flight.load(REAL / "rotors-waypoint.bag")
    assert found.commanded is None  # the only wrench is that of collisions
    assert found.actuators.rotor_speed.shape == (6576, 4)
    assert found.odometry.topic == "/ground_truth/pose + /ground_truth/twist"
    (samples,) = flight.uniform(found, require=("actuators", "imu"))
    assert np.median(samples.specific_force_B[:, 2]) == pytest.approx(9.81, abs=0.05)


def test_px4_is_refused_with_a_reason():
    with pytest.raises(flight.LogError, match=r"\.ulg logs are not read"):
        flight.load(REAL / "px4-quad.ulg")


def test_torque_predicts_rate_on_the_independent_simulation():
    path = REAL.parent / "multibody" / "ideal.train.mcap"
    assert min(torque_correlation(path, [0.1035, 0.1045, 0.1914], (0.5, 8.0), 39.0)) > 0.99
