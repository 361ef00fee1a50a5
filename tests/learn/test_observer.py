"""The observer's bandwidth: what a sinusoid leaves in closed form, and what noise and lag do to the choice."""

from dataclasses import replace

import numpy as np
import pytest

from wrenchgap import flight
from wrenchgap.learn.data.measurement import prepare
from wrenchgap.learn.identify import observer
from wrenchgap.learn.identify.observer import (
    OBSERVER,
    choose,
    fast_rates,
    longest_lag,
    missed,
)
from wrenchgap.learn.identify.samples import LAG, Stretch
from wrenchgap.plant import model_file
from wrenchgap.plant.model import make_effect
from wrenchgap.plant.simulation.simulate import simulate
from wrenchgap.plant.stability import Loop, loop_peak, sensitivity_peak
from wrenchgap.plant.trajectory import named

MODEL = model_file.load("tilt_hexarotor")
DT = 0.005
NONE = np.zeros(6)


@pytest.mark.parametrize("told", [0.0, 0.04, 0.06])
@pytest.mark.parametrize(("hz", "tau"), [(1.0, 0.0001), (2.0, 0.06), (4.0, 0.06)])
def test_what_is_left_of_a_sinusoid_is_that_of_the_closed_form(hz, tau, told):
    """|1 - H Q / (1 + Q (H - H_o))| at s = j w; |1 - k / (tau s^2 + s + k)| where nothing is told."""
    omega, k, time = 5.0, 2.0 * np.pi * hz, np.arange(8000) * DT
    d = np.sin(omega * time)[:, None] * [1.0, 2.0, 0.0]
    s = 1j * omega
    H, H_o, Q = 1.0 / (1.0 + tau * s), 1.0 / (1.0 + told * s), k / (s + k)
    left = abs(1.0 - H * Q / (1.0 + Q * (H - H_o))) / np.sqrt(2.0)
    assert told or left == pytest.approx(abs(1.0 - k / (tau * s**2 + s + k)) / np.sqrt(2.0))
    assert missed([(d, DT)], hz, tau, told) == pytest.approx([left, 2.0 * left, 0.0], rel=0.02)


def records(noise=1.0, disturbance=0.2):
    """A hover with a torque that comes and goes, and a gyroscope of so many times the usual noise."""
    sensors = replace(MODEL.sensors, gyro_density=noise * MODEL.sensors.gyro_density)
    pushed = lambda t: np.array([0, 0, 0, *(disturbance * np.sin([2.0 * t, 2.6 * t, 3.1 * t]))])  # noqa: E731
    rng = np.random.default_rng(3)
    log = simulate(MODEL, MODEL, named("hover"), 6.0, rng=rng, disturbance=pushed, sensors=sensors)
    return [prepare(s, MODEL.vehicle) for s in flight.uniform(log)]


@pytest.fixture(scope="module")
def quiet():
    return records()


def loop(lag):
    return Loop(MODEL.controller, MODEL.vehicle.body.inertia, lag, 0.01)


def chosen(some, lag, *, model=MODEL, delay=0.01, unseen=0.1, steepest=np.inf):
    return choose(some, model, NONE, replace(loop(lag), delay=delay), unseen, steepest)


@pytest.mark.parametrize("lag", [0.0, 0.02, 0.05, 0.1])
def test_whole_loop_keeps_its_margin(quiet, lag):
    """Whatever the log asks for: M_s <= 2, with the lag that was found told, and one that was not seen not told."""
    found = chosen(quiet, lag)
    assert found.peak <= OBSERVER.most_sensitive
    assert found.peak == pytest.approx(sensitivity_peak(replace(loop(lag or 0.1), delay=0.01), found.observer))
    assert (found.observer.lag, found.lag) == (lag, lag or 0.1)


def test_lag_that_nobody_has_seen_bounds_the_bandwidth_and_one_that_is_told_does_not(quiet, monkeypatch):
    # also one that removes hardly anything
    monkeypatch.setattr(observer, "OBSERVER", replace(observer.OBSERVER, worth=2.0))
    unseen, ruled_out, told = chosen(quiet, 0.0), chosen(quiet, 0.0, unseen=0.01), chosen(quiet, 0.1, delay=0.0)
    assert 0.0 < unseen.observer.hz < 0.3
    assert ruled_out.observer.hz > 1.0
    assert told.observer.hz > 1.0


def test_loop_that_has_no_margin_by_itself_gets_no_observer(quiet):
    found = chosen(quiet, 0.15, delay=0.05)
    assert found.observer.hz == 0.0
    assert found.peak > OBSERVER.most_sensitive


def test_steep_feed_forward_asks_for_a_quieter_loop(quiet, monkeypatch):
    """|T| |D| <= 1: where the slope may be wrong, an observer that raises |T| must be slower."""
    monkeypatch.setattr(observer, "OBSERVER", replace(observer.OBSERVER, worth=2.0))
    free, bound = chosen(quiet, 0.0, unseen=0.03), chosen(quiet, 0.0, unseen=0.03, steepest=1.4)
    at = replace(loop(0.03), delay=0.01)
    assert loop_peak(at, free.observer) > 1.4 >= loop_peak(at, bound.observer)
    assert 0.0 < bound.observer.hz < free.observer.hz
    assert chosen(quiet, 0.05, steepest=0.5).observer.hz == 0.0


def test_noise_asks_for_less(quiet):
    noisy = records(noise=40.0)
    assert np.all(fast_rates(noisy[0]) > 20.0 * fast_rates(quiet[0]))
    assert chosen(noisy, 0.05).observer.hz < 0.7 * chosen(quiet, 0.05).observer.hz


def test_where_nothing_is_to_be_removed_there_is_no_observer(quiet):
    """Nothing but noise is left where nothing was there: no observer helps. Of a slow torque one does."""
    none, some = chosen(records(disturbance=0.0), 0.05), chosen(quiet, 0.05)
    assert none.observer.hz == 0.0
    assert some.left < 0.3 < OBSERVER.worth < none.left
    assert some.observer.hz > 0.0
    assert none.peak < OBSERVER.most_sensitive  # and not for want of a margin


def test_named_effects_are_no_disturbance(quiet):
    known = MODEL.with_effects([make_effect(MODEL.vehicle, "com_offset", [0.0, 0.0, 0.0])])
    assert chosen(quiet, 0.05, model=known) == chosen(quiet, 0.05)


def stretch(lag, seconds=40.0, noise=0.01):
    """Commands of several sines, and what follows them behind a lag, as an independent closed form."""
    t = np.arange(0.0, seconds, 0.02)
    w = np.array([1.0, 2.3, 3.1, 4.7, 6.0, 9.0])
    command = np.sin(np.outer(t, w))
    made = np.sin(np.outer(t, w) - np.arctan(lag * w)) / np.sqrt(1.0 + (lag * w) ** 2)
    measured = made + noise * np.random.default_rng(4).normal(size=made.shape)
    return Stretch(0.02, command, command, measured)


def test_log_rules_out_lags_that_it_would_show():
    """Without a lag the shortest that is tried is ruled out; where the commands are not looked at nothing is."""
    looks, rows = np.ones(6, dtype=bool), np.array([3, 4, 5])
    assert longest_lag([stretch(0.0)], looks, rows) == LAG.taus[1]
    assert longest_lag([stretch(0.0, noise=1.0)], looks, rows) > LAG.taus[1]
    blind = looks & (np.arange(6) != 4)
    assert longest_lag([stretch(0.0)], blind, rows) == OBSERVER.unknown
