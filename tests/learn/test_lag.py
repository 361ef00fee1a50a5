"""A lag is a lag: the closed form of a first-order response, what a static line would make of it, and none in noise."""

import numpy as np
import pytest

from wrenchgap.learn.identify import guard
from wrenchgap.learn.identify.samples import Stretch, lagged, lags, shared_lag
from wrenchgap.learn.process.gp import FitSettings
from wrenchgap.plant.effects.lag import first_order

DT, TAU = 0.025, 0.06
TIME = np.arange(2400) * DT
FREQUENCIES = np.array([1.1, 2.3, 3.7, 5.2, 6.9, 8.3])  # rad/s
PHASES = np.linspace(0.0, 5.0, 6)
LOOKS = np.ones(6, dtype=bool)


def sinusoids(tau, seed=0, noise=0.01):
    """Six commands, three sinusoids each, and what comes out behind a lag by the closed form."""
    rng = np.random.default_rng(seed)
    command, out = np.zeros((len(TIME), 6)), np.zeros((len(TIME), 6))
    for k in range(6):
        for omega, phase in zip(rng.uniform(1.0, 9.0, 3), rng.uniform(0, 6, 3), strict=True):
            command[:, k] += np.sin(omega * TIME + phase)
            out[:, k] += np.sin(omega * TIME + phase - np.arctan(omega * tau)) / np.sqrt(1.0 + (omega * tau) ** 2)
    return command, out + noise * rng.normal(size=out.shape)


def test_lagged_signal_is_that_of_the_closed_form():
    command, out = sinusoids(TAU, noise=0.0)
    error = lagged(command, TAU, DT)[100:] - out[100:]
    assert np.abs(error).max() < 0.02 * np.abs(out).max()  # samples are linear in between


def test_lag_is_found_and_nothing_else_is_left():
    command, measured = sinusoids(TAU)
    found = lags([Stretch(DT, command, command, measured)], LOOKS)
    assert found == pytest.approx(np.full(6, TAU), abs=0.011)
    left = measured - lagged(command, found, DT)
    assert np.std(left[100:]) < 0.2 * np.std(measured - command)


def test_static_line_would_take_the_lag_for_a_slope():
    """-w^2 tau^2 / (1 + w^2 tau^2), the in-phase part; behind the lag there is none."""
    omega = 6.0
    command = np.sin(omega * TIME)[:, None]
    measured, _ = first_order(command, TAU, DT, None)
    rows = slice(400, 400 + round(2 * np.pi / omega / DT) * 8)
    slope = np.linalg.lstsq(command[rows], (measured - command)[rows], rcond=None)[0][0, 0]
    assert slope == pytest.approx(-((omega * TAU) ** 2) / (1.0 + (omega * TAU) ** 2), rel=0.05)
    late = lagged(command, TAU, DT)
    assert abs(np.linalg.lstsq(late[rows], (measured - late)[rows], rcond=None)[0][0, 0]) < 1e-12


def test_function_behind_a_lag_does_not_hide_it():
    command, out = sinusoids(TAU)
    measured = 0.8 * out + 0.1 * out**2
    assert lags([Stretch(DT, command, command, measured)], LOOKS) == pytest.approx(np.full(6, TAU), abs=0.011)


def test_vehicle_without_a_lag_gets_none():
    command, measured = sinusoids(0.0)
    assert lags([Stretch(DT, command, command, measured * [1, 1, 1, 0.8, 1.2, 1])], LOOKS).tolist() == [0.0] * 6
    noise = np.random.default_rng(3).normal(size=command.shape)
    assert lags([Stretch(DT, command, command, command + noise)], LOOKS).tolist() == [0.0] * 6


def test_axis_that_was_not_measured_has_none():
    command, measured = sinusoids(TAU)
    measured[:, 2] = np.nan
    assert lags([Stretch(DT, command, command, measured)], LOOKS)[2] == 0.0


def smooth_flight(tau, noise=0.002):
    """Torques that cancel a function of the force, as in slow closed loop, behind the vehicle's lag.

    The force is answered late; of the torque little is measured: what turns the vehicle, and what the lag leaves.
    """
    command, _ = sinusoids(0.0, noise=0.0)
    turning = 0.1 * command[:, 3:]
    mismatch = 0.3 * command[:, :3] + 0.1 * command[:, :3] ** 2
    command[:, 3:] = turning - mismatch
    made = command + np.hstack((np.zeros_like(mismatch), mismatch))
    measured = first_order(made, tau, DT, None)[0] + noise * np.random.default_rng(4).normal(size=made.shape)
    return [Stretch(DT, command, command, measured)]


BLIND = np.array([True, True, True, False, False, False])


def test_lag_is_shared_by_outputs_that_the_process_is_blind_to():
    """Of those one is found together, from the little that is measured; and none where there is none."""
    assert shared_lag(smooth_flight(TAU), BLIND, np.array([3, 4, 5])) == pytest.approx(TAU, abs=0.021)
    assert shared_lag(smooth_flight(0.0), BLIND, np.array([3, 4, 5])) == 0.0


@pytest.mark.parametrize("tau", [0.0, TAU])
def test_blind_outputs_have_the_lag_of_the_axes_that_show_it(tau, monkeypatch):
    """Commands lagged, expectations not: a mismatch of the lag's making, which is what this must not be."""
    parts, torques = smooth_flight(tau), ("torque_x", "torque_y", "torque_z")
    monkeypatch.setattr(guard, "stretches", lambda records, base: parts)
    found = guard._lags([], None, torques, FitSettings(blind=torques))
    assert found[3:] == pytest.approx(np.full(3, found.max()))
    assert found[:3] == pytest.approx(np.full(3, tau), abs=0.011)
    left = parts[0].measured - lagged(parts[0].expected, found, DT)
    behind = lagged(parts[0].commanded, found.max(), DT)[:, :3]
    features = np.column_stack([np.ones(len(behind)), behind, behind**2])
    error = left[:, 3:] - features @ np.linalg.lstsq(features, left[:, 3:], rcond=None)[0]
    assert error[100:].std() < 0.02
    partly = guard._lags([], None, torques, FitSettings(blind=("torque_y",)))
    assert partly[4] == partly.max()
