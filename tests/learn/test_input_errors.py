"""What a sampled command does not say: against signals whose error is known, and flights logged too slowly."""

from dataclasses import replace

import numpy as np
import pytest

import wrenchgap as wg
from wrenchgap.flight.errors import FitError
from wrenchgap.flight.flight import ActuatorSeries
from wrenchgap.learn.data.dataset import dataset
from wrenchgap.learn.data.input_errors import EDGES, INPUT_ERRORS, Measurement, share_of_error
from wrenchgap.learn.identify.calibrate import Fate

RATE, SECONDS = 400.0, 200.0
BAND_OF_1_HZ = int(np.digitize(1.0, EDGES))


def loop(noise, seed=0):
    """A command (N, 6) at 400 Hz: a slow part of 1 N rms below 1 Hz, and `noise` [N] that is new at each tick."""
    rng = np.random.default_rng(seed)
    time = np.arange(round(SECONDS * RATE)) / RATE
    hz = rng.uniform(0.05, 1.1, (60, 6))
    slow = np.sqrt(2 / 60) * np.sin(2 * np.pi * time[:, None, None] * hz + rng.uniform(0, 6.3, hz.shape)).sum(axis=1)
    return slow + noise * rng.normal(size=slow.shape)


def share(log_hz, noise):
    """Of commands logged at a rate, of a vehicle that makes what is sent."""
    sent = loop(noise)
    seen = Measurement(dt=1 / 40, cutoff_hz=8.0, noise=np.full(6, 1e-3))
    measured = sent.reshape(-1, 10, 6).mean(axis=1)  # the wrench, at 40 Hz: what 25 ms of it amount to
    every = round(RATE / log_hz)
    logged = sent[::every]
    held = np.repeat(logged, every, axis=0)[: len(sent)].reshape(-1, 10, 6).mean(axis=1)
    return share_of_error(logged, 1 / log_hz, measured, measured - held, seen)


def test_a_snapshot_of_a_noisy_loop_errs_by_what_is_folded():
    """White noise of 1 N is 0.2 N^2/Hz once it is sampled at 10 Hz; the slow part is some 1 N^2/Hz below 1 Hz."""
    found = share(10.0, 1.0)
    one_hz, two_hz = found[BAND_OF_1_HZ], found[BAND_OF_1_HZ + 1]
    assert one_hz == pytest.approx(0.2 / 1.2, abs=0.08)
    assert np.all(two_hz > 0.7)


def test_a_loop_without_noise_is_exact():
    assert share(10.0, 0.0)[:3].max() < 1e-3


def test_noise_that_the_vehicle_makes_a_wrench_of_is_no_error():
    """Logged at the rate of the loop: its noise is in the measured wrench."""
    assert np.all(share(400.0, 1.0)[: BAND_OF_1_HZ + 2] < INPUT_ERRORS.share)


def test_a_band_above_half_the_rate_of_the_log_says_nothing():
    assert np.all(share(10.0, 1.0)[int(np.digitize(7.0, EDGES))] == 1.0)


@pytest.fixture(scope="module")
def crazyflie():
    return wg.load_model("crazyflie")


@pytest.fixture(scope="module")
def snapshots(crazyflie):
    """Three hovers as an autopilot logs them: motors at 10 Hz, with the noise of its gyroscope in every snapshot."""
    made = []
    for seed in range(3):
        flight = wg.simulate(crazyflie, "hover", duration=40, seed=seed, name=f"hover{seed}")
        sent, rng = flight.actuators, np.random.default_rng(seed)
        speed = sent.rotor_speed * (1.0 + 0.05 * rng.normal(size=sent.rotor_speed.shape))
        every = round(0.1 / sent.period)
        rows = slice(0, None, every)
        slow = ActuatorSeries(sent.topic, sent.time[rows], tilt=sent.tilt[rows], rotor_speed=speed[rows])
        made.append(replace(flight, actuators=slow, commanded=None, desired=None))
    return wg.open_flights(made, crazyflie, cutoff_hz=3.8)


def test_torques_of_a_hover_logged_at_10_hz_keep_their_means(snapshots, crazyflie):
    data = dataset([r for one in snapshots for r in one.records], crazyflie)
    assert data.untrusted[0, 3:].all()
    values = np.random.default_rng(0).normal(size=data.measured.shape)
    kept = data.unanswered(values)
    for flight in range(3):
        rows = data.flight == flight
        np.testing.assert_allclose(kept[rows, 3:], np.broadcast_to(values[rows, 3:].mean(axis=0), (rows.sum(), 3)))
    assert "nothing but the mean" in " ".join(str(n) for n in snapshots[0].notes)


def test_what_is_projected_out_is_projected_out_once(snapshots, crazyflie):
    data = dataset(snapshots[0].records, crazyflie)
    values = np.random.default_rng(1).normal(size=(*data.measured.shape, 2))
    once = data.informative(values)
    np.testing.assert_allclose(data.informative(once), once, atol=1e-12)
    assert np.sum(once**2) < np.sum(values**2)


def test_a_healthy_vehicle_is_not_calibrated_by_what_its_log_cannot_carry(snapshots, crazyflie):
    """Every parameter that shrinks the prediction lowers what is left of commands that were never sent.

    Where the model grants its rotors' axes nothing, a torque about z is drag_torque's, at its limit.
    """
    for model, fate in ((crazyflie, Fate.NO_HELP), (crazyflie.without_tolerances, Fate.AT_LIMIT)):
        found = wg.calibrate(snapshots, model)
        fates = {t.effect: t.fate for t in found.tried}
        assert found.effects == ()
        assert fates["motor_lag"] is Fate.UNTRIED  # no axis follows these commands
        assert fates["drag_torque"] is fate


def test_there_is_nothing_to_learn_from_snapshots(snapshots, crazyflie):
    """A process would learn that nothing comes of what was never sent."""
    words = "but for the mean nothing of torque_x, torque_y, torque_z follows the logged commands"
    with pytest.raises(FitError, match=words):
        wg.learn_gp(snapshots, crazyflie)
