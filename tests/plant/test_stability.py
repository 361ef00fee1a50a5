"""The stability margin: peaks of |T| in closed form, loops at the margin by their characteristic roots."""

from dataclasses import replace

import numpy as np
import pytest

from wrenchgap.plant.controller import ControllerGains
from wrenchgap.plant.mismatch import LinearMismatch
from wrenchgap.plant.stability import FREQUENCIES, Loop, loop_peak, margin, of_model, sensitivity_peak

AXIS = ("torque_x",)
TORQUES = ("torque_x", "torque_y", "torque_z")
J = np.diag([0.1, 0.2, 0.4])


def gains(zeta, omega):
    return ControllerGains(zeta_attitude=(zeta,) * 3, omega_attitude=(omega,) * 3)


def slope(*values):
    found = np.zeros((1, len(values), 6))
    found[0, range(len(values)), range(3, 3 + len(values))] = values
    return found


@pytest.mark.parametrize(("zeta", "omega"), [(0.3, 2.0), (0.7, 3.5), (1.3, 9.0)])
def test_peak_without_lag_is_that_of_the_closed_form(zeta, omega):
    """|T|^2 = (1 + r^2 u) / ((1 - u)^2 + r^2 u) with r = 2 zeta, u = (w / omega)^2; largest at u = (sqrt(1 + 2 r^2) - 1) / r^2."""  # noqa: E501
    r2 = 4.0 * zeta**2
    u = (np.sqrt(1.0 + 2.0 * r2) - 1.0) / r2
    assert loop_peak(gains(zeta, omega)) == pytest.approx(np.sqrt((1 + r2 * u) / ((1 - u) ** 2 + r2 * u)), rel=1e-4)


@pytest.mark.parametrize("s", [0.2, 0.5, 0.9])
def test_scalar_margin_is_known(s):
    """A = 1 - s, D = A^-1 - 1 = s / (1 - s)."""
    loop = Loop(gains(0.7, 3.5), J)
    assert margin(slope(-s), AXIS, loop).least == pytest.approx((1.0 - s) / s / loop_peak(loop.gains), rel=1e-9)


def roots(zeta, omega, lag, delay, gain):
    """Of 1 + gain L, the delay by its third-order Pade approximant."""
    d = delay
    top, bottom = np.poly1d([-(d**3), 12 * d**2, -60 * d, 120]), np.poly1d([d**3, 12 * d**2, 60 * d, 120])
    plant = np.poly1d([1, 0, 0]) * np.poly1d([lag, 1])
    return (plant * bottom + gain * np.poly1d([2 * zeta * omega, omega**2]) * top).roots


@pytest.mark.parametrize(("lag", "delay"), [(0.0, 0.05), (0.06, 0.01), (0.06, 0.03), (0.1, 0.02)])
def test_loop_is_stable_up_to_its_margin_and_not_everywhere_beyond(lag, delay):
    """A slope that is not there multiplies the loop by A^-1. Stable at a margin of 1, not at 1/15."""
    zeta, omega = 1.3, 3.5
    loop = Loop(gains(zeta, omega), J, lag, delay)
    peak = loop_peak(loop.gains, lag, delay)
    for times, stable in ((0.5, True), (1.0, True), (15.0, False)):
        change = times / peak
        s = change / (1.0 + change)
        assert margin(slope(-s), AXIS, loop).least == pytest.approx(1.0 / times)
        assert (roots(zeta, omega, lag, delay, 1.0 + change).real < 0).all() == stable


def test_no_slope_has_no_limit_and_a_singular_one_no_margin():
    loop = Loop(gains(0.7, 3.5), J)
    assert margin(slope(0.0, 0.0, 0.0), TORQUES, loop).least > 1e6
    assert margin(slope(0.0, -1.0, 0.0), TORQUES, loop).least == 0.0


def test_margin_does_not_depend_on_the_unit_of_torque():
    full = np.zeros((1, 3, 6))
    full[0, :, 3:] = [[-0.2, 0.3, 0.0], [0.05, -0.1, 0.1], [0.0, 0.02, -0.3]]
    loop = Loop(gains(0.7, 3.5), J)
    scaled = replace(loop, inertia=1e-4 * J)
    assert margin(full, TORQUES, loop).least == pytest.approx(margin(full, TORQUES, scaled).least)


def test_delay_costs_margin():
    at = [margin(slope(-0.3), AXIS, Loop(gains(1.3, 3.5), J, 0.05, d)).least for d in (0.0, 0.01, 0.025)]
    assert at[0] > at[1] > at[2]


def test_past_of_the_command_counts_by_its_own_loop():
    """W_k = W_des + c W_(k-1) at high frequencies: stable for |c| < 1."""
    loop, past = Loop(gains(0.7, 3.5), J), np.zeros((1, 1, 6))
    past[0, 0, 3] = -0.8
    assert margin(slope(0.0), AXIS, loop, past).least == pytest.approx(1.0 / 0.8)


def test_model_is_looked_at_along_its_inputs():
    line = LinearMismatch(AXIS, np.zeros(1), slope(-0.5)[0], np.ones(1))
    found = of_model(line, np.zeros((7, 6)), Loop(gains(0.7, 3.5), J))
    assert len(found.along) == 7
    assert found.least == pytest.approx(1.0 / loop_peak(gains(0.7, 3.5)))


def test_observer_multiplies_the_sensitivity_by_its_high_pass():
    """Without lag and delay S = s^2 / (s^2 + 2 zeta w s + w^2) s / (s + k): the peak is that of the product."""
    zeta, w, hz = 0.4, 3.5, 1.0
    s, k = 1j * FREQUENCIES, 2.0 * np.pi * hz
    for high_pass, asked in ((1.0, 0.0), (s / (s + k), hz)):
        expected = np.abs(s**2 / (s**2 + 2 * zeta * w * s + w**2) * high_pass).max()
        assert sensitivity_peak(Loop(gains(zeta, w), J), asked) == pytest.approx(expected, rel=1e-9)


def test_lag_makes_an_observer_ring():
    """Behind a lag the peak grows with the bandwidth; an observer of 1 Hz that is quiet at 10 ms is not at 80 ms."""
    peaks = [sensitivity_peak(Loop(gains(1.3, 3.5), J, 0.08, 0.0075), hz) for hz in (0.0, 0.5, 1.0, 2.0)]
    assert peaks == sorted(peaks)
    assert sensitivity_peak(Loop(gains(1.3, 3.5), J, 0.01), 1.0) < 1.3 < 2.0 < peaks[2]
